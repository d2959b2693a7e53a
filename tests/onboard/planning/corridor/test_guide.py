"""The guide: shortest ways over known boxes, with room, and other gaps after a penalty."""

from __future__ import annotations

import math

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.planning.corridor import guide as guide_module
from onboard.planning.corridor.guide import CELL_M, Guide, along

MARGIN_M = 0.75
GOAL_M = (12.0, 0.0)


def guide(*boxes: Box, half_width_m: float = math.inf) -> Guide:
    made = Guide(GOAL_M, MARGIN_M, half_width_m)
    made.update((0.0, 0.0), boxes)
    return made


def path_of(made: Guide, start_m: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    path = made.path_leg_m(start_m, 18.0)
    assert path is not None
    return path


def least_gap_m(path: FloatArray, box: Box) -> float:
    x, y = along(path, np.arange(0.0, 30.0, 0.02)).T
    dx = np.maximum(np.maximum(box.x_min_m - x, x - box.x_max_m), 0.0)
    dy = np.maximum(np.maximum(box.y_min_m - y, y - box.y_max_m), 0.0)
    return float(np.maximum(dx, dy).min())


def test_in_the_open_the_way_is_straight() -> None:
    made = guide()
    path = path_of(made)
    assert np.abs(path[:, 1]).max() < CELL_M
    left_m = made.distance_m(np.array([0.0, 6.0]), np.array([0.0, 0.0]))
    assert left_m == pytest.approx([12.0, 6.0], abs=CELL_M)


def test_a_box_is_passed_with_the_margin() -> None:
    box = Box(5.0, 6.0, -2.0, 0.4)
    path = path_of(guide(box))
    assert least_gap_m(path, box) >= MARGIN_M
    assert path[:, 1].max() > 0.0  # the shorter side
    assert path[-1].tolist() == list(GOAL_M)


def test_no_way_is_cut_past_the_corners_of_two_boxes() -> None:
    # Grown, the two touch at one corner, which no body passes.
    boxes = (Box(4.0, 5.0, -9.0, -0.25), Box(6.6, 8.0, 1.35, 9.0), Box(5.0, 6.5, -9.0, -0.15))
    for box in boxes:
        assert least_gap_m(path_of(guide(*boxes)), box) >= MARGIN_M


def test_the_corridor_is_a_wall() -> None:
    box = Box(5.0, 6.0, -2.0, 2.2)
    assert path_of(guide(box), (0.0, 0.0))[:, 1].min() < -2.0
    beside = path_of(guide(box, half_width_m=4.0))
    assert np.abs(beside[:, 1]).max() <= 4.0 - MARGIN_M + CELL_M
    made = guide(box, half_width_m=2.9)
    assert (
        made.path_leg_m((0.0, 0.0), 18.0) is None
        or (least_gap_m(path_of(made), box) < MARGIN_M) is False
    )


def test_a_penalty_makes_it_try_the_other_side() -> None:
    box = Box(5.0, 6.0, -2.0, 1.6)
    made = guide(box)
    assert path_of(made)[:, 1].max() > 2.0
    made.penalized_leg_m.append((5.5, 2.6))
    made.update((0.0, 0.0), [box])
    assert path_of(made)[:, 1].min() < -2.0


def test_far_from_the_goal_the_straight_way_counts_beyond_the_window() -> None:
    made = Guide((60.0, 0.0), MARGIN_M)
    made.update((0.0, 0.0), [])
    assert float(made.distance_m(np.zeros(1), np.zeros(1))[0]) == pytest.approx(60.0, abs=0.5)


def test_the_old_field_serves_until_the_new_one_is_complete() -> None:
    made = guide()
    before = path_of(made)
    slices = made.updating((0.0, 0.0), [Box(5.0, 6.0, -2.0, 0.4)])
    next(slices)
    assert np.array_equal(path_of(made), before)
    with pytest.raises(StopIteration):
        next(slices)
    assert not np.array_equal(path_of(made), before)


def test_from_a_blocked_cell_it_leads_to_the_next_open_one() -> None:
    made = guide(Box(-0.5, 0.5, -0.5, 0.5))
    assert math.isfinite(float(made.distance_m(np.array([1.2]), np.zeros(1))[0]))
    assert path_of(made, (1.2, 0.0))[-1].tolist() == list(GOAL_M)


def test_points_along_a_path() -> None:
    path = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)))
    assert along(path, [1.0, 5.0, 99.0]).tolist() == [[1.0, 0.0], [3.0, 2.0], [3.0, 4.0]]


def test_no_way_cuts_the_corner_between_two_blocked_cells() -> None:
    cost = np.ones((3, 3))
    cost[0, 1] = cost[1, 0] = math.inf
    exits = np.full((3, 3), math.inf)
    exits[0, 0] = 0.0
    ways_m = guide_module._Raster((3, 3)).distances(cost, exits)
    assert ways_m[0, 0] < 1e-6
    assert math.isinf(ways_m[1, 1])
    cost[0, 1] = cost[1, 0] = 1.0
    ways_m = guide_module._Raster((3, 3)).distances(cost, exits)
    assert ways_m[1, 1] == pytest.approx(math.sqrt(2.0) * CELL_M, abs=1e-6)
