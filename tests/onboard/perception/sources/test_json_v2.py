"""Detection frames as JSON, version 2."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import (
    MovingFrame,
    is_complete,
    is_mover,
    is_whole,
    kind_of,
    turned_velocity_mps,
)
from onboard.perception.sources.json_v1 import JsonV1Source, parse_frame

PERSON = {
    "id": "7", "center_m": [14.2, 0.6], "size_m": [0.6, 0.6], "yaw_deg": 0.0,
    "uncertainty_m": 0.1, "down_m": [-1.9, 0.0], "motion": "moving", "class": "person",
    "box_whole": True, "velocity_mps": [0.9, -0.4, 0.0], "velocity_uncertainty_mps": 0.8,
}  # fmt: skip
FRAME = {
    "version": 2, "source": "front", "sequence": 812, "stamp_unix_s": 1790000000.25,
    "frame": "local_ned", "range_m": 12.0, "field_of_view_deg": 120.0, "frame_complete": True,
    "obstacles": [PERSON],
}  # fmt: skip


def payload(change: dict[str, Any] | None = None, **seen: Any) -> bytes:
    return json.dumps({**FRAME, "obstacles": [{**PERSON, **seen}], **(change or {})}).encode()


def test_a_frame_of_version_2_says_what_moves() -> None:
    frame = parse_frame(payload())
    (person,) = frame.obstacles
    assert isinstance(frame, MovingFrame)
    assert is_mover(person)
    assert is_whole(person)
    assert is_complete(frame)
    assert kind_of(person) == "person"
    assert turned_velocity_mps(person, 0.0) == (0.9, -0.4)
    assert turned_velocity_mps(person, math.pi / 2) == pytest.approx((0.4, 0.9))


def test_readers_of_version_1_reject_it() -> None:
    with pytest.raises(MalformedPayloadError, match="version"):
        parse(payload(), DetectionFrame)


def test_what_is_not_stated_counts_as_moving_in_part_and_incomplete() -> None:
    bare = {key: PERSON[key] for key in ("id", "center_m", "size_m", "yaw_deg", "uncertainty_m")}
    frame = parse_frame(
        json.dumps({**FRAME, "obstacles": [bare], "frame_complete": False}).encode()
    )
    (seen,) = frame.obstacles
    assert is_mover(seen)
    assert not is_whole(seen)
    assert kind_of(seen) == "unknown"
    assert turned_velocity_mps(seen, 0.0) is None
    assert not is_complete(frame)
    without = {key: value for key, value in FRAME.items() if key != "frame_complete"}
    assert not is_complete(parse_frame(json.dumps(without).encode()))


def test_a_static_claim_is_one() -> None:
    assert not is_mover(parse_frame(payload(motion="static")).obstacles[0])


def test_version_1_says_nothing_of_motion() -> None:
    frame = parse_frame(payload({"version": 1}))
    assert type(frame) is DetectionFrame
    assert is_mover(frame.obstacles[0])
    assert is_complete(frame)
    assert is_whole(frame.obstacles[0])


@pytest.mark.parametrize(
    ("change", "seen", "names"),
    [
        ({}, {"motion": "slow"}, "motion"),
        ({}, {"class": ""}, "class"),
        ({}, {"velocity_mps": [1.0]}, "velocity_mps"),
        ({}, {"velocity_mps": [1.0, 1e9]}, "velocity_mps"),
        ({}, {"velocity_uncertainty_mps": -1.0}, "velocity_uncertainty_mps"),
        ({}, {"box_whole": 1}, "box_whole"),
        ({}, {"partial": True}, "obstacles.0"),
        ({"frame_complete": "yes"}, {}, "frame_complete"),
        ({"version": 3}, {}, "version"),
        ({"version": "2"}, {}, "version"),
        ({"version": 2.5}, {}, "version"),
        ({"version": None}, {}, "version"),
    ],
)
def test_malformed_frames_are_counted_and_dropped(
    change: dict[str, Any], seen: dict[str, Any], names: str
) -> None:
    with pytest.raises(MalformedPayloadError) as raised:
        parse_frame(payload(change, **seen))
    if change.get("version") != "2":
        assert names in str(raised.value)
    source = JsonV1Source()
    assert source.read(payload(change, **seen), 0.0) == ()
    assert source.malformed == 1


@pytest.mark.parametrize("broken", [b"", b'"version"', b'{"version": 2', b"\xff\xfe", b"[2]"])
def test_what_is_not_json_is_dropped(broken: bytes) -> None:
    source = JsonV1Source()
    assert source.read(broken, 0.0) == ()
    assert source.malformed == 1
