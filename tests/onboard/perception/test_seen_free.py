"""The seen-free set: rows of frames, moves of the grid, turns to other legs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.geometry.box import Box
from onboard.geometry.fence import Fence, FenceArea
from onboard.geometry.frames import LegFrame
from onboard.perception.cells import eroded, shifted
from onboard.perception.line_of_sight import View, seen_free
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


# --- the parts against slow ones


def speckled(seed: int = 6, free: float = 0.9) -> SeenFree:
    """A small set with cells at random, off the middle of its frame."""
    space = SeenFree(frames_needed=1, reach_m=2.0)
    space._free[:] = np.random.default_rng(seed).random(space._free.shape) < free
    space._has_changed()
    return space


def test_the_middle_and_the_reach_of_the_grid() -> None:
    space = SeenFree(reach_m=5.0)
    assert space.reach_m == pytest.approx(9.0)
    assert space.centre_leg_m == (0.0, 0.0)
    for x_m, y_m, middle_m in ((1.9, -1.9, (0.0, 0.0)), (2.1, -6.1, (4.0, -8.0))):
        space.centre_on(x_m, y_m)
        assert space.centre_leg_m == pytest.approx(middle_m)


@pytest.mark.parametrize(("di", "dj"), [(0, 0), (2, -1), (-3, 2), (0, 6), (-7, 0), (7, 7)])
def test_cells_are_moved_one_by_one(di: int, dj: int) -> None:
    cells = np.random.default_rng(7).random((7, 7)) < 0.5
    moved = shifted(cells, di, dj)
    for i in range(7):
        for j in range(7):
            inside = 0 <= i + di < 7 and 0 <= j + dj < 7
            assert moved[i, j] == (inside and cells[i + di, j + dj])


def test_a_cell_with_an_unknown_neighbour_is_eroded() -> None:
    cells = np.random.default_rng(8).random((9, 9)) < 0.95
    core = eroded(cells)
    for i in range(9):
        for j in range(9):
            inner = 0 < i < 8 and 0 < j < 8
            assert core[i, j] == (inner and cells[i - 1 : i + 2, j - 1 : j + 2].all())


def test_a_set_is_the_same_asked_for_points_rectangles_and_snapshots() -> None:
    space = speckled()
    size, corner = space._free.shape[0], space._corner[0]
    low_m, high_m = corner * 0.1, (corner + size) * 0.1
    edges = np.array([low_m - 1e-9, low_m + 1e-9, 0.05, high_m - 1e-9, high_m + 1e-9, math.inf])
    for x_m in edges:
        held = space.holds(np.full(6, x_m), edges)
        for y_m, found in zip(edges, held, strict=True):
            inside = low_m <= x_m < high_m and low_m <= y_m < high_m
            i, j = (math.floor(c / 0.1) - corner if inside else 0 for c in (x_m, y_m))
            assert found == (inside and space._free[i, j])
    random = np.random.default_rng(9)
    for _ in range(300):
        x0_m, y0_m = random.uniform(low_m - 0.1, high_m, 2)
        x1_m, y1_m = np.add((x0_m, y0_m), random.uniform(0.0, 0.4, 2))
        box = [np.array([value]) for value in (x0_m, x1_m, y0_m, y1_m)]
        assert space.are_free(*box) == space.grid().is_free(x0_m, x1_m, y0_m, y1_m)
    assert space.grid().free_cells == space.size == np.count_nonzero(space._free)


def test_the_free_disc_about_a_place_ends_at_the_nearest_unknown_point() -> None:
    random = np.random.default_rng(10)
    space = speckled(free=0.999)
    low_m = space._corner[0] * 0.1
    corners_m = low_m + 0.1 * np.argwhere(~space._free)
    for x_m, y_m in random.uniform(-7.0, 7.0, (60, 2)):
        nearest = np.clip((x_m, y_m), corners_m, corners_m + 0.1)
        nearest_m = float(np.hypot(*(nearest - (x_m, y_m)).T).min())
        edge_m = min(x_m, y_m, -x_m, -y_m) - low_m
        expected_m = min(nearest_m, edge_m)
        if max(0.0, expected_m) < 2.9:
            assert space.free_radius_m(x_m, y_m) == pytest.approx(max(0.0, expected_m), abs=1e-9)
    everywhere = speckled(free=2.0)
    assert 2.9 <= everywhere.free_radius_m(0.0, 0.0) <= 3.1
    # What was free where the vehicle rested stays so, less the way from there.
    everywhere.void()
    everywhere._rest_disc = (1.0, 2.0, 0.8)
    assert everywhere.free_radius_m(1.3, 2.4) == pytest.approx(0.3)
    assert everywhere.free_radius_m(-1.0, 2.0) == 0.0
    everywhere.shift(0.5, -0.7)
    assert everywhere.free_radius_m(1.5, 1.3) == pytest.approx(0.8)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_quarter_turn_keeps_what_is_free_with_its_neighbours(quarters: int) -> None:
    """The circumscribed square of a turned cell reaches a little into its neighbours."""
    space, turn_rad = speckled(free=0.97), quarters * math.pi / 2.0
    turned = space.turned((1.0, -0.5), turn_rad)
    cosine, sine = round(math.cos(turn_rad)), round(math.sin(turn_rad))
    sure = eroded(space._free)
    corner, size = space._corner[0], space._free.shape[0]
    kept = 0
    for i in range(0, turned._free.shape[0], 3):
        for j in range(0, turned._free.shape[1], 3):
            x_m, y_m = ((each + 0.5 + turned._corner[0]) * 0.1 for each in (i, j))
            old_x_m = 1.0 + cosine * x_m - sine * y_m
            old_y_m = -0.5 + sine * x_m + cosine * y_m
            a, b = (math.floor(c / 0.1 + 1e-6) - corner for c in (old_x_m, old_y_m))
            inside = 0 <= a < size and 0 <= b < size
            assert turned._free[i, j] >= (inside and sure[a, b])
            assert turned._free[i, j] <= (inside and space._free[a, b])
            kept += int(turned._free[i, j])
    assert kept > 100


def test_the_window_of_a_frame_holds_all_that_it_shows_and_little_more() -> None:
    for heading_rad in np.linspace(-3.0, 3.0, 7).tolist():
        for half_rad in (0.3, 1.2, math.pi / 2.0, 2.5, math.pi):
            view = replace(ALL_ROUND, heading_leg_rad=heading_rad, half_view_rad=half_rad)
            space = SeenFree(frames_needed=1, reach_m=7.0)
            whole = slice(0, space._free.shape[0])
            xs_m, ys_m = space._centres(whole, whole)
            x_m, y_m = np.meshgrid(xs_m, ys_m, indexing="ij")
            shown = seen_free(view, x_m.ravel(), y_m.ravel(), 0.1).reshape(x_m.shape)
            space.see(view)
            assert (space._free == shown).all()
            window = space._window(view)
            assert window is not None
            cells = [np.flatnonzero(shown.any(axis=1 - axis)) for axis in (0, 1)]
            for part, found in zip(window, cells, strict=True):
                assert part.start <= found[0] <= part.start + 12
                assert part.stop - 12 <= found[-1] + 1 <= part.stop
    beyond = replace(ALL_ROUND, position_leg_m=(40.0, 0.0))
    assert SeenFree(frames_needed=1, reach_m=7.0)._window(beyond) is None


def test_a_turned_set_reaches_as_far_and_keeps_off_what_its_cells_touch() -> None:
    space = seen(1, replace(ALL_ROUND, boxes=(Box(1.0, 1.5, 0.0, 1.0),)))
    turned = space.turned((0.0, 0.0), 0.0)
    assert turned.reach_m == space.reach_m
    # Turned by nothing, its cells are the same: one that touches an unknown cell may lie in it.
    np.testing.assert_array_equal(turned._free, eroded(space._free))


def test_a_fence_is_where_it_is_whatever_way_the_leg_points() -> None:
    """A leg east from (10, 20): x is east of 20, y is south of 10."""
    corners = ((8.0, 18.0), (8.0, 23.0), (11.0, 23.0), (11.0, 18.0))
    fence = Fence((FenceArea(corners, None, keeps_in=True),))
    space = seen(1, ALL_ROUND)
    space.keep_in(fence, LegFrame((10.0, 20.0, -4.0), math.pi / 2.0))
    assert is_free(space, 2.5, 1.5)
    assert is_free(space, -1.5, -0.5)
    for x_m, y_m in ((3.5, 0.5), (1.5, 2.5), (1.5, -1.5), (-2.5, 0.5)):
        assert not is_free(space, x_m, y_m)
        assert is_free(seen(1, ALL_ROUND), x_m, y_m)
