"""A raster that says which cells are free, and answers for rectangles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from onboard.geometry.frames import FloatArray

    BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FreeGrid:
    """A snapshot of the seen-free set that answers questions about rectangles in O(1).

    Attributes:
        origin_leg_m: corner of the grid with the least x and y.
        cell_m: edge of a cell.
        unknown_sum: (nx + 1, ny + 1), number of unknown cells below and left of each corner.
        free_disc: (x, y, radius) of a disc that is free besides, whatever its cells are.
        level_m: how far above or below the leg that still holds; infinite at every height.
    """

    origin_leg_m: tuple[float, float]
    cell_m: float
    unknown_sum: NDArray[np.int32]
    free_disc: tuple[float, float, float] | None = None
    level_m: float = math.inf

    @property
    def free_cells(self) -> int:
        """Number of cells that are known to be free."""
        nx, ny = self.unknown_sum.shape
        return int((nx - 1) * (ny - 1) - self.unknown_sum[-1, -1])

    def without(self, first: tuple[int, int], shut: BoolArray) -> FreeGrid:
        """Return the grid with some cells not free.

        Args:
            first: indices of the cell with which they begin.
            shut: (n, m), which of the cells from there on, all within the grid.
        """
        cells = np.zeros(self.unknown_sum.shape, self.unknown_sum.dtype)
        (i, j), (rows, columns) = first, shut.shape
        # A cell that is unknown already counts twice, which is no more unknown.
        cells[i + 1 : i + 1 + rows, j + 1 : j + 1 + columns] = shut
        more = cells.cumsum(axis=0).cumsum(axis=1)
        return replace(self, unknown_sum=(self.unknown_sum + more).astype(cells.dtype))

    def is_free(self, x_min_m: float, x_max_m: float, y_min_m: float, y_max_m: float) -> bool:
        """Tell whether a closed rectangle holds no unknown cell; none is known outside the grid."""
        faces = (np.array([face]) for face in (x_min_m, x_max_m, y_min_m, y_max_m))
        return bool(self.are_free(*faces)[0])

    def are_free(
        self, x_min_m: FloatArray, x_max_m: FloatArray, y_min_m: FloatArray, y_max_m: FloatArray
    ) -> BoolArray:
        """Tell for each closed rectangle whether it holds no unknown cell; arrays of any shape."""
        return self.are_free_between(
            np.array((x_min_m, y_min_m), np.float64), np.array((x_max_m, y_max_m), np.float64)
        )

    def are_free_between(self, low_m: FloatArray, high_m: FloatArray) -> BoolArray:
        """Tell the same of rectangles between two corners each; both axes at once.

        Args:
            low_m: least x and y, (2, ...).
            high_m: greatest x and y, (2, ...).
        """
        axes, table = (2, *(1,) * (low_m.ndim - 1)), self.unknown_sum
        origin_m, sizes = np.array(self.origin_leg_m).reshape(axes), np.reshape(table.shape, axes)
        first, last = (low_m - origin_m) / self.cell_m, (high_m - origin_m) / self.cell_m
        np.floor(first, out=first)
        np.ceil(last, out=last)
        # Compared as floats, so that what is not finite is outside, on every processor.
        each = (first >= 0) & (low_m <= high_m) & (last < sizes)
        inside: BoolArray = each[0] & each[1]
        if not inside.all():
            first, last = np.where(inside, first, 0.0), np.where(inside, last, 0.0)
        i_j0, i_j1 = first.astype(int), last.astype(int)
        # A rectangle without extent on the edge of a cell still lies in a cell.
        np.maximum(i_j1, i_j0 + 1, out=i_j1)
        within = i_j1 < sizes
        if not within.all():
            inside &= within[0] & within[1]
            i_j0, i_j1 = np.where(inside, i_j0, 0), np.where(inside, i_j1, 0)
        (i0, j0), (i1, j1) = i_j0, i_j1
        unknown = table[i1, j1] - table[i0, j1] - table[i1, j0] + table[i0, j0]
        free: BoolArray = inside & (unknown == 0)
        return free
