"""What is known of the ways from places that have left the guide's window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.planning.corridor.raster import IntArray

# Cells around the window that are remembered at least; it moves in steps of half as many.
_BEYOND: Final = 192


class Memory:
    """The greatest distance to the goal that was ever computed for each cell around the window.

    Distances are computed as if unseen space were free, so that they only grow as more is seen: the
    greatest is the best.  A vehicle that has turned back from a way that leads nowhere does not
    try it again as soon as the end of that way is out of its window.

    Args:
        shape: of the window, in cells.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._left_m = np.zeros([count + 2 * _BEYOND for count in shape])
        self._low: tuple[int, int] | None = None

    def add(self, low: tuple[int, int], left_m: FloatArray) -> None:
        """Remember the distances of a window.

        Args:
            low: indices of its first cell, on the raster of the goal.
            left_m: (nx, ny).
        """
        i, j = self._moved_to(low)
        window = self._left_m[i : i + left_m.shape[0], j : j + left_m.shape[1]]
        np.maximum(window, left_m, out=window)

    def clear(self) -> None:
        """Forget everything."""
        self._left_m[:] = 0.0

    def left_m(self, i: IntArray, j: IntArray) -> FloatArray:
        """Return the distances from cells by their indices; 0 where nothing is known."""
        if self._low is None:
            return np.zeros(i.shape)
        i, j = i - self._low[0], j - self._low[1]
        rows, columns = self._left_m.shape
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        found = self._left_m[np.where(inside, i, 0), np.where(inside, j, 0)]
        return np.where(inside, found, 0.0)

    def _moved_to(self, low: tuple[int, int]) -> tuple[int, int]:
        """Move along with the window where it comes near the edge; return where it begins."""
        if self._low is None:
            self._low = (low[0] - _BEYOND, low[1] - _BEYOND)
        offset = (low[0] - self._low[0], low[1] - self._low[1])
        if max(abs(value - _BEYOND) for value in offset) > _BEYOND // 2:
            moved = np.zeros_like(self._left_m)
            new, old = zip(
                *(
                    _overlap(value - _BEYOND, count)
                    for value, count in zip(offset, moved.shape, strict=True)
                ),
                strict=True,
            )
            moved[new] = self._left_m[old]
            self._left_m, self._low = moved, (low[0] - _BEYOND, low[1] - _BEYOND)
            offset = (_BEYOND, _BEYOND)
        return offset


def _overlap(shift: int, count: int) -> tuple[slice, slice]:
    """Return what is kept of an axis that begins later by a shift: its new and its old place."""
    kept = max(count - abs(shift), 0)
    new, old = max(-shift, 0), max(shift, 0)
    return slice(new, new + kept), slice(old, old + kept)
