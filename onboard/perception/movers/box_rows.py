"""Boxes of many movers, all compared with what was measured at once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import BoolArray


class BoxRows:
    """Boxes along north and east.

    Args:
        boxes: n of them.
    """

    def __init__(self, boxes: Iterable[Box]) -> None:
        rows = [(box.x_min_m, box.y_min_m, box.x_max_m, box.y_max_m) for box in boxes]
        self._low, self._high = np.array(rows).reshape(-1, 2, 2).transpose(1, 0, 2)

    def meet(self, measured: Box, error_m: float) -> BoolArray:
        """Tell of each box, grown by an error, whether it shares a point with another one, (n,).

        Args:
            measured: the other one.
            error_m: how far each of its faces may be off.
        """
        low, high = self._low - error_m, self._high + error_m
        axes = low <= (measured.x_max_m, measured.y_max_m)
        axes &= high >= (measured.x_min_m, measured.y_min_m)
        meets: BoolArray = axes[:, 0] & axes[:, 1]
        return meets
