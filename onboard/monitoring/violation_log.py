"""Says each violation once in a flight, however long it lasts."""

from __future__ import annotations

from collections.abc import Callable

from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.monitoring.assumptions import Assumption, Violation


class ViolationLog:
    """Turns violations into events.

    Args:
        emit: takes the events.
    """

    def __init__(self, emit: Callable[[Event], None]) -> None:
        self._emit = emit
        self._reported: set[tuple[Assumption, str]] = set()
        self._limiter = EventLimiter()

    def begin_flight(self) -> None:
        """Report everything again: a flight departs."""
        self._reported.clear()

    def report(self, violation: Violation, now_s: float) -> None:
        """Say a violation, once for each subject in a flight."""
        if self._is_new(violation.assumption, violation.subject):
            self._emit(violation.event(now_s))

    def report_delay(self, violation: Violation, now_s: float) -> None:
        """Say, once for each subject in a flight, what slows the vehicle or stops it for a time."""
        if self._is_new(violation.assumption, violation.subject):
            text = f"{violation}; going on by itself when that is over"
            data = violation.event(now_s).data
            self._emit(Event(now_s, EventName.DELAYED, Severity.NOTICE, text, data))

    def report_suspicion(self, violation: Violation, now_s: float) -> None:
        """Say, once in a flight, that the vehicle deviates but may follow another commander."""
        if self._is_new(Assumption.SECOND_COMMANDER, "suspected"):
            text = (
                f"vehicle deviates from setpoint ({violation}): pilot takeover or second commander?"
            )
            self._emit(Event(now_s, EventName.SUSPICION, Severity.WARNING, text))

    def report_merger(self, obstacle_id: str, separation_min_m: float, now_s: float) -> None:
        """Say, once for each obstacle and rarely, that its regions intersect and it is one now."""
        key = Assumption.ROI_INTERSECTION, obstacle_id
        if key in self._reported or not self._limiter.allows("merged", now_s):
            return
        self._reported.add(key)
        intersecting = Violation(key[0], 0.0, separation_min_m, "m", obstacle_id)
        self._emit(intersecting.event(now_s))
        text = f"avoiding {obstacle_id} as one"
        self._emit(Event(now_s, EventName.MERGED, Severity.WARNING, text))

    def _is_new(self, assumption: Assumption, subject: str) -> bool:
        key = assumption, subject
        if key in self._reported:
            return False
        self._reported.add(key)
        return True
