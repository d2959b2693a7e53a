"""THREAD: fly through a dense field on ways to rest, each certified in the space seen free.

Nothing here decides on safety.  A plan is flown only if the certifier accepts it for the set as it
is (`way_to_rest`); whatever else happens, the one that is held goes on and ends at rest.  So late
frames, a short range, large or near obstacles and a planner that finds nothing cost time only.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from onboard.contract.assessment import TICK_S
from onboard.geometry.frames import wrap_angle
from onboard.guidance.dense.limits import rest_limits_of
from onboard.guidance.dense.look_round import points_at
from onboard.guidance.dense.pause import PAUSES_MAX, Pause
from onboard.guidance.dense.seen_space import NothingSeen, SeenSpace, take_operators_word
from onboard.guidance.dense.sliced_planning import SlicedPlanning, Surroundings
from onboard.guidance.dense.way_to_rest import WayToRest, moves
from onboard.guidance.phases import FlightState, Trigger
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import Y
from onboard.planning.corridor.guide import Guide
from onboard.planning.corridor.horizon import PIECE_S
from onboard.planning.corridor.look import (
    TURN_MAX_RADPS,
    Outlook,
    first_looks_rad,
    heading_in_flight_rad,
)

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.fallback import Fallback
    from onboard.guidance.situation import Situation
    from onboard.motion.trajectory import State, Trajectory, Vector
    from onboard.planning.corridor.horizon import Horizon
    from onboard.planning.rest_certifier import RestLimits
    from onboard.vehicle_state import Pose

_GUIDE_M: Final = 18.0
# The vehicle has arrived where it rests this near to the leg's end.
ARRIVED_M: Final = 0.3
# At rest for so long, or without getting nearer by `_NEARER_M` for longer: nothing certifies.
_IDLE_S: Final = 0.6
_WITHOUT_PROGRESS_S: Final = 5.0
_NEARER_M: Final = 0.2
# After a turn the nose of a vehicle follows its command within this.
_STEADY_S: Final = 1.0
_STEADY_RADPS: Final = math.radians(0.5)
# The guide has changed: the way left is longer by this than it was.
_LONGER_M: Final = 2.0
# Beside where an avoidance has led there is this much room for another way.
_BESIDE_M: Final = 1.0


class _Leg(NamedTuple):
    """What belongs to the leg that is flown."""

    limits: RestLimits
    planning: SlicedPlanning
    pause: Pause


class Thread:
    """Flies legs with best effort.

    Args:
        situation: what is flown, and what is known.
        fallback: what is left where looking is exhausted.

    Attributes:
        way: the way to rest that is held.
        plans: how many plans were adopted.
        nose_steady: whether the nose has been told for a while to point where it does.
        slices_max: the most slices of planning that one tick has done.
    """

    def __init__(self, situation: Situation, fallback: Fallback) -> None:
        self._situation, self._fallback = situation, fallback
        self._seen: SeenSpace = NothingSeen()
        self.way = WayToRest(situation.reference)
        self.plans = 0
        self._leg = self._new_leg()
        # From the node that was passed last.
        self._path_leg_m: FloatArray | None = None
        self._confirming = False
        self.nose_steady = False
        self._turned_s = -math.inf
        self._turn_radps = 0.0
        # Frames that had counted when the look, or the way since, began.
        self._frames_before = 0
        self._idle_since_s: float | None = None
        self._nearest_m, self._nearest_s = math.inf, -math.inf

    @property
    def slices_max(self) -> int:
        """The most slices of planning that one tick has done on this leg."""
        return self._leg.planning.slices_max

    @property
    def pauses(self) -> int:
        """Pauses on this leg."""
        return self._leg.pause.count

    @property
    def turns_nose(self) -> bool:
        """Whether the nose may still be on its way to where it was told to point."""
        return self._situation.state.in_seen_space and not self.nose_steady

    @property
    def confirms_start(self) -> bool:
        """Whether the vehicle looks all round, since the place where it hovers has to be seen."""
        return self._confirming

    @property
    def free_grid(self) -> FreeGrid | None:
        """The seen-free set, leg frame, for the record."""
        return self._seen.grid() if self.way.flown is not None else None

    @property
    def held_way(self) -> Trajectory | None:
        """The way to rest that is flown, for the record."""
        return None if self.way.flown is None else self._situation.reference.current

    @property
    def guide_path_leg_m(self) -> FloatArray | None:
        """The way to try, (k, 2), for the record; None where no way leads on."""
        return self._path_leg_m

    @property
    def pause_reason(self) -> str | None:
        """Why the vehicle rests; None while it flies on."""
        if self._situation.state is not FlightState.LOOKING:
            return None
        if self._confirming:
            return "looking round: the start has to be seen"
        return f"nothing certifies (pause {self.pauses} of {PAUSES_MAX}): looking"

    def see_by(self, seen: SeenSpace) -> None:
        """Fly in the space that this set says was seen free; before, nothing was."""
        self._seen = seen
        seen.relied_on = True

    # ------------------------------------------------------------------ legs

    def begin_leg(self, state: State, yaw_rad: float, now_s: float) -> None:
        """Start, resume or go on with a leg where the vehicle is at rest: look first.

        Args:
            state: in the frame of the leg, which is the situation's already.
            yaw_rad: where the nose points.
            now_s: the time.
        """
        situation, seen = self._situation, self._seen
        self._leg, self._path_leg_m = self._new_leg(), None
        seen.begin_leg(situation.leg)
        seen.limit(self._half_width_m(0.0))
        self.way.begin(now_s, state.position_leg_m)
        take_operators_word(seen, situation.route.mission)
        self.way.recheck(self._leg.limits, seen.grid())
        situation.reference.heading_rad = wrap_angle(yaw_rad - situation.leg.heading_rad)
        self._confirming = not self.way.certified
        outlook = replace(self._outlook(), heading_rad=0.0)
        if self._confirming:
            self.way.certified = None  # not before the look all round
        looks_rad = first_looks_rad(0.0, outlook.half_view_rad) if self._confirming else (0.0,)
        self._leg.pause.look_round(looks_rad, seen.frames_needed)
        self._nearest_m = math.inf
        self._turned_s, self._turn_radps = now_s, 0.0
        self.nose_steady = False
        self._restart_clock(now_s)

    def take_over(self, held: Trajectory, now_s: float) -> None:
        """Go on with the leg that is flown from where a certified way to rest ends.

        Args:
            held: what is flown, leg frame.
            now_s: the time.
        """
        seen = self._seen
        beside_m = max(map(abs, held.position_range_m(Y)))
        self._leg, self._path_leg_m = self._new_leg(beside_m), None
        self.way.follow(held, now_s)
        self._confirming = False
        seen.limit(self._half_width_m(beside_m))
        self._leg.pause.look_round((0.0,), seen.frames_needed)
        self._nearest_m = math.inf
        self._turned_s, self.nose_steady = now_s, False
        self._restart_clock(now_s)

    def release(self) -> None:
        """Hold nothing: another commander flies."""
        self.way.end()

    def shift(self, shift_leg_m: Vector) -> None:
        """Move with the estimate."""
        self.way.shift(shift_leg_m)

    def _half_width_m(self, beside_m: float) -> float:
        """Return how far beside its line the leg may be flown.

        Without a stated corridor an avoidance may have led farther than best effort would.
        """
        leg = self._situation.route.leg
        room_m = self._situation.assessment.inflation_m() + _BESIDE_M
        stated = leg.corridor_half_width_m is not None
        return max(leg.threading_half_width_m, 0.0 if stated else beside_m + room_m)

    def _new_leg(self, beside_m: float = 0.0) -> _Leg:
        situation = self._situation
        assessment, route = situation.assessment, situation.route
        limits = rest_limits_of(assessment, any_heading=route.mission.heading == "path")
        margin_m = assessment.inflation_m()
        guide = Guide(
            (route.length_m, 0.0),
            margin_m,
            self._half_width_m(beside_m),
            face_error_m=assessment.face_error_m,
            wish_m=assessment.contract.vehicle.clearance_wish_m,
        )
        return _Leg(limits, SlicedPlanning(guide, limits), Pause(situation.reference, guide))

    # ------------------------------------------------------------------ one tick

    def advance(self, pose: Pose, now_s: float) -> bool:
        """Decide what is flown until the next tick; tell whether the leg has been flown.

        Args:
            pose: the newest.
            now_s: the time.
        """
        passed = self.way.pass_nodes(now_s)
        if passed:
            x_m, y_m, _ = self._here()
            self._path_leg_m = self._leg.planning.path_leg_m((x_m, y_m))
        if passed and not self._confirming:
            self.way.recheck(self._leg.limits, self._seen.grid())
        if self._situation.state is FlightState.RESTING:
            return self.way.ended
        if self._situation.state is FlightState.LOOKING:
            self._look(pose, now_s)
        else:
            if passed:
                self._follow_guide()
            self._turn_nose(now_s)
            if passed and self._is_at_end():
                return self.way.ended
            if passed and self._stands(now_s):
                self._pause(now_s)
        if self._situation.state.in_seen_space and self._may_plan(pose):
            self._plan(now_s)
        return False

    def _look(self, pose: Pose, now_s: float) -> None:
        """Turn the nose; once all round for a start that has to be seen, then in each pause.

        Where W is meant along the leg, not before the vehicle has come to rest.
        """
        if self._is_along_leg and not self.way.still:
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
        """Begin a pause (NO_WAY), or give up."""
        if self._leg.pause.exhausted:
            pauses = float(self._leg.pause.count)
            exhausted = Violation(Assumption.NO_PASSAGE, pauses, float(PAUSES_MAX), "pauses")
            self._fallback.report_and_hold(exhausted, now_s)
            return
        self._situation.fire(Trigger.NO_WAY, now_s)
        self._leg.pause.begin(
            self._outlook(), self._seen.frames_needed, along_leg=self._is_along_leg
        )
        self._leg.planning.forget_guide()
        self._restart_clock(now_s)

    def _may_plan(self, pose: Pose) -> bool:
        """Tell whether what a plan may ask for holds where the nose points now.

        In a pause nothing is planned before the vehicle is at rest and has seen something, so that
        it waits for a sensor that is silent; where W is meant along the leg, not before the nose
        is back, and told to be: on its way from one look to the next it passes the leg.
        """
        if self._situation.state is FlightState.THREADING:
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
            self._seen.grid, [obstacle.measured for obstacle in obstacles], obstacles.revision
        )
        proposal = leg.planning.advance(way, surroundings, now_s)
        if proposal is None or (way.still and not self._leads_on(proposal.horizon)):
            return
        certificate = way.adopt(
            proposal.horizon, proposal.version, now_s, leg.limits, self._seen.grid()
        )
        if certificate is None or not certificate.valid:
            return
        self.plans += 1
        if situation.state is FlightState.LOOKING:
            situation.fire(Trigger.WAY_FOUND, now_s)
            self._restart_clock(now_s)

    @property
    def _is_along_leg(self) -> bool:
        """Whether what plans ask for holds with the nose along the leg only."""
        return math.isinf(self._leg.limits.acceleration_disc_mps2)

    def _leads_on(self, plan: Horizon) -> bool:
        """Tell whether a plan is worth setting off for, from rest."""
        x_m, y_m = (plan.nodes[-1, 0] - plan.nodes[0, 0]).tolist()
        return moves(plan) and math.hypot(x_m, y_m) >= _NEARER_M

    def _follow_guide(self) -> None:
        """Choose the heading of the next node: along the guide, or back along the leg."""
        heading_rad = self._situation.reference.heading_rad
        if self._situation.route.mission.heading == "path":
            wanted_rad = heading_in_flight_rad(self._outlook(), PIECE_S)
            self._turn_radps = (wanted_rad - heading_rad) / PIECE_S
        else:
            turn_rad, most_rad = wrap_angle(-heading_rad), TURN_MAX_RADPS * PIECE_S
            self._turn_radps = max(-most_rad, min(most_rad, turn_rad)) / PIECE_S

    def _turn_nose(self, now_s: float) -> None:
        """Turn the nose by a tick's worth."""
        self._situation.reference.heading_rad += self._turn_radps * TICK_S
        if abs(self._turn_radps) > _STEADY_RADPS:
            self._turned_s = now_s
        self.nose_steady = now_s - self._turned_s >= _STEADY_S

    # ------------------------------------------------------------------ what is the case

    def _is_at_end(self) -> bool:
        """Tell whether the vehicle comes to rest at the end of the leg."""
        x_m, y_m, _ = self._here()
        left_m = math.hypot(x_m - self._situation.route.length_m, y_m)
        return self.way.still and left_m <= ARRIVED_M

    def _stands(self, now_s: float) -> bool:
        """Tell whether the vehicle is at rest, or does not get nearer, and that for long."""
        x_m, y_m, _ = self._here()
        guide = self._leg.planning.guide
        left_m = float(guide.distance_m(np.array([x_m]), np.array([y_m]))[0])
        self._leg.pause.note_progress(left_m)
        if left_m < self._nearest_m - _NEARER_M or left_m > self._nearest_m + _LONGER_M:
            self._nearest_m, self._nearest_s = left_m, now_s
        if not self.way.still:
            self._idle_since_s = None
        elif self._idle_since_s is None:
            self._idle_since_s = now_s
        idle = self._idle_since_s is not None and now_s - self._idle_since_s >= _IDLE_S
        return idle or now_s - self._nearest_s > _WITHOUT_PROGRESS_S

    def _restart_clock(self, now_s: float) -> None:
        self._frames_before = self._seen.frames_counted
        self._turn_radps = 0.0
        self._idle_since_s, self._nearest_s = None, now_s

    def _here(self) -> Vector:
        flown = self.way.flown
        assert flown is not None  # noqa: S101  what threads holds a way to rest
        x_m, y_m = flown.nodes[0, 0].tolist()
        return x_m, y_m, self.way.height_m

    def _outlook(self) -> Outlook:
        situation, (x_m, y_m, _) = self._situation, self._here()
        return Outlook(
            position_leg_m=(x_m, y_m),
            heading_rad=situation.reference.heading_rad,
            half_view_rad=situation.assessment.terms.field_of_view_rad / 2.0,
            path_leg_m=self._path_leg_m,
            grid=self._seen.grid(),
            body_radius_m=self._leg.limits.body_radius_m,
        )
