"""How long ticks took and how late they began, and whether that was the daemon's own doing.

A tick is late of itself where what ran before it took too long; it is starved where the daemon was
ready to run and the kernel gave the processor to others.  Linux counts the latter for each thread
(``run_delay``, https://docs.kernel.org/scheduler/sched-stats.html#proc-pid-schedstat).
"""

from __future__ import annotations

from bisect import bisect_left
from enum import StrEnum, unique
from typing import Final

from onboard.contract.assessment import TICK_S

# A tick this late means that the computer cannot keep up, or was suspended.
LATE_TICK_S: Final = 2.0 * TICK_S
# Upper bounds of the buckets; the last one is open.
BUCKETS_S: Final = (0.001, 0.002, 0.003, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.25)


@unique
class LateCause(StrEnum):
    """Why a tick was late."""

    OWN = "own"
    STARVED = "starved"

    @property
    def sentence(self) -> str:
        """What it means, for people."""
        if self is LateCause.STARVED:
            return "other processes had the processor"
        return "the daemon itself took too long"


class TickTimes:
    """Counts ticks; the caller reads the clocks.

    Attributes:
        late: late ticks so far, by cause.
        late_max_s: the latest beginning of each cause.
        duration_max_s: the longest tick, waits for a processor included.
        duration_sum_s: of all ticks.
        duration_last_s: of the last one that has ended.
        waited_s: for a processor, before the newest tick.
    """

    def __init__(self) -> None:
        self.late = dict.fromkeys(LateCause, 0)
        self.late_max_s = dict.fromkeys(LateCause, 0.0)
        self.duration_max_s = self.duration_sum_s = self.duration_last_s = 0.0
        self._counts = [0] * (len(BUCKETS_S) + 1)
        self.waited_s = 0.0

    @property
    def count(self) -> int:
        """How many ticks have ended."""
        return sum(self._counts)

    def begin(self, late_s: float, ran_s: float, waited_s: float) -> LateCause | None:
        """Take the beginning of a tick.

        Args:
            late_s: after it was due.
            ran_s: how long the main thread has run since the tick before began.
            waited_s: how long any thread of ours has been ready without a processor since then.

        Returns:
            Why it is late; None if it is not, or only a little.
        """
        self.waited_s = waited_s
        if late_s <= LATE_TICK_S:
            return None
        own = ran_s > LATE_TICK_S or late_s - waited_s > LATE_TICK_S
        cause = LateCause.OWN if own else LateCause.STARVED
        self.late[cause] += 1
        self.late_max_s[cause] = max(self.late_max_s[cause], late_s)
        return cause

    def end(self, duration_s: float) -> None:
        """Take the end of a tick, with all that was sent, recorded and published in it."""
        self._counts[bisect_left(BUCKETS_S, duration_s)] += 1
        self.duration_last_s = duration_s
        self.duration_sum_s += duration_s
        self.duration_max_s = max(self.duration_max_s, duration_s)

    def cumulative(self) -> list[tuple[float, int]]:
        """Return how many ticks took no longer than each bound of the buckets."""
        found, total = [], 0
        for bound_s, count in zip((*BUCKETS_S, float("inf")), tuple(self._counts), strict=True):
            total += count
            found.append((bound_s, total))
        return found
