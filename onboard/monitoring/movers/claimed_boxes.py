"""Which returns of a ranging sensor come from what another sensor claims to stand still.

A return tells neither what it comes from nor whether that moves.  One that lies within a box that
is claimed to be static, errors included, is taken for that; all others may move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.detection import Corners


class ClaimedBoxes:
    """Boxes that are claimed to stand still.

    Args:
        boxes: corners (north, east) of each: the first, its two neighbours, and the opposite one.
        error_m: how far their faces may be off.
    """

    def __init__(self, boxes: Sequence[Corners], error_m: float) -> None:
        corners = np.array(boxes, dtype=np.float64).reshape(-1, 4, 2)
        self._origin_m = corners[:, 0]
        sides = corners[:, 1:3] - corners[:, :1]
        self._length_m = np.hypot(sides[..., 0], sides[..., 1])
        self._axes = sides / np.maximum(self._length_m, 1e-9)[..., None]
        self._error_m = error_m

    def unexplained(self, boxes: FloatArray, error_m: Callable[[FloatArray], float]) -> list[bool]:
        """Tell of each of some returns whether it has to come from something else.

        Args:
            boxes: (n, 4, 2), corners of what encloses each, north and east.
            error_m: tells how far one of them may be off.
        """
        return [not self.explain(box.tolist(), error_m(box)) for box in boxes]

    def explain(self, corners_m: Corners, error_m: float) -> bool:
        """Tell whether a return may come from one of them alone.

        Args:
            corners_m: of what encloses the return, north and east.
            error_m: how far it may be off.
        """
        if not len(self._origin_m):
            return False
        along_m = self._along_m(np.array(corners_m, dtype=np.float64))
        margin_m = self._error_m + error_m
        limit_m = self._length_m[:, None] + margin_m
        within = (along_m >= -margin_m) & (along_m <= limit_m)
        return bool(within.all(axis=(1, 2)).any())

    def _along_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far points are along both axes of each box, (boxes, points, 2)."""
        from_m = points_m[None] - self._origin_m[:, None]
        along_m: FloatArray = np.einsum("bpi,bai->bpa", from_m, self._axes)
        return along_m
