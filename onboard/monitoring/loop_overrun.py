"""Check that the service decides on time.

One late tick costs time only where a certified way to rest is held.  A second one soon after shows
a computer that cannot keep up: then the vehicle stops.
"""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.assessment import TICK_S
from onboard.monitoring.assumptions import Assumption, Violation

# Ticks later than this are the computer's failure, not the scheduler's jitter.
TICK_OVERRUN_S: Final = 3.0 * TICK_S
# Within this time of a late tick, another one is no longer a single event.
AGAIN_WITHIN_S: Final = 60.0


class LoopOverrunMonitor:
    """Checks the time between ticks; time that stands still or runs backwards is a fault too."""

    def __init__(self) -> None:
        self._previous_s: float | None = None
        self._late_s = -math.inf

    def check(self, now_s: float) -> Violation | None:
        """Record a tick; return the violation if it is late."""
        previous_s, self._previous_s = self._previous_s, now_s
        if previous_s is None or 0.0 < now_s - previous_s <= TICK_OVERRUN_S:
            return None
        return Violation(Assumption.TICK_OVERRUN, now_s - previous_s, TICK_OVERRUN_S, "s")

    def count_in_motion(self, now_s: float) -> Violation | None:
        """Count a late tick during which the reference has moved; return what a second one breaks.

        Returns:
            The time since the late tick before, if that is less than `AGAIN_WITHIN_S`.
        """
        since_s, self._late_s = now_s - self._late_s, now_s
        if since_s >= AGAIN_WITHIN_S:
            return None
        return Violation(Assumption.LATE_TICKS, since_s, AGAIN_WITHIN_S, "s apart")
