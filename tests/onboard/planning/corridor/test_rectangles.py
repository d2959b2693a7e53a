"""Free rectangles: never smaller than asked for, and as large as the unknown cells let them."""

from __future__ import annotations

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


def test_outside_the_grid_nothing_is_free() -> None:
    assert not corridor([]).is_free(Rectangle(4.0, 4.9, 0.0, 0.0))
