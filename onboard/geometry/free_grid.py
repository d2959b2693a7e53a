"""A raster that says which cells are free, and answers for rectangles."""

from __future__ import annotations

from dataclasses import dataclass
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
    """

    origin_leg_m: tuple[float, float]
    cell_m: float
    unknown_sum: FloatArray

    def is_free(self, x_min_m: float, x_max_m: float, y_min_m: float, y_max_m: float) -> bool:
        """Tell whether a closed rectangle holds no unknown cell; none is known outside the grid."""
        faces = (np.array([face]) for face in (x_min_m, x_max_m, y_min_m, y_max_m))
        return bool(self.are_free(*faces)[0])

    def are_free(
        self, x_min_m: FloatArray, x_max_m: FloatArray, y_min_m: FloatArray, y_max_m: FloatArray
    ) -> BoolArray:
        """Tell for each closed rectangle whether it holds no unknown cell; arrays of any shape."""
        (x_m, y_m), cell_m, table = self.origin_leg_m, self.cell_m, self.unknown_sum
        i0 = np.floor((x_min_m - x_m) / cell_m).astype(int)
        i1 = np.ceil((x_max_m - x_m) / cell_m).astype(int)
        j0 = np.floor((y_min_m - y_m) / cell_m).astype(int)
        j1 = np.ceil((y_max_m - y_m) / cell_m).astype(int)
        last_i, last_j = table.shape[0] - 1, table.shape[1] - 1
        inside = (i0 >= 0) & (j0 >= 0) & (i1 <= last_i) & (j1 <= last_j)
        i0, i1 = np.clip(i0, 0, last_i), np.clip(i1, 0, last_i)
        j0, j1 = np.clip(j0, 0, last_j), np.clip(j1, 0, last_j)
        unknown = table[i1, j1] - table[i0, j1] - table[i1, j0] + table[i0, j0]
        free: BoolArray = inside & (unknown == 0)
        return free
