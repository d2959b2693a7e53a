"""LaserScan as frames: what is said to be free is free, and what stands there is reported."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.files.sensor_sources import LaserScanSource, Mounting, RangeSource
from onboard.perception.detection import DetectionFrame, corners_ned
from onboard.perception.sources.laser_scan import LaserScanInput, RangeInput
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import CdrWriter, laser_scan, scan_all_round, stamp_of
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    LOW_SENSORS,
    Box,
    free_at,
    lidar,
    measured_ranges,
    overclaim_m,
    pose_at,
    poses_of,
    ranges_around,
)

PILLAR: Box = (6.0, 0.0, 1.0, 1.0, 0.0)
NOTHING = np.full(720, math.inf)


def read(
    ranges_m: Any, pose: Pose | None = None, *, source: LaserScanInput | None = None, **keys: Any
) -> DetectionFrame:
    source = source or LaserScanInput(lidar(**keys), poses_of(pose or pose_at()))
    (frame,) = source.read(scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S), 0.0)
    return frame


def refusals(source: LaserScanInput | RangeInput, payload: bytes) -> dict[str, int]:
    assert list(source.read(payload, 0.0)) == []
    assert source.malformed == sum(source.refused.values())
    return dict(source.refused)


def test_a_pillar_ahead_is_one_box_and_nothing_behind_it_is_free() -> None:
    frame = read(ranges_around([PILLAR]), no_return_is_free_to_m=10.0)
    (box,) = frame.obstacles
    assert box.center_m == pytest.approx((5.5, 0.0), abs=0.03)
    assert box.size_m[0] < 0.1
    # At both ends within half a beam, which is no more than faces may be off.
    assert box.size_m[1] == pytest.approx(1.0, abs=5.5 * math.radians(0.55))
    assert (frame.source, frame.frame, frame.range_m) == ("lidar", "body_frd", 12.0)
    assert frame.field_of_view_deg == 360.0
    assert free_at(frame, 0.0) == pytest.approx(5.5, abs=0.01)
    assert free_at(frame, 30.0) == free_at(frame, -150.0) == 10.0


def test_it_is_placed_by_heading_and_position() -> None:
    pose = pose_at(position_ned_m=(3.0, -2.0, -4.0), yaw_deg=90.0)
    east = (3.0, 4.0, 1.0, 1.0, 0.0)
    frame = read(ranges_around([east], (3.0, -2.0), math.pi / 2.0), pose)
    corners = np.array(corners_ned(frame.obstacles[0], pose))
    assert corners.mean(axis=0) == pytest.approx((3.0, 3.5), abs=0.03)


def test_without_a_declaration_what_does_not_return_is_unknown() -> None:
    frame = read(ranges_around([PILLAR]))
    assert free_at(frame, 0.0) == pytest.approx(5.5, abs=0.01)
    assert free_at(frame, 90.0) == 0.0


@pytest.mark.parametrize("nothing", [math.nan, 0.0, -math.inf, -1.0, 0.05])
def test_what_is_no_measurement_is_never_free(nothing: float) -> None:
    ranges_m = ranges_around([PILLAR])
    ranges_m[100] = nothing  # of beams every half degree, from behind to the left
    frame = read(ranges_m, no_return_is_free_to_m=10.0)
    assert free_at(frame, 180.0 - 50.0 - 0.25) == 0.0
    assert free_at(frame, 180.0 - 52.0) == 10.0
    assert len(frame.obstacles) == 1


def test_a_lidar_that_measures_hardly_anything_is_blind() -> None:
    """An empty frame would say that nothing is there."""
    ranges_m = np.full(720, math.nan)
    ranges_m[:300] = 5.0
    source = LaserScanInput(lidar(), poses_of(pose_at()))
    payload = scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S)
    assert refusals(source, payload) == {"mostly blind": 1}
    ranges_m[:420] = 5.0
    assert read(ranges_m).obstacles


def test_beyond_the_range_there_is_no_box_but_free_space_up_to_the_range() -> None:
    frame = read(ranges_around([(15.0, 0.0, 1.0, 1.0, 0.0)]))
    assert frame.obstacles == ()
    assert free_at(frame, 0.0) == 12.0


def test_a_range_of_exactly_the_sensors_limit_is_no_return() -> None:
    frame = read(np.full(720, 30.0))
    assert frame.obstacles == ()
    assert free_at(frame, 0.0) == 0.0


def test_a_lone_return_is_no_box_but_nothing_behind_it_is_free() -> None:
    ranges_m = np.full(720, math.inf)
    ranges_m[360] = 4.0
    frame = read(ranges_m, no_return_is_free_to_m=10.0)
    assert frame.obstacles == ()
    assert free_at(frame, -0.3) == 4.0
    frame = read(ranges_m, no_return_is_free_to_m=10.0, points_min=1)
    assert len(frame.obstacles) == 1


@pytest.mark.parametrize(("pitch_deg", "reach_m"), [(0.0, 12.0), (-15.0, 3.73), (15.0, 3.73)])
def test_a_tilted_plane_counts_only_within_the_height_band(
    pitch_deg: float, reach_m: float
) -> None:
    pose = pose_at(pitch_deg=pitch_deg)
    frame = read(NOTHING, pose, no_return_is_free_to_m=12.0)
    assert free_at(frame, 0.3) == pytest.approx(reach_m, abs=0.02)
    assert free_at(frame, 90.3) == pytest.approx(12.0, abs=0.5)  # the pitch axis stays level
    assert frame.range_m == pytest.approx(reach_m, abs=0.02)


def test_what_returns_from_outside_the_band_is_neither_obstacle_nor_free() -> None:
    pose, high = pose_at(pitch_deg=15.0), (3.0, 1.0)
    ranges_m = measured_ranges([PILLAR], [pose] * 720, Mounting())
    assert read(ranges_m, pose).obstacles == ()
    assert free_at(read(ranges_m, pose), 0.3) == pytest.approx(3.73, abs=0.02)
    frame = read(ranges_m, pose, height_band_m=high)  # at 5.5 m it is 1.5 m higher
    assert frame.obstacles[0].center_m == pytest.approx((5.5, 0.0), abs=0.03)
    assert free_at(frame, 0.3) == pytest.approx(5.5, abs=0.02)


def test_the_ground_is_no_obstacle_during_take_off() -> None:
    # 0.6 m up and tilted, the plane ahead meets the ground after 3.5 m.
    pose = pose_at(position_ned_m=(0.0, 0.0, -0.6), pitch_deg=-10.0)
    ranges_m = NOTHING.copy()
    ranges_m[340:380] = 0.6 / math.sin(math.radians(10.0))
    frame = read(ranges_m, pose, height_band_m=(6.0, 3.5))
    assert frame.obstacles == ()
    # At this height 0.1 m below the vehicle the ground begins; higher up what is declared counts.
    assert free_at(frame, 0.3) == pytest.approx(0.1 / math.tan(math.radians(10.0)), abs=0.01)
    above = pose._replace(position_ned_m=(0.0, 0.0, -6.0))
    assert len(read(ranges_m, above, height_band_m=(6.0, 3.5), box_max_m=9.0).obstacles) == 1
    # Without a margin, errors of height make the ground an obstacle.
    bold = read(ranges_m, pose, height_band_m=(6.0, 3.5), box_max_m=9.0, ground_margin_m=0.0)
    assert len(bold.obstacles) == 1


@pytest.mark.parametrize(("up_m", "z_m", "margin_m"), LOW_SENSORS)
def test_a_low_sensor_near_the_ground_still_sees_what_stands_there(
    up_m: float, z_m: float, margin_m: float
) -> None:
    keys: dict[str, Any] = {"mounting": {"z_m": z_m}, "no_return_is_free_to_m": 8.0}
    pose = pose_at(position_ned_m=(0.0, 0.0, -up_m))
    ranges_m = ranges_around([(3.5, 0.0, 1.0, 1.0, 0.0)])
    frame = read(ranges_m, pose, ground_margin_m=margin_m, **keys)
    assert frame.obstacles[0].center_m == pytest.approx((3.0, 0.0), abs=0.05)
    assert free_at(frame, 0.3) == pytest.approx(3.0, abs=0.02)
    # Where every obstacle may end above the sensor, it sees nothing.
    below = read(ranges_m, pose, height_band_m=(1.0, z_m - 0.01), **keys)
    assert (below.obstacles, free_at(below, 0.3), below.range_m) == ((), 0.0, 0.01)


def test_the_range_is_that_of_the_view_which_is_counted_on() -> None:
    pose = pose_at(roll_deg=15.0)
    assert read(NOTHING, pose, no_return_is_free_to_m=12.0).range_m == pytest.approx(3.73, abs=0.02)
    ahead = read(NOTHING, pose, no_return_is_free_to_m=12.0, field_of_view_deg=30.0)
    assert ahead.range_m == 12.0
    assert ahead.field_of_view_deg == pytest.approx(30.0)


def test_parts_of_the_vehicle_are_no_obstacles_and_hide_what_is_behind() -> None:
    ranges_m = np.full(720, 8.0)
    ranges_m[358:362] = 0.25
    frame = read(ranges_m, own_radius_m=0.4, box_max_m=100.0)
    assert free_at(frame, 0.3) == 0.0
    assert free_at(frame, 5.0) == 8.0
    assert all(max(box.size_m) > 1.0 for box in frame.obstacles)


def test_a_blind_sector_is_not_in_view() -> None:
    frame = read(NOTHING, blind_sectors_deg=[[60.0, 70.0]], no_return_is_free_to_m=10.0)
    assert 119.0 - 1.5 <= frame.field_of_view_deg <= 120.0
    frame = read(NOTHING, blind_sectors_deg=[[170.0, -170.0]], no_return_is_free_to_m=10.0)
    assert 338.0 <= frame.field_of_view_deg <= 340.0


def test_a_scan_of_a_sector_sees_that_sector() -> None:
    source = LaserScanInput(lidar(mounting={"yaw_deg": 20.0}), poses_of(pose_at()))
    payload = laser_scan(
        np.full(181, 5.0),
        stamp_unix_s=EPOCH_UNIX_S,
        angle_min_rad=-math.pi / 4.0,
        angle_max_rad=math.pi / 4.0,
        angle_increment_rad=math.pi / 360.0,
    )
    (frame,) = source.read(payload, 0.0)
    assert 2 * 23.0 <= frame.field_of_view_deg <= 2 * 25.5  # from -25 to 65 degrees


def test_a_scan_that_does_not_look_ahead_is_refused() -> None:
    source = LaserScanInput(lidar(mounting={"yaw_deg": 180.0}), poses_of(pose_at()))
    assert refusals(source, laser_scan(stamp_unix_s=EPOCH_UNIX_S)) == {"does not look ahead": 1}


def test_upside_down_and_turned() -> None:
    mounting = Mounting(roll_deg=180.0, yaw_deg=35.0)
    pose = pose_at(yaw_deg=10.0)
    right = (5.0, 3.0, 0.8, 0.8, 0.3)
    ranges_m = measured_ranges([right], [pose] * 720, mounting)
    frame = read(ranges_m, pose, mounting=mounting.model_dump())
    seen = np.array(corners_ned(frame.obstacles[0], pose)).mean(axis=0)
    assert np.hypot(*(seen - right[:2])) < 0.6


def test_no_pose_at_its_stamp() -> None:
    source = LaserScanInput(lidar(), poses_of(pose_at()))
    late = scan_all_round(NOTHING, stamp_unix_s=EPOCH_UNIX_S + 30.0)
    assert refusals(source, late) == {"no pose at its stamp": 1}
    # The begin of a scan is not enough.
    long = scan_all_round(NOTHING, stamp_unix_s=EPOCH_UNIX_S + 0.4, time_increment_s=0.5 / 720)
    assert refusals(source, long) == {"no pose at its stamp": 2}


def test_another_frame_id_and_garbage() -> None:
    source = LaserScanInput(lidar(), poses_of(pose_at()))
    assert len(source.read(scan_all_round(NOTHING, stamp_unix_s=EPOCH_UNIX_S), 0.0)) == 1
    other = scan_all_round(NOTHING, stamp_unix_s=EPOCH_UNIX_S, frame_id="rear")
    assert refusals(source, other) == {"another frame_id": 1}
    assert refusals(source, b"{}") == {"another frame_id": 1, "not plain CDR": 1}
    stated = LaserScanInput(lidar(frame_id="rear"), poses_of(pose_at()))
    first = scan_all_round(NOTHING, stamp_unix_s=EPOCH_UNIX_S)
    assert refusals(stated, first) == {"another frame_id": 1}


def test_frames_are_numbered_and_stamped() -> None:
    source = LaserScanInput(lidar(), poses_of(pose_at()))
    first, second = (read(NOTHING, source=source) for _ in range(2))
    assert (first.sequence, second.sequence) == (1, 2)
    assert first.stamp_unix_s == pytest.approx(EPOCH_UNIX_S, abs=1e-6)


# ------------------------------------------------------------------ what is said free is free

pillars = st.lists(
    st.tuples(st.floats(0.9, 11.0), st.floats(0.0, 6.28), st.floats(0.2, 1.5), st.floats(0.2, 1.5)),
    min_size=1,
    max_size=6,
)
mountings = st.builds(
    Mounting,
    x_m=st.floats(-0.2, 0.2),
    y_m=st.floats(-0.2, 0.2),
    z_m=st.floats(-0.1, 0.1),
    roll_deg=st.floats(-5.0, 5.0),
    pitch_deg=st.floats(-5.0, 5.0),
    yaw_deg=st.floats(-180.0, 180.0),
)


def scene(drawn: list[tuple[float, float, float, float]]) -> list[Box]:
    """Return pillars whose nearest point is farther away than the vehicle reaches."""
    return [
        (
            (near_m + 1.1) * math.cos(bearing_rad),
            (near_m + 1.1) * math.sin(bearing_rad),
            length_m,
            width_m,
            bearing_rad * 3.0,
        )
        for near_m, bearing_rad, length_m, width_m in drawn
    ]


@settings(max_examples=40, deadline=None)
@given(pillars, mountings, st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.floats(-180, 180))
def test_all_that_is_said_free_is_free(
    drawn: list[tuple[float, float, float, float]],
    mounting: Mounting,
    roll_deg: float,
    pitch_deg: float,
    yaw_deg: float,
) -> None:
    boxes, pose = scene(drawn), pose_at(roll_deg=roll_deg, pitch_deg=pitch_deg, yaw_deg=yaw_deg)
    ranges_m = measured_ranges(boxes, [pose] * 360, mounting)
    keys: dict[str, Any] = {"mounting": mounting.model_dump(), "height_band_m": (3.0, 3.0)}
    frame = read(ranges_m, pose, no_return_is_free_to_m=12.0, **keys)
    assert overclaim_m(frame, boxes, pose, spacing_deg=1.0) <= 0.005
    assert free_at(frame, 0.0) + free_at(frame, 90.0) + free_at(frame, -120.0) > 0.5


@settings(max_examples=20, deadline=None)
@given(pillars, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-90.0, 90.0))
def test_all_that_is_said_free_in_motion_is_free(
    drawn: list[tuple[float, float, float, float]],
    north_mps: float,
    east_mps: float,
    turn_degps: float,
) -> None:
    """A scan takes a tenth of a second; its beams come from where the vehicle has gone since."""
    boxes, scan_s = scene(drawn), 0.1

    def moved(time_s: float) -> Pose:
        place_m = (north_mps * time_s, east_mps * time_s, -4.0)
        velocity = (north_mps, east_mps, 0.0)
        return pose_at(time_s, place_m, velocity, yaw_deg=20.0 + turn_degps * time_s)

    beams_s = np.arange(360) * scan_s / 360
    ranges_m = measured_ranges(boxes, [moved(time_s) for time_s in beams_s], Mounting(x_m=0.1))
    poses = poses_of(*(moved(0.02 * step - 0.1) for step in range(20)))
    config = lidar(mounting={"x_m": 0.1}, no_return_is_free_to_m=12.0)
    source = LaserScanInput(config, poses)
    payload = scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S, time_increment_s=scan_s / 360)
    (frame,) = source.read(payload, 0.0)
    assert overclaim_m(frame, boxes, moved(0.0), spacing_deg=1.0) <= 0.005


def test_a_scan_in_motion_is_straightened() -> None:
    """At 2.8 m/s a wall ahead smears by 0.28 m over a scan unless each beam has its own pose."""
    wall: Box = (6.0, 0.0, 0.4, 16.0, 0.0)

    def moved(time_s: float) -> Pose:
        return pose_at(time_s, (2.8 * time_s, 0.0, -4.0), (2.8, 0.0, 0.0))

    beam_s = 0.1 / 720
    ranges_m = measured_ranges([wall], [moved(beam * beam_s) for beam in range(720)], Mounting())
    poses = poses_of(*(moved(0.02 * step - 0.1) for step in range(20)))
    payloads = [
        scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S, time_increment_s=step_s)
        for step_s in (beam_s, 0.0)
    ]
    config = lidar(box_max_m=100.0)
    straight, smeared = (LaserScanInput(config, poses).read(p, 0.0)[0] for p in payloads)
    corners = np.array(corners_ned(straight.obstacles[0], moved(0.0)))
    # Its ends, seen at a slant, are half a beam nearer at most.
    assert corners[:, 0].min() == pytest.approx(5.78, abs=0.03)
    corners = np.array(corners_ned(smeared.obstacles[0], moved(0.0)))
    assert abs(corners[:, 0].min() - 5.8) > 0.1


# ------------------------------------------------------------------ one cone


def cone_message(range_m: float, view_rad: float = 0.4) -> bytes:
    writer = CdrWriter().header(stamp_of(EPOCH_UNIX_S), "sonar")
    return writer.add("Bffff", 0, view_rad, 0.2, 8.0, range_m).payload()


def cone(**keys: Any) -> RangeInput:
    stated = {"kind": "range", "name": "sonar", "topic": "sonar", "range_m": 6.0}
    config = RangeSource.model_validate(stated | {"uncertainty_m": 0.1} | keys)
    return RangeInput(config, poses_of(pose_at()))


def test_a_cone_is_free_up_to_its_obstacle_which_may_be_anywhere_across() -> None:
    (frame,) = cone().read(cone_message(3.0), 0.0)
    assert 20.0 <= frame.field_of_view_deg <= math.degrees(0.44)
    assert free_at(frame, 5.0) == 3.0
    (box,) = frame.obstacles
    assert box.partial
    assert box.size_m[1] >= 2.0 * 3.0 * math.sin(0.2)


@pytest.mark.parametrize("range_m", [math.inf, 8.0])
def test_a_cone_without_an_echo_shows_nothing(range_m: float) -> None:
    (frame,) = cone().read(cone_message(range_m), 0.0)
    assert frame.obstacles == ()
    assert free_at(frame, 0.0) == 0.0
    (frame,) = cone(no_return_is_free_to_m=5.0).read(cone_message(range_m), 0.0)
    assert free_at(frame, 0.0) == 5.0


@pytest.mark.parametrize("range_m", [math.nan, 0.1, -math.inf])
def test_a_cone_that_measures_nothing_is_blind(range_m: float) -> None:
    source = cone(no_return_is_free_to_m=5.0)
    assert refusals(source, cone_message(range_m)) == {"mostly blind": 1}


def test_a_lidar_is_read_as_its_file_says() -> None:
    assert lidar().height_band_m == (1.0, 1.0)
    assert isinstance(lidar(), LaserScanSource)
