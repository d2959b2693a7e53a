"""Which holds the operator may end by ``clearway resume``, and whether what failed holds again.

The command replaces the pilot only where the service itself can confirm that the assumption holds
again, now and at the place where the vehicle rests.  What says that the estimate, the vehicle or
the sensor cannot be believed is never confirmed by their own word: there the pilot has to look.
"""

from __future__ import annotations

from typing import Final

from onboard.monitoring.assumptions import Assumption, Violation

# So long nothing may have failed: many frames and ticks, each of which is checked in a hold, too.
QUIET_S: Final = 3.0

# Frames, ticks and wind are checked all the time.  Obstacles are checked again where the vehicle
# is to set off, from rest.  Looking once more for a way costs time only.
RESUMABLE: Final = frozenset(
    {
        Assumption.DETECTION_AGE,
        Assumption.REACTION_TIME,
        Assumption.DETECTION_RANGE,
        Assumption.FIELD_OF_VIEW,
        Assumption.DETECTION_UNCERTAINTY,
        Assumption.OBSTACLE_SIZE,
        Assumption.ROI_INTERSECTION,
        Assumption.LATE_FIRST_SIGHT,
        Assumption.PLAN_EXISTS,
        Assumption.NO_PASSAGE,
        Assumption.WIND,
        Assumption.TICK_OVERRUN,
        Assumption.LATE_TICKS,
        Assumption.MOVER_CLASS,
        Assumption.REST_SPEED,
        Assumption.YIELD_TIME,
        Assumption.MOVER_VIEW,
    }
)


class FailureTimes:
    """Remembers when each assumption failed last, in a hold as in flight."""

    def __init__(self) -> None:
        self._failed_s: dict[Assumption, float] = {}

    def note(self, violation: Violation, now_s: float) -> None:
        """Take note that an assumption does not hold now."""
        self._failed_s[violation.assumption] = now_s

    def since(self, begin_s: float) -> dict[Assumption, float]:
        """Return when each assumption failed last, of those that have failed since a time."""
        return {each: failed_s for each, failed_s in self._failed_s.items() if failed_s >= begin_s}


def resume_objections(
    cause: Assumption, held_s: float, failures: FailureTimes, now_s: float
) -> dict[Assumption, str]:
    """Return what speaks against ending a hold, one sentence for each assumption.

    Args:
        cause: the assumption that failed, so that the vehicle holds.
        held_s: when that was.
        failures: of that time and since.
        now_s: the time.
    """
    failed_s = {cause: held_s} | failures.since(held_s)
    found = {}
    for assumption, last_s in failed_s.items():
        if assumption not in RESUMABLE:
            found[assumption] = f"{assumption} has failed: only the pilot may end this hold"
        elif now_s - last_s < QUIET_S:
            ago_s = now_s - last_s
            found[assumption] = f"{assumption} failed {ago_s:.1f} s ago (limit {QUIET_S:g} s)"
    return found
