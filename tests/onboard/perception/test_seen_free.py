"""The seen-free set: rows of frames, moves of the grid, turns to other legs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import SeenFree

ALL_ROUND = View((0.0, 0.0), 0.0, math.pi, 5.0, (), 0.05)
FOUR_STEPS_M = 4.0


def seen(frames_needed: int = 1, *views: View, reach_m: float = 6.0) -> SeenFree:
    space = SeenFree(frames_needed=frames_needed, reach_m=reach_m)
    for view in views:
        space.see(view)
    return space


def is_free(space: SeenFree, x_m: float, y_m: float, half_m: float = 0.01) -> bool:
    return space.grid().is_free(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)


@pytest.mark.parametrize("frames_needed", [1, 2, 3, 7])
def test_a_cell_is_free_after_so_many_frames(frames_needed: int) -> None:
    space = seen(frames_needed)
    for number in range(frames_needed):
        assert not is_free(space, 2.03, 1.03)
        assert space.size == 0
        assert space.version == 0
        space.see(ALL_ROUND)
        assert (space.size > 0) == (number == frames_needed - 1)
    assert is_free(space, 2.03, 1.03)
    assert space.version == 1


def test_a_frame_that_does_not_show_a_cell_starts_its_row_again() -> None:
    hidden = replace(ALL_ROUND, boxes=(Box(1.0, 1.5, 0.0, 1.0),))
    space = seen(2, ALL_ROUND, hidden, ALL_ROUND)
    assert not is_free(space, 2.03, 1.03)
    assert is_free(space, -2.03, 1.03)
    space.see(ALL_ROUND)
    assert is_free(space, 2.03, 1.03)
    space.see(hidden)  # obstacles stand still: what was free stays so
    assert is_free(space, 2.03, 1.03)


def test_each_sensor_has_to_show_it_so_often_by_itself() -> None:
    space = SeenFree(frames_needed=2)
    space.see(ALL_ROUND, "front")
    space.see(ALL_ROUND, "left")
    assert space.size == 0
    space.see(ALL_ROUND, "front")
    assert space.size > 0


def test_a_missed_frame_starts_the_row_of_its_sensor_again() -> None:
    space = SeenFree(frames_needed=2)
    for source in ("front", "left"):
        space.see(ALL_ROUND, source)
    space.break_row("front")
    space.see(ALL_ROUND, "front")
    assert space.size == 0
    space.see(ALL_ROUND, "left")
    assert space.size > 0


def test_nothing_is_forgotten_but_what_leaves_the_grid() -> None:
    space = seen(1, ALL_ROUND)
    assert is_free(space, -4.0, 0.5)
    for x_m in np.arange(0.0, 9.0, 0.5).tolist():
        space.centre_on(x_m, 0.0)
        assert is_free(space, 4.0, 0.5)
        assert abs(space.centre_leg_m[0] - x_m) <= FOUR_STEPS_M / 2.0
    assert not is_free(space, -4.0, 0.5)
    space.centre_on(0.0, 0.0)
    assert not is_free(space, -4.0, 0.5)
    space.centre_on(1000.0, -1000.0)
    assert space.size == 0


def test_rows_move_with_the_grid() -> None:
    space = seen(2, ALL_ROUND)
    space.centre_on(FOUR_STEPS_M, 0.0)
    space.see(ALL_ROUND)
    assert is_free(space, 4.0, 0.5)
    assert not is_free(space, 9.0, 0.5)


def test_void_forgets_rows_too() -> None:
    space = seen(2, ALL_ROUND)
    space.void()
    space.see(ALL_ROUND)
    assert space.size == 0
    space.see(ALL_ROUND)
    assert space.size > 0
    before = space.version
    space.void()
    assert space.size == 0
    assert space.version > before


def test_cells_wholly_in_a_disc_are_confirmed() -> None:
    space = SeenFree()
    space.confirm(0.5, 0.0, 1.0)
    assert is_free(space, 0.5, 0.0, half_m=0.65)
    assert not is_free(space, 0.5, 0.0, half_m=0.75)
    assert not is_free(space, 1.45, 0.35)


def test_beyond_the_corridor_nothing_is_free() -> None:
    space = seen(1, ALL_ROUND)
    assert is_free(space, 1.0, 3.03)
    before = space.version
    space.limit(3.0)
    assert space.version > before
    assert not is_free(space, 1.0, 3.03)
    assert is_free(space, 1.0, 2.95)
    assert is_free(space.turned((0.0, 0.0), 0.0), 1.0, 3.03)  # another leg, another corridor


def test_a_snapshot_does_not_change_any_more() -> None:
    space = seen(1, ALL_ROUND)
    grid = space.grid()
    assert space.grid() is grid
    space.void()
    assert grid.is_free(1.0, 2.0, 0.0, 1.0)
    assert not space.grid().is_free(1.0, 2.0, 0.0, 1.0)


def test_small_rectangles_are_asked_without_a_snapshot() -> None:
    space = seen(1, replace(ALL_ROUND, boxes=(Box(1.0, 1.5, 0.0, 1.0),)))
    random = np.random.default_rng(2)
    low = random.uniform(-6.0, 6.0, (400, 2))
    high = low + random.uniform(0.0, 0.5, (400, 2))
    answers = space.grid().are_free(low[:, 0], high[:, 0], low[:, 1], high[:, 1])
    for index in range(400):
        one = slice(index, index + 1)
        faces = (low[one, 0], high[one, 0], low[one, 1], high[one, 1])
        assert space.are_free(*faces) == answers[index]
    centres = space.holds(low[:, 0], low[:, 1])
    points = space.grid().are_free(low[:, 0], low[:, 0], low[:, 1], low[:, 1])
    assert (centres == points).all()
    assert not space.holds(np.array([math.nan, 1e30]), np.array([0.0, 0.0])).any()


@settings(max_examples=25)
@given(
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.sampled_from([0.0, math.pi / 2.0, math.pi, -0.3]) | st.floats(-math.pi, math.pi),
    st.integers(0, 2**32 - 1),
)
def test_a_turn_to_another_leg_frees_nothing_that_was_not_free(
    x_m: float, y_m: float, turn_rad: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    boxes = [
        Box(x, x + 0.4, y, y + 0.4)
        for x, y in random.uniform(-4.0, 4.0, (5, 2)).tolist()
        if max(abs(x + 0.2), abs(y + 0.2)) > 0.5
    ]
    space = seen(1, replace(ALL_ROUND, boxes=boxes), reach_m=5.0)
    turned = space.turned((x_m, y_m), turn_rad)
    points = random.uniform(-9.0, 9.0, (20_000, 2))
    free = turned.grid().are_free(points[:, 0], points[:, 0], points[:, 1], points[:, 1])
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    old_x_m = x_m + cosine * points[:, 0] - sine * points[:, 1]
    old_y_m = y_m + sine * points[:, 0] + cosine * points[:, 1]
    was_free = space.grid().are_free(old_x_m, old_x_m, old_y_m, old_y_m)
    assert (was_free | ~free).all()
    if boxes or space.size > 0:
        assert turned.size > 0.5 * space.size
    assert turned.version > space.version


@settings(max_examples=25)
@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_shift_moves_the_set_with_the_obstacles(x_m: float, y_m: float) -> None:
    box = Box(1.0, 1.6, -0.3, 0.3)
    space = seen(1, replace(ALL_ROUND, boxes=(box,)), reach_m=6.0)
    before = space.grid()
    space.shift(x_m, y_m)
    points = np.random.default_rng(1).uniform(-7.0, 7.0, (20_000, 2))
    after = space.grid().are_free(points[:, 0], points[:, 0], points[:, 1], points[:, 1])
    old = points - (x_m, y_m)
    was_free = before.are_free(old[:, 0], old[:, 0], old[:, 1], old[:, 1])
    assert (was_free | ~after).all()
    assert after.sum() > 0.7 * was_free.sum()


@pytest.mark.parametrize(("half_width_m", "radius_m"), [(math.inf, 2.0), (1.0, 1.0), (5.0, 2.0)])
def test_the_disc_where_a_leg_begins_ends_at_its_corridor(
    half_width_m: float, radius_m: float
) -> None:
    space = SeenFree(frames_needed=1)
    space.confirm(0.0, 0.0, 2.0)
    turned = space.turned((0.0, 0.0), 0.5)
    turned.limit(half_width_m)
    disc = turned.grid().free_disc
    assert disc is not None
    assert disc[:2] == (0.0, 0.0)
    # Whole cells are free, of 0.1 m: their diagonals are lost on either side.
    assert radius_m - 0.3 <= disc[2] <= radius_m


@pytest.mark.parametrize("half_width_m", [math.inf, 1.55])
def test_a_snapshot_by_what_was_freed_is_that_of_the_whole_set(half_width_m: float) -> None:
    space = seen()
    space.limit(half_width_m)
    for number in range(4):
        before = space.grid().unknown_sum.copy()
        kept = space.grid()
        for step in range(2):  # two changes between two snapshots
            x_m = 0.4 * number + 0.1 * step
            space.see(View((x_m, 0.0), 0.3 * number, 0.5, 3.0, (Box(2.0, 2.3, 0.2, 0.6),), 0.05))
        np.testing.assert_array_equal(kept.unknown_sum, before)  # snapshots do not change
        np.testing.assert_array_equal(
            space.grid().unknown_sum, space._grid(half_width_m).unknown_sum
        )
        assert space.size == np.count_nonzero(space._free)
    space.confirm(0.0, 0.0, 1.0)
    np.testing.assert_array_equal(space.grid().unknown_sum, space._grid(half_width_m).unknown_sum)
    assert space.size == np.count_nonzero(space._free)
