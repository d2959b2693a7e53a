"""OccupancyGrid as frames: cells as boxes of a lattice, and what may count as free."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.files.sensor_sources import OccupancyGridSource
from onboard.perception.detection import DetectionFrame, corners_ned
from onboard.perception.sources.occupancy_grid import OccupancyGridInput
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import occupancy_grid
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, free_at, pose_at, poses_of

CELL_M, SIDE = 0.5, 60
ORIGIN_M = (-15.0, -15.0)


def cells(occupied: list[tuple[int, int]], fill: int = 0) -> NDArray[np.int8]:
    """Return a grid of 30 m around its origin; (x, y) in cells from the middle are occupied."""
    grid = np.full((SIDE, SIDE), fill, np.int8)
    for x, y in occupied:
        grid[y + SIDE // 2, x + SIDE // 2] = 100
    return grid


def read(grid: NDArray[np.int8], pose: Pose | None = None, **keys: Any) -> DetectionFrame:
    stated = {"kind": "occupancygrid", "name": "map", "topic": "map", "range_m": 10.0}
    stated |= {"uncertainty_m": 0.1, "grid_frame": "body"}
    source = OccupancyGridInput(
        OccupancyGridSource.model_validate(stated | keys), poses_of(pose or pose_at())
    )
    payload = occupancy_grid(grid, cell_m=CELL_M, origin_m=ORIGIN_M, stamp_unix_s=EPOCH_UNIX_S)
    (frame,) = source.read(payload, 0.0)
    return frame


def test_an_occupied_cell_is_a_box_that_holds_it() -> None:
    (box,) = read(cells([(10, 4)])).obstacles  # 5.0 to 5.5 m ahead, 2.0 to 2.5 m to the left
    assert box.center_m == pytest.approx((5.25, -2.25))
    assert box.size_m == pytest.approx((0.5, 0.5))
    assert box.partial


def test_in_the_autopilots_own_frame_x_is_east() -> None:
    pose = pose_at(position_ned_m=(1.0, 2.0, -4.0), yaw_deg=40.0)
    (box,) = read(cells([(10, 4)]), pose, grid_frame="local_enu").obstacles
    corners = np.array(corners_ned(box, pose))
    assert corners.min(axis=0) == pytest.approx((2.0, 5.0))
    assert corners.max(axis=0) == pytest.approx((2.5, 5.5))


def test_a_long_wall_is_many_boxes_without_gaps() -> None:
    frame = read(cells([(8, y) for y in range(-12, 12)]), box_max_m=2.0)
    assert len(frame.obstacles) >= 7
    spans = sorted(
        (box.center_m[1] - box.size_m[1] / 2.0, box.center_m[1] + box.size_m[1] / 2.0)
        for box in frame.obstacles
    )
    for (_, end_m), (begin_m, _) in itertools.pairwise(spans):
        assert begin_m <= end_m + 1e-6


def test_free_cells_count_only_where_that_is_declared() -> None:
    assert set(read(cells([])).free_range_m or ()) == {0.0}
    frame = read(cells([(10, 0)]), no_return_is_free_to_m=9.0)
    assert 3.8 <= free_at(frame, 0.0) <= 5.0
    assert free_at(frame, 90.0) == pytest.approx(9.0, abs=0.01)


@pytest.mark.parametrize("unknown", [-1, 30, 100])
def test_unknown_and_doubtful_cells_end_what_is_free(unknown: int) -> None:
    grid = cells([])
    grid[:, SIDE // 2 + 12] = unknown  # from 6.0 m ahead on
    frame = read(grid, no_return_is_free_to_m=10.0, occupied_min=60)
    assert 4.8 <= free_at(frame, 0.0) <= 6.0
    for bearing_deg in range(-80, 81, 5):
        assert free_at(frame, bearing_deg) * math.cos(math.radians(bearing_deg)) <= 6.0
    assert bool(frame.obstacles) == (unknown == 100)


def test_beyond_the_grid_nothing_is_known() -> None:
    frame = read(cells([])[:, : SIDE // 2 + 8], no_return_is_free_to_m=10.0)
    assert 2.8 <= free_at(frame, 0.0) <= 4.0


def test_the_vehicles_own_cells_are_no_obstacle() -> None:
    assert read(cells([(0, 0), (-1, -1)]), own_radius_m=0.5).obstacles == ()


def test_a_single_cell_hides_all_behind_it_however_fine_the_grid_is() -> None:
    """Bins are wider than cells at the end of the range."""
    cell_m, side = 0.05, 520
    stated = {"kind": "occupancygrid", "name": "map", "topic": "map", "range_m": 12.0}
    stated |= {"uncertainty_m": 0.1, "grid_frame": "body", "no_return_is_free_to_m": 12.0}
    config = OccupancyGridSource.model_validate(stated)
    for row, column in ((100, 230), (37, 7), (200, 41)):
        grid = np.zeros((side, side), np.int8)
        grid[side // 2 + column, side // 2 + row] = 100
        source = OccupancyGridInput(config, poses_of(pose_at()))
        payload = occupancy_grid(
            grid, cell_m=cell_m, origin_m=(-13.0, -13.0), stamp_unix_s=EPOCH_UNIX_S
        )
        (frame,) = source.read(payload, 0.0)
        corners = [((row + i) * cell_m, -(column + j) * cell_m) for i in (0, 1) for j in (0, 1)]
        for x_m, y_m in corners:
            said_m = free_at(frame, math.degrees(math.atan2(y_m, x_m)))
            assert said_m <= math.hypot(x_m, y_m) + 1e-6
