"""Flies the mission by induction: cruise, avoid one obstacle of interest, cruise on (Fig. 14).

The navigator only dispatches: each tick and each trigger from outside goes to the part that the
state of the automaton (`onboard.guidance.phases`) calls for.
"""

from __future__ import annotations

from collections.abc import Callable

from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.geometry.frames import LegFrame, Vector, wrap_angle
from onboard.guidance.adaptation_ladder import AdaptationLadder
from onboard.guidance.avoidance_step import AvoidanceStep
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.cruise import Cruise
from onboard.guidance.dense.seen_space import SeenSpace
from onboard.guidance.dense.shield import Shield
from onboard.guidance.dense.thread import Thread
from onboard.guidance.departure import Refusal, departure_refusals
from onboard.guidance.fallback import Fallback
from onboard.guidance.induction_planner import InductionPlanner
from onboard.guidance.leg_progress import LegProgress
from onboard.guidance.movers.mover_guard import KnownMovers
from onboard.guidance.phases import FlightState, Phase
from onboard.guidance.situation import Avoidance, Situation
from onboard.monitoring.assumptions import Violation
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.planner import Planner
from onboard.vehicle_state import Pose, Setpoint


class Navigator:
    """Decides, tick by tick, which reference is flown.

    Args:
        assessment: the contract and what follows from it.
        mission: where to fly.
        planner: Eq. 17.
        stopwatch: reads a clock in seconds, only to report how long plans took.
        adaptive: respond to a failed assumption by solving the contract again where that helps.

    Attributes:
        thread: flies in the space seen free; None where the contract does not require to stop.
        shield: certifies what cruise and avoidance fly there; None where they do not fly so.
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
        self.situation = situation = Situation(assessment, mission, adaptive=adaptive)
        self.obstacles, self.events = situation.obstacles, situation.events
        clear_check = ClearCheck(situation)
        induction_planner = InductionPlanner(situation, planner, stopwatch)
        self.plan_times_s, self._see_grid = induction_planner.plan_times_s, induction_planner.see_by
        self._fallback = fallback = Fallback(situation, clear_check, induction_planner)
        self.thread = thread = Thread(situation, fallback) if assessment.terms.stop else None
        self.shield = shield = Shield(situation, thread) if thread else None
        self._cruise = cruise = Cruise(situation, fallback, shield)
        self._avoidance_step = step = AvoidanceStep(
            situation, clear_check, fallback, cruise, induction_planner, shield
        )
        self._leg_progress = LegProgress(situation, fallback, cruise, thread, shield, step.passing)
        ladder = AdaptationLadder(situation, fallback, cruise, self._avoidance_step, shield)
        # What needs no dispatch goes straight to the part that it concerns.
        self.take_control = self._leg_progress.take_control
        self.release_control = self._leg_progress.release_control
        self.resume = self._leg_progress.resume
        self.fly_back = self._leg_progress.fly_back
        self.accept_no_progress = self._leg_progress.accept_no_progress
        self.change_mission = self._leg_progress.change_mission
        self.respond_to = ladder.respond_to
        self.hold, self.hover_at = fallback.hold, fallback.hover_at
        self.take_planned = self._avoidance_step.take_planned
        self.obstacles_to_meet = situation.obstacles_to_meet

    @property
    def assessment(self) -> Assessment:
        """The contract in force: as declared, or solved again for what was seen."""
        return self.situation.assessment

    @property
    def state(self) -> FlightState:
        """State of the automaton."""
        return self.situation.state

    @property
    def phase(self) -> Phase:
        """The published phase that the state belongs to."""
        return self.state.phase

    @property
    def leg(self) -> LegFrame:
        """Frame of the leg that is flown."""
        return self.situation.leg

    @property
    def avoidance(self) -> Avoidance | None:
        """The induction step in progress."""
        return self.situation.avoidance

    @property
    def flying(self) -> bool:
        """Whether the vehicle flies its mission, so that the guarantee applies."""
        return self.state.flying

    @property
    def cruising_freely(self) -> bool:
        """Whether the vehicle cruises along its leg, outside every Region of Influence."""
        return self.state.cruising_freely

    @property
    def in_seen_space(self) -> bool:
        """Whether the vehicle holds a certified way to rest in the space seen free."""
        return self.state.in_seen_space or (self.situation.shielded and self.flying)

    @property
    def pointing_rad(self) -> float | None:
        """Where the nose is told to point, clockwise from north; None while it turns."""
        if (self.thread is not None and self.thread.turns_nose) or not self.moving:
            return None
        return wrap_angle(self.leg.heading_rad + self.situation.reference.heading_rad)

    @property
    def moving(self) -> bool:
        """Whether the vehicle is on its way along a leg, its nose aligned."""
        return self.cruising_freely or self.phase in (Phase.AVOID, Phase.THREAD)

    def reference(self, time_s: float) -> State | None:
        """Return the reference at a time, leg frame; None in STANDBY."""
        return self.situation.reference.sample(time_s)

    def setpoint(self, time_s: float) -> Setpoint | None:
        """Return the reference at a time as a setpoint in NED; None in STANDBY."""
        return self.situation.reference.setpoint(time_s, self.leg)

    def see_by(self, seen: SeenSpace, movers: KnownMovers | None = None) -> None:
        """Fly, where a way to rest has to be held, in space seen free, and clear of movers."""
        if self.shield is not None and self.thread is not None:
            self.shield.see_by(seen)
            self._see_grid(seen.grid)
            self.thread.guard.known = movers or self.thread.guard.known

    def departure_refusals(self, pose: Pose) -> list[Refusal]:
        """Return why the leg may not be started or resumed from here; empty if it may."""
        return departure_refusals(self.situation, pose)

    def shift(self, shift_ned_m: Vector) -> None:
        """Move everything remembered into the present local frame, which a reset has moved."""
        self.situation.shift(shift_ned_m)
        if self.thread is not None:
            self.thread.shift(self.leg.vector_leg(shift_ned_m))

    def fly_on_after_shift(self, violation: Violation, now_s: float) -> None:
        """Certify again what is flown after a `shift`; hold for the violation if that fails."""
        current = self.situation.reference.current
        if self.cruising_freely and current is not None:  # aim again at the leg's end and height
            self._cruise.replan(current.sample(now_s), now_s)
        self._avoidance_step.recertify(violation, now_s)

    def recheck_plan(self, obstacle: Obstacle, now_s: float) -> None:
        """Check what is flown against an obstacle that is new or has grown."""
        if self.phase is Phase.HOLD:
            self._fallback.recheck_way_to_hover(obstacle, now_s)
        elif self.phase is Phase.AVOID:
            self._avoidance_step.recheck(obstacle, now_s)

    def advance(self, pose: Pose, now_s: float) -> None:
        """Decide what is flown until the next tick."""
        if self.flying and not self.situation.route.returning:
            self.situation.route.flown.add(pose.position_ned_m[:2])
        self._avoidance_step.note_first_sights(now_s)
        if self.thread is not None and self.state.in_seen_space:
            self._leg_progress.thread_on(self.thread, pose, now_s)
            return
        if self.phase is Phase.AVOID:
            self._avoidance_step.advance(now_s)
        cruises = self.phase is Phase.CRUISE and not self._leg_progress.advance(pose, now_s)
        if cruises:
            self._avoidance_step.begin_due(self._cruise.advance(now_s), now_s)
        if self.shield is not None and self.shield.guards:
            self._cruise.keep_guarded(self.shield, now_s)
