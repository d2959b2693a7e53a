"""Detects that a vehicle hovers from how far it has moved, not from its speed.

Used where the service is seen from outside: by the operator of a live flight and the simulated one.

A real estimate drifts while the vehicle hovers: in recorded hovers of PX4 its speed reads 0.2 to
0.9 m/s, but within one second its position moves by less than half a metre.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

WINDOW_S: Final = 1.0
MOVED_MAX_M: Final = 0.5


class RestDetector:
    """Keeps the positions of the last second."""

    def __init__(self) -> None:
        self._positions: deque[tuple[float, tuple[float, float, float]]] = deque()

    def add(self, time_s: float, position_ned_m: tuple[float, float, float]) -> None:
        """Take the next position; start again where the time goes back, as after a reboot."""
        if self._positions and time_s < self._positions[-1][0]:
            self._positions.clear()
        self._positions.append((time_s, position_ned_m))
        # One older than the window stays: it shows that the window is full.
        while len(self._positions) > 1 and self._positions[1][0] <= time_s - WINDOW_S:
            self._positions.popleft()

    @property
    def at_rest(self) -> bool:
        """Whether all positions of the last second lie near the newest; False until it is full."""
        if not self._positions:
            return False
        newest_s, here_m = self._positions[-1]
        if newest_s - self._positions[0][0] < WINDOW_S - 1e-6:
            return False
        return all(math.dist(was_m, here_m) <= MOVED_MAX_M for _, was_m in self._positions)
