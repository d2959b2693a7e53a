"""One step of the induction: begin a plan around an obstacle, check it, follow it, cruise on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from onboard.contract.assessment import TICK_S
from onboard.events import Event, EventName, Severity
from onboard.geometry.frames import LegFrame
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.cruise import Cruise
from onboard.guidance.dense.shield import Shield
from onboard.guidance.fallback import Fallback
from onboard.guidance.induction_planner import InductionPlanner
from onboard.guidance.movers.mover_passing import MoverPassing
from onboard.guidance.phases import Condition, Trigger, post_condition, pre_condition
from onboard.guidance.situation import RETRY_S, Avoidance, Situation
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State, X, Y
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.planner import Plan

# The speed of a cruise may exceed the contract's by round-off.
_ROUND_OFF_MPS = 1e-9


@dataclass(frozen=True)
class PlannedStep:
    """A plan as it was made, for the log.

    Attributes:
        plan: the certified plan.
        obstacle: what it avoids.
        leg: frame of the plan.
        plan_time_s: duration of planning.
    """

    plan: Plan
    obstacle: Obstacle
    leg: LegFrame
    plan_time_s: float


class AvoidanceStep:
    """Begins, follows, rechecks and ends an avoidance.

    Args:
        situation: what is flown, and what is known.
        clear_check: certifies what is left of a plan.
        fallback: what is left if no plan is.
        cruise: goes on after the step.
        planner: makes plans.
        shield: certifies that what they begin with ends at rest; None where that is not required.

    Attributes:
        passing: begins avoidances of movers; None where no way to rest is required.
    """

    def __init__(
        self,
        situation: Situation,
        clear_check: ClearCheck,
        fallback: Fallback,
        cruise: Cruise,
        planner: InductionPlanner,
        shield: Shield | None = None,
    ) -> None:
        self._situation, self._clear_check = situation, clear_check
        self._fallback, self._cruise, self._planner = fallback, cruise, planner
        self._shield = shield
        self.passing: MoverPassing | None = None
        if shield is not None:
            self.passing = MoverPassing(situation, clear_check, planner, shield, self.follow)
        self._planned: list[PlannedStep] = []
        # Which obstacle no plan was found around, and when to try again.
        self._unplanned, self._retry_s = "", -math.inf
        # Of this leg: which tracks have been noted, up to which state of the map, and which of
        # them were seen in time.
        self._noted: set[str] = set()
        self._in_time: set[str] = set()
        self._noted_leg: LegFrame | None = None
        self._noted_revision = -1

    def take_planned(self) -> list[PlannedStep]:
        """Return and forget the plans made since the last call."""
        planned, self._planned = self._planned, []
        return planned

    # ------------------------------------------------------------------ from begin to end

    def note_first_sights(self, now_s: float) -> None:
        """Remember of each obstacle that is new whether it is seen in time on this leg.

        What is known when a leg begins, where the vehicle rests, is known in time.
        """
        situation = self._situation
        state, revision = situation.reference.sample(now_s), situation.obstacles.revision
        begins = situation.leg != self._noted_leg
        if state is None or (revision == self._noted_revision and not begins):
            return
        if begins:
            self._noted.clear()
            self._in_time.clear()
        self._noted_leg, self._noted_revision = situation.leg, revision
        x_m, y_m, _ = state.position_leg_m
        for seen in situation.obstacles.each_new(self._noted):
            self._noted.add(seen.id)
            late_m = x_m - seen.region.approach_x_m
            if begins or late_m <= self._late_max_m(seen, y_m):
                self._in_time.add(seen.id)

    def begin_due(self, obstacle: Obstacle | None, now_s: float) -> None:
        """Begin the step around an obstacle that is due, or else around a mover ahead."""
        if obstacle is not None:
            self.begin(obstacle, now_s)
        if self.passing is not None and self._situation.state.cruising_freely:
            self.passing.begin_if_due(now_s)

    def begin(self, obstacle: Obstacle, now_s: float) -> None:
        """Plan the step around an obstacle whose region begins by the next tick.

        Where the vehicle stops in time all the same, it cruises on without a plan that certifies,
        and tries again a little later.
        """
        if self._shield is not None and obstacle.id == self._unplanned and now_s < self._retry_s:
            return
        again, seen = obstacle.id == self._unplanned, obstacle
        obstacle = self._situation.to_avoid(seen)
        current = self._situation.reference.current
        assert current is not None  # noqa: S101  what cruises has a reference
        front_m = obstacle.region.approach_x_m
        start_s = current.from_time(now_s).first_time_s(X, front_m)
        # An obstacle first seen inside its region is planned against from where the vehicle is.
        start_s = now_s if start_s is None or start_s < now_s else min(start_s, now_s + TICK_S)
        start = current.sample(start_s)
        if not again:
            self._check_pre_condition(start, seen, now_s)
        avoidance = self._planner.plan(obstacle, start, start_s, start.velocity_leg_mps[X])
        if avoidance is None and self._shield is None:
            self._report_no_plan(obstacle, now_s)
            return
        if avoidance is None or not self._may_fly(avoidance, now_s):
            self._unplanned, self._retry_s = obstacle.id, now_s + RETRY_S
            return
        self._unplanned = ""
        self.follow(avoidance, now_s, f"avoiding {obstacle.id} ({avoidance.plan.kind})")

    def follow(self, avoidance: Avoidance, now_s: float, text: str) -> None:
        """Fly an avoidance that the shield has accepted, where one is; the text is for the log."""
        self._fly(avoidance, now_s)
        self._situation.fire(Trigger.PRE_CONDITION, now_s, text=text)

    def advance(self, now_s: float) -> None:
        """Follow the plan, and cruise on from its end."""
        situation, avoidance = self._situation, self._situation.avoidance
        assert avoidance is not None  # noqa: S101  what avoids has an avoidance
        situation.reference.hand_over(now_s)
        trajectory = avoidance.plan.trajectory
        if now_s < trajectory.end_s:
            return
        condition = post_condition(
            trajectory.final, avoidance.obstacle.region, exit_speed_mps=avoidance.exit_speed_mps
        )
        if not condition.holds:
            # The certificate promised otherwise: a defect of the software.
            text = "; ".join(condition.failures)
            situation.emit(Event(now_s, EventName.POST_CONDITION, Severity.CRITICAL, text))
        situation.avoidance = None
        situation.fire(Trigger.POST_CONDITION, now_s)
        self._cruise.fly_from(trajectory.final, trajectory.end_s)

    def _check_pre_condition(self, start: State, obstacle: Obstacle, now_s: float) -> None:
        """Report where a step does not start as the contract says; it is planned all the same."""
        assessment = self._situation.assessment
        allowed_m = self._late_max_m(obstacle, start.position_leg_m[Y])
        if self._may_have_grown_into_way(obstacle, start.position_leg_m[Y]):
            allowed_m = math.inf
        condition: Condition = pre_condition(
            start,
            obstacle.region,
            speed_max_mps=assessment.terms.cruise_speed_mps + _ROUND_OFF_MPS,
            late_m=allowed_m,
        )
        if condition.holds:
            return
        late_m = start.position_leg_m[X] - obstacle.region.approach_x_m
        late = Violation(Assumption.LATE_FIRST_SIGHT, late_m, allowed_m, "m", obstacle.id)
        other = Event(now_s, EventName.PRE_CONDITION, Severity.ERROR, "; ".join(condition.failures))
        self._situation.emit(late.event(now_s) if late_m > allowed_m else other)

    def _late_max_m(self, obstacle: Obstacle, y_m: float) -> float:
        """Return how far into an obstacle's region the contract allows the vehicle to see it."""
        assessment = self._situation.assessment
        encounter_mps = assessment.inflated.manoeuvre_encounter.speed_mps
        reaction_m = encounter_mps * assessment.terms.reaction_time_s
        return reaction_m + self._out_of_sight_m(obstacle, y_m)

    def _out_of_sight_m(self, obstacle: Obstacle, y_m: float) -> float:
        """Return how far into an obstacle's region the vehicle flies before the range shows it.

        A contract that requires to be able to stop asks for the range of a stop, which may be less
        than that of its avoidance: there no obstacle is late that is seen where the range begins.
        """
        if self._shield is None:
            return 0.0
        box, range_m = obstacle.measured, self._situation.assessment.terms.detection_range_m
        beside_m = max(box.y_min_m - y_m, y_m - box.y_max_m, 0.0)
        ahead_m = math.sqrt(max(range_m**2 - beside_m**2, 0.0))
        return max(box.x_min_m - ahead_m - obstacle.region.approach_x_m, 0.0)

    def _may_have_grown_into_way(self, obstacle: Obstacle, y_m: float) -> bool:
        """Tell whether an obstacle seen in time may have come into the way only by faces' errors.

        The box of all measurements grows by up to an error of each, beside what is flown past it.
        The error is the contract's: one that a sensor reports excuses nothing.
        """
        if not self._in_time.issuperset(obstacle.members):
            return False
        low_m, high_m = obstacle.region.conflict_band_y_m
        return min(y_m - low_m, high_m - y_m) <= 2.0 * self._situation.assessment.face_error_m

    def _fly(self, avoidance: Avoidance, now_s: float) -> None:
        situation = self._situation
        situation.avoidance = avoidance
        situation.reference.schedule(avoidance.plan.trajectory, now_s)
        plan_time_s = self._planner.plan_times_s[-1]
        step = PlannedStep(avoidance.plan, avoidance.obstacle, situation.leg, plan_time_s)
        self._planned.append(step)

    def _may_fly(self, avoidance: Avoidance, now_s: float) -> bool:
        return self._shield is None or self._shield.accepts(avoidance.plan.trajectory, now_s)

    def _report_no_plan(self, obstacle: Obstacle, now_s: float) -> None:
        none = Violation(Assumption.PLAN_EXISTS, 0.0, 1.0, "plans", obstacle.id)
        if self._shield is None:
            self._fallback.report_and_hold(none, now_s)
        else:
            self._shield.report_and_divert(none, now_s)

    # ------------------------------------------------------------------ what turns out on the way

    def recheck(self, obstacle: Obstacle, now_s: float) -> None:
        """Check the rest of the plan against an obstacle that is new or has grown.

        If it does not certify: plan again, else keep the plan if the obstacle has grown within the
        error of its position, else brake to hover.
        """
        avoidance = self._situation.avoidance
        if avoidance is None or now_s >= avoidance.plan.trajectory.end_s:
            return
        rest = avoidance.plan.trajectory.from_time(now_s)
        of_interest = avoidance.track_id in obstacle.members
        if self._clear_check.is_clear(rest, [obstacle]):
            if of_interest:
                self._extend_plan_past(avoidance, obstacle, obstacle, now_s)
            return
        if of_interest and self._replan(avoidance, obstacle, now_s):
            return
        as_planned = self._clear_check.as_planned(obstacle)
        if self._clear_check.is_clear(rest, [as_planned]):
            if of_interest:
                self._extend_plan_past(avoidance, obstacle, as_planned, now_s)
            text = f"keeping the plan: obstacle {obstacle.id} has grown within its position error"
            event = Event(now_s, EventName.PLAN_KEPT, Severity.NOTICE, text)
            self._situation.emit_rarely(event, obstacle.id)
            return
        self._report_no_plan(obstacle, now_s)

    def recheck_avoided(self, now_s: float) -> None:
        """Check the plan against its own obstacle, under a contract that has been adapted."""
        avoidance = self._situation.avoidance
        if avoidance is not None:
            obstacle = self._situation.obstacles.of_track(avoidance.track_id)
            if obstacle is not None:
                self.recheck(obstacle, now_s)

    def recertify(self, violation: Violation, now_s: float) -> None:
        """Check the rest of the plan against every obstacle, and hold for a violation if it fails.

        Args:
            violation: what changed the situation, such as an estimator reset.
            now_s: the time.
        """
        avoidance = self._situation.avoidance
        if avoidance is None or now_s >= avoidance.plan.trajectory.end_s:
            return
        if self._shield is not None:
            return  # what is flown is certified in the set that has been shifted, or braked for
        if not self._clear_check.is_clear(avoidance.plan.trajectory.from_time(now_s)):
            self._fallback.hold(violation, now_s)

    def _replan(self, avoidance: Avoidance, obstacle: Obstacle, now_s: float) -> bool:
        """Plan again in mid-manoeuvre; tell whether there is a plan."""
        start_s = now_s + TICK_S
        start = self._situation.reference.sample(start_s)
        if start is None:
            return False
        obstacle = self._situation.to_avoid(obstacle)
        replanned = self._planner.plan(obstacle, start, start_s, avoidance.entry_speed_mps)
        if replanned is None or not self._may_fly(replanned, now_s):
            return False
        self._fly(replanned, now_s)
        text = f"replanned around {obstacle.id} ({replanned.plan.kind})"
        self._situation.emit(Event(now_s, EventName.REPLANNED, Severity.NOTICE, text))
        return True

    def _extend_plan_past(
        self, avoidance: Avoidance, obstacle: Obstacle, certified: Obstacle, now_s: float
    ) -> None:
        """Let the plan end later where its obstacle turns out to reach beyond its end.

        Otherwise the vehicle, still beside it, would meet it once more there, and far too late.

        Args:
            avoidance: what is flown.
            obstacle: as it is known now.
            certified: the obstacle that the rest of the plan is clear of: its sides are where they
                are, however far the obstacle reaches.
            now_s: the time.
        """
        plan, sides = avoidance.plan, certified.region.obstacle
        final = plan.trajectory.final
        (x_m, y_m, _), speed_mps = final.position_leg_m, final.velocity_leg_mps[X]
        left_m = obstacle.region.x_pob_m - x_m
        beside = not sides.y_min_m < y_m < sides.y_max_m
        met_again = left_m > 0.0 and obstacle.region.on_collision_course(x_m, y_m)
        if not (met_again and beside and speed_mps > 0.0):
            return
        # To the border of the region that plans are made in, which is larger than the map's.
        obstacle = self._situation.to_avoid(obstacle)
        left_m = obstacle.region.x_pob_m - x_m
        longer = plan.trajectory.coasting_for(left_m / speed_mps)
        if self._clear_check.is_clear(longer.from_time(now_s), [certified]):
            plan = replace(plan, trajectory=longer)
            self._situation.avoidance = replace(avoidance, plan=plan)
            self._situation.reference.schedule(longer, now_s)
            self._planned.append(PlannedStep(plan, obstacle, self._situation.leg, 0.0))
