"""Free rectangles: as far as each piece of a plan may move inside the space that was seen free."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid

# A rectangle grows no farther than this at once.
_GROWTH_MAX_M: Final = 6.0
# Half sides of rectangles that together cover a disc of radius 1: they end at equal angles.
_COVER_RAD: Final = np.linspace(0.0, math.pi / 2.0, 9)
COVER: Final = tuple(
    zip(np.cos(_COVER_RAD[:-1]).tolist(), np.sin(_COVER_RAD[1:]).tolist(), strict=True)
)


class Rectangle(NamedTuple):
    """A rectangle in the leg frame that the path and its run-on may use; the body adds to it."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float

    def contains(self, other: Rectangle) -> bool:
        """Tell whether another rectangle lies inside this one."""
        return (
            self.x_min_m <= other.x_min_m
            and other.x_max_m <= self.x_max_m
            and self.y_min_m <= other.y_min_m
            and other.y_max_m <= self.y_max_m
        )


class Corridor:
    """Grows rectangles in a grid for a body of one radius.

    The body is taken for its square, where there is room for that; else for its disc, as the
    certifier does.  A vehicle may rest where only its disc is free, and has to get away from there.
    """

    def __init__(self, grid: FreeGrid, body_radius_m: float) -> None:
        self._grid, self._radius_m = grid, body_radius_m
        self._x_m, self._y_m = grid.origin_leg_m
        self._table = grid.unknown_sum

    def is_free(self, r: Rectangle) -> bool:
        """Tell whether the body's square may be anywhere in a rectangle."""
        return self._are_free(self._cells(r, self._radius_m, self._radius_m))

    def has_room(self, r: Rectangle) -> bool:
        """Tell whether the body's disc may be anywhere in a rectangle."""
        return self.is_free(r) or all(self._are_free(cells) for cells in self._cells_of_disc(r))

    def grown(self, rectangle: Rectangle, direction: tuple[float, float]) -> Rectangle:
        """Move each face out to the first unknown cell in its strip, the leading one first.

        Args:
            rectangle: has room.
            direction: (x, y) towards which the plan should get on.
        """
        radius_m = self._radius_m
        faces, cells = list(rectangle), list(self._cells(rectangle, radius_m, radius_m))
        if not self._are_free(cells):
            return self._grown_for_disc(rectangle, direction)
        for face in _order(*direction):
            faces[face], cells[face] = self._moved(faces[face], cells, face, radius_m)
        return Rectangle(*faces)

    def _grown_for_disc(self, rectangle: Rectangle, direction: tuple[float, float]) -> Rectangle:
        """Move each face as far as every part of the disc's cover lets it."""
        faces = list(rectangle)
        for face in _order(*direction):
            reached_m = [
                self._moved(faces[face], cells, face, self._radius_m * half[face // 2])[0]
                for half, cells in zip(COVER, self._cells_of_disc(Rectangle(*faces)), strict=True)
            ]
            faces[face] = min(reached_m) if face % 2 else max(reached_m)
        return Rectangle(*faces)

    def _are_free(self, cells: Sequence[int]) -> bool:
        i0, i1, j0, j1 = cells
        table = self._table
        if i0 < 0 or j0 < 0 or i1 >= table.shape[0] or j1 >= table.shape[1]:
            return False
        return bool(table[i1, j1] - table[i0, j1] - table[i1, j0] + table[i0, j0] == 0)

    def _moved(
        self, at_m: float, cells: Sequence[int], face: int, half_m: float
    ) -> tuple[float, int]:
        """Return where a face may be moved to, and the index of its cells there."""
        cell_m = self._grid.cell_m
        origin_m = self._x_m if face < 2 else self._y_m
        reach = math.ceil(_GROWTH_MAX_M / cell_m) + 3
        index = cells[face]
        if face % 2:  # towards greater coordinates
            strip = self._strip(cells, face, index, index + reach)
            last = index + int(strip.searchsorted(strip[0], side="right")) - 1
            free_m = min(origin_m + last * cell_m - half_m, at_m + _GROWTH_MAX_M)
            moved_m = max(at_m, free_m)
            return moved_m, math.ceil((moved_m + half_m - origin_m) / cell_m - 1e-9)
        first = max(index + 1 - reach, 0)
        strip = self._strip(cells, face, first, index + 1)
        last = first + int(strip.searchsorted(strip[-1], side="left"))
        free_m = max(origin_m + last * cell_m + half_m, at_m - _GROWTH_MAX_M)
        moved_m = min(at_m, free_m)
        return moved_m, math.floor((moved_m - half_m - origin_m) / cell_m + 1e-9)

    def _strip(self, cells: Sequence[int], face: int, first: int, last: int) -> NDArray[np.int32]:
        """Return how many unknown cells lie beside the rectangle up to each line of cells."""
        i0, i1, j0, j1 = cells
        if face < 2:
            lines = self._table[first:last]
            strip: NDArray[np.int32] = lines[:, j1] - lines[:, j0]
            return strip
        return self._table[i1, first:last] - self._table[i0, first:last]

    def _cells_of_disc(self, r: Rectangle) -> list[tuple[int, int, int, int]]:
        """Index ranges of each rectangle of the cover of a rectangle that the disc grows."""
        radius_m = self._radius_m
        return [self._cells(r, radius_m * x, radius_m * y) for x, y in COVER]

    def _cells(self, r: Rectangle, half_x_m: float, half_y_m: float) -> tuple[int, int, int, int]:
        """Index ranges of the cells that a grown rectangle touches."""
        cell_m = self._grid.cell_m
        return (
            math.floor((r.x_min_m - half_x_m - self._x_m) / cell_m + 1e-9),
            math.ceil((r.x_max_m + half_x_m - self._x_m) / cell_m - 1e-9),
            math.floor((r.y_min_m - half_y_m - self._y_m) / cell_m + 1e-9),
            math.ceil((r.y_max_m + half_y_m - self._y_m) / cell_m - 1e-9),
        )


def _order(x: float, y: float) -> tuple[int, int, int, int]:
    """Return the faces (x min, x max, y min, y max) by index, ahead first and behind last."""
    along = (1, 0) if x >= 0.0 else (0, 1)
    across = (3, 2) if y >= 0.0 else (2, 3)
    if abs(x) >= abs(y):
        return along[0], across[0], across[1], along[1]
    return across[0], along[0], along[1], across[1]


def unbroken_m(
    path: FloatArray, lengths_m: FloatArray, r: Rectangle, near_leg_m: FloatArray
) -> float:
    """Return how far along the path a rectangle holds it without a break, from near a point on."""
    x, y = path[:, 0], path[:, 1]
    inside = (
        (x >= r.x_min_m - 0.05)
        & (x <= r.x_max_m + 0.05)
        & (y >= r.y_min_m - 0.05)
        & (y <= r.y_max_m + 0.05)
    )
    (within,) = inside.nonzero()
    if not within.size:
        beside = np.maximum(np.maximum(r.x_min_m - x, x - r.x_max_m), 0.0) ** 2
        beside += np.maximum(np.maximum(r.y_min_m - y, y - r.y_max_m), 0.0) ** 2
        return float(lengths_m[int(beside.argmin())])
    dx_m, dy_m = x[within] - near_leg_m[0], y[within] - near_leg_m[1]
    first = within[(dx_m * dx_m + dy_m * dy_m).argmin()]
    (beyond,) = (~inside[first:]).nonzero()
    last = first + int(beyond[0]) - 1 if beyond.size else len(path) - 1
    return float(lengths_m[min(last + 1, len(path) - 1)])
