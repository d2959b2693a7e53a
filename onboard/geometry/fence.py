"""A geofence in local NED: how far a place is from where the vehicle must not be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import BoolArray

Place = tuple[float, float]

# A leg is sampled this densely; between samples a clearance falls by half of it at most.
_SAMPLE_M: Final = 0.5
# Cells along the edge of a block that is decided as a whole where it can be, as the grid allows.
_BLOCKS: Final = (8, 4, 2, 1)


@dataclass(frozen=True)
class FenceArea:
    """A polygon or a circle, north and east.

    Attributes:
        corners_ned_m: of a polygon; of a circle, its centre alone.
        radius_m: of a circle; None for a polygon.
        keeps_in: whether the vehicle must stay inside, rather than outside.
    """

    corners_ned_m: tuple[Place, ...]
    radius_m: float | None
    keeps_in: bool

    def clearance_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        """Return the distance of places to the border; negative on the wrong side.

        Args:
            north_m: of each place.
            east_m: likewise, of the same shape.
        """
        if self.radius_m is not None:
            ((n_m, e_m),) = self.corners_ned_m
            inside_m = self.radius_m - np.hypot(north_m - n_m, east_m - e_m)
        else:
            inside_m = self._inside_polygon_m(north_m, east_m)
        return inside_m if self.keeps_in else -inside_m

    def _inside_polygon_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        away_m = np.full(north_m.shape, math.inf)
        inside = np.zeros(north_m.shape, bool)
        corners = self.corners_ned_m
        for (n0, e0), (n1, e1) in zip(corners, (*corners[1:], corners[0]), strict=True):
            dn, de = n1 - n0, e1 - e0
            length2 = max(dn * dn + de * de, 1e-12)
            share = np.clip(((north_m - n0) * dn + (east_m - e0) * de) / length2, 0.0, 1.0)
            away_m = np.minimum(
                away_m, np.hypot(north_m - n0 - share * dn, east_m - e0 - share * de)
            )
            if e0 != e1:  # an edge along north is not crossed by a ray to the north
                crosses = (e0 > east_m) != (e1 > east_m)
                inside ^= crosses & (north_m < n0 + (east_m - e0) / de * dn)
        return np.where(inside, away_m, -away_m)


@dataclass(frozen=True)
class Fence:
    """Areas that the vehicle has to stay in, and out of, all together."""

    areas: tuple[FenceArea, ...]

    def clearance_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        """Return how far places are from where the vehicle must not be; negative there.

        No place nearer to them than that is forbidden: the function falls by at most a metre in
        each metre.
        """
        each_m = [area.clearance_m(north_m, east_m) for area in self.areas]
        least_m: FloatArray = np.stack(each_m).min(axis=0)
        return least_m

    def leg_clearance_m(self, start_ned_m: Place, end_ned_m: Place) -> float:
        """Return a lower bound of the clearance on the straight way between two places."""
        count = 2 + math.ceil(math.dist(start_ned_m, end_ned_m) / _SAMPLE_M)
        north_m, east_m = (
            np.linspace(start_ned_m[axis], end_ned_m[axis], count) for axis in (0, 1)
        )
        return float(self.clearance_m(north_m, east_m).min()) - _SAMPLE_M / 2.0

    def crossed_leg(self, places_ned_m: Sequence[Place], margins_m: Sequence[float]) -> int | None:
        """Return which of some legs in a row comes too near to the border first; None if none.

        Args:
            places_ned_m: start of the first leg, and the ends.
            margins_m: the clearance that each leg needs.
        """
        for number, margin_m in enumerate(margins_m):
            if self.leg_clearance_m(*places_ned_m[number : number + 2]) < margin_m:
                return number
        return None

    def allowed_cells(
        self, north_m: FloatArray, east_m: FloatArray, cell_m: float
    ) -> BoolArray | None:
        """Return which cells of a square grid lie wholly where the vehicle may be.

        Whole blocks of cells are decided by their middle, so that only those at the border are
        looked at cell by cell.

        Args:
            north_m: (n, n), of the middle of each cell.
            east_m: likewise.
            cell_m: edge of a cell.

        Returns:
            (n, n); None if all do.
        """
        side = north_m.shape[0]
        block = next(each for each in _BLOCKS if side % each == 0)
        count = side // block
        north_m, east_m = (
            each.reshape(count, block, count, block).swapaxes(1, 2) for each in (north_m, east_m)
        )
        middle_m = self.clearance_m(north_m.mean(axis=(2, 3)), east_m.mean(axis=(2, 3)))
        reach_m = block * cell_m / math.sqrt(2.0)
        if middle_m.min() >= reach_m:
            return None
        blocks = np.empty(north_m.shape, bool)
        blocks[:] = (middle_m >= reach_m)[..., None, None]
        i, j = np.nonzero(np.abs(middle_m) < reach_m)
        blocks[i, j] = self.clearance_m(north_m[i, j], east_m[i, j]) >= cell_m / math.sqrt(2.0)
        return blocks.swapaxes(1, 2).reshape(side, side)
