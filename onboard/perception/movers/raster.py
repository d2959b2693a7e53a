"""Arrays of cells around the vehicle: how deep inside an area each lies, and moving the window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeVar

import numpy as np
from scipy.ndimage import distance_transform_edt

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray

_Cells = TypeVar("_Cells", FloatArray, BoolArray)
# Of more rectangles than these, the transform of all cells is no slower.
_RECTANGLES_MAX: Final = 12


class Rectangle(NamedTuple):
    """Cells of a raster, from the first row and column to before the last."""

    i0: int
    i1: int
    j0: int
    j1: int

    @property
    def cells(self) -> int:
        """How many."""
        return max(self.i1 - self.i0, 0) * max(self.j1 - self.j0, 0)

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.i0, self.i1), slice(self.j0, self.j1)

    def shifted(self, di: int, dj: int, size: int) -> Rectangle:
        """Return what is left of it on a raster that has moved by whole cells; may be empty."""
        i0, i1, j0, j1 = (
            min(max(index - step, 0), size)
            for index, step in zip(self, (di, di, dj, dj), strict=True)
        )
        return Rectangle(i0, i1, j0, j1)


def shifted(rectangles: Sequence[Rectangle], di: int, dj: int, size: int) -> list[Rectangle]:
    """Return what is left of some rectangles on a raster that has moved by whole cells."""
    left = (rectangle.shifted(di, dj, size) for rectangle in rectangles)
    return [rectangle for rectangle in left if rectangle.cells]


class Depth(NamedTuple):
    """How many cells lie at least between each of some cells and the nearest other one.

    Attributes:
        window: rows and columns that hold all of them; everywhere else the depth is 0.
        cells: the depth within the window, 0 where a cell is none of them.
    """

    window: tuple[slice, slice]
    cells: FloatArray


def bounds_of(cells: BoolArray) -> Rectangle:
    """Return the least rectangle that holds some cells; an empty one for none."""
    rows = np.flatnonzero(cells.any(axis=1))
    if not rows.size:
        return Rectangle(0, 0, 0, 0)
    i0, i1 = int(rows[0]), int(rows[-1]) + 1
    columns = np.flatnonzero(cells[i0:i1].any(axis=0))
    return Rectangle(i0, i1, int(columns[0]), int(columns[-1]) + 1)


def depth_within(cells: BoolArray, *, edge_open: bool) -> Depth:
    """Return how deep inside an area each of its cells lies, where the area is.

    From centre to centre it is the square root of two more, at most.  Beyond the area's bounds no
    cell is nearer than the ring around them, so that only they are looked at.

    Args:
        cells: those inside.
        edge_open: whether what lies beyond the raster counts as inside.
    """
    bounds = bounds_of(cells)
    i0, i1, j0, j1 = bounds
    if i0 == i1:
        return Depth(bounds.window, np.zeros((0, 0)))
    padded = np.zeros((i1 - i0 + 2, j1 - j0 + 2), dtype=bool)
    padded[1:-1, 1:-1] = cells[bounds.window]
    if edge_open:
        rows, columns = cells.shape
        padded[0] |= i0 == 0
        padded[-1] |= i1 == rows
        padded[:, 0] |= j0 == 0
        padded[:, -1] |= j1 == columns
        if padded.all():
            return Depth(bounds.window, np.full((i1 - i0, j1 - j0), math.inf))
    # Its own distances take as long as the search for what is nearest.
    nearest = distance_transform_edt(padded, return_distances=False, return_indices=True)
    di = nearest[0, 1:-1, 1:-1] - np.arange(1, i1 - i0 + 1, dtype=np.int32)[:, None]
    dj = nearest[1, 1:-1, 1:-1] - np.arange(1, j1 - j0 + 1, dtype=np.int32)
    return Depth(bounds.window, _between(di * di + dj * dj))


def depth_of(cells: BoolArray, *, edge_open: bool) -> FloatArray:
    """Return the same for the whole raster, see `depth_within`."""
    window, depth = depth_within(cells, edge_open=edge_open)
    whole = np.zeros(cells.shape)
    whole[window] = depth
    return whole


def away_from(rectangles: Sequence[Rectangle], size: int) -> FloatArray:
    """Return how many cells lie at least between each cell of a raster and some rectangles.

    What `depth_of` says of all other cells, where what lies beyond the raster counts as inside.

    Args:
        rectangles: none of them empty.
        size: of the raster.
    """
    if not rectangles:
        return np.full((size, size), math.inf)
    if len(rectangles) > _RECTANGLES_MAX:
        others = np.ones((size, size), dtype=bool)
        for rectangle in rectangles:
            others[rectangle.window] = False
        return depth_of(others, edge_open=True)
    index = np.arange(size, dtype=np.int32)
    least = None
    for i0, i1, j0, j1 in rectangles:
        di = np.maximum(np.maximum(i0 - index, index - (i1 - 1)), 0)
        dj = np.maximum(np.maximum(j0 - index, index - (j1 - 1)), 0)
        squares = (di * di)[:, None] + dj * dj
        least = squares if least is None else np.minimum(least, squares, out=least)
    assert least is not None  # noqa: S101  there is one at least
    return _between(least)


def _between(squares: FloatArray) -> FloatArray:
    """Return how many cells lie between two whose centres are so far apart, at least."""
    depth: FloatArray = np.sqrt(squares, dtype=np.float64)
    depth -= math.sqrt(2.0)
    return np.maximum(depth, 0.0, out=depth)


def moved(cells: _Cells, di: int, dj: int, fill: float) -> _Cells:
    """Return the window moved by whole cells; new cells get a value."""
    window = np.full_like(cells, fill)
    size = cells.shape[0]
    if abs(di) >= size or abs(dj) >= size:
        return window
    source = cells[max(di, 0) : size + min(di, 0), max(dj, 0) : size + min(dj, 0)]
    window[max(-di, 0) : size + min(-di, 0), max(-dj, 0) : size + min(-dj, 0)] = source
    return window
