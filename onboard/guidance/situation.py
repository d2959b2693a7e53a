"""What every part of guidance reads and changes: the contract in force, what is flown, and where.

The parts decide; they hold no state of the flight beyond what only they need.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from onboard.contract.assessment import TICK_S, Assessment
from onboard.contract.heights import half_band_m
from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.files.contract_file import Progress
from onboard.files.mission_file import Mission
from onboard.geometry.fence import Fence
from onboard.geometry.frames import LegFrame
from onboard.guidance.envelope import envelope_of, has_best_effort, is_shielded
from onboard.guidance.phases import FlightState, Trigger, next_state
from onboard.guidance.reference import Reference
from onboard.guidance.route import Route
from onboard.monitoring.assumptions import Assumption, measured_size_max
from onboard.motion.trajectory import State, Trajectory, Vector
from onboard.perception.obstacle_map import Obstacle, ObstacleMap
from onboard.planning.closed_form import brake_to_hover
from onboard.planning.planner import Plan
from onboard.vehicle_state import Pose

# Between an obstacle and what is seen free lie at most a cell that it touches, one that the
# certifier rounds out to, and the bins of bearing.
GRID_MARGIN_M: Final = 0.2

# What is intended is certified for this long ahead, braking after it (`Shield`).
GUARD_AHEAD_S: Final = 0.1 + 2.0 * TICK_S
# Planning takes a while: without a plan that certifies it is tried again after this.
RETRY_S: Final = 0.2


@dataclass(frozen=True)
class Avoidance:
    """One induction step in progress.

    Attributes:
        obstacle: the obstacle, with its region, as the plan was made for it.
        plan: the certified plan.
        entry_speed_mps: speed along the leg at the beginning.
        exit_speed_mps: speed along the leg at the end.
        of_mover: the obstacle is a mover, as large as it may become; the map does not have it.
    """

    obstacle: Obstacle
    plan: Plan
    entry_speed_mps: float
    exit_speed_mps: float
    of_mover: bool = False

    @property
    def track_id(self) -> str:
        """A track of the obstacle, which finds it again in the map."""
        return self.obstacle.members[0]

    def shifted_by(self, shift_leg_m: Vector) -> Avoidance:
        """Return the same avoidance elsewhere in the leg frame."""
        x_m, y_m, _ = shift_leg_m
        plan = replace(self.plan, trajectory=self.plan.trajectory.shifted_by(shift_leg_m))
        return replace(self, obstacle=self.obstacle.shifted_by(x_m, y_m), plan=plan)


class Situation:
    """The state of the flight that all parts of guidance share.

    Args:
        assessment: the contract and what follows from it.
        mission: where to fly.
        adaptive: solve the contract again for a failed assumption, where that helps.

    Attributes:
        assessment: the contract in force.
        envelope: what plans may ask for under it.
        adaptive: as given.
        state: of the automaton.
        route: the legs.
        reference: the trajectory that is flown.
        avoidance: the induction step in progress; None outside `Phase.AVOID`, and in HOLDING that
            of the step which braking has ended.
        obstacles: what has been seen.
        events: what has happened, for the caller to take and clear.
        rest_held: whether what is flown is a way to rest in the space seen free, also in HOLDING.
        fence: the geofence that legs keep within, in local NED; None if there is none.
        mission_doubt: why the mission may not be the one to fly; None while it is.
        fleet_objection: why the vehicle may not depart in its fleet; None if it may, or is of none.
        left_flight: that the operator has to say how a flight goes on; None otherwise.
        hold_cause: what failed last, so that the vehicle held, and when; None before.
    """

    def __init__(self, assessment: Assessment, mission: Mission, *, adaptive: bool) -> None:
        self.assessment = assessment
        self.envelope = envelope_of(assessment)
        self.adaptive = adaptive
        self.state = FlightState.STANDBY
        self.route = Route(mission)
        self.reference = Reference()
        self.avoidance: Avoidance | None = None
        self.obstacles = ObstacleMap(
            self.leg,
            assessment.region_around,
            self._merged_size_max_m,
            half_band_m(assessment.terms),
        )
        self.events: list[Event] = []
        self.rest_held = False
        self.fence: Fence | None = None
        self.mission_doubt: str | None = None
        self.fleet_objection: str | None = None
        self.left_flight: str | None = None
        self.hold_cause: tuple[Assumption, float] | None = None
        self._limiter = EventLimiter()

    @property
    def leg(self) -> LegFrame:
        """Frame of the leg that is flown."""
        return self.route.frame

    @property
    def best_effort(self) -> bool:
        """Whether the mission is flown where passing obstacles is not guaranteed, and safely so."""
        return has_best_effort(self.assessment)

    @property
    def shielded(self) -> bool:
        """Whether cruise and avoidance are flown only with a certified way to rest."""
        return is_shielded(self.assessment)

    # ------------------------------------------------------------------ what changes

    def fire(self, trigger: Trigger, now_s: float, *, text: str = "") -> None:
        """Move the automaton, and report it if the published phase or the leg changes.

        Args:
            trigger: what happened.
            now_s: when.
            text: the report; by default the phase and the trigger.

        Raises:
            IllegalTransitionError: the automaton has no such transition.
        """
        before, self.state = self.state, next_state(self.state, trigger)
        if self.state.phase is before.phase and trigger is not Trigger.LEG_FLOWN:
            return
        failed = trigger is Trigger.ASSUMPTION_FAILED
        self.emit(
            Event(
                now_s,
                EventName.PHASE,
                Severity.ERROR if failed else Severity.INFO,
                text or f"{self.state.phase} ({trigger})",
                {"from": before.phase, "to": self.state.phase, "trigger": trigger},
            )
        )

    def adopt(self, assessment: Assessment) -> None:
        """Put another solution of the contract in force."""
        self.assessment, self.envelope = assessment, envelope_of(assessment)
        self.rebuild_map()

    def require(self, progress: Progress) -> bool:
        """Fly under another requirement on progress; tell whether it is another one."""
        contract = self.assessment.contract
        if progress == contract.requirements.progress:
            return False
        requirements = contract.requirements.model_copy(update={"progress": progress})
        contract = contract.model_copy(update={"requirements": requirements})
        self.adopt(replace(self.assessment, contract=contract))
        return True

    def rebuild_map(self) -> None:
        """State the obstacles in the frame of the leg and under the contract in force."""
        half_m = half_band_m(self.assessment.terms)
        regions = self.assessment.region_around
        self.obstacles.rebuild(self.leg, regions, self._merged_size_max_m, half_m)

    def shift(self, shift_ned_m: Vector) -> None:
        """State everything remembered in the present local frame, which the estimator has moved.

        What is flown and what it has been certified against move alike, so that certificates keep
        holding.  The leg stays: the mission states it in the present frame.
        """
        shift_leg_m = self.leg.vector_leg(shift_ned_m)
        self.obstacles.shift(*shift_ned_m)
        self.reference.shift(shift_leg_m)
        self.route.flown.shift(*shift_ned_m[:2])
        if self.avoidance is not None:
            self.avoidance = self.avoidance.shifted_by(shift_leg_m)

    def emit(self, event: Event) -> None:
        """Report an event."""
        self.events.append(event)

    def emit_rarely(self, event: Event, kind: str) -> None:
        """Report an event that may repeat in every tick, limited for each name and kind."""
        if self._limiter.allows(f"{event.name} {kind}", event.time_s):
            self.emit(event)

    # ------------------------------------------------------------------ what follows

    def measured_state(self, pose: Pose) -> State:
        """Return a measured position and velocity in the leg frame, without acceleration."""
        return State(
            self.leg.position_leg(pose.position_ned_m),
            self.leg.vector_leg(pose.velocity_ned_mps),
        )

    def to_avoid(self, obstacle: Obstacle) -> Obstacle:
        """Return an obstacle as a plan around it has to take it.

        Where the plan has to be certified in the space seen free, whose cells next to a face are
        never free, it keeps away by that much more.  Its region begins where the vehicle could not
        stop any more otherwise: the shield would stop it there.
        """
        if not self.shielded:
            return obstacle
        assessment = self.assessment
        error_m = max(obstacle.position_error_m, assessment.face_error_m) + GRID_MARGIN_M
        region = assessment.region_around(obstacle.measured, error_m)
        terms, brake_mps2 = assessment.terms, assessment.limits.brake_mps2
        speed_mps = terms.cruise_speed_mps
        stopping_m = speed_mps**2 / (2.0 * brake_mps2) + speed_mps * terms.attitude_lag_s
        decided_m = speed_mps * (GUARD_AHEAD_S + 2.0 * RETRY_S)
        front_m = min(region.approach_x_m, region.keep_out.x_min_m - stopping_m - decided_m)
        manoeuvre = replace(region.manoeuvre, x_min_m=front_m)
        return replace(obstacle, region=replace(region, manoeuvre=manoeuvre))

    def fence_objection(self, mission: Mission) -> str | None:
        """Return why the geofence forbids a mission; None if it does not.

        Where a way to rest is held, nothing beyond the fence is taken for free, so that the body
        with its errors has to fit on the leg; elsewhere avoidances lead aside as far as they may.
        """
        if self.fence is None:
            return None
        assessment = self.assessment
        beside_m = assessment.inflated.manoeuvre_width_m / 2.0
        margins_m = [
            assessment.inflation_m()
            if assessment.terms.stop
            else max(beside_m, leg.target_half_width_m)
            for leg in mission.legs
        ]
        places_ned_m = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
        number = self.fence.crossed_leg(places_ned_m, margins_m)
        if number is None:
            return None
        return f"legs.{number} comes within {margins_m[number]:.1f} m of the geofence, or leaves it"

    def braking_from(self, state: State, now_s: float) -> Trajectory:
        """Return the trajectory that brakes to hover from a state."""
        return brake_to_hover(state, now_s, self.envelope)

    def obstacles_to_meet(self, now_s: float) -> list[Obstacle]:
        """Return the obstacles whose properties matter now: the one avoided, and the next ahead.

        Ahead means on the line that the vehicle is on, or will be on after its avoidance; in
        STANDBY, on the line from the start of the leg.  None where the vehicle flies in the space
        seen free only: there no size and no distance is assumed of any obstacle.
        """
        if self._assumes_nothing:
            return []
        state = self.reference.sample(now_s)
        x_m, y_m = (0.0, 0.0) if state is None else state.position_leg_m[:2]
        met = []
        if self.avoidance is not None:
            if not self.avoidance.of_mover:
                met.append(self.avoidance.obstacle)
            x_m, y_m, _ = self.avoidance.plan.trajectory.final.position_leg_m
        range_m = self.assessment.terms.detection_range_m
        following = self.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=range_m)
        if following is not None:
            met.append(following)
        # As the map has them now, not as they were when the plan was made.
        return [self.obstacles.of_track(each.members[0]) or each for each in met]

    @property
    def _assumes_nothing(self) -> bool:
        return self.best_effort or self.state.in_seen_space

    @property
    def _merged_size_max_m(self) -> float:
        # Gaps in a dense field must not be merged away: nothing there depends on regions.
        merging = self.adaptive and not self._assumes_nothing
        return measured_size_max(self.assessment.terms) if merging else 0.0
