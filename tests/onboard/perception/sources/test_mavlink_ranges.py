"""OBSTACLE_DISTANCE and DISTANCE_SENSOR as frames, as the MAVLink specification words them."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.sensor_sources import DistanceSensorSource, ObstacleDistanceSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.sources.mavlink_ranges import DistanceSensorInput, ObstacleDistanceInput
from onboard.vehicle_state import Pose
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, free_at, pose_at, poses_of

NOW_UNIX_S = EPOCH_UNIX_S + 0.2
BODY, NORTH = mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_FRAME_GLOBAL


def framed(message: Any, component: int = 195) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, component)))


def obstacle_distance(distances_cm: dict[int, int], others_cm: int = 1001, **keys: Any) -> bytes:
    values: dict[str, Any] = {
        "increment": 5,
        "min_distance": 20,
        "max_distance": 1000,
        "increment_f": 0.0,
    }
    values |= {"angle_offset": 0.0, "frame": BODY, "time_usec": 0, "sensor_type": 0} | keys
    distances = [distances_cm.get(index, others_cm) for index in range(72)]
    component = values.pop("component", 195)
    message = mavlink.MAVLink_obstacle_distance_message(distances=distances, **values)
    return framed(message, component)


def sectors(pose: Pose | None = None, **keys: Any) -> ObstacleDistanceInput:
    stated = {"kind": "obstacle_distance", "name": "prox", "range_m": 10.0, "uncertainty_m": 0.2}
    config = ObstacleDistanceSource.model_validate(stated | keys)
    return ObstacleDistanceInput(config, poses_of(pose or pose_at()))


def read(payload: bytes, pose: Pose | None = None, **keys: Any) -> DetectionFrame:
    (frame,) = sectors(pose, **keys).read(payload, NOW_UNIX_S)
    return frame


def test_a_sector_to_the_right() -> None:
    frame = read(obstacle_distance({18: 400}), no_return_is_free_to_m=9.0)
    (box,) = frame.obstacles
    assert box.center_m == pytest.approx((0.0, 4.0), abs=0.05)
    assert box.size_m[0] >= 2.0 * 4.0 * math.sin(math.radians(2.5))
    assert free_at(frame, 90.0) == 4.0
    assert free_at(frame, 0.0) == 9.0
    assert frame.field_of_view_deg == 360.0


def test_it_counts_as_measured_before_it_arrived() -> None:
    frame = read(obstacle_distance({}), latency_s=0.15)
    assert frame.stamp_unix_s == pytest.approx(NOW_UNIX_S - 0.15)


def test_one_beyond_the_greatest_distance_is_nothing_there() -> None:
    assert free_at(read(obstacle_distance({}, 1001)), 0.0) == 0.0
    assert free_at(read(obstacle_distance({}, 1001), no_return_is_free_to_m=8.0), 0.0) == 8.0
    (wall, *_) = read(obstacle_distance({}, 900)).obstacles  # and 9 m is a wall
    assert math.hypot(*wall.center_m) == pytest.approx(9.0, abs=0.5)


def test_what_is_unknown_is_out_of_view() -> None:
    unknown = dict.fromkeys(range(20, 53), 65535)
    frame = read(obstacle_distance(unknown), no_return_is_free_to_m=8.0)
    assert frame.field_of_view_deg == pytest.approx(2 * 97.5, abs=1.6)


def test_below_the_least_distance_nothing_is_known() -> None:
    frame = read(obstacle_distance({0: 5}), no_return_is_free_to_m=8.0)
    assert frame.obstacles == ()
    assert free_at(frame, 1.0) == 0.0
    assert free_at(frame, 10.0) == 8.0


def test_a_message_that_is_aligned_to_the_north_is_turned() -> None:
    pose = pose_at(yaw_deg=90.0, pitch_deg=20.0)  # levelled already
    frame = read(obstacle_distance({18: 400}, frame=NORTH), pose)
    assert frame.obstacles[0].center_m == pytest.approx((4.0, 0.0), abs=0.05)


def test_finer_increments_offsets_and_counter_clockwise_order() -> None:
    frame = read(obstacle_distance({62: 500}, increment_f=-2.5, angle_offset=65.0))
    bearing_deg = math.degrees(math.atan2(*frame.obstacles[0].center_m[::-1]))
    assert bearing_deg == pytest.approx(-90.0, abs=0.5)


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"increment": 0}, "increment"),
        ({"increment_f": math.nan}, "increment"),
        ({"increment_f": 1e6}, "increment"),
        ({"angle_offset": math.inf}, "angle offset"),
        ({"min_distance": 1000}, "range limits"),
        ({"frame": mavlink.MAV_FRAME_BODY_NED}, "coordinate frame"),
    ],
)
def test_what_means_nothing_is_refused(keys: dict[str, Any], reason: str) -> None:
    source = sectors()
    assert list(source.read(obstacle_distance({}, **keys), NOW_UNIX_S)) == []
    assert source.refused == {reason: 1}


def test_a_message_without_any_sector_is_refused() -> None:
    source = sectors()
    assert list(source.read(obstacle_distance({}, 65535), NOW_UNIX_S)) == []
    assert source.refused == {"no sector is known": 1}


def test_garbage_is_no_message() -> None:
    assert list(sectors().read(b"\xfd" * 40, NOW_UNIX_S)) == []


# ------------------------------------------------------------------ DISTANCE_SENSOR


def distance(centimetres: int, **keys: Any) -> bytes:
    values: dict[str, Any] = {
        "min_distance": 20,
        "max_distance": 1200,
        "type": 0,
        "id": 3,
        "covariance": 255,
    }
    values |= {"orientation": 0, "horizontal_fov": 0.1, "vertical_fov": 0.1, "signal_quality": 90}
    message = mavlink.MAVLink_distance_sensor_message(
        time_boot_ms=5, current_distance=centimetres, **(values | keys)
    )
    return framed(message)


def beam(**keys: Any) -> DistanceSensorInput:
    stated = {"kind": "distance_sensor", "name": "beam", "range_m": 10.0, "uncertainty_m": 0.1}
    return DistanceSensorInput(
        DistanceSensorSource.model_validate(stated | keys), poses_of(pose_at())
    )


def test_a_beam_ahead() -> None:
    (frame,) = beam().read(distance(450), NOW_UNIX_S)
    (box,) = frame.obstacles
    assert box.center_m == pytest.approx((4.5, 0.0), abs=0.02)
    assert free_at(frame, 0.0) == 4.5
    assert frame.field_of_view_deg < math.degrees(0.12)


def test_a_beam_down_is_the_ground() -> None:
    source = beam()
    down = distance(450, orientation=mavlink.MAV_SENSOR_ROTATION_PITCH_270)
    assert list(source.read(down, NOW_UNIX_S)) == []
    assert source.malformed == 0


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"orientation": mavlink.MAV_SENSOR_ROTATION_YAW_90}, "does not look ahead"),
        ({"horizontal_fov": math.nan}, "field of view"),
        ({"max_distance": 20}, "range limits"),
    ],
)
def test_other_beams_are_refused(keys: dict[str, Any], reason: str) -> None:
    source = beam()
    assert list(source.read(distance(450, **keys), NOW_UNIX_S)) == []
    assert source.refused == {reason: 1}


def test_two_sensors_are_not_mixed_up() -> None:
    source = beam()
    assert len(source.read(distance(450), NOW_UNIX_S)) == 1
    assert list(source.read(distance(450, id=4), NOW_UNIX_S)) == []
    assert source.refused == {"another sensor id": 1}


def test_an_invalid_signal_is_unknown_and_a_wide_beam_may_be_stated() -> None:
    source = beam(no_return_is_free_to_m=5.0)
    assert list(source.read(distance(450, signal_quality=1), NOW_UNIX_S)) == []
    assert source.refused == {"mostly blind": 1}
    (frame,) = beam(beam_width_deg=20.0).read(distance(450, horizontal_fov=0.0), NOW_UNIX_S)
    assert 18.0 <= frame.field_of_view_deg <= 22.0


@pytest.mark.parametrize("other", [{"component": 1}, {"sensor_type": 1}])
def test_two_senders_are_two_sensors(other: dict[str, int]) -> None:
    source = sectors(no_return_is_free_to_m=9.0)
    assert source.read(obstacle_distance({0: 400}), NOW_UNIX_S)
    # What an autopilot has kept for longer than the declared latency would show free what is not.
    assert not source.read(obstacle_distance({}, **other), NOW_UNIX_S + 0.05)
    assert source.refused == {"two senders": 1}
    assert source.read(obstacle_distance({0: 400}), NOW_UNIX_S + 0.1)


def test_another_sender_replaces_one_that_is_silent() -> None:
    source = sectors()
    assert source.read(obstacle_distance({}), NOW_UNIX_S - 0.6)
    assert source.read(obstacle_distance({}, component=1), NOW_UNIX_S + 0.41)
