"""The guide: shortest ways over known boxes, with room, and other gaps after a penalty."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.planning.corridor.guide import AHEAD_M, ASIDE_M, BEHIND_M, Guide, along
from onboard.planning.corridor.raster import CELL_M

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
    for _ in slices:
        assert np.array_equal(path_of(made), before)
    assert not np.array_equal(path_of(made), before)


def test_from_a_blocked_cell_it_leads_to_the_next_open_one() -> None:
    made = guide(Box(-0.5, 0.5, -0.5, 0.5))
    assert math.isfinite(float(made.distance_m(np.array([1.2]), np.zeros(1))[0]))
    assert path_of(made, (1.2, 0.0))[-1].tolist() == list(GOAL_M)


def test_points_along_a_path() -> None:
    path = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)))
    assert along(path, [1.0, 5.0, 99.0]).tolist() == [[1.0, 0.0], [3.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize(("gap_m", "passes"), [(1.77, True), (1.5, False)])
@pytest.mark.parametrize("middle_m", [0.0, 0.05, 0.1, 0.17])
def test_a_gap_is_a_way_if_the_seen_free_set_leaves_room_in_it(
    gap_m: float, middle_m: float, *, passes: bool
) -> None:
    # Faces take 0.2 m of a gap, lines of sight 0.06 m, and cells up to 0.2 m: 1.3 m are needed.
    low_m, high_m = middle_m - gap_m / 2.0, middle_m + gap_m / 2.0
    made = Guide(GOAL_M, MARGIN_M, 9.0, face_error_m=0.1)
    made.update((0.0, 0.0), [Box(4.0, 8.0, -9.0, low_m), Box(4.0, 8.0, high_m, 9.0)])
    x_m, y_m = path_of(made, (0.0, middle_m)).T
    assert (x_m.max() == GOAL_M[0] and x_m.min() > -1.0) == passes
    if passes:
        assert np.abs(y_m[(x_m > 3.4) & (x_m < 8.6)] - middle_m).max() < 0.15


def test_a_wall_that_leaves_the_window_is_passed_round_its_nearer_end() -> None:
    wall = Box(5.0, 6.0, -ASIDE_M - 4.0, ASIDE_M + 1.0)
    for half_width_m in (40.0, math.inf):
        made = guide(wall, half_width_m=half_width_m)
        assert path_of(made)[:-1, 1].max() == pytest.approx(ASIDE_M, abs=0.5)
        made.update((0.0, 6.0), [wall])
        assert path_of(made, (0.0, 6.0))[:, 1].max() > wall.y_max_m + MARGIN_M


def test_the_window_covers_the_corridor_wherever_the_vehicle_is_in_it() -> None:
    wall = Box(5.0, 6.0, -9.0, 5.5)
    made = guide(wall, half_width_m=9.0)
    made.update((0.0, -7.0), [wall])
    assert path_of(made, (0.0, -7.0))[:, 1].max() > 6.0


def test_a_way_that_leads_nowhere_is_not_tried_again_from_farther_away() -> None:
    """A pocket as long as the window is left for good, and the far way round is found."""
    shut = Box(20.0, 21.0, -9.0, 3.0)
    pocket = [shut, Box(4.0, 21.0, 3.0, 4.0)]
    made = Guide((40.0, 0.0), MARGIN_M, 9.0)
    x_m, y_m, turns, forward = 0.0, 0.0, 0, True
    seen: list[Box] = []
    for _ in range(400):
        seen += [box for box in pocket if box.x_min_m - x_m < 8.0 and box not in seen]
        made.update((x_m, y_m), seen)
        path = path_of(made, (x_m, y_m))
        before_m = x_m
        x_m, y_m = along(path, (0.6,))[0].tolist()
        if (x_m > before_m) != forward and abs(x_m - before_m) > 0.1:
            turns, forward = turns + 1, not forward
        if x_m > 25.0:
            break
    assert x_m > 25.0
    assert turns <= 4


def test_no_way_leads_far_behind_the_start_or_beyond_the_end() -> None:
    wall = Box(5.0, 6.0, -12.0, 12.0)
    made = guide(wall, half_width_m=9.0)
    x_m, y_m = 0.0, 0.0
    for _ in range(300):
        made.update((x_m, y_m), [wall])
        path = made.path_leg_m((x_m, y_m), 18.0)
        if path is None:
            break
        x_m, y_m = along(path, (0.6,))[0].tolist()
        assert x_m > -BEHIND_M - CELL_M
        assert x_m < AHEAD_M
    assert made.path_leg_m((x_m, y_m), 18.0) is None  # shut, and it knows


def test_boxes_that_are_gone_close_no_way() -> None:
    wall = [Box(5.0, 6.0, -12.0, 12.0), Box(5.0, 6.0, -12.0, 12.0)]
    made = guide(*wall, half_width_m=9.0)
    for x_m in (0.0, -4.0, -8.0):
        made.update((x_m, 0.0), wall)
    made.update((-8.0, 0.0), [])
    path = path_of(made, (-8.0, 0.0))
    assert path[1, 0] > path[0, 0]


def test_the_wish_keeps_a_distance_where_there_is_room_and_closes_no_gap() -> None:
    box = Box(5.0, 6.0, -2.0, 0.4)
    walls = (Box(5.0, 6.0, -9.0, -1.2), Box(5.0, 6.0, 1.2, 9.0))
    for boxes, least_m in (((box,), MARGIN_M + 1.5), (walls, MARGIN_M)):
        made = Guide(GOAL_M, MARGIN_M, 9.0, wish_m=1.5)
        made.update((0.0, 0.0), boxes)
        path = path_of(made)
        assert path[:, 0].min() > -1.0
        assert min(least_gap_m(path, one) for one in boxes) >= least_m - CELL_M / 2.0
    assert least_gap_m(path_of(guide(box)), box) < MARGIN_M + 1.0


def test_in_a_blocked_cell_staying_does_not_look_cheaper_than_the_way_on() -> None:
    """Round a blocked place the cells differ: the nearest counts, where the path begins."""
    made = Guide(GOAL_M, MARGIN_M, 9.0)
    made.penalized_leg_m += [(4.2, 0.6), (4.2, 0.6)]
    made.update((0.0, 0.0), [Box(5.0, 6.0, -2.0, 0.4)])
    for y_m in (0.0, 0.4, 0.8, 1.1):
        path = path_of(made, (4.6, y_m))
        here_m, next_m = made.distance_m(np.array([4.6, path[1, 0]]), np.array([y_m, path[1, 1]]))
        assert here_m > next_m
        assert here_m < next_m + 2.0


class Crowd:
    """Is everywhere within a box."""

    def __init__(self, box: Box) -> None:
        self._box = box

    def are_met(self, x_m: FloatArray, y_m: FloatArray) -> NDArray[np.bool_]:
        box = self._box
        along_it = (x_m >= box.x_min_m) & (x_m <= box.x_max_m)
        across_it = (y_m >= box.y_min_m) & (y_m <= box.y_max_m)
        return along_it[:, None] & across_it[None, :]


def test_what_passes_is_led_round_but_closes_no_way() -> None:
    made = Guide(GOAL_M, MARGIN_M, math.inf)
    small = Box(5.0, 7.0, -1.0, 0.6)
    for _ in made.updating((0.0, 0.0), (), Crowd(small)):
        pass
    assert least_gap_m(path_of(made), small) >= MARGIN_M - CELL_M
    wide = Box(5.0, 6.0, -50.0, 50.0)
    made = Guide(GOAL_M, MARGIN_M, 8.0)
    for _ in made.updating((0.0, 0.0), (), Crowd(wide)):
        pass
    assert path_of(made)[-1].tolist() == list(GOAL_M)
