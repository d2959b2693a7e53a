"""The setpoints of late: what the vehicle's response is compared with."""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Iterator
from typing import Final

from onboard.vehicle_state import Setpoint, Target

# The autopilot's echo of a setpoint lags by up to half a second.
SENT_MEMORY_S: Final = 0.6


class SentSetpoints:
    """Remembers the setpoints of the last `SENT_MEMORY_S`, in the order of time."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Setpoint]] = deque()

    def add(self, setpoint: Setpoint, now_s: float) -> None:
        """Remember a setpoint that has just been sent."""
        self._sent.append((now_s, setpoint))
        while self._sent[0][0] < now_s - SENT_MEMORY_S:
            self._sent.popleft()

    def acceleration_ned_mps2(self, time_s: float) -> tuple[float, float, float]:
        """Return the acceleration asked for by the first setpoint from a time on; 0 without one."""
        since = bisect.bisect_left(self._sent, time_s, key=_time_of)
        if since == len(self._sent):
            return 0.0, 0.0, 0.0
        return self._sent[since][1].acceleration_ned_mps2

    def newest_first(self) -> Iterator[Target]:
        """Yield position and velocity of each, NED."""
        for _, setpoint in reversed(self._sent):
            yield setpoint.position_ned_m, setpoint.velocity_ned_mps


def _time_of(sent: tuple[float, Setpoint]) -> float:
    return sent[0]
