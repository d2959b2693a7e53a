"""Check that the service decides on time."""

from __future__ import annotations

from typing import Final

from onboard.contract.assessment import TICK_S
from onboard.monitoring.assumptions import Assumption, Violation

# Ticks later than this are the computer's failure, not the scheduler's jitter.
TICK_OVERRUN_S: Final = 3.0 * TICK_S


class LoopOverrunMonitor:
    """Checks the time between ticks; time that stands still or runs backwards is a fault too."""

    def __init__(self) -> None:
        self._previous_s: float | None = None

    def check(self, now_s: float) -> Violation | None:
        """Record a tick; return the violation if it is late."""
        previous_s, self._previous_s = self._previous_s, now_s
        if previous_s is None or 0.0 < now_s - previous_s <= TICK_OVERRUN_S:
            return None
        return Violation(Assumption.TICK_OVERRUN, now_s - previous_s, TICK_OVERRUN_S, "s")
