"""Poses of frames in each other, over chains of static transforms."""

import math

import numpy as np
import pytest

from onboard.perception.ros2 import transform_tree
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import decode_transforms
from onboard.perception.ros2.transform_tree import TransformTree
from tests.onboard.perception.ros2.encoding import Link, transforms

LEVEL = (0.0, 0.0, 0.0, 1.0)
HALF = math.sqrt(0.5)
TO_THE_LEFT = (0.0, 0.0, HALF, HALF)  # 90° about z


def tree(*links: Link) -> TransformTree:
    found = TransformTree()
    for link in links:  # as from as many publishers
        found.add(decode_transforms(transforms(link)))
    return found


def test_a_chain_is_multiplied_from_the_base_to_the_sensor() -> None:
    frames = tree(
        ("base_link", "mast", (1.0, 0.0, 0.5), TO_THE_LEFT),
        ("mast", "laser", (0.2, 0.0, 0.0), LEVEL),
    )
    pose = frames.pose("laser", "base_link")
    assert pose is not None
    assert pose[:3, 3] == pytest.approx([1.0, 0.2, 0.5])  # 0.2 m ahead of a mast that looks left
    assert pose[:3, :3] @ (1.0, 0.0, 0.0) == pytest.approx([0.0, 1.0, 0.0])
    assert frames.root_of("laser") == "base_link"
    assert frames.frames == {"base_link", "mast", "laser"}


def test_a_frame_beside_the_base_is_found_over_what_both_hang_on() -> None:
    frames = tree(
        ("footprint", "base_link", (0.0, 0.0, 0.3), LEVEL),
        ("footprint", "laser", (0.1, 0.0, 0.5), LEVEL),
    )
    pose = frames.pose("laser", "base_link")
    assert pose is not None
    assert pose[:3, 3] == pytest.approx([0.1, 0.0, 0.2])
    above = frames.pose("footprint", "base_link")
    assert above is not None
    assert above[:3, 3] == pytest.approx([0.0, 0.0, -0.3])


def test_without_a_way_nothing_is_known() -> None:
    frames = tree(("base_link", "camera", (0.0, 0.0, 0.0), LEVEL), ("x", "laser", (0, 0, 0), LEVEL))
    assert frames.pose("laser", "base_link") is None
    assert frames.pose("nothing", "base_link") is None
    itself = frames.pose("base_link", "base_link")
    assert itself is not None
    assert np.array_equal(itself, np.eye(4))


def test_a_circle_ends() -> None:
    frames = tree(("a", "b", (0.0, 0.0, 0.0), LEVEL), ("b", "a", (0.0, 0.0, 0.0), LEVEL))
    assert frames.pose("a", "base_link") is None
    assert frames.root_of("a") in {"a", "b"}


def test_the_number_of_frames_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transform_tree, "FRAMES_MAX", 2)
    frames = tree(("base_link", "a", (0, 0, 0), LEVEL), ("base_link", "b", (0, 0, 0), LEVEL))
    with pytest.raises(DecodeError, match="too many frames"):
        frames.add(decode_transforms(transforms(("base_link", "c", (0, 0, 0), LEVEL))))
    frames.add(decode_transforms(transforms(("base_link", "a", (1, 0, 0), LEVEL))))  # known
    pose = frames.pose("a", "base_link")
    assert pose is not None
    assert pose[0, 3] == 1.0
