"""The worst plant that a contract allows: its tracking error is E, toward the nearest obstacle."""

from __future__ import annotations

import math
from typing import Final

# How fast the error may turn or grow: in passing an obstacle it turns from ahead to the side.
_CHANGE_MAX_MPS: Final = 2.0


class PinnedError:
    """Horizontal tracking error of one vehicle.

    Args:
        error_m: its size.
        seen_late_s: by this much older than it is taken for is the position that the error is
            judged by; then neither the error nor what is seen of it exceeds the size.

    Attributes:
        north_m, east_m: position of the vehicle less that of its setpoint.
    """

    def __init__(self, error_m: float, seen_late_s: float = 0.0) -> None:
        self.north_m = self.east_m = 0.0
        self._error_m, self._seen_late_s = error_m, seen_late_s

    def forget(self, north_m: float = 0.0, east_m: float = 0.0) -> None:
        """Reset the error, to zero or to what an estimate causes: the vehicle stays where it is."""
        self.north_m, self.east_m = north_m, east_m

    def advance(
        self,
        toward_ned: tuple[float, float],
        passed_s: float,
        velocity_ned_mps: tuple[float, float] = (0.0, 0.0),
        estimate_error_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Turn towards a direction: a unit vector, or zero where there is no obstacle.

        Args:
            toward_ned: the direction.
            passed_s: since the last call.
            velocity_ned_mps: of the setpoint; what is seen of the error lags behind by it.
            estimate_error_m: of the estimated position, north and east, by which it is seen.
        """
        north_m = self._error_m * toward_ned[0] - self.north_m
        east_m = self._error_m * toward_ned[1] - self.east_m
        away_m = math.hypot(north_m, east_m)
        share = min(_CHANGE_MAX_MPS * passed_s / away_m, 1.0) if away_m else 0.0
        self.north_m += share * north_m
        self.east_m += share * east_m
        if self._seen_late_s:
            late_m = (self._seen_late_s * speed_mps for speed_mps in velocity_ned_mps)
            self._stay_unseen(*(a - b for a, b in zip(late_m, estimate_error_m, strict=True)))

    def _stay_unseen(self, late_north_m: float, late_east_m: float) -> None:
        """Shorten the error until neither it nor what is seen of it exceeds its size."""
        for north_m, east_m in ((late_north_m, late_east_m), (0.0, 0.0)):
            seen_m = math.hypot(self.north_m - north_m, self.east_m - east_m)
            share = min(self._error_m / seen_m, 1.0) if seen_m else 1.0
            self.north_m = north_m + share * (self.north_m - north_m)
            self.east_m = east_m + share * (self.east_m - east_m)
