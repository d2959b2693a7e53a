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

    Attributes:
        north_m, east_m: position of the vehicle less that of its setpoint.
    """

    def __init__(self, error_m: float) -> None:
        self.north_m = self.east_m = 0.0
        self._error_m = error_m

    def forget(self) -> None:
        """Reset the error to zero: the vehicle stays where it is."""
        self.north_m = self.east_m = 0.0

    def advance(self, toward_ned: tuple[float, float], passed_s: float) -> None:
        """Turn towards a direction: a unit vector, or zero where there is no obstacle."""
        north_m = self._error_m * toward_ned[0] - self.north_m
        east_m = self._error_m * toward_ned[1] - self.east_m
        away_m = math.hypot(north_m, east_m)
        share = min(_CHANGE_MAX_MPS * passed_s / away_m, 1.0) if away_m else 0.0
        self.north_m += share * north_m
        self.east_m += share * east_m
