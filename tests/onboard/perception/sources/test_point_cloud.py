"""PointCloud2 as frames: the height band, views, noise, and what may count as free."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from onboard.files.sensor_sources import PointCloudSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.sources.point_cloud import PointCloudInput
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import point_cloud
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    LOW_SENSORS,
    free_at,
    pose_at,
    poses_of,
)

Points = NDArray[np.float64]


def config(**keys: Any) -> PointCloudSource:
    stated: dict[str, Any] = {
        "kind": "pointcloud2",
        "name": "depth",
        "topic": "/points",
        "view_deg": [90.0, 60.0],
    }
    stated |= {"range_m": 10.0, "uncertainty_m": 0.05}
    return PointCloudSource.model_validate(stated | keys)


def read(points_m: Points, pose: Pose | None = None, **keys: Any) -> DetectionFrame:
    source = PointCloudInput(config(**keys), poses_of(pose or pose_at()))
    (frame,) = source.read(point_cloud(points_m, stamp_unix_s=EPOCH_UNIX_S), 0.0)
    return frame


def wall(
    ahead_m: float, left_m: tuple[float, float], up_m: tuple[float, float], step_m: float = 0.03
) -> Points:
    """Return the face of a wall across the way: forward, left, up."""
    left = np.arange(*left_m, step_m)
    up = np.arange(*up_m, step_m)
    grid = np.array(np.meshgrid(left, up)).reshape(2, -1)
    return np.column_stack((np.full(grid.shape[1], ahead_m), grid[0], grid[1]))


def test_a_post_at_flight_height_is_a_box() -> None:
    frame = read(wall(5.0, (-0.5, 0.5), (-2.0, 2.0)))
    (box,) = frame.obstacles
    assert box.center_m == pytest.approx((5.0, 0.0), abs=0.06)
    assert 0.95 <= box.size_m[1] <= 1.2
    assert free_at(frame, 0.0) == pytest.approx(5.0, abs=0.08)
    assert free_at(frame, 0.0) <= 5.0
    assert frame.field_of_view_deg == pytest.approx(89.0, abs=1.1)


@pytest.mark.parametrize("up_m", [(-3.0, -1.1), (1.1, 3.0)])
def test_ground_and_branches_above_are_no_obstacles_and_show_nothing_free(
    up_m: tuple[float, float],
) -> None:
    frame = read(wall(5.0, (-0.5, 0.5), up_m))
    assert frame.obstacles == ()
    assert free_at(frame, 0.0) == 0.0


def test_a_vehicle_on_the_ground_does_not_take_it_for_an_obstacle() -> None:
    left, ahead = (axis.ravel() for axis in np.mgrid[-3.0:3.0:0.04, 1.0:6.0:0.04])
    ground = np.column_stack((ahead, left, np.full(ahead.size, -0.15)))
    tall: dict[str, Any] = {"height_band_m": (6.0, 3.5), "no_return_is_free_to_m": 8.0}
    on_it = pose_at(position_ned_m=(0.0, 0.0, 0.0))
    assert read(ground, on_it, **tall).obstacles == ()
    # What stands on it is one.
    post = np.vstack((ground, wall(5.0, (-0.5, 0.5), (-0.1, 2.0))))
    assert len(read(post, on_it, **tall).obstacles) == 1
    # At 4 m it is a shrub, which a vehicle may descend to.
    assert read(ground, pose_at(), **tall).obstacles != ()


@pytest.mark.parametrize(("up_m", "z_m", "margin_m"), LOW_SENSORS)
def test_a_low_sensor_near_the_ground_still_sees_what_stands_there(
    up_m: float, z_m: float, margin_m: float
) -> None:
    keys: dict[str, Any] = {"mounting": {"z_m": z_m}, "no_return_is_free_to_m": 8.0}
    pose, pillar = pose_at(position_ned_m=(0.0, 0.0, -up_m)), wall(3.0, (-0.3, 0.3), (0.0, 0.04))
    frame = read(pillar, pose, ground_margin_m=margin_m, **keys)
    assert len(frame.obstacles) == 1
    assert free_at(frame, 0.3) == pytest.approx(3.0, abs=0.1)
    # From outside the band it shows nothing free and sees no distance, whatever returns.
    for band_m in ((1.0, z_m - 0.01), (0.01, 1.0)):
        mounted = keys if band_m[1] < 1.0 else keys | {"mounting": {"z_m": -z_m}}
        outside = read(pillar, pose_at(), height_band_m=band_m, **mounted)
        assert set(outside.free_range_m or ()) == {0.0}
        assert outside.range_m == 0.01


def test_it_is_levelled_by_the_attitude() -> None:
    """Pitched down by 20 degrees, what is at flight height lies above the axis."""
    level = wall(5.0, (-0.5, 0.5), (-0.3, 0.3))
    tilt = math.radians(-20.0)
    turned = level.copy()
    turned[:, 0] = math.cos(tilt) * level[:, 0] + math.sin(tilt) * level[:, 2]
    turned[:, 2] = -math.sin(tilt) * level[:, 0] + math.cos(tilt) * level[:, 2]
    frame = read(turned, pose_at(pitch_deg=-20.0))
    assert frame.obstacles[0].center_m == pytest.approx((5.0, 0.0), abs=0.06)
    assert read(turned).obstacles == ()


def test_a_cameras_own_axes() -> None:
    points_m = wall(4.0, (-0.4, 0.4), (-0.5, 0.5))
    optical = np.column_stack((-points_m[:, 1], -points_m[:, 2], points_m[:, 0]))
    frame = read(optical, axes="optical")
    assert frame.obstacles[0].center_m == pytest.approx((4.0, 0.0), abs=0.06)


def test_what_does_not_return_is_free_only_as_declared_in_view_and_at_its_height() -> None:
    nothing = np.full((50, 3), np.nan)
    blind = PointCloudInput(config(), poses_of(pose_at()))
    assert list(blind.read(point_cloud(nothing, stamp_unix_s=EPOCH_UNIX_S), 0.0)) == []
    assert blind.refused == {"not a single point": 1}
    frame = read(nothing, no_return_is_free_to_m=6.0)
    assert free_at(frame, 0.3) == 6.0
    assert frame.field_of_view_deg < 90.0
    source = PointCloudInput(config(no_return_is_free_to_m=6.0), poses_of(pose_at(pitch_deg=-31.0)))
    # Pitched by more than half of the vertical view, it does not look ahead at its own height.
    assert list(source.read(point_cloud(nothing, stamp_unix_s=EPOCH_UNIX_S), 0.0)) == []
    assert source.refused == {"does not look ahead": 1}


def test_few_points_are_no_obstacle_but_nothing_behind_them_is_free() -> None:
    behind = wall(8.0, (-2.0, 2.0), (-0.5, 0.5))
    speck = np.array([[4.0, 0.01, 0.0]])
    frame = read(np.concatenate((behind, speck)), points_min=2)
    assert all(box.center_m[0] > 7.0 for box in frame.obstacles)
    assert free_at(frame, -0.2) == pytest.approx(4.0, abs=0.1)
    assert free_at(frame, 5.0) == pytest.approx(8.0, abs=0.1)
    assert any(
        box.center_m[0] < 5.0
        for box in read(np.concatenate((behind, speck)), points_min=1).obstacles
    )


def test_parts_of_the_vehicle_hide_what_is_behind() -> None:
    leg = wall(0.2, (-0.02, 0.02), (-0.1, 0.1), 0.01)
    frame = read(np.concatenate((leg, wall(5.0, (-0.5, 0.5), (-0.5, 0.5)))))
    assert free_at(frame, 0.2) == 0.0
    assert all(box.center_m[0] > 4.0 for box in frame.obstacles)


def test_of_two_walls_the_near_one_is_seen() -> None:
    near, far = wall(4.0, (-0.5, 0.5), (-0.5, 0.5)), wall(8.0, (-0.3, 0.3), (-0.5, 0.5))
    assert all(box.center_m[0] < 5.0 for box in read(np.concatenate((far, near))).obstacles)


def test_nothing_beyond_the_range() -> None:
    frame = read(wall(10.5, (-1.0, 1.0), (-0.5, 0.5)), no_return_is_free_to_m=10.0)
    assert frame.obstacles == ()
    assert free_at(frame, 0.2) == 10.0


def test_absurd_points_are_left_out() -> None:
    odd = np.array([[np.inf, 0, 0], [1e30, 0, 0], [-1e38, 1e38, 1e38], [np.nan, 1, 0], [0, 0, 0]])
    frame = read(np.concatenate((odd, wall(5.0, (-0.5, 0.5), (-0.5, 0.5)))))
    assert len(frame.obstacles) == 1


def test_it_is_placed_by_its_mounting() -> None:
    mounting = {"x_m": 0.2, "y_m": 0.1, "yaw_deg": 10.0}
    points_m = wall(5.0, (-0.3, 0.3), (-0.5, 0.5))
    frame = read(points_m, mounting=mounting)
    turn = math.radians(10.0)
    expected = (0.2 + 5.0 * math.cos(turn), 0.1 + 5.0 * math.sin(turn))
    assert frame.obstacles[0].center_m == pytest.approx(expected, abs=0.08)


def test_a_cloud_needs_its_view_stated() -> None:
    with pytest.raises(ValidationError, match="view_deg"):
        PointCloudSource.model_validate(
            {"kind": "pointcloud2", "name": "c", "topic": "c", "range_m": 5.0, "uncertainty_m": 0.1}
        )


@pytest.mark.parametrize("seed", range(4))
def test_all_that_is_said_free_is_free(seed: int) -> None:
    """Of posts that are seen densely, none is nearer than what is said free at its bearing."""
    draw = np.random.default_rng(seed)
    posts = [
        (draw.uniform(1.5, 9.0), draw.uniform(-0.7, 0.7), draw.uniform(0.1, 0.5)) for _ in range(6)
    ]
    points = []
    for away_m, bearing_rad, radius_m in posts:
        angle = np.linspace(0.0, 2.0 * math.pi, 400)
        circle = np.column_stack(
            (
                away_m * math.cos(bearing_rad) + radius_m * np.cos(angle),
                -away_m * math.sin(bearing_rad) + radius_m * np.sin(angle),
            )
        )
        points += [np.column_stack((circle, np.full(400, up))) for up in np.linspace(-0.5, 0.5, 9)]
    frame = read(np.concatenate(points), no_return_is_free_to_m=10.0)
    for away_m, bearing_rad, radius_m in posts:
        half_rad = math.asin(radius_m / away_m)
        for share in np.linspace(-0.95, 0.95, 15):
            bearing = bearing_rad + share * half_rad
            chord = math.sqrt(radius_m**2 - (away_m * math.sin(share * half_rad)) ** 2)
            true_m = away_m * math.cos(share * half_rad) - chord
            assert free_at(frame, math.degrees(bearing)) <= true_m + 0.005
