"""THREAD: fly through a dense field on ways to rest, each certified in the space seen free.

Nothing here decides on safety.  A plan is flown only if the certifier accepts it for the set as it
is (`way_to_rest`); whatever else happens, the one that is held goes on and ends at rest.  So late
frames, a short range, large or near obstacles and a planner that finds nothing cost time only.
Before a pause, and before it gives up, the vehicle stops, looks and sidesteps
(`stop_and_sidestep`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from onboard.geometry.frames import wrap_angle
from onboard.guidance.dense.level import Level
from onboard.guidance.dense.limits import turn_max_radps
from onboard.guidance.dense.look_round import points_at
from onboard.guidance.dense.nose import Nose
from onboard.guidance.dense.seen_space import NothingSeen, SeenSpace, take_operators_word
from onboard.guidance.dense.sliced_planning import Surroundings, leads_on
from onboard.guidance.dense.standstill_clock import StandstillClock
from onboard.guidance.dense.stop_and_sidestep import Step, known_of
from onboard.guidance.dense.thread_record import ThreadRecord
from onboard.guidance.dense.threaded_leg import (
    ARRIVED_M,
    NO_END,
    ThreadedLeg,
    leg_to,
    with_free_end,
)
from onboard.guidance.dense.way_to_rest import WayToRest
from onboard.guidance.movers.early_stop import adopts_some
from onboard.guidance.movers.forecast import forecast_of
from onboard.guidance.movers.mover_guard import MoverGuard
from onboard.guidance.movers.yielding import Yielding
from onboard.guidance.phases import FlightState, Trigger
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import Y
from onboard.planning.corridor.look import first_looks_rad

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.guidance.fallback import Fallback
    from onboard.guidance.situation import Situation
    from onboard.motion.trajectory import State, Trajectory, Vector
    from onboard.planning.certifier import Certificate
    from onboard.planning.corridor.horizon import Horizon
    from onboard.vehicle_state import Pose


class Thread(ThreadRecord):
    """Flies legs with best effort.

    Args:
        situation: what is flown, and what is known.
        fallback: what is left where looking is exhausted.

    Attributes:
        way: the way to rest that is held.
        guard: certifies it against movers.
        yielding: waits for them.
        plans: how many plans were adopted.
        nose: turns in flight.
    """

    def __init__(self, situation: Situation, fallback: Fallback) -> None:
        self._situation, self._fallback = situation, fallback
        self._seen: SeenSpace = NothingSeen()
        self.guard = MoverGuard(situation)
        self.way = WayToRest(situation.reference, self.guard)
        self.yielding = Yielding(situation, self.guard, fallback)
        self.nose = Nose(situation.reference)
        self.plans = 0
        self._leg = self._leg_to((situation.route.length_m, 0.0))
        # From the node that was passed last.
        self._path_leg_m: FloatArray | None = None
        self._confirming = False
        # Frames that had counted when the look, or the way since, began.
        self._frames_before = 0
        self._clock = StandstillClock()
        self._level = Level(situation)

    def see_by(self, seen: SeenSpace) -> None:
        """Fly in the space that this set says was seen free; before, nothing was."""
        self._seen = seen
        seen.relied_on = True

    # ------------------------------------------------------------------ legs

    def begin_leg(self, state: State, yaw_rad: float, now_s: float) -> None:
        """Start, resume or go on with a leg where the vehicle is at rest: look first.

        What is seen free is so at the height of the leg only.  A vehicle at another height goes
        there on the spot before it looks.

        Args:
            state: in the frame of the leg, which is the situation's already.
            yaw_rad: where the nose points.
            now_s: the time.
        """
        situation, seen = self._situation, self._seen
        self._leg = self._leg_to((situation.route.length_m, 0.0))
        self._path_leg_m = None
        seen.begin_leg(situation.leg)
        seen.limit(self._leg.half_width_m)
        situation.reference.heading_rad = wrap_angle(yaw_rad - situation.leg.heading_rad)
        self._begin_at(state.position_leg_m, now_s)

    def _begin_at(self, position_leg_m: Vector, now_s: float) -> None:
        """Begin the leg at a place; first go to its height, if that is another."""
        if self._level.begin(position_leg_m, now_s):
            self.way.end()
            return
        (x_m, y_m, _), seen = position_leg_m, self._seen
        self.way.begin(now_s, (x_m, y_m, 0.0))
        take_operators_word(seen, self._situation.route.mission)
        self.way.recheck(self._leg.limits, seen.grid())
        self._confirming = not self.way.certified
        outlook = replace(self._outlook(), heading_rad=0.0)
        if self._confirming:
            self.way.certified = None  # not before the look all round
        looks_rad = first_looks_rad(0.0, outlook.half_view_rad) if self._confirming else (0.0,)
        self._leg.pause.look_round(looks_rad, seen.frames_needed)
        self._clock.begin_leg(now_s, self._situation.route.length_m)
        self._restart_clock(now_s)

    def take_over(self, held: Trajectory, now_s: float) -> None:
        """Go on with the leg that is flown from where a certified way to rest ends.

        Args:
            held: what is flown, leg frame.
            now_s: the time.
        """
        seen = self._seen
        beside_m = max(map(abs, held.position_range_m(Y)))
        end_leg_m = (self._situation.route.length_m, 0.0)
        self._leg, self._path_leg_m = self._leg_to(end_leg_m, beside_m), None
        self.way.follow(held, now_s)
        self._confirming = self._level.changing = False
        seen.limit(self._leg.half_width_m)
        self._leg.pause.look_round((0.0,), seen.frames_needed)
        self._clock.begin_leg(now_s, self._situation.route.length_m)
        self._restart_clock(now_s)

    def release(self) -> None:
        """Hold nothing: another commander flies."""
        self.way.end()
        self._level.changing = False

    def shift(self, shift_leg_m: Vector) -> None:
        """Move with the estimate."""
        self.way.shift(shift_leg_m)

    def _leg_to(self, end_leg_m: tuple[float, float], beside_m: float = 0.0) -> ThreadedLeg:
        return leg_to(end_leg_m, self._situation, self.way, self._seen.frames_needed, beside_m)

    # ------------------------------------------------------------------ one tick

    def advance(self, pose: Pose, now_s: float) -> bool:
        """Decide what is flown until the next tick; tell whether the leg has been flown.

        Args:
            pose: the newest.
            now_s: the time.
        """
        if self._level.changing:
            place_leg_m = self._level.reached_leg_m(now_s)
            if place_leg_m is not None:
                self._begin_at(place_leg_m, now_s)
            return False
        passed = self._pass_nodes(now_s)
        if self._situation.state is FlightState.RESTING:
            return self.way.ended
        if self._leg.manoeuvre.active:
            self._manoeuvre(pose, now_s, passed=passed)
            threading = self._situation.state is FlightState.THREADING
            return threading and self._is_at_end() and self.way.ended
        if self._situation.state is FlightState.YIELDING:
            return self._yield(pose, now_s)
        if self._situation.state is FlightState.LOOKING:
            self._look(pose, now_s)
        elif self._fly_on(now_s, passed=passed):
            return self.way.ended
        if self._may_plan(pose):
            self._plan(now_s)
        return False

    def _yield(self, pose: Pose, now_s: float) -> bool:
        """Wait for a mover, and go on once a plan certifies; tell whether the leg has been flown.

        What cruises again is not planned here: the cruise is taken up where it was left.
        """
        if not self.way.still:
            return False
        if self._is_at_end():
            return self.way.ended
        if self.yielding.rest(now_s) and not self.resumes_cruise and self._may_plan(pose):
            self._plan(now_s)
        if self._situation.state is FlightState.LOOKING:
            self._restart_clock(now_s)
        return False

    @property
    def resumes_cruise(self) -> bool:
        """Whether a wait for movers ends with the cruise of this leg, not with threading it."""
        return self.yielding.resumes_cruise(*self._here()[:2])

    def _pass_nodes(self, now_s: float) -> bool:
        """Go on to the plan that is due; tell whether a node has been passed."""
        passed = self.way.pass_nodes(now_s)
        if passed:
            x_m, y_m, _ = self._here()
            self._path_leg_m = self._leg.planning.path_leg_m((x_m, y_m))
        if passed and not self._confirming:
            self.way.recheck(self._leg.limits, self._seen.grid())
        return passed

    def _fly_on(self, now_s: float, *, passed: bool) -> bool:
        """Turn the nose and look after progress; tell whether the leg's end has been reached."""
        if passed:
            self._follow_guide()
        self.nose.turn(now_s)
        if passed and self._is_at_end():
            return True
        if passed and (not self._has_end(now_s) or self._stands(now_s)):
            self._pause(now_s)
        return False

    def _has_end(self, now_s: float) -> bool:
        """Fly to a free place beside the end where an obstacle covers it; tell if there is one."""
        leg = with_free_end(self._leg, self._situation, self.way, self._seen.frames_needed)
        if leg is not None and leg is not self._leg:
            self._leg = leg
            self._clock.begin_leg(now_s, self._situation.route.length_m)
        return leg is not None

    def _manoeuvre(self, pose: Pose, now_s: float, *, passed: bool) -> None:
        """Stop, look, sidestep or go for one tick."""
        situation, manoeuvre = self._situation, self._leg.manoeuvre
        if manoeuvre.moving:
            if passed:
                self._follow_guide()
            self.nose.turn(now_s)
        known = known_of(situation, self._seen, pose, now_s)
        step = manoeuvre.advance(known, now_s)
        if manoeuvre.looking and situation.state is FlightState.THREADING:
            situation.fire(Trigger.NO_WAY, now_s)
        elif step is Step.FLIES:
            self.plans += 1
            if situation.state is FlightState.LOOKING:
                situation.fire(Trigger.WAY_FOUND, now_s)
        elif step is Step.FAILED:
            self._look_or_give_up(now_s)
        if not manoeuvre.moving:
            self.nose.rest(now_s)
        if step is Step.PASSED:
            self._restart_clock(now_s)

    def _look(self, pose: Pose, now_s: float) -> None:
        """Turn the nose; once all round for a start that has to be seen, then in each pause.

        Where W is meant along the leg, not before the vehicle has come to rest; nor on a way that
        cruise or avoidance have begun, with the nose along the leg.
        """
        if (self._is_along_leg or self.way.follows) and not self.way.still:
            return
        heading_rad = wrap_angle(pose.yaw_rad - self._situation.leg.heading_rad)
        pause, seen = self._leg.pause, self._seen
        over = pause.advance(heading_rad, seen.frames_counted, now_s)
        if self._confirming:
            if not pause.looking:
                self._confirm_start(now_s)
        elif over:
            self._pause(now_s)

    def _confirm_start(self, now_s: float) -> None:
        """Take the place where the vehicle rests as free, after a look all round, or give up."""
        self._confirming = False
        x_m, y_m, _ = self._here()
        confirmed = self._seen.confirm_start(x_m, y_m)
        self.way.recheck(self._leg.limits, self._seen.grid())
        if not (confirmed and self.way.certified):
            sentence = "the place where the vehicle hovers is not seen free"
            blocked = Violation(Assumption.NO_PASSAGE, 0.0, 1.0, "places", sentence=sentence)
            self._fallback.report_and_hold(blocked, now_s)

    def _pause(self, now_s: float) -> None:
        """Stop, look and sidestep, if that may lead on; else pause or give up."""
        if self._yields(now_s):
            return
        pause = self._leg.pause
        if pause.repeated and not self._has_end(now_s):
            self._fallback.report_and_hold(NO_END, now_s)
            return
        # The first look is short, along the guide: that is often enough.
        if not self._leg.manoeuvre.begin(may_look=pause.repeated or pause.exhausted):
            self._look_or_give_up(now_s)

    def _look_or_give_up(self, now_s: float) -> None:
        """Begin a pause (NO_WAY), or give up; wait where movers are the reason."""
        if self._yields(now_s):
            return
        exhaustion = self._leg.pause.exhaustion(now_s)
        if exhaustion is not None:
            self._fallback.report_and_hold(exhaustion, now_s)
            return
        self._situation.fire(Trigger.NO_WAY, now_s)
        self._leg.pause.begin(
            self._outlook(), self._seen.frames_needed, now_s, along_leg=self._is_along_leg
        )
        self._leg.planning.forget_guide()
        self._restart_clock(now_s)

    def _yields(self, now_s: float) -> bool:
        """Wait for movers if they are why nothing leads on; tell whether they are."""
        due = self.yielding.is_due(now_s)
        if due:
            self._leg.manoeuvre.cancel()
            self.nose.rest(now_s)
            self.yielding.begin(now_s)
        return due

    def _may_plan(self, pose: Pose) -> bool:
        """Tell whether what a plan may ask for holds where the nose points now.

        In a pause nothing is planned before the vehicle is at rest and has seen something, so that
        it waits for a sensor that is silent; where W is meant along the leg, not before the nose
        is back, and told to be: on its way from one look to the next it passes the leg.
        """
        state = self._situation.state
        if self._leg.manoeuvre.active or not state.in_seen_space:
            return False
        if state is FlightState.THREADING:
            return True
        heading_rad = wrap_angle(pose.yaw_rad - self._situation.leg.heading_rad)
        told_rad = self._situation.reference.heading_rad
        back = points_at(heading_rad, 0.0) and points_at(told_rad, 0.0)
        aside = self._is_along_leg and not back
        seen = self._seen.frames_counted - self._frames_before >= self._seen.frames_needed
        return seen and not (self._confirming or aside) and self.way.still

    def _plan(self, now_s: float) -> None:
        situation, way, leg = self._situation, self.way, self._leg
        obstacles = situation.obstacles
        surroundings = Surroundings(
            self._seen.grid,
            [obstacle.measured for obstacle in obstacles],
            obstacles.revision,
            forecast_of(self.guard, situation.leg, self._here(), leg.limits, now_s),
        )
        proposal = leg.planning.advance(way, surroundings, now_s)
        if proposal is None or (way.still and not leads_on(proposal.horizon)):
            return

        def adopt(plan: Horizon) -> Certificate | None:
            return way.adopt(plan, proposal.version, now_s, leg.limits, self._seen.grid())

        if not adopts_some(proposal.horizon, leg.limits, self.guard, adopt, now_s):
            return
        self.plans += 1
        if situation.state is not FlightState.THREADING:
            waited = situation.state is FlightState.YIELDING
            situation.fire(Trigger.WAY_CLEAR if waited else Trigger.WAY_FOUND, now_s)
            self._restart_clock(now_s)

    def _follow_guide(self) -> None:
        """Choose where the nose points until the next node: along the guide, or along the leg."""
        along_path = self._situation.route.mission.heading == "path"
        if along_path and not self._leg.manoeuvre.active:
            self.nose.follow(self._outlook(), turn_max_radps(self._situation.assessment))
        else:
            self.nose.return_to_leg()

    # ------------------------------------------------------------------ what is the case

    def _is_at_end(self) -> bool:
        """Tell whether the vehicle comes to rest at the end of the leg."""
        left_m = math.dist(self._here()[:2], self._leg.end_leg_m)
        return self.way.still and left_m <= ARRIVED_M

    def _stands(self, now_s: float) -> bool:
        """Tell whether the vehicle is at rest, or does not get nearer, and that for long."""
        x_m, y_m, _ = self._here()
        guide = self._leg.planning.guide
        left_m = float(guide.distance_m(np.array([x_m]), np.array([y_m]))[0])
        self._leg.pause.note_progress(left_m)
        return self._clock.has_stopped(left_m, now_s, still=self.way.still)

    def _restart_clock(self, now_s: float) -> None:
        self._frames_before = self._seen.frames_counted
        self.nose.rest(now_s)
        self._clock.restart(now_s)
