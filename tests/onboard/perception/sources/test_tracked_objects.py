"""Autoware's TrackedObjects as reports: movers besides those that sensors see."""

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.sensor_sources import TrackedObjectsSource
from onboard.perception.movers.moving_detection import (
    MovingDetection,
    ReportsFrame,
    is_complete,
    is_mover,
    is_whole,
)
from onboard.perception.ros2.tracked_objects import decode_tracked_objects
from onboard.perception.sources.tracked_objects import TrackedObjectsInput
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import CdrWriter, stamp_of
from tests.onboard.perception.ros2.recorded import ORDERS, encoded
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, pose_at, poses_of

TYPE = "autoware_perception_msgs/TrackedObjects"
KEYS: dict[str, Any] = {
    "kind": "tracked_objects", "name": "tracker", "topic": "/objects", "range_m": 40.0,
    "uncertainty_m": 0.2, "objects_frame": "local_enu", "labels": {"pedestrian": "person"},
}  # fmt: skip


def tracker(pose: Pose | None = None, **keys: Any) -> TrackedObjectsInput:
    config = TrackedObjectsSource.model_validate(KEYS | keys)
    return TrackedObjectsInput(config, poses_of(pose or pose_at()))


def message(
    *places: tuple[float, float],
    labels: tuple[int, ...] = (7,),
    velocity_mps: tuple[float, float] = (1.5, 0.0),
    orientation: int = 2,
    dimensions_m: tuple[float, float, float] = (0.6, 0.8, 1.8),
    kind: int = 0,
    points: tuple[tuple[float, float], ...] = (),
    variance: float = 0.0,
    name: int = 1,
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
) -> bytes:
    writer = CdrWriter().header(stamp_of(EPOCH_UNIX_S), "map").add("I", len(places))
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = variance
    for x_m, y_m in places:
        writer.raw(bytes([name] * 16)).add("fI", 0.9, len(labels))
        for label in labels:
            writer.add("Bf", label, 0.5)
        writer.add("d" * 7, x_m, y_m, 1.0, *rotation).add("d" * 36, *covariance)
        writer.add("d" * 6, *velocity_mps, 0.0, 0.0, 0.0, 0.0).add("d" * 36, *covariance)
        writer.add("d" * 42, *[0.0] * 42)
        writer.add("BBBI", orientation, 0, kind, len(points))
        for point in points:
            writer.add("fff", *point, 0.0)
        writer.add("ddd", *dimensions_m)
    return writer.payload()


def read(payload: bytes, pose: Pose | None = None, **keys: Any) -> ReportsFrame:
    (frame,) = tracker(pose, **keys).read(payload, 0.0)
    assert isinstance(frame, ReportsFrame)
    return frame


def only(payload: bytes, pose: Pose | None = None, **keys: Any) -> MovingDetection:
    (seen,) = read(payload, pose, **keys).obstacles
    return seen


@pytest.mark.parametrize("order", ORDERS)
def test_what_another_implementation_encodes_is_read(order: str) -> None:
    (payload,) = encoded(TYPE, order)
    frame = read(payload)
    assert frame.stamp_unix_s == EPOCH_UNIX_S + 0.25
    (seen,) = frame.obstacles
    # 3 m east, 6 m north; it walks north at 1.5 m/s.
    assert seen.center_m == pytest.approx((6.0, 3.0))
    assert seen.size_m == (0.6, 0.8)
    assert seen.velocity_mps == pytest.approx((1.5, 0.0), abs=1e-9)
    assert (seen.kind, seen.id) == ("person", bytes(range(16)).hex())


def test_a_tracker_adds_movers_and_shows_nothing() -> None:
    frame = read(message((3.0, 6.0)))
    assert not is_complete(frame)
    assert frame.free_range_m is None
    assert is_mover(frame.obstacles[0])
    assert not is_whole(frame.obstacles[0])
    assert is_whole(read(message((3.0, 6.0)), boxes_whole=True).obstacles[0])


