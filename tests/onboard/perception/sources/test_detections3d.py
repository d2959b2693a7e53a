"""Detection3DArray as frames: names, footprints, heights, and that silence is not free space."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from onboard.files.sensor_sources import DetectionsSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import (
    MovingDetection,
    ReturnsFrame,
    is_complete,
)
from onboard.perception.sources.detections3d import DetectionsInput, rotation_of
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import CdrWriter, stamp_of
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    LOW_SENSORS,
    free_at,
    pose_at,
    poses_of,
)

# Name, centre, size: forward, left, up; yaw, counter-clockwise.
Seen = tuple[str, tuple[float, float, float], tuple[float, float, float], float]
TREE: Seen = ("7", (6.0, 1.0, 0.0), (0.4, 0.8, 4.0), 0.0)


def message(seen: Sequence[Seen], rotation: Sequence[float] | None = None) -> bytes:
    writer = CdrWriter().header(stamp_of(EPOCH_UNIX_S), "camera").add("I", len(seen))
    for name, center_m, size_m, yaw_rad in seen:
        writer.header(stamp_of(EPOCH_UNIX_S), "camera").add("I", 0)
        turn = rotation or (0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0))
        writer.add("dddddddddd", *center_m, *turn, *size_m).text(name)
    return writer.payload()


def detector(pose: Pose | None = None, **keys: Any) -> DetectionsInput:
    stated: dict[str, Any] = {
        "kind": "detection3d",
        "name": "eye",
        "topic": "d",
        "view_deg": [80.0, 60.0],
    }
    stated |= {"range_m": 10.0, "uncertainty_m": 0.1}
    config = DetectionsSource.model_validate(stated | keys)
    return DetectionsInput(config, poses_of(pose or pose_at()))


def read(*seen: Seen, pose: Pose | None = None, **keys: Any) -> DetectionFrame:
    (frame,) = detector(pose, **keys).read(message(seen), 0.0)
    return frame


def test_a_box_comes_with_its_name_from_left_to_right_handed_axes() -> None:
    (box,) = read(TREE).obstacles
    assert box.id == "id-7"
    assert box.center_m == pytest.approx((6.0, -1.0))
    turned = abs(round(box.yaw_deg / 90.0)) % 2
    assert box.size_m == pytest.approx((0.8, 0.4) if turned else (0.4, 0.8))
    assert box.uncertainty_m == 0.1


def test_a_turned_box_keeps_its_corners() -> None:
    (box,) = read(("", (5.0, 0.0, 0.0), (2.0, 0.5, 1.0), math.radians(30.0))).obstacles
    yaw_deg = box.yaw_deg if box.size_m[0] > 1.0 else box.yaw_deg + 90.0
    assert yaw_deg % 180.0 == pytest.approx(150.0)  # clockwise
    assert sorted(box.size_m) == pytest.approx([0.5, 2.0])


def test_what_is_not_reported_is_not_free_unless_declared() -> None:
    frame = read()
    assert frame.obstacles == ()
    assert set(frame.free_range_m or ()) == {0.0}
    frame = read(no_return_is_free_to_m=8.0)
    assert free_at(frame, 0.0) == 8.0
    assert 77.0 <= frame.field_of_view_deg <= 80.0


def test_boxes_above_and_below_the_vehicle_are_left_out() -> None:
    high, low = (
        ("a", (5.0, 0.0, 3.0), (1.0, 1.0, 1.0), 0.0),
        ("b", (5.0, 0.0, -1.4), (1, 1, 1), 0.0),
    )
    assert [box.id for box in read(high, low).obstacles] == ["id-b"]


@pytest.mark.parametrize(("up_m", "z_m", "margin_m"), LOW_SENSORS)
def test_a_low_sensor_near_the_ground_still_sees_what_stands_there(
    up_m: float, z_m: float, margin_m: float
) -> None:
    keys: dict[str, Any] = {"mounting": {"z_m": z_m}, "no_return_is_free_to_m": 8.0}
    seen = ("a", (3.0, 0.0, 0.0), (0.5, 0.5, 0.04), 0.0)
    pose = pose_at(position_ned_m=(0.0, 0.0, -up_m))
    assert len(read(seen, pose=pose, ground_margin_m=margin_m, **keys).obstacles) == 1
    outside = read(seen, pose=pose, height_band_m=(1.0, z_m - 0.05), **keys)
    assert (set(outside.free_range_m or ()), outside.range_m) == ({0.0}, 0.01)


def test_boxes_without_a_name_are_named_by_where_they_are() -> None:
    source = detector()
    one, other = ("", (5.0, 0.0, 0.0), (1, 1, 1), 0.0), ("", (5.0, 3.0, 0.0), (1, 1, 1), 0.0)
    (first,) = source.read(message([one, other]), 0.0)
    (second,) = source.read(message([other, one]), 0.0)
    assert [b.id for b in first.obstacles] == [b.id for b in second.obstacles][::-1]


def test_a_name_that_comes_twice_names_only_the_first() -> None:
    twin = ("7", (6.0, -3.0, 0.0), (0.4, 0.8, 4.0), 0.0)
    names = [box.id for box in read(TREE, twin).obstacles]
    assert names[0] == "id-7"
    assert len(set(names)) == 2


def test_it_is_levelled_and_mounted() -> None:
    # A camera that looks down by 20 degrees sees what is at its height above its axis.
    down = Rotation.from_euler("y", -20.0, degrees=True).as_matrix()
    center = tuple((down @ (6.0, 0.0, 0.0)).tolist())
    pose, seen = pose_at(pitch_deg=5.0), ("x", center, (0.5, 0.5, 3.0), 0.0)
    (box,) = read(seen, pose=pose, mounting={"pitch_deg": -25.0}).obstacles
    assert box.center_m == pytest.approx((6.0, 0.0), abs=0.05)


def test_numbers_out_of_bounds_are_refused() -> None:
    source = detector()
    huge = ("a", (5.0, 0.0, 0.0), (1e5, 1.0, 1.0), 0.0)
    assert list(source.read(message([huge]), 0.0)) == []
    assert source.refused == {"numbers out of bounds": 1}


@pytest.mark.parametrize("seed", range(3))
def test_rotations_of_quaternions(seed: int) -> None:
    turn = Rotation.random(random_state=seed)
    x, y, z, w = turn.as_quat()
    np.testing.assert_allclose(rotation_of((x, y, z, w)), turn.as_matrix(), atol=1e-12)


def test_a_box_that_lies_on_its_side_has_the_footprint_of_that() -> None:
    lying = Rotation.from_euler("y", 90.0, degrees=True).as_quat().tolist()
    payload = message([("log", (5.0, 0.0, 0.0), (0.4, 0.4, 4.0), 0.0)], lying)
    ((box,),) = (frame.obstacles for frame in detector().read(payload, 0.0))
    assert sorted(box.size_m) == pytest.approx([0.4, 4.0])


def test_boxes_carry_their_heights_and_frames_what_they_show_of_them() -> None:
    frame = read(TREE, height_band_m=[3.0, 4.0])
    (box,) = frame.obstacles
    assert box.down_m == pytest.approx((-2.0, 2.0))
    assert box.down_uncertainty_m == 0.1
    assert frame.vertical_field_of_view_deg == pytest.approx((30.0, 30.0))
    assert frame.reported_height_m is not None
    assert frame.reported_height_m[0] == 3.0
    assert frame.reported_height_m[1] <= 4.0


def test_heights_are_those_of_the_levelled_body() -> None:
    pose = pose_at()._replace(pitch_rad=math.radians(5.0))
    (box,) = read(("7", (6.0, 0.0, 0.0), (0.01, 0.01, 0.01), 0.0), pose=pose).obstacles
    assert box.down_m is not None
    top_m, bottom_m = box.down_m
    assert top_m is not None
    assert bottom_m is not None
    assert (top_m + bottom_m) / 2.0 == pytest.approx(-6.0 * math.sin(math.radians(5.0)))


def test_a_sensor_that_is_mounted_at_an_angle_shows_less_either_way() -> None:
    frame = read(TREE, mounting={"pitch_deg": -20.0})
    assert frame.vertical_field_of_view_deg == pytest.approx((10.0, 10.0))


@pytest.mark.parametrize(
    ("labels", "kind"),
    [
        ((), "unknown"),
        (("human",), "person"),
        (("human", "pedestrian"), "person"),
        (("human", "dog"), "unknown"),
        (("dog",), "unknown"),
    ],
)
def test_a_label_is_a_class_only_where_all_that_it_may_be_is(
    labels: tuple[str, ...], kind: str
) -> None:
    writer = CdrWriter().header(stamp_of(EPOCH_UNIX_S), "camera").add("I", 1)
    writer.header(stamp_of(EPOCH_UNIX_S), "camera").add("I", len(labels))
    for label in labels:
        writer.text(label).add("d", 0.5).add("d" * 43, *[0.0] * 43)
    writer.add("d" * 10, 6.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.4, 0.8, 1.8).text("7")
    for whole in (False, True):
        source = detector(labels={"human": "person", "pedestrian": "person"}, boxes_whole=whole)
        (frame,) = source.read(writer.payload(), 0.0)
        (seen,) = frame.obstacles
        assert isinstance(seen, MovingDetection)
        assert (seen.kind, seen.motion, seen.box_whole) == (kind, "unknown", whole)
        assert is_complete(frame)
        assert not isinstance(frame, ReturnsFrame)  # it has identities
