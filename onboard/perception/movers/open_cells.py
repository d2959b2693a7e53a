"""Cells that a frame shows open: which of them lie deep enough among them.

Mostly a few cells are deep enough, for which shifting the cells about is a fifth of the work of all
distances; these are computed where more is asked.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray
from onboard.perception.movers.raster import Rectangle, bounds_of, depth_of, moved

# Farther apart than this, in cells, all distances are computed.
_SHIFTS_MAX: Final = 7
# By squared distance of two centres: how many cells lie between at least, as `depth_of` says.
_DEPTHS: Final = np.maximum(np.sqrt(np.arange((_SHIFTS_MAX + 1) ** 2 + 1)) - math.sqrt(2.0), 0.0)


class OpenCells:
    """Cells of a raster that a frame shows open; beyond the raster none is.

    Args:
        cells: (n, n).

    Attributes:
        bounds: hold all of them.
    """

    def __init__(self, cells: BoolArray) -> None:
        self._cells = cells
        self.bounds = bounds_of(cells)
        self._depth: FloatArray | None = None

    def moved(self, di: int, dj: int) -> OpenCells:
        """Return them on a raster that has moved by whole cells, as deep as they were."""
        after = OpenCells(moved(self._cells, di, dj, False))
        after._depth = moved(self._all_depths(), di, dj, 0)
        return after

    def are_deep(self, bounds: Rectangle, cell_m: float, depth_m: float) -> BoolArray:
        """Tell of the cells of a window whether each lies so deep among the open ones.

        Args:
            bounds: the window.
            cell_m: edge of a cell.
            depth_m: to the nearest cell that is not open, at least.
        """
        squares = int(np.searchsorted(_DEPTHS * cell_m, depth_m))
        if self._depth is None and squares < _DEPTHS.size:
            return self._without_others(bounds, squares)
        deep: BoolArray = self._all_depths()[bounds.window] * cell_m >= depth_m
        return deep

    def _all_depths(self) -> FloatArray:
        if self._depth is None:
            self._depth = depth_of(self._cells, edge_open=False)
        return self._depth

    def _without_others(self, bounds: Rectangle, squares: int) -> BoolArray:
        """Tell of the cells of a window whether none that is not open is nearer than a root."""
        rows, columns = bounds.i1 - bounds.i0, bounds.j1 - bounds.j0
        if squares == 0:
            return np.ones((rows, columns), dtype=bool)
        reach = math.isqrt(squares - 1)
        around = self._around(bounds, reach)
        # All open in a row to both sides, by how far; then by rows above and below.
        in_row = [around[:, reach : reach + columns]]
        for j in range(1, reach + 1):
            sides = around[:, reach - j :][:, :columns] & around[:, reach + j :][:, :columns]
            in_row.append(in_row[-1] & sides)
        deep = in_row[reach][reach : reach + rows].copy()
        for i in range(1, reach + 1):
            within = in_row[math.isqrt(squares - 1 - i * i)]
            deep &= within[reach - i :][:rows]
            deep &= within[reach + i :][:rows]
        return deep

    def _around(self, bounds: Rectangle, reach: int) -> BoolArray:
        """Return the cells of a window and around it."""
        i0, i1, j0, j1 = bounds
        around = np.zeros((i1 - i0 + 2 * reach, j1 - j0 + 2 * reach), dtype=bool)
        first_i, first_j = max(i0 - reach, 0), max(j0 - reach, 0)
        part = self._cells[first_i : i1 + reach, first_j : j1 + reach]
        at_i, at_j = first_i - (i0 - reach), first_j - (j0 - reach)
        around[at_i : at_i + part.shape[0], at_j : at_j + part.shape[1]] = part
        return around
