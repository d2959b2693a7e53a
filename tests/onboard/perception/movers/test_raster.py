"""How deep inside an area cells lie: the same as by distances between all cells of the raster."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from onboard.perception.line_of_sight import BoolArray
from onboard.perception.movers.open_cells import OpenCells
from onboard.perception.movers.raster import (
    Rectangle,
    away_from,
    bounds_of,
    depth_of,
    depth_within,
    moved,
)

SIZE = 9
rasters = arrays(np.bool_, (SIZE, SIZE))


def between(cells: BoolArray, *, edge_open: bool) -> list[list[float]]:
    """Return the depth of each cell, by looking at every other one, and at those beyond."""
    beyond = np.full((SIZE + 2, SIZE + 2), edge_open)
    beyond[1:-1, 1:-1] = cells
    others = np.argwhere(~beyond) - 1
    return [
        [
            max(math.sqrt(min(((others - (i, j)) ** 2).sum(axis=1).tolist())) - math.sqrt(2.0), 0.0)
            if len(others)
            else math.inf
            for j in range(SIZE)
        ]
        for i in range(SIZE)
    ]


@given(cells=rasters, edge_open=st.booleans())
def test_the_depth_is_the_distance_to_the_nearest_other_cell(
    cells: BoolArray, edge_open: bool
) -> None:
    assert depth_of(cells, edge_open=edge_open).tolist() == between(cells, edge_open=edge_open)


@given(i=st.integers(0, 7), j=st.integers(0, 7), edge_open=st.booleans())
def test_an_area_in_a_corner_is_as_deep_as_the_whole_raster_tells(
    i: int, j: int, edge_open: bool
) -> None:
    cells = np.zeros((SIZE, SIZE), dtype=bool)
    cells[i:, j:] = True
    assert depth_of(cells, edge_open=edge_open).tolist() == between(cells, edge_open=edge_open)


def test_only_the_bounds_of_an_area_are_looked_at() -> None:
    cells = np.zeros((SIZE, SIZE), dtype=bool)
    cells[2:5, 3:8] = True
    window, depth = depth_within(cells, edge_open=True)
    assert window == (slice(2, 5), slice(3, 8))
    assert depth.shape == (3, 5)


corners = st.integers(0, SIZE - 1)


@given(
    cells=rasters,
    corner=st.tuples(corners, corners),
    depth_m=st.floats(-0.1, 2.5) | st.sampled_from((0.0, (2.0 - math.sqrt(2.0)) * 0.2)),
    shift=st.tuples(st.integers(-3, 3), st.integers(-3, 3)) | st.none(),
)
def test_deep_cells_are_those_whose_depth_says_so(
    cells: BoolArray, corner: tuple[int, int], depth_m: float, shift: tuple[int, int] | None
) -> None:
    cells[: corner[0], : corner[1]] = True
    opened, depth = OpenCells(cells), depth_of(cells, edge_open=False)
    if shift is not None:
        # They stay as deep as they were, whatever the raster no longer holds.
        opened, depth = opened.moved(*shift), moved(depth, *shift, 0.0)
    bounds = Rectangle(1, SIZE, 0, SIZE - 2)
    deep = opened.are_deep(bounds, 0.2, depth_m)
    assert deep.tolist() == (depth[bounds.window] * 0.2 >= depth_m).tolist()
    assert opened.bounds == bounds_of(cells if shift is None else moved(cells, *shift, False))


@given(ends=st.lists(st.tuples(corners, corners, corners, corners), max_size=15))
def test_away_from_rectangles_is_the_depth_of_what_they_leave(
    ends: list[tuple[int, int, int, int]],
) -> None:
    rectangles = [
        Rectangle(min(i, k), max(i, k) + 1, min(j, m), max(j, m) + 1) for i, j, k, m in ends
    ]
    left = np.ones((SIZE, SIZE), dtype=bool)
    for rectangle in rectangles:
        left[rectangle.window] = False
    away = away_from(rectangles, SIZE)
    assert away.tolist() == between(left, edge_open=True)


@pytest.mark.parametrize(("di", "dj"), [(3, 0), (-4, 2), (20, 0), (0, -20)])
def test_a_rectangle_moves_with_its_cells(di: int, dj: int) -> None:
    rectangle = Rectangle(1, 4, 5, 9)
    shifted = rectangle.shifted(di, dj, SIZE)
    cells = {(i - di, j - dj) for i in range(1, 4) for j in range(5, 9)}
    kept = {(i, j) for i, j in cells if 0 <= i < SIZE and 0 <= j < SIZE}
    assert shifted.cells == len(kept)
    assert {
        (i, j) for i in range(shifted.i0, shifted.i1) for j in range(shifted.j0, shifted.j1)
    } == kept