def test_in_the_body_it_is_forward_and_left() -> None:
    pose = pose_at(position_ned_m=(10.0, 0.0, -4.0), yaw_deg=90.0)
    seen = only(message((5.0, 2.0)), pose, objects_frame="body")
    # The nose points east, and left of it is north.
    assert seen.center_m == pytest.approx((12.0, 5.0))
    assert seen.velocity_mps == pytest.approx((0.0, 1.5), abs=1e-9)


@pytest.mark.parametrize(
    ("labels", "kind"),
    [((7,), "person"), ((1,), "unknown"), ((7, 1), "unknown"), ((), "unknown"), ((99,), "unknown")],
)
def test_only_what_is_surely_of_a_class_is_of_it(labels: tuple[int, ...], kind: str) -> None:
    assert only(message((3.0, 6.0), labels=labels)).kind == kind


def test_standard_deviations_count_only_as_declared() -> None:
    payload = message((3.0, 6.0), variance=0.02)
    assert only(payload).uncertainty_m == 0.2
    assert only(payload).velocity_uncertainty_mps is None
    declared = only(payload, sigmas=3.0)
    assert declared.uncertainty_m == pytest.approx(0.2 + 3.0 * math.sqrt(0.04))
    assert declared.velocity_uncertainty_mps == pytest.approx(3.0 * math.sqrt(0.04))


def test_without_axes_a_box_is_as_wide_as_it_may_be_and_a_velocity_has_no_direction() -> None:
    seen = only(message((3.0, 6.0), orientation=0))
    assert seen.size_m == pytest.approx((1.0, 1.0))
    assert seen.velocity_mps is None
    assert only(message((3.0, 6.0), orientation=1)).velocity_mps is None


def test_a_polygon_is_enclosed_around_its_centre() -> None:
    seen = only(message((3.0, 6.0), kind=2, points=((1.0, 0.2), (-0.5, -0.4))))
    assert seen.size_m == pytest.approx((2.0, 0.8))


def test_names_are_told_apart_and_what_is_far_is_left_out() -> None:
    frame = read(message((3.0, 6.0), (3.0, 9.0), (300.0, 0.0)))
    assert [each.id for each in frame.obstacles] == ["01" * 16, "01" * 16 + "-2"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"velocity_mps": (math.nan, 0.0)}, "velocity"),
        ({"dimensions_m": (-1.0, 1.0, 1.0)}, "dimensions"),
        ({"variance": -1.0}, "covariance"),
        ({"variance": math.inf}, "covariance"),
        ({"kind": 2, "points": ((math.nan, 0.0),)}, "dimensions"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], reason: str) -> None:
    source = tracker()
    assert not source.read(message((3.0, 6.0), **changes), 0.0)
    assert source.refused == {reason: 1}


@given(st.data())
def test_no_damaged_message_raises(data: st.DataObject) -> None:
    payload = bytearray(message((3.0, 6.0), points=((0.1, 0.1),)))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(payload) // 4 - 1)) * 4
        word = data.draw(st.sampled_from((0, 1, 0xFFFF, 0x7FC00000, 0xFF800000, 0xFFFFFFFF)))
        payload[at : at + 4] = struct.pack("<I", word)
    source = tracker(sigmas=2.0)
    found = source.read(bytes(payload[: data.draw(st.integers(0, len(payload)))]), 0.0)
    assert bool(found) != bool(source.malformed)


def test_a_message_may_name_no_object() -> None:
    assert decode_tracked_objects(message()).objects == ()
    assert read(message()).obstacles == ()


def test_a_box_that_lies_on_its_side_covers_its_height() -> None:
    half = math.sqrt(0.5)
    (frame,) = tracker(boxes_whole=True).read(
        message((0.0, 5.0), dimensions_m=(0.4, 0.6, 3.0), rotation=(half, 0.0, 0.0, half)), 0.0
    )
    assert sorted(frame.obstacles[0].size_m) == pytest.approx([0.4, 3.0])


def test_an_object_that_may_be_within_range_counts() -> None:
    assert read(message((0.0, 42.0), variance=2.0), sigmas=3.0).obstacles
    assert not read(message((0.0, 42.0), variance=0.0), sigmas=3.0).obstacles
