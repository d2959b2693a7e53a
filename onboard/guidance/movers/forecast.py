"""Where movers may be before the vehicle has come to rest again: what planning keeps clear of.

Nothing relies on it: the certificate against movers decides, and where the planner finds nothing
that is clear of them, it plans as if nothing moved, to tell whether they are the reason.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from onboard.geometry.frames import FloatArray, LegFrame
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.motion.trajectory import Vector
    from onboard.planning.mover_certifier import MoverFreePlaces
    from onboard.planning.rest_certifier import RestLimits

    BoolArray = NDArray[np.bool_]

# A place is of use if no mover reaches it for so long: about what it takes to go there and stop.
AHEAD_S: Final = 2.0
# Nearer places are left sooner: the vehicle gets on with about this.
_PACE_MPS: Final = 1.0
# Farther away, movers will be elsewhere by then.
WINDOW_M: Final = 8.0
# Edge of the squares that are looked at, in cells of the seen-free set.
_COARSE_CELLS: Final = 2


@dataclass(frozen=True)
class Forecast:
    """What is known of movers, seen from where the next plan starts.

    Attributes:
        places: until when they hold no mover.
        leg: the frame of the plan.
        here_leg_m: where it starts.
        body_m: radius about the reference.
        now_s: the time.
    """

    places: MoverFreePlaces
    leg: LegFrame
    here_leg_m: tuple[float, float]
    body_m: float
    now_s: float

    def are_met(self, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """Tell of places (n, m) whether a mover may be there too soon; of none outside the window.

        Args:
            x_m: (n,), along the leg.
            y_m: (m,), to its right.
        """
        here_x_m, here_y_m = self.here_leg_m
        rows = np.flatnonzero(np.abs(x_m - here_x_m) <= WINDOW_M)
        columns = np.flatnonzero(np.abs(y_m - here_y_m) <= WINDOW_M)
        met = np.zeros((x_m.size, y_m.size), bool)
        if not (rows.size and columns.size):
            return met
        xs_m, ys_m = (each.ravel() for each in np.meshgrid(x_m[rows], y_m[columns], indexing="ij"))
        needed_s = np.hypot(xs_m - here_x_m, ys_m - here_y_m) / _PACE_MPS + self._left_here_s()
        soon = self._left_s(xs_m, ys_m) < np.minimum(needed_s, AHEAD_S)
        met[np.ix_(rows, columns)] = soon.reshape(rows.size, columns.size)
        return met

    def clear_of(self, grid: FreeGrid) -> FreeGrid:
        """Return a seen-free set without the places that a mover may be in too soon."""
        edge_m, sizes = _COARSE_CELLS * grid.cell_m, grid.unknown_sum.shape
        firsts, middles_m = [], []
        for axis in (0, 1):
            origin_m, here_m = grid.origin_leg_m[axis], self.here_leg_m[axis]
            first = max(math.floor((here_m - WINDOW_M - origin_m) / grid.cell_m), 0)
            last = min(math.ceil((here_m + WINDOW_M - origin_m) / grid.cell_m), sizes[axis] - 1)
            count = max(last - first, 0) // _COARSE_CELLS
            firsts.append(first)
            middles_m.append(origin_m + first * grid.cell_m + (np.arange(count) + 0.5) * edge_m)
        met = self.are_met(*middles_m)
        if not met.any():
            return grid
        fine = met.repeat(_COARSE_CELLS, axis=0).repeat(_COARSE_CELLS, axis=1)
        return grid.without((firsts[0], firsts[1]), fine)

    def _left_here_s(self) -> float:
        """Return for how long no mover reaches the body where the plan starts; 0 if one may now."""
        offsets_m = np.linspace(-self.body_m, self.body_m, 5)
        xs_m, ys_m = np.meshgrid(self.here_leg_m[0] + offsets_m, self.here_leg_m[1] + offsets_m)
        return max(float(self._left_s(xs_m.ravel(), ys_m.ravel()).min()), 0.0)

    def _left_s(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return for how long no mover reaches some places (n,)."""
        points_m = np.stack((x_m, y_m, np.zeros_like(x_m)), axis=1)
        places_ned_m = self.leg.position_ned_from_leg(points_m)[:, :2]
        left_s: FloatArray = self.places.free_until_s(places_ned_m) - self.now_s
        return left_s


def forecast_of(
    guard: MoverGuard, leg: LegFrame, here_leg_m: Vector, limits: RestLimits, now_s: float
) -> Forecast | None:
    """Return what planning keeps clear of; None where the contract has no movers."""
    movers = guard.known.movers
    if movers is None:
        return None
    return Forecast(movers.places, leg, here_leg_m[:2], limits.body_radius_m, now_s)
