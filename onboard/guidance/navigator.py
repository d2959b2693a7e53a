"""Flies the mission by induction: cruise, avoid one obstacle of interest, cruise on (Fig. 14).

The navigator owns the *reference*: a trajectory in the leg frame that is continuous over phases.
Plans start at the reference, not at the measured state; the tracking error is in the contract.
Only certified trajectories become the reference, but for two that are all that is left: braking
where no way to stop certifies, and braking where a position can no longer be believed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import TICK_S, Assessment
from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventData, EventName, Severity
from onboard.files.models import Mission
from onboard.geometry.frames import LegFrame, wrap_angle
from onboard.guidance.departure import Refusal, RefusalKind
from onboard.guidance.phases import (
    Phase,
    Trigger,
    next_phase,
    post_condition,
    pre_condition,
)
from onboard.guidance.route import Itinerary
from onboard.monitoring.adaptation import Adaptation, adapt, slowing_distance, slows_in_time
from onboard.monitoring.assumptions import Assumption, Violation, measured_size_max
from onboard.motion.axis_profile import coasting_speed
from onboard.motion.trajectory import State, Trajectory, Vector, X
from onboard.perception.obstacle_map import Obstacle, ObstacleMap
from onboard.planning.certifier import certify_clear
from onboard.planning.closed_form import brake_to_hover, stop_at
from onboard.planning.planner import Plan, Planner
from onboard.planning.problem import AvoidanceProblem, Envelope, exit_speeds_mps
from onboard.planning.proximity import least_room_m
from onboard.vehicle_state import Pose, Setpoint

# A leg starts once the nose points along it, at rest, and the sensor has looked there since.
HEADING_TOLERANCE_RAD: Final = math.radians(5.0)
# At rest is what stops within the tracking error, but not less than this, nor more: no hover is
# that fast.  The estimate of a real hover reads up to 0.9 m/s (PX4), its position wanders with it.
AT_REST_MPS: Final = 0.3
AT_REST_MAX_MPS: Final = 1.0
# How near the vehicle must hover to the start of the mission.
START_TOLERANCE_M: Final = 1.5


@dataclass(frozen=True)
class Avoidance:
    """One induction step in progress: the obstacle, its region as planned against, and the plan.

    ``entry_speed_mps`` is the speed along the leg at its beginning, ``exit_speed_mps`` at its end.
    """

    obstacle: Obstacle
    plan: Plan
    entry_speed_mps: float
    exit_speed_mps: float


@dataclass(frozen=True)
class PlannedStep:
    """A plan as it was made, for the log; ``plan_time_s`` is what the planner took for it."""

    plan: Plan
    obstacle: Obstacle
    leg: LegFrame
    plan_time_s: float


class Navigator:
    """Decides, tick by tick, which reference is flown.

    Args:
        assessment: the contract and what follows from it.
        mission: where to fly.
        planner: Eq. 17.
        stopwatch: reads a clock in seconds, only to report how long plans took.
        adaptive: answer a failed assumption by solving the contract again where that helps.
    """

    def __init__(
        self,
        assessment: Assessment,
        mission: Mission,
        planner: Planner,
        stopwatch: Callable[[], float],
        *,
        adaptive: bool,
    ) -> None:
        self.assessment = assessment
        self.phase = Phase.STANDBY
        self.avoidance: Avoidance | None = None
        self._planned: list[PlannedStep] = []
        self.plan_times_s: list[float] = []
        self.events: list[Event] = []
        self._limiter = EventLimiter()
        self._adaptive = adaptive
        self._planner = planner
        self._stopwatch = stopwatch
        self._itinerary = Itinerary(mission)
        self.obstacles = ObstacleMap(self.leg, assessment.region_around, self._merged_size_max_m)
        self._envelope = _envelope(assessment)
        # What is flown now; in STANDBY nothing is.
        self._reference: Trajectory | None = None
        # What takes over from it, between this tick and the next.
        self._upcoming: Trajectory | None = None
        self._aligned_since_s: float | None = None
        self._aligning = False
        # Theory F: whether the cruise drifts back to the leg line, else since where it is straight.
        self._drifting, self._straight_from_x_m = False, 0.0

    # ------------------------------------------------------------------ what is flown

    @property
    def leg(self) -> LegFrame:
        """Frame of the leg that is flown."""
        return self._itinerary.frame

    def reference(self, time_s: float) -> State | None:
        """Return the reference at a time, leg frame; None in STANDBY."""
        flown = self._reference
        if self._upcoming is not None and time_s >= self._upcoming.start_s:
            flown = self._upcoming
        return None if flown is None else flown.sample(time_s)

    def setpoint(self, time_s: float) -> Setpoint | None:
        """Return the reference at a time as a setpoint in NED; None in STANDBY."""
        state = self.reference(time_s)
        if state is None:
            return None
        return Setpoint(
            self.leg.position_ned(state.position_leg_m),
            self.leg.vector_ned(state.velocity_leg_mps),
            self.leg.vector_ned(state.acceleration_leg_mps2),
            self.leg.heading_rad,
        )

    @property
    def cruising_freely(self) -> bool:
        """Whether the vehicle cruises outside every Region of Influence."""
        return self.phase is Phase.CRUISE and not self._aligning

    @property
    def moving(self) -> bool:
        """Whether the vehicle is on its way along a leg, its nose aligned."""
        return self.cruising_freely or self.phase is Phase.AVOID

    @property
    def in_control(self) -> bool:
        """Whether the service commands the vehicle: in every phase but STANDBY."""
        return self.phase is not Phase.STANDBY

    @property
    def flying(self) -> bool:
        """Whether the guarantee is at stake: the vehicle is on its way."""
        return self.phase in (Phase.CRUISE, Phase.AVOID)

    def take_planned(self) -> list[PlannedStep]:
        """Return and forget the plans made since the last call."""
        planned, self._planned = self._planned, []
        return planned

    def obstacles_to_meet(self, now_s: float) -> list[Obstacle]:
        """Obstacles whose properties matter now: the one avoided, and the next one ahead.

        Ahead means on the line that the vehicle is on, or will be on after its avoidance; in
        STANDBY, on the line from the start of the leg.
        """
        state = self.reference(now_s)
        x_m, y_m = (0.0, 0.0) if state is None else state.position_leg_m[:2]
        met = []
        if self.avoidance is not None:
            met.append(self.avoidance.obstacle)
            x_m, y_m, _ = self.avoidance.plan.trajectory.final.position_leg_m
        range_m = self.assessment.terms.detection_range_m
        following = self.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=range_m)
        if following is not None:
            met.append(following)
        # As they are known now, not as they were when the plan was made.
        return [self.obstacles.of_track(o.members[0]) or o for o in met]

    # ------------------------------------------------------------------ triggers from outside

    def departure_refusals(self, pose: Pose) -> list[Refusal]:
        """Return why the leg may not be started or resumed from here; empty if it may."""
        x_m, y_m, z_m = self.leg.position_leg(pose.position_ned_m)
        speed_mps = math.hypot(*pose.velocity_ned_mps)
        beside_max_m = self._itinerary.leg.target_half_width_m
        kind = RefusalKind
        checks = [
            (
                kind.BEFORE_LEG,
                x_m >= -START_TOLERANCE_M,
                f"{-x_m:.1f} m before the start of the leg",
            ),
            (
                kind.LEG_FLOWN,
                x_m < self._itinerary.length_m - START_TOLERANCE_M,
                "the leg is already flown",
            ),
            (kind.BESIDE_LEG, abs(y_m) <= beside_max_m, f"{abs(y_m):.1f} m beside the leg"),
            (
                kind.OFF_HEIGHT,
                -START_TOLERANCE_M <= z_m <= self._start_lower_max_m,
                f"{abs(z_m):.1f} m off the cruise height",
            ),
            # From rest only: whatever way braking would take has not been certified.
            (kind.MOVING, speed_mps < self._at_rest_mps, f"not at rest ({speed_mps:.1f} m/s)"),
        ]
        refusals = [Refusal(which, text) for which, passed, text in checks if not passed]
        refusals += [
            Refusal(
                kind.INSIDE_REGION,
                f"inside the region of influence of obstacle {obstacle.id}",
                obstacle.id,
            )
            for obstacle in self.obstacles.between(x_m, x_m)
            if obstacle.region.lane_left_m <= y_m <= obstacle.region.lane_right_m
        ]
        return refusals

    @property
    def _start_lower_max_m(self) -> float:
        """How far below the cruise height a flight may start: not nearer to the ground than safe.

        Where the contract does not comply, a forced flight starts all the same.
        """
        margins_m = [c.margin for c in self.assessment.clauses if c.name == "ground_clearance"]
        return min([START_TOLERANCE_M, *(margin_m for margin_m in margins_m if margin_m > 0.0)])

    def take_control(self, pose: Pose, now_s: float) -> None:
        """Come to a hover and start, or resume, the current leg (CONTROL_GRANTED)."""
        self._trigger(Trigger.CONTROL_GRANTED, now_s)
        self._align(self._measured_state(pose), now_s)

    def release_control(self, now_s: float) -> None:
        """Stop flying: somebody else does (CONTROL_TAKEN)."""
        if self.phase is not Phase.STANDBY:
            self._trigger(Trigger.CONTROL_TAKEN, now_s)
        self._reference = self._upcoming = self.avoidance = None
        self._aligning = False
        self.obstacles.rejoin()
        self._restart_itinerary()

    def change_mission(self, mission: Mission, now_s: float) -> None:
        """Fly another mission: from its start in STANDBY, else from where the vehicle stops.

        An avoidance in progress is finished first.  Who hovers in ARRIVED or HOLD goes on hovering;
        what is flown after the pilot has taken over and handed back is the new mission.
        """
        if self._reference is not None and mission.altitude_m != self._itinerary.mission.altitude_m:
            text = f"mission refused: in flight it has to stay at {-self.leg.origin_ned_m[2]:g} m"
            self._note_rarely(
                Event(now_s, EventName.MISSION_REFUSED, Severity.WARNING, text), "altitude"
            )
            return
        self._itinerary.successor = mission
        self.assessment = self.assessment.at_altitude(mission.altitude_m)
        when = "now" if self.flying else "once control is granted"
        text = f"another mission is flown {when}"
        data: EventData = {"mission": mission.model_dump(mode="json")}
        self._note(Event(now_s, EventName.MISSION_CHANGED, Severity.NOTICE, text, data))
        if self.phase is Phase.STANDBY:
            self._restart_itinerary()
        elif self.cruising_freely and self._reference is not None:
            self._cruise_from(self._reference.sample(now_s), now_s)

    def answer(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Answer a failed assumption: by a contract solved again if that complies, else by braking.

        The arguments are those of `fail`.
        """
        if not self.flying:
            return
        adaptation = adapt(self.assessment, violation) if self._adaptive else None
        if adaptation is None or not self._adopt(adaptation, violation, now_s):
            self.fail(violation, now_s, measured)

    def _adopt(self, adaptation: Adaptation, violation: Violation, now_s: float) -> bool:
        """Fly on under the adapted contract, if the vehicle can get there from here."""
        state, before = self.reference(now_s), self.assessment
        if state is None:
            return False
        if adaptation.slower and not (
            self.phase is Phase.CRUISE
            and slows_in_time(before, self._peak_mps(state), adaptation.assessment)
        ):
            return False
        self._adopt_terms(adaptation.assessment)
        if adaptation.slower and not self._slow_down(state, before, now_s):
            self._adopt_terms(before)
            return False
        speed_mps = self.assessment.terms.cruise_speed_mps
        text = f"contract solved again for {violation}: flying on at {speed_mps:.2f} m/s"
        # Another speed is news; it only ever falls, by steps, so that there are few.
        kind = f"{violation.key} {speed_mps:.2f}"
        self._note_rarely(Event(now_s, EventName.ADAPTED, Severity.WARNING, text), kind)
        if self.avoidance is not None:
            self._recheck_avoided(now_s)
        return True

    def _adopt_terms(self, assessment: Assessment) -> None:
        self.assessment, self._envelope = assessment, _envelope(assessment)
        self._rebuild_map()

    def _slow_down(self, state: State, before: Assessment, now_s: float) -> bool:
        """Cruise on at the adapted speed, unless a known region begins before it is reached."""
        x_m, y_m, _ = state.position_leg_m
        way_m = slowing_distance(before, self._peak_mps(state), self.assessment)
        if self.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=way_m) is not None:
            return False
        if not self._aligning:
            self._cruise_from(state, now_s)
        return True

    def _recheck_avoided(self, now_s: float) -> None:
        """Hold the flown plan against its obstacle, as inflated by the adapted contract."""
        assert self.avoidance is not None  # noqa: S101  the caller checked
        obstacle = self.obstacles.of_track(self.avoidance.obstacle.members[0])
        if obstacle is not None:
            self.recheck_plan(obstacle, now_s)

    def fail(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Answer a failed assumption by braking to hover (ASSUMPTION_FAILED).

        Args:
            violation: what failed.
            now_s: when.
            measured: brake from this pose, when the reference itself cannot be believed.
        """
        if not self.flying:
            return
        if measured is None:
            self._reference, how = self._way_to_hover(now_s)
        else:
            state = self._measured_state(measured)
            self._reference = brake_to_hover(state, now_s, self._envelope)
            how = "braking to hover where the vehicle is now"
        self._upcoming, self._aligning = None, False
        self._trigger(Trigger.ASSUMPTION_FAILED, now_s, text=f"holding: {violation}; {how}")

    def shift(self, shift_ned_m: Vector) -> None:
        """State everything remembered in the local frame of now, which the estimator has moved.

        What is flown and what it has been certified against move alike, so that certificates keep
        holding.  The leg stays: it is what the mission says in the frame of now.
        """
        shift_leg_m = x_m, y_m, _ = self.leg.vector_leg(shift_ned_m)
        self.obstacles.shift(*shift_ned_m)
        if self._reference is not None:
            self._reference = self._reference.shifted_by(shift_leg_m)
        if self._upcoming is not None:
            self._upcoming = self._upcoming.shifted_by(shift_leg_m)
        if self.avoidance is not None:
            plan, obstacle = self.avoidance.plan, self.avoidance.obstacle
            plan = replace(plan, trajectory=plan.trajectory.shifted_by(shift_leg_m))
            self.avoidance = replace(
                self.avoidance, obstacle=obstacle.shifted_by(x_m, y_m), plan=plan
            )

    def fly_on_after_shift(self, violation: Violation, now_s: float) -> None:
        """Certify anew what is flown after a `shift`; stop for the violation if that fails.

        In cruise the vehicle aims again at the leg's end and at its height.
        """
        if self.cruising_freely and self._reference is not None:
            self._cruise_from(self._reference.sample(now_s), now_s)
        if self.avoidance is None:
            return
        planned = self.avoidance.plan.trajectory
        if now_s < planned.end_s and not self._clear(planned.from_time(now_s)):
            self.fail(violation, now_s)

    def hover_at(self, pose: Pose, now_s: float) -> None:
        """Hover where the vehicle is now said to be, rather than fly there in one step."""
        if self.phase in (Phase.HOLD, Phase.ARRIVED):
            state = self._measured_state(pose)
            self._reference = brake_to_hover(state, now_s, self._envelope)

    def _measured_state(self, pose: Pose) -> State:
        return State(
            self.leg.position_leg(pose.position_ned_m),
            self.leg.vector_leg(pose.velocity_ned_mps),
        )

    # ------------------------------------------------------------------ one tick

    def advance(self, pose: Pose, now_s: float) -> None:
        """Decide what is flown until the next tick."""
        if self.phase is Phase.AVOID:
            self._continue_avoiding(now_s)
        if self.phase is Phase.CRUISE:
            self._continue_cruising(pose, now_s)

    def recheck_plan(self, obstacle: Obstacle, now_s: float) -> None:
        """Hold what is flown against an obstacle that is new or has grown."""
        if self.phase is Phase.HOLD:
            self._recheck_way_to_hover(obstacle, now_s)
        if self.phase is not Phase.AVOID or self.avoidance is None:
            return
        planned = self.avoidance.plan.trajectory
        if now_s >= planned.end_s:
            return
        of_interest = self.avoidance.obstacle.members[0] in obstacle.members
        if self._clear(planned.from_time(now_s), [obstacle]):
            if of_interest:
                self._fly_past(obstacle, obstacle, now_s)
            return
        if of_interest and self._replan(obstacle, now_s):
            return
        as_planned = self._as_planned(obstacle)
        if self._clear(planned.from_time(now_s), [as_planned]):
            if of_interest:
                self._fly_past(obstacle, as_planned, now_s)
            text = f"{obstacle.id} is seen to reach farther, within the error of its position"
            self._note_rarely(Event(now_s, EventName.PLAN_KEPT, Severity.NOTICE, text), obstacle.id)
            return
        self._break(Violation(Assumption.PLAN_EXISTS, 0.0, 1.0, "plans", obstacle.id), now_s)

    def _fly_past(self, obstacle: Obstacle, certified: Obstacle, now_s: float) -> None:
        """Let the plan end later where its obstacle is seen to reach beyond its end.

        Else the vehicle, still beside it, would meet it once more there, and far too late.

        Args:
            obstacle: as it is seen now.
            certified: as the rest of the plan is known to be clear of it: its sides are where
                they are, however far the obstacle reaches.
            now_s: the time.
        """
        assert self.avoidance is not None  # noqa: S101  the caller checked
        plan, side_m = self.avoidance.plan, certified.region.obstacle
        final = plan.trajectory.final
        (x_m, y_m, _), speed_mps = final.position_leg_m, final.velocity_leg_mps[X]
        left_m = obstacle.region.x_pob_m - x_m
        beside = not side_m.y_min_m < y_m < side_m.y_max_m
        met_again = left_m > 0.0 and obstacle.region.lies_ahead(x_m, y_m)
        if not (met_again and beside and speed_mps > 0.0):
            return
        longer = plan.trajectory.coasting_for(left_m / speed_mps)
        if self._clear(longer.from_time(now_s), [certified]):
            plan = replace(plan, trajectory=longer)
            self.avoidance = replace(self.avoidance, plan=plan)
            self._upcoming = longer
            self._planned.append(PlannedStep(plan, obstacle, self.leg, 0.0))

    def _recheck_way_to_hover(self, obstacle: Obstacle, now_s: float) -> None:
        if self._reference is None or now_s >= self._reference.end_s:
            return
        if not self._clear(self._reference.from_time(now_s), [obstacle]):
            self._reference, how = self._way_to_hover(now_s)
            text = f"{obstacle.id} is in the way to hover: {how}"
            self._note_rarely(Event(now_s, EventName.HOLD_REPLANNED, Severity.ERROR, text), text)

    # ------------------------------------------------------------------ cruise

    def _continue_cruising(self, pose: Pose, now_s: float) -> None:
        if self._reference is None:
            return
        if now_s >= self._reference.end_s and (self._stops_for_another or not self._aligning):
            self._finish_leg(now_s)
            return
        if self._aligning:
            self._await_alignment(pose, now_s)
            return
        here, soon = self._reference.sample(now_s), self._reference.sample(now_s + TICK_S)
        (x_m, y_m, _), soon_m = here.position_leg_m, soon.position_leg_m[0]
        obstacle = self.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=soon_m - x_m)
        end_x_m = self._reference.final.position_leg_m[X]
        if obstacle is None or end_x_m < obstacle.region.keep_out.x_min_m:
            self._recentre(here, now_s)
            return
        if end_x_m <= obstacle.region.x_pob_m and not self._stops_for_another:
            short_m = obstacle.region.x_pob_m - end_x_m
            self._break(Violation(Assumption.LEG_END_CLEAR, short_m, 0.0, "m", obstacle.id), now_s)
            return
        self._avoid(obstacle, now_s)

    def _recentre(self, here: State, now_s: float) -> None:
        """Begin or end the drift back to the leg line (theory F)."""
        corridor = self.assessment.corridor
        if corridor is None or self._reference is None:
            return
        x_m, y_m, _ = here.position_leg_m
        soon = self._reference.sample(now_s + corridor.ending_s)
        steady = corridor.steady(here.velocity_leg_mps[X], soon.velocity_leg_mps[X])
        free = steady and not any(
            corridor.meets(y_m, obstacle.region.keep_out)
            for obstacle in self.obstacles.between(x_m, x_m + corridor.reach_m)
        )
        if self._drifting:
            if not free:
                self._cruise_from(here, now_s)
        elif free and corridor.seen(y_m, straight_m=x_m - self._straight_from_x_m):
            self._cruise_from(here, now_s, drifting=True)

    def _await_alignment(self, pose: Pose, now_s: float) -> None:
        error_rad = abs(wrap_angle(pose.yaw_rad - self.leg.heading_rad))
        resting = self._reference is not None and now_s >= self._reference.end_s
        at_rest = resting and math.hypot(*pose.velocity_ned_mps) < self._at_rest_mps
        look_s = self.assessment.terms.frame_age_max_s + self.assessment.terms.reaction_time_s
        if error_rad > HEADING_TOLERANCE_RAD or not at_rest:
            self._aligned_since_s = None
        elif self._aligned_since_s is None:
            self._aligned_since_s = now_s
        elif now_s - self._aligned_since_s >= look_s:
            self._aligning = False
            state = self.reference(now_s)
            assert state is not None  # noqa: S101  aligning implies a reference
            self._cruise_from(state, now_s)

    def _finish_leg(self, now_s: float) -> None:
        assert self._reference is not None  # noqa: S101  the caller checked
        x_m, y_m, z_m = self._reference.final.position_leg_m
        beside_m = max(abs(y_m), abs(x_m - self._itinerary.length_m))
        allowed_m = self._itinerary.leg.target_half_width_m
        if beside_m > allowed_m and not self._stops_for_another:
            self._break(Violation(Assumption.TARGET_REACHED, beside_m, allowed_m, "m"), now_s)
            return
        # From where the vehicle is: the last leg may have left it beside its end (erratum 16).
        north_m, east_m, _ = self.leg.position_ned((x_m, y_m, 0.0))
        if self._itinerary.begin_next(north_m, east_m):
            self._rebuild_map()
            self._trigger(Trigger.LEG_FLOWN, now_s)
            # Perhaps still a little above the cruise height, after a climb.
            self._align(State((0.0, 0.0, z_m), (0.0, 0.0, 0.0)), now_s)
        else:
            self._trigger(Trigger.MISSION_FLOWN, now_s)

    @property
    def _at_rest_mps(self) -> float:
        """Speed from which the vehicle stops, lag included, within its tracking error."""
        terms, brake_mps2 = self.assessment.terms, self.assessment.limits.brake_mps2
        lag_s = terms.attitude_lag_s
        stops_mps = brake_mps2 * (
            math.sqrt(lag_s**2 + 2.0 * terms.tracking_error_m / brake_mps2) - lag_s
        )
        return min(max(AT_REST_MPS, stops_mps), AT_REST_MAX_MPS)

    def _align(self, state: State, now_s: float) -> None:
        """Hover and turn the nose, and with it the sensor, along the leg."""
        self._reference = brake_to_hover(state, now_s, self._envelope)
        self._aligned_since_s, self._aligning = None, True

    def _cruise_from(self, state: State, start_s: float, *, drifting: bool = False) -> None:
        """Fly on along the leg and stop at its end, or beyond it if that is too near.

        Before another mission, stop as soon as may be.
        """
        x_m = state.position_leg_m[X]
        self._drifting, self._straight_from_x_m = drifting, x_m
        terms = self.assessment.terms
        stopping = stop_at(
            state,
            start_s,
            self._envelope,
            x_m if self._stops_for_another else self._itinerary.length_m,
            speed_mps=terms.cruise_speed_mps,
            z_m=0.0,
            recentring_mps=terms.recentring_speed_mps if drifting else 0.0,
        )
        self._reference = stopping or brake_to_hover(state, start_s, self._envelope)
        envelope = self._envelope_from(state)
        certificate = certify_clear(self._reference, state, start_s, envelope)
        if not certificate.valid:
            text = f"the cruise does not certify: {'; '.join(certificate.failures)}"
            self._note(Event(start_s, EventName.CERTIFICATE, Severity.CRITICAL, text))
            self._break(Violation(Assumption.SELF_CHECK, 1.0, 0.0, "certificates"), start_s)

    @property
    def _stops_for_another(self) -> bool:
        """Whether the vehicle stops where it can, to fly another mission from there."""
        return self._itinerary.successor is not None

    def _restart_itinerary(self) -> None:
        if self._stops_for_another:
            self._itinerary.restart()
            self._rebuild_map()

    # ------------------------------------------------------------------ avoidance

    def _avoid(self, obstacle: Obstacle, now_s: float) -> None:
        """Plan the induction step for an obstacle whose pre-condition holds by the next tick."""
        assert self._reference is not None  # noqa: S101  the caller checked
        region = obstacle.region
        start_s = self._reference.from_time(now_s).first_time_s(X, region.extent.x_min_m)
        # An obstacle first seen inside its region is planned against from where we are.
        start_s = now_s if start_s is None or start_s < now_s else min(start_s, now_s + TICK_S)
        start = self._reference.sample(start_s)
        terms = self.assessment.terms
        allowed_m = self.assessment.inflated.encounter.speed_mps * terms.reaction_time_s
        condition = pre_condition(
            start,
            region,
            speed_max_mps=terms.cruise_speed_mps + 1e-9,
            late_m=allowed_m,
        )
        if not condition.holds:
            late_m = start.position_leg_m[0] - region.extent.x_min_m
            late = Violation(Assumption.LATE_FIRST_SIGHT, late_m, allowed_m, "m", obstacle.id)
            other = Event(
                now_s, EventName.PRE_CONDITION, Severity.ERROR, "; ".join(condition.failures)
            )
            self._note(late.event(now_s) if late_m > allowed_m else other)
        entry_mps = start.velocity_leg_mps[X]
        avoidance = self._plan(obstacle, start, start_s, entry_mps)
        if avoidance is None:
            self._break(Violation(Assumption.PLAN_EXISTS, 0.0, 1.0, "plans", obstacle.id), now_s)
            return
        self._fly(avoidance)
        text = f"avoiding {obstacle.id} ({avoidance.plan.kind})"
        self._trigger(Trigger.PRE_CONDITION, now_s, text=text)

    def _continue_avoiding(self, now_s: float) -> None:
        assert self.avoidance is not None  # noqa: S101  AVOID implies it
        plan = self.avoidance.plan
        if self._upcoming is not None and now_s >= self._upcoming.start_s:
            self._reference, self._upcoming = self._upcoming, None
        if now_s < plan.trajectory.end_s:
            return
        final = plan.trajectory.final
        condition = post_condition(
            final,
            self.avoidance.obstacle.region,
            exit_speed_mps=self.avoidance.exit_speed_mps,
        )
        if not condition.holds:
            # The certificate promised otherwise: a defect, and answered like one.
            text = "; ".join(condition.failures)
            self._note(Event(now_s, EventName.POST_CONDITION, Severity.CRITICAL, text))
        self.avoidance = None
        self._trigger(Trigger.POST_CONDITION, now_s)
        self._cruise_from(final, plan.trajectory.end_s)

    def _fly(self, avoidance: Avoidance) -> None:
        self.avoidance = avoidance
        self._upcoming = avoidance.plan.trajectory
        step = PlannedStep(avoidance.plan, avoidance.obstacle, self.leg, self.plan_times_s[-1])
        self._planned.append(step)

    def _replan(self, obstacle: Obstacle, now_s: float) -> bool:
        """Plan again in mid-manoeuvre, around an obstacle that has grown."""
        assert self.avoidance is not None  # noqa: S101  the caller checked
        start_s = now_s + TICK_S
        start = self.reference(start_s)
        if start is None:
            return False
        avoidance = self._plan(obstacle, start, start_s, self.avoidance.entry_speed_mps)
        if avoidance is None:
            return False
        self._fly(avoidance)
        text = f"replanned around {obstacle.id} ({avoidance.plan.kind})"
        self._note(Event(now_s, EventName.REPLANNED, Severity.NOTICE, text))
        return True

    def _problem(
        self, obstacle: Obstacle, start: State, start_s: float, exit_speed_mps: float
    ) -> AvoidanceProblem:
        climb_max_m = self._itinerary.mission.climb_max_m
        return AvoidanceProblem(
            start=start,
            start_s=start_s,
            region=obstacle.region,
            envelope=self._envelope,
            exit_speed_mps=exit_speed_mps,
            climb_m=climb_max_m,
            climb_preferred=climb_max_m > 0.0,
            coast_time_s=self.assessment.inflated.encounter.coast_time_s,
        )

    def _plan(
        self, obstacle: Obstacle, start: State, start_s: float, entry_mps: float
    ) -> Avoidance | None:
        """Return the first plan that certifies and passes the obstacle, whatever is flown now."""
        current = None if self.avoidance is None else self.avoidance.plan
        began_s, found = self._stopwatch(), None
        for exit_mps in exit_speeds_mps(entry_mps, self._envelope.speed_max_mps):
            problem = self._problem(obstacle, start, start_s, exit_mps)
            plan = self._planner.plan(problem, current)
            if isinstance(plan, Plan) and plan.kind != "brake":
                found = Avoidance(obstacle, plan, entry_mps, exit_mps)
                break
        self.plan_times_s.append(self._stopwatch() - began_s)
        return found

    # ------------------------------------------------------------------ hover

    def _way_to_hover(self, now_s: float) -> tuple[Trajectory, str]:
        """Brake now if that is clear; else after the plan if that is; else what keeps farther off.

        Where obstacles are seen to be elsewhere than before, neither may be clear of all places.
        """
        state = self.reference(now_s)
        assert state is not None  # noqa: S101  the caller checked
        brake = brake_to_hover(state, now_s, self._envelope)
        if self._clear(brake):
            return brake, "braking to hover"
        finish = None
        if self.avoidance is not None and now_s < self.avoidance.plan.trajectory.end_s:
            planned = self.avoidance.plan.trajectory.from_time(now_s)
            after = brake_to_hover(planned.final, planned.end_s, self._envelope)
            finish = planned.followed_by(after)
            if self._clear(planned) and self._clear(after):
                return finish, "finishing the avoidance, then braking to hover"
        uncertain = ", although no way to stop is certified"
        if finish is not None and self._room_m(finish) > self._room_m(brake):
            way = "finishing the avoidance, which keeps farther away, then braking to hover"
            return finish, way + uncertain
        return brake, "braking to hover" + uncertain

    def _room_m(self, trajectory: Trajectory) -> float:
        near = self.obstacles.between(*trajectory.position_range_m(X))
        return least_room_m(trajectory, [obstacle.region.obstacle for obstacle in near])

    def _clear(self, trajectory: Trajectory, obstacles: Iterable[Obstacle] | None = None) -> bool:
        """Tell whether a trajectory certifies; by default against every obstacle in its way."""
        if obstacles is None:
            obstacles = map(
                self._as_planned, self.obstacles.between(*trajectory.position_range_m(X))
            )
        start = trajectory.sample(trajectory.start_s)
        boxes = [obstacle.region.obstacle for obstacle in obstacles]
        envelope = self._envelope_from(start)
        return certify_clear(trajectory, start, trajectory.start_s, envelope, boxes).valid

    def _as_planned(self, obstacle: Obstacle) -> Obstacle:
        """Return the obstacle as the flown plan knows it, while what is seen confirms that."""
        if self.avoidance is None:
            return obstacle
        planned = self.avoidance.obstacle
        if not obstacle.confirms(planned, self.assessment.face_error_m):
            return obstacle
        # The box of then under the terms of now: an adapted contract may inflate it more.
        region = self.assessment.region_around(planned.measured, planned.position_error_m)
        return replace(planned, region=region)

    def _envelope_from(self, state: State) -> Envelope:
        """Return the envelope with room for a speed that is still to be slowed down from."""
        speed_max_mps = max(self._envelope.speed_max_mps, self._peak_mps(state))
        return replace(self._envelope, speed_max_mps=speed_max_mps)

    def _peak_mps(self, state: State) -> float:
        """Return the speed that is reached while the jerk limit ends an acceleration."""
        x = state.axis(X)
        return max(x.velocity_mps, coasting_speed(x, self._envelope.jerk_max_mps3[X]))

    # ------------------------------------------------------------------ bookkeeping

    @property
    def _merged_size_max_m(self) -> float:
        return measured_size_max(self.assessment.terms) if self._adaptive else 0.0

    def _rebuild_map(self) -> None:
        self.obstacles.rebuild(self.leg, self.assessment.region_around, self._merged_size_max_m)

    def _trigger(self, trigger: Trigger, now_s: float, *, text: str = "") -> None:
        before, self.phase = self.phase, next_phase(self.phase, trigger)
        failed = trigger is Trigger.ASSUMPTION_FAILED
        self._note(
            Event(
                now_s,
                EventName.PHASE,
                Severity.ERROR if failed else Severity.INFO,
                text or f"{self.phase} ({trigger})",
                {"from": before, "to": self.phase, "trigger": trigger},
            )
        )

    def _note(self, event: Event) -> None:
        self.events.append(event)

    def _note_rarely(self, event: Event, kind: str) -> None:
        """Say what may repeat in every tick."""
        if self._limiter.allows(f"{event.name} {kind}", event.time_s):
            self._note(event)

    def _break(self, violation: Violation, now_s: float) -> None:
        """Report an assumption that failed in planning, and answer it."""
        self._note(violation.event(now_s))
        self.fail(violation, now_s)


def _envelope(assessment: Assessment) -> Envelope:
    """What plans may ask for: W, the thrust limit, and jerk that the attitude can follow.

    Full acceleration builds up within the attitude lag that the contract allows for (theory D).
    """
    terms, limits = assessment.terms, assessment.limits
    jerk_x_mps3 = jerk_y_mps3 = math.inf
    if terms.attitude_lag_s > 0.0:
        jerk_x_mps3 = max(limits.brake_mps2, limits.forward_mps2) / terms.attitude_lag_s
        jerk_y_mps3 = max(limits.left_mps2, limits.right_mps2) / terms.attitude_lag_s
    return Envelope(
        limits=limits,
        thrust_max_mps2=terms.thrust_to_weight * GRAVITY_MPS2,
        jerk_max_mps3=(jerk_x_mps3, jerk_y_mps3, jerk_y_mps3),
        speed_max_mps=terms.cruise_speed_mps,
        trim_mps2=assessment.reserved_trim_mps2,
    )
