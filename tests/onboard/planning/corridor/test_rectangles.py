"""Free rectangles: never smaller than asked for, and as large as the unknown cells let them."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.free_grid import FreeGrid
from onboard.planning.corridor.rectangles import Corridor, Rectangle

CELL_M, SIDE, RADIUS_M = 0.1, 100, 0.302


def corridor(unknown: list[tuple[int, int]]) -> Corridor:
    cells = np.zeros((SIDE, SIDE), np.int64)
    for i, j in unknown:
        cells[i, j] = 1
    table = np.zeros((SIDE + 1, SIDE + 1), np.int32)
    table[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return Corridor(FreeGrid((-5.0, -5.0), CELL_M, table), RADIUS_M)


cells = st.lists(st.tuples(st.integers(0, SIDE - 1), st.integers(0, SIDE - 1)), max_size=30)
places = st.floats(-3.0, 3.0)
lengths = st.floats(0.0, 1.0)
directions = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@given(cells, places, places, lengths, lengths, directions)
def test_a_grown_rectangle_is_free_and_holds_the_one_it_grew_from(
    unknown: list[tuple[int, int]],
    x_m: float,
    y_m: float,
    length_m: float,
    width_m: float,
    direction: tuple[float, float],
) -> None:
    room = corridor(unknown)
    small = Rectangle(x_m, x_m + length_m, y_m, y_m + width_m)
    if not room.is_free(small):
        return
    grown = room.grown(small, direction)
    assert grown.contains(small)
    assert room.is_free(grown)
    for face, sign in enumerate((-1.0, 1.0, -1.0, 1.0)):
        faces = list(grown)
        faces[face] += sign * 1.01 * CELL_M
        moved_m = abs(grown[face] - small[face])
        assert moved_m > 5.9 or not room.is_free(Rectangle(*faces))


def test_it_grows_ahead_first() -> None:
    room = corridor([(80, 60)])  # 3 m ahead, 1 m to the right
    place = Rectangle(0.0, 0.0, 0.0, 0.0)
    assert room.grown(place, (1.0, 0.1)).x_max_m > 4.0
    assert room.grown(place, (0.1, 1.0)).y_max_m > 4.0


@given(cells, places, places, directions)
def test_where_only_the_disc_of_the_body_has_room_a_rectangle_still_grows(
    unknown: list[tuple[int, int]], x_m: float, y_m: float, direction: tuple[float, float]
) -> None:
    room = corridor(unknown)
    place = Rectangle(x_m, x_m, y_m, y_m)
    if not room.has_room(place):
        return
    grown = room.grown(place, direction)
    assert grown.contains(place)
    assert room.has_room(grown)
    # Whatever the body's disc covers anywhere in it has been seen free.
    for cell_x_m, cell_y_m in ((0.1 * i - 5.0, 0.1 * j - 5.0) for i, j in unknown):
        beside_x_m = max(grown.x_min_m - cell_x_m - CELL_M, cell_x_m - grown.x_max_m, 0.0)
        beside_y_m = max(grown.y_min_m - cell_y_m - CELL_M, cell_y_m - grown.y_max_m, 0.0)
        assert math.hypot(beside_x_m, beside_y_m) >= RADIUS_M - 1e-6


def test_from_beside_unknown_cells_it_grows_away_from_them() -> None:
    # Within the square around the place, outside the disc: ahead to the left, behind to the left.
    room = corridor([(52, 46), (47, 46)])
    place = Rectangle(0.0, 0.0, 0.0, 0.0)
    assert not room.is_free(place)
    assert room.has_room(place)
    grown = room.grown(place, (0.1, 1.0))
    assert grown.y_max_m > 4.0
    assert -0.1 < grown.y_min_m <= 0.0 <= grown.x_max_m < 0.2


def test_outside_the_grid_nothing_is_free() -> None:
    assert not corridor([]).is_free(Rectangle(4.0, 4.9, 0.0, 0.0))
