"""The response to a failed assumption: fly on under an adapted contract, else brake to hover.

Where a way to rest is always held, an assumption of progress ends no flight: the vehicle flies on
as far as it sees, or threads the rest of its leg.  One of safety is never adapted to there.
"""

from __future__ import annotations

from typing import Final

from onboard.contract.assessment import Assessment
from onboard.events import Event, EventName, Severity
from onboard.guidance.avoidance_step import AvoidanceStep
from onboard.guidance.cruise import Cruise
from onboard.guidance.dense.shield import Shield
from onboard.guidance.envelope import peak_speed_mps
from onboard.guidance.fallback import Fallback
from onboard.guidance.phases import Phase
from onboard.guidance.situation import Situation
from onboard.monitoring.adaptation import (
    Adaptation,
    adapt,
    costs_progress_only,
    slowing_distance,
    slows_in_time,
)
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.vehicle_state import Pose

# With a way to rest that is held, these say only that passing is not guaranteed any more: nothing
# that is flown depends on how large obstacles are, or how far apart.
NOTICES: Final = frozenset({Assumption.OBSTACLE_SIZE, Assumption.ROI_INTERSECTION})
# And these say only that nothing new is seen, or decided, for a while: what is held goes on, and is
# renewed once that is over, or comes to rest.
DELAYS: Final = frozenset(
    {Assumption.DETECTION_AGE, Assumption.REACTION_TIME, Assumption.TICK_OVERRUN}
)


class AdaptationLadder:
    """Tries the same speed, then a lower one, then a stop.

    Args:
        situation: what is flown, and what is known.
        fallback: the last step.
        cruise: slows down.
        avoidance_step: whose plan is checked again under an adapted contract.
        shield: has the rest of a leg threaded; None where no way to rest is required.
    """

    def __init__(
        self,
        situation: Situation,
        fallback: Fallback,
        cruise: Cruise,
        avoidance_step: AvoidanceStep,
        shield: Shield | None = None,
    ) -> None:
        self._situation, self._fallback = situation, fallback
        self._cruise, self._avoidance_step = cruise, avoidance_step
        self._shield = shield

    def respond_to(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Respond to a failed assumption, if flying; the arguments are those of `Fallback.hold`."""
        situation = self._situation
        if not situation.state.flying:
            return
        if self._shield is not None:
            self._respond_on_held_way(self._shield, violation, now_s, measured)
        elif not self._adapts(violation, now_s):
            self._fallback.hold(violation, now_s, measured)

    def _respond_on_held_way(
        self, shield: Shield, violation: Violation, now_s: float, measured: Pose | None
    ) -> None:
        assumption = violation.assumption
        if not costs_progress_only(assumption, self._situation.assessment.terms):
            # What the set and the way held were built with is never adapted in flight.
            self._fallback.hold(violation, now_s, measured)
        elif self._situation.state.in_seen_space or assumption in NOTICES:
            return
        elif not self._adapts(violation, now_s) and assumption not in DELAYS and shield.guards:
            shield.divert(str(violation), now_s)

    def _adapts(self, violation: Violation, now_s: float) -> bool:
        """Fly on under the contract solved again for a violation, if that helps."""
        situation = self._situation
        adaptation = adapt(situation.assessment, violation) if situation.adaptive else None
        return adaptation is not None and self._adopt(adaptation, violation, now_s)

    def _adopt(self, adaptation: Adaptation, violation: Violation, now_s: float) -> bool:
        """Fly on under the adapted contract, if the vehicle can get there from here."""
        situation = self._situation
        state, before = situation.reference.sample(now_s), situation.assessment
        if state is None:
            return False
        if adaptation.slower and not (
            situation.state.phase is Phase.CRUISE
            and slows_in_time(
                before, peak_speed_mps(state, situation.envelope), adaptation.assessment
            )
        ):
            return False
        situation.adopt(adaptation.assessment)
        if adaptation.slower and not self._slow_down(state, before, now_s):
            situation.adopt(before)
            return False
        speed_mps = situation.assessment.terms.cruise_speed_mps
        text = f"contract solved again for {violation}: continuing at {speed_mps:.2f} m/s"
        # Another speed is reported at once; it only falls, by steps, so that there are few.
        kind = f"{violation.key} {speed_mps:.2f}"
        situation.emit_rarely(Event(now_s, EventName.ADAPTED, Severity.WARNING, text), kind)
        self._avoidance_step.recheck_avoided(now_s)
        return True

    def _slow_down(self, state: State, before: Assessment, now_s: float) -> bool:
        """Cruise on at the adapted speed, unless a known region begins before it is reached."""
        situation = self._situation
        x_m, y_m, _ = state.position_leg_m
        peak_mps = peak_speed_mps(state, situation.envelope)
        horizon_m = slowing_distance(before, peak_mps, situation.assessment)
        if situation.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=horizon_m) is not None:
            return False
        if situation.state.cruising_freely:
            self._cruise.replan(state, now_s)
        return True
