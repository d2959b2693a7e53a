"""Braking to hover: what is left where an assumption failed.

Only certified trajectories become the reference, with two exceptions: braking where no way to stop
certifies, and braking where the estimated position can no longer be trusted.
"""

from __future__ import annotations

from onboard.events import Event, EventName, Severity
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.phases import Phase, Trigger
from onboard.guidance.situation import Situation
from onboard.monitoring.assumptions import Violation
from onboard.motion.trajectory import Trajectory
from onboard.perception.obstacle_map import Obstacle
from onboard.vehicle_state import Pose

UNCERTIFIED = ", although no way to stop is certified"


class Fallback:
    """Chooses the way to a hover, and keeps to it.

    Args:
        situation: what is flown, and what is known.
        clear_check: certifies ways to stop.
    """

    def __init__(self, situation: Situation, clear_check: ClearCheck) -> None:
        self._situation, self._clear_check = situation, clear_check

    def hold(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Respond to a failed assumption by braking to hover (ASSUMPTION_FAILED), if flying.

        Args:
            violation: what failed.
            now_s: when.
            measured: brake from this pose, where the reference itself cannot be trusted.
        """
        situation = self._situation
        if not situation.state.flying:
            return
        how = "going on to rest in the space seen free"
        if measured is not None:
            braking = situation.braking_from(situation.measured_state(measured), now_s)
            how = "braking to hover where the vehicle is now"
            situation.reference.fly(braking)
            situation.rest_held = False
        elif not situation.rest_held:
            braking, how = self._way_to_hover(now_s)
            situation.reference.fly(braking)
        situation.hold_cause = violation.assumption, now_s
        text = f"holding: {violation}; {how}"
        situation.fire(Trigger.ASSUMPTION_FAILED, now_s, text=text)

    def report_and_hold(self, violation: Violation, now_s: float) -> None:
        """Report an assumption that failed in guidance itself, and brake to hover."""
        self._situation.emit(violation.event(now_s))
        self.hold(violation, now_s)

    def recheck_way_to_hover(self, obstacle: Obstacle, now_s: float) -> None:
        """Choose the way to hover again if an obstacle that is new or has grown blocks it."""
        current = self._situation.reference.current
        if current is None or now_s >= current.end_s or self._situation.rest_held:
            return
        if not self._clear_check.is_clear(current.from_time(now_s), [obstacle]):
            braking, how = self._way_to_hover(now_s)
            self._situation.reference.fly(braking)
            text = f"obstacle {obstacle.id} blocks the braking path: {how}"
            event = Event(now_s, EventName.HOLD_REPLANNED, Severity.ERROR, text)
            self._situation.emit_rarely(event, text)

    def hover_at(self, pose: Pose, now_s: float) -> None:
        """Hover where the vehicle is now estimated to be, rather than fly there in one step."""
        situation = self._situation
        if situation.state.phase in (Phase.HOLD, Phase.ARRIVED):
            braking = situation.braking_from(situation.measured_state(pose), now_s)
            situation.reference.fly(braking)

    def _way_to_hover(self, now_s: float) -> tuple[Trajectory, str]:
        """Return the trajectory to a hover, and its description.

        Brake now if that is clear; else after the plan if that is; else what keeps farther away.
        If obstacles turn out to be elsewhere than before, neither may be clear of all of them.
        """
        state = self._situation.reference.sample(now_s)
        assert state is not None  # noqa: S101  the caller checked
        braking = self._situation.braking_from(state, now_s)
        if self._clear_check.is_clear(braking):
            return braking, "braking to hover"
        finishing, avoidance = None, self._situation.avoidance
        if avoidance is not None and now_s < avoidance.plan.trajectory.end_s:
            planned = avoidance.plan.trajectory.from_time(now_s)
            after = self._situation.braking_from(planned.final, planned.end_s)
            finishing = planned.followed_by(after)
            if self._clear_check.is_clear(planned) and self._clear_check.is_clear(after):
                return finishing, "finishing the avoidance, then braking to hover"
        room_m = self._clear_check.room_m
        if finishing is not None and room_m(finishing) > room_m(braking):
            how = "finishing the avoidance, which keeps farther away, then braking to hover"
            return finishing, how + UNCERTIFIED
        return braking, "braking to hover" + UNCERTIFIED
