"""Braking to hover: what is left where an assumption failed.

Only certified trajectories become the reference, with two exceptions: braking where no way to stop
certifies, and braking where the estimated position can no longer be trusted.
"""

from __future__ import annotations

from onboard.events import Event, EventName, Severity
from onboard.geometry.frames import wrap_angle
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.envelope import HEADING_TOLERANCE_RAD, any_heading
from onboard.guidance.induction_planner import InductionPlanner
from onboard.guidance.phases import Phase, Trigger
from onboard.guidance.situation import Situation
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State, Trajectory, X
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.closed_form import brake_to_hover
from onboard.vehicle_state import Pose

UNCERTIFIED = ", although no way to stop is certified"


class Fallback:
    """Chooses the way to a hover, and keeps to it.

    Args:
        situation: what is flown, and what is known.
        clear_check: certifies ways to stop.
        planner: plans around what braking would meet.
    """

    def __init__(
        self, situation: Situation, clear_check: ClearCheck, planner: InductionPlanner
    ) -> None:
        self._situation, self._clear_check = situation, clear_check
        self._planner = planner

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
            braking = self._braking_from_measured(measured, now_s)
            how = "braking to hover where the vehicle is now"
            situation.reference.fly(braking)
            situation.rest_held = False
        elif situation.rest_held:
            situation.reference.fly_guard()
            how = self._leaving_what_is_contradicted(violation, now_s) or how
        else:
            braking, how = self._way_to_hover(now_s)
            situation.reference.fly(braking)
        situation.hold_cause = violation.assumption, now_s
        text = f"holding: {violation}; {how}"
        situation.fire(Trigger.ASSUMPTION_FAILED, now_s, text=text)

    def _leaving_what_is_contradicted(self, violation: Violation, now_s: float) -> str | None:
        """Brake otherwise where the way held leads to what was never seen; return how.

        The set that it was certified in has turned out to be wrong.
        """
        held = self._situation.reference.remaining(now_s)
        contradicted = violation.assumption is Assumption.SENSOR_CONTRADICTION
        if not contradicted or held is None or self._clear_check.is_clear(held):
            return None
        braking, how = self._way_to_hover(now_s)
        self._situation.reference.fly(braking)
        self._situation.rest_held = False
        return how

    def report_and_hold(self, violation: Violation, now_s: float) -> None:
        """Report an assumption that failed in guidance itself, and brake to hover."""
        self._situation.emit(violation.event(now_s))
        self.hold(violation, now_s)

    def recheck_way_to_hover(self, obstacle: Obstacle, now_s: float) -> None:
        """Choose the way to hover again if an obstacle that is new or has grown blocks it."""
        held = self._situation.reference.remaining(now_s)
        if held is None or self._situation.rest_held:
            return
        if not self._clear_check.is_clear(held, [obstacle]):
            braking, how = self._way_to_hover(now_s)
            self._situation.reference.fly(braking)
            text = f"obstacle {obstacle.id} blocks the braking path: {how}"
            event = Event(now_s, EventName.HOLD_REPLANNED, Severity.ERROR, text)
            self._situation.emit_rarely(event, text)

    def hover_at(self, pose: Pose, now_s: float) -> None:
        """Hover where the vehicle is now estimated to be, rather than fly there in one step."""
        situation = self._situation
        if situation.state.phase in (Phase.HOLD, Phase.ARRIVED):
            situation.reference.fly(self._braking_from_measured(pose, now_s))

    def _braking_from_measured(self, pose: Pose, now_s: float) -> Trajectory:
        """Return how to brake from a measured pose.

        The box W holds along and across the nose; wherever that points instead, the least of its
        limits holds in every direction.
        """
        situation = self._situation
        turned_rad = abs(wrap_angle(pose.yaw_rad - situation.leg.heading_rad))
        envelope = situation.envelope
        if turned_rad > HEADING_TOLERANCE_RAD:
            envelope = any_heading(envelope)
        return brake_to_hover(situation.measured_state(pose), now_s, envelope)

    def _way_to_hover(self, now_s: float) -> tuple[Trajectory, str]:
        """Return the trajectory to a hover, and its description.

        Brake now if that is clear; else after the plan if that is; else after another avoidance,
        which may be safe where braking is not; else what keeps farther away.  If obstacles turn out
        to be elsewhere than before, none of them may be clear of all of them.
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
        swerving = self._avoiding_what_braking_meets(braking, state, now_s)
        if swerving is not None:
            return swerving, "avoiding what braking would meet, then braking to hover"
        room_m = self._clear_check.room_m
        if finishing is not None and room_m(finishing) > room_m(braking):
            how = "finishing the avoidance, which keeps farther away, then braking to hover"
            return finishing, how + UNCERTIFIED
        return braking, "braking to hover" + UNCERTIFIED

    def _avoiding_what_braking_meets(
        self, braking: Trajectory, state: State, now_s: float
    ) -> Trajectory | None:
        """Return an avoidance of the obstacle in front, and braking after it, if that certifies.

        Between the last place to stop and the front of a pointed region only this is safe.
        """
        x_m, y_m, _ = state.position_leg_m
        stopping_m = braking.final.position_leg_m[X] - x_m
        obstacle = self._situation.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=stopping_m)
        if obstacle is None:
            return None
        entry_mps = state.velocity_leg_mps[X]
        avoidance = self._planner.plan(obstacle, state, now_s, entry_mps)
        if avoidance is None:
            return None
        planned = avoidance.plan.trajectory
        after = self._situation.braking_from(planned.final, planned.end_s)
        clear = self._clear_check.is_clear(planned) and self._clear_check.is_clear(after)
        return planned.followed_by(after) if clear else None
