"""Which cells around a sensor are worth looking at: a coarse sector that holds its whole view.

Most cells around a view's bounding box lie beside it.  A sector is computed once for a heading to
the degree, and left out is only what `onboard.perception.line_of_sight.seen_free` refuses anyway.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from onboard.perception.line_of_sight import BoolArray, View

_HEADINGS: Final = 360
# How far the cells of a view reach at most, as a share of its range.
_REACH: Final = 1.15
# As many sectors as several sensors on a vehicle that turns need at a time.
_KEPT_MAX: Final = 32


class Sectors:
    """Sectors in cells, each computed when it is first needed.

    Args:
        cell_m: edge of a cell.
    """

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._kept: dict[tuple[int, float, float], BoolArray] = {}

    def around(self, view: View, corner: tuple[int, int], rows: slice, columns: slice) -> BoolArray:
        """Return for each cell of a window of a grid whether the view may show it.

        Args:
            view: the frame.
            corner: of the grid, in cells from the origin of the leg.
            rows: of the window; within 1.15 times the range of the sensor.
            columns: likewise.
        """
        turn = round(view.heading_leg_rad / (2.0 * math.pi) * _HEADINGS) % _HEADINGS
        key = turn, view.half_view_rad, view.range_m
        sector = self._kept.get(key)
        if sector is None:
            if len(self._kept) >= _KEPT_MAX:
                self._kept.clear()
            sector = self._kept[key] = self._sector(turn, view.half_view_rad, view.range_m)
        middle = len(sector) // 2
        i, j = (
            middle + low - math.floor(position_m / self._cell_m)
            for low, position_m in zip(corner, view.position_leg_m, strict=True)
        )
        return sector[i + rows.start : i + rows.stop, j + columns.start : j + columns.stop]

    def _sector(self, turn: int, half_view_rad: float, range_m: float) -> BoolArray:
        """Return the sector around a sensor that is anywhere in the middle cell."""
        reach = math.ceil(_REACH * range_m / self._cell_m) + 2
        away_m = np.arange(-reach, reach + 1) * self._cell_m
        distance_m = np.hypot(away_m[:, None], away_m[None, :])
        astray_m = self._cell_m  # the sensor is up to 0.71 cells from the middle
        sector: BoolArray = distance_m <= range_m + astray_m
        if half_view_rad < math.pi:
            heading_rad = turn * 2.0 * math.pi / _HEADINGS
            aside_rad = np.arctan2(away_m[None, :], away_m[:, None]) - heading_rad
            aside_rad = np.abs((aside_rad + math.pi) % (2.0 * math.pi) - math.pi)
            shy_rad = np.arcsin(np.minimum(astray_m / np.maximum(distance_m, astray_m), 1.0))
            rounded_rad = 2.0 * math.pi / _HEADINGS
            near = distance_m <= 2.0 * astray_m
            sector &= near | (aside_rad - shy_rad - rounded_rad <= half_view_rad)
        return sector
