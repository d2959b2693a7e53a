"""YIELD: come to rest for a mover or for leave, wait, and go on; reversible, unlike HOLD.

The vehicle is on the way to rest that it holds, or rests at its end.  Being touched there is no
failure of passive safety.  What leads on is flown as soon as it certifies.  For leave of other
vehicles of its fleet it waits as long as it takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from onboard.events import Event, EventName, Severity
from onboard.guidance.phases import Trigger
from onboard.monitoring.assumptions import Assumption, Violation

if TYPE_CHECKING:
    from collections.abc import Callable

    from onboard.guidance.fallback import Fallback
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.guidance.situation import Situation

# Without a way that only movers speak against for so long, something else does.
_OTHER_REASON_S: Final = 2.0
_OUT_OF_VIEW: Final = (
    "out of view, movers may have come to where the vehicle rests: it goes on by your word only"
)
# A cruise is taken up again once it has been clear for so long.
CLEAR_S: Final = 1.0
# Whether it is clear is asked this often.
_LOOK_S: Final = 0.5
# At rest without leave for so long, where the contract does not say how long, it is blocked.
_BLOCKED_S: Final = 60.0
# A way that leads nowhere but for movers has been refused within this: they are the reason.
LATELY_S: Final = 1.0


@dataclass
class _Wait:
    since_s: float
    # What the vehicle waits for leave is no wait for movers.
    for_movers_since_s: float
    blocked: bool = False
    rest_since_s: float | None = None
    clear_since_s: float | None = None
    looked_s: float = -math.inf


class Yielding:
    """Waits for movers.

    Args:
        situation: what is flown.
        guard: refuses ways on which a mover may be.
        fallback: what is left after too long a wait.
    """

    def __init__(self, situation: Situation, guard: MoverGuard, fallback: Fallback) -> None:
        self._situation, self._guard, self._fallback = situation, guard, fallback
        self._wait = _Wait(0.0, 0.0)

    def is_due(self, now_s: float) -> bool:
        """Tell whether movers, or missing leave, are why nothing leads on."""
        return self._guard.has_refused(now_s, LATELY_S)

    def begin(self, now_s: float) -> None:
        """Wait from now on (MOVER_NEAR, NO_LEAVE)."""
        self._wait = _Wait(now_s, now_s)
        for_leave = self._guard.waits_for_leave(now_s, LATELY_S)
        trigger = Trigger.NO_LEAVE if for_leave else Trigger.MOVER_NEAR
        self._situation.fire(trigger, now_s, text=f"yielding: {self._guard.reason}")

    def rest(self, now_s: float) -> bool:
        """Note that the vehicle rests on its way; tell whether it still waits.

        After a wait for movers that is longer than the contract allows, it holds; one for leave it
        reports.  Where neither is the reason any more, it looks for another way (NO_WAY).
        """
        wait = self._wait
        if wait.rest_since_s is None:
            wait.rest_since_s = now_s
        longest_s = self._situation.assessment.contract.requirements.yield_max_s
        if self._guard.waits_for_leave(now_s, LATELY_S):
            wait.for_movers_since_s = now_s
            self._report_if_blocked(longest_s or _BLOCKED_S, now_s)
        waited_s = now_s - wait.for_movers_since_s
        if longest_s is not None and waited_s > longest_s:
            self._fallback.report_and_hold(
                Violation(Assumption.YIELD_TIME, waited_s, longest_s, "s"), now_s
            )
            return False
        resting = self._situation.reference.sample(now_s)
        if resting is not None and self._guard.has_lost_view(resting.position_leg_m, now_s):
            self._fallback.report_and_hold(
                Violation(Assumption.MOVER_VIEW, waited_s, 0.0, "s", sentence=_OUT_OF_VIEW), now_s
            )
            return False
        rested_s = now_s - wait.rest_since_s
        others = rested_s > _OTHER_REASON_S and wait.clear_since_s is None
        if others and not self._guard.has_refused(now_s, _OTHER_REASON_S):
            self._situation.fire(Trigger.NO_WAY, now_s)
            return False
        return True

    def _report_if_blocked(self, longest_s: float, now_s: float) -> None:
        wait = self._wait
        waited_s = now_s - wait.since_s
        if waited_s > longest_s and not wait.blocked:
            wait.blocked = True
            text = f"blocked, at rest for {waited_s:.0f} s: {self._guard.reason}"
            self._situation.emit(Event(now_s, EventName.BLOCKED, Severity.WARNING, text))

    def has_been_clear(self, is_clear: Callable[[], bool], now_s: float) -> bool:
        """Tell whether a way has been clear for long enough.

        Args:
            is_clear: tells whether it is now; asked a few times a second.
            now_s: the time.
        """
        wait = self._wait
        if now_s < wait.looked_s + _LOOK_S:
            return False
        wait.looked_s = now_s
        if not is_clear():
            wait.clear_since_s = None
            return False
        if wait.clear_since_s is None:
            wait.clear_since_s = now_s
        return now_s - wait.clear_since_s >= CLEAR_S

    def resumes_cruise(self, x_m: float, y_m: float) -> bool:
        """Tell whether the cruise of the leg is taken up again from a place, outside all regions.

        Elsewhere the rest of the leg is threaded.
        """
        situation = self._situation
        return situation.shielded and not any(
            obstacle.region.lane_left_m <= y_m <= obstacle.region.lane_right_m
            for obstacle in situation.obstacles.between(x_m, x_m)
        )

    @property
    def has_settled(self) -> bool:
        """Whether the vehicle rests, and not only its setpoint."""
        return self._wait.rest_since_s is not None
