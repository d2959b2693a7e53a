"""The shield: in CRUISE and AVOID, what is flown is a certified way to rest, renewed all the time.

The invariant (two-tier theory, section 4.2) holds for the induction, too: what is flown is what
cruise or avoidance intend until a time shortly ahead, and braking to rest from then on, certified
as a whole in the space seen free.  Where it cannot be renewed in time, the vehicle is already on
its way to rest, and the rest of the leg is flown by THREAD.  So a broken assumption of progress
costs time only, whatever the planner of the induction makes of it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.contract.assessment import TICK_S
from onboard.events import Event, EventName, Severity
from onboard.guidance.dense.limits import run_on_of
from onboard.guidance.dense.seen_space import NothingSeen, SeenSpace, take_operators_word
from onboard.guidance.dense.tails import ways_to_rest
from onboard.guidance.dense.way_to_rest import largest_margin_m
from onboard.guidance.envelope import envelope_from
from onboard.guidance.phases import FlightState, Phase, Trigger
from onboard.guidance.situation import GUARD_AHEAD_S
from onboard.motion.trajectory import State, Trajectory, X
from onboard.planning.closed_form import stop_at
from onboard.planning.rest_certifier import (
    RestLimits,
    certify_rest,
    has_room,
    velocity_points_mps,
)

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.dense.thread import Thread
    from onboard.guidance.situation import Situation
    from onboard.monitoring.assumptions import Violation
    from onboard.planning.mover_certifier import Movers

# A certificate is renewed this often, and every tick once that fails: two ticks are left then.
RENEWAL_S: Final = GUARD_AHEAD_S - 2.0 * TICK_S
# At rest before the first way: so long to find one, before the leg is threaded.
_PATIENCE_S: Final = 1.0
# The margin is stated for every so many renewals.
_MARGIN_EVERY: Final = 4
# A cruise is taken up again after a mover once so much of it, and braking then, certifies.
_CLEAR_AHEAD_S: Final = 1.0
_SPEED_TOLERANCE_MPS: Final = 1e-6
# An intention that starts elsewhere than what is flown has to be stated again.
_APART_M: Final = 1e-6


class Shield:
    """Renews the guard of the reference, and has THREAD take over where it cannot.

    Args:
        situation: what is flown, and what is known.
        thread: flies on where nothing that is intended certifies.

    Attributes:
        certified: whether what is flown is a way to rest, certified when it was taken up; None
            where none is held.
        margin_m: by how much the body could be larger in the set, in steps; None before the first.
        renewals: how many certificates were given.
    """

    def __init__(self, situation: Situation, thread: Thread) -> None:
        self._situation, self._thread = situation, thread
        self._seen: SeenSpace = NothingSeen()
        self.certified: bool | None = None
        self.margin_m: float | None = None
        self.renewals = 0
        self._guarded: Trajectory | None = None
        self._due_s = self._switch_s = -math.inf

    def see_by(self, seen: SeenSpace) -> None:
        """Fly in the space that this set says was seen free; before, nothing was."""
        self._seen = seen
        self._thread.see_by(seen)

    @property
    def guards(self) -> bool:
        """Whether the state of the automaton is one in which the shield guards what moves."""
        situation = self._situation
        state = situation.state
        moving = state.cruising_freely or state.phase is Phase.AVOID
        return situation.shielded and moving

    @property
    def movers(self) -> Movers | None:
        """What is known of movers; None where the contract has none."""
        return self._thread.guard.known.movers

    # ------------------------------------------------------------------ for the record

    @property
    def rest_certified(self) -> bool | None:
        """Whether what is flown is a way to rest in the space seen free; None without one."""
        return self._thread.way.certified if self.certified is None else self.certified

    @property
    def rest_margin_m(self) -> float | None:
        """By how much the body could be larger in it, in steps; None if that was not found."""
        return self._thread.way.margin_m if self.certified is None else self.margin_m

    @property
    def free_grid(self) -> FreeGrid | None:
        """The seen-free set, leg frame; None before it matters."""
        return self._thread.free_grid if self.certified is None else self._seen.grid()

    @property
    def held_way(self) -> Trajectory | None:
        """The way to rest that is flown."""
        guard = self._situation.reference.guard
        return self._thread.held_way if guard is None else guard

    @property
    def guide_path_leg_m(self) -> FloatArray | None:
        """The way to try, (k, 2); None where no way leads on, or none is sought."""
        return self._thread.guide_path_leg_m if self.certified is None else None

    @property
    def pause_reason(self) -> str | None:
        """Why the vehicle rests; None while it flies on."""
        return self._thread.pause_reason

    # ------------------------------------------------------------------ at rest, before a leg

    def rest(self, state: State, now_s: float) -> bool:
        """Guard the rest at a place, if it is certified; tell whether it is.

        A place that the operator has confirmed at the mission's start counts as free.

        Args:
            state: where the vehicle rests, leg frame.
            now_s: the time.
        """
        situation, seen = self._situation, self._seen
        seen.begin_leg(situation.leg)
        seen.limit(situation.route.leg.corridor_half_width_m or math.inf)
        resting = Trajectory(
            now_s,
            np.array((_PATIENCE_S,)),
            np.array((state.position_leg_m,)),
            *(np.zeros((1, 3)) for _ in range(3)),
        )
        self.certified = self._certifies(resting, state, now_s)
        if not self.certified:
            take_operators_word(seen, situation.route.mission)
            self.certified = self._certifies(resting, state, now_s)
        if self.certified:
            situation.reference.intend(resting)
            situation.reference.guard = self._guarded = resting
            self._due_s, self._switch_s = now_s, now_s + _PATIENCE_S
            return True
        self.release()  # nothing is held before the look all round
        return False

    def release(self) -> None:
        """Hold nothing: another commander flies, or THREAD."""
        self.certified = self.margin_m = None
        self._guarded = None

    # ------------------------------------------------------------------ on the way

    def accepts(self, trajectory: Trajectory, now_s: float) -> bool:
        """Guard what is flown with a trajectory that takes over at its start, if that certifies.

        Args:
            trajectory: starts on what is flown, now or before the next tick.
            now_s: the time.

        Returns:
            whether the caller may intend it; always where no way to rest is required.
        """
        return not self._situation.shielded or self._renew(trajectory, now_s)

    def advance(self, now_s: float) -> bool:
        """Renew the guard where that is due; tell whether what is intended is guarded."""
        intended = self._situation.reference.intended
        if intended is None:
            return False
        if intended is self._guarded and now_s < self._due_s:
            return True
        return self._renew(intended, now_s)

    def is_off_course(self, now_s: float) -> bool:
        """Tell whether what is flown has left what is intended, which has to start on it again."""
        reference = self._situation.reference
        flown, intended = reference.sample(now_s), reference.intended
        if flown is None or intended is None or intended.start_s > now_s:
            return False
        meant = intended.sample(now_s)
        return any(
            math.dist(one, other) > _APART_M for one, other in zip(flown, meant, strict=True)
        )

    def divert_if_due(self, now_s: float) -> None:
        """Leave the leg to THREAD, once what is flown brakes without what is intended.

        Where only movers speak against that, the vehicle waits for them instead.
        """
        if now_s + TICK_S < self._switch_s:
            return
        yields = self._thread.yielding.is_due(now_s) and not self._situation.state.changes_mission
        self.divert("nothing that is intended certifies", now_s, yields=yields)

    def is_clear_from_rest(self, now_s: float) -> bool:
        """Tell whether the cruise of the leg, from where the vehicle rests, certifies."""
        situation = self._situation
        start = situation.reference.sample(now_s)
        if start is None:
            return False
        at_rest = State(start.position_leg_m, (0.0, 0.0, 0.0))
        speed_mps, x_m = situation.assessment.terms.cruise_speed_mps, situation.route.length_m
        cruise = stop_at(at_rest, now_s, situation.envelope, x_m, speed_mps=speed_mps, z_m=0.0)
        if cruise is None:
            return False
        head = cruise.until(now_s + _CLEAR_AHEAD_S)
        way = next(ways_to_rest(head, cruise, situation.envelope))
        return self._certifies(way, at_rest, now_s, switch=head.final)

    def certifies_start(self, plan: Trajectory, now_s: float) -> bool:
        """Tell whether what a plan from rest begins with, and braking then, certifies."""
        start, head = plan.sample(now_s), plan.until(now_s + _CLEAR_AHEAD_S)
        ways = ways_to_rest(head, plan, self._situation.envelope)
        return any(self._certifies(way, start, now_s, switch=head.final) for way in ways)

    def meets_mover_after_stop(
        self, plan: Trajectory, begin_s: float, switch_s: float, now_s: float
    ) -> bool:
        """Tell whether a plan that is left for a stop may meet a mover that is seen now.

        Args:
            plan: is flown until the switch.
            begin_s: of the part of it that is asked about.
            switch_s: when the vehicle begins to stop.
            now_s: the time.
        """
        head = plan.until(switch_s).from_time(begin_s)
        guard = self._thread.guard
        return all(
            guard.failures(way, self._limits(way, head.final), now_s, seen_only=True)
            for way in ways_to_rest(head, plan, self._situation.envelope)
        )

    def divert(self, reason: str, now_s: float, *, yields: bool = False) -> None:
        """Come to rest on the way that is held, and fly the rest of the leg by THREAD.

        Args:
            reason: for the report.
            now_s: the time.
            yields: wait for movers first.
        """
        situation = self._situation
        reference = situation.reference
        reference.fly_guard()
        held = reference.current
        assert held is not None  # noqa: S101  what flies a leg has a reference
        situation.avoidance = None
        if yields:
            self._thread.yielding.begin(now_s)
        else:
            text = f"threading the rest of the leg: {reason}"
            situation.fire(Trigger.NO_WAY, now_s, text=text)
        if situation.state in (FlightState.LOOKING, FlightState.YIELDING):
            # Gaps must not be merged away there.
            situation.rebuild_map()
        self.release()
        self._thread.take_over(held, now_s)

    def report_and_divert(self, violation: Violation, now_s: float) -> None:
        """Report an assumption of progress that failed, and leave the leg to THREAD."""
        text = f"{violation}; passing is no longer guaranteed on this leg"
        event = Event(now_s, EventName.DELAYED, Severity.NOTICE, text)
        self._situation.emit_rarely(event, violation.key)
        self.divert(str(violation), now_s)

    # ------------------------------------------------------------------ certificates

    def _renew(self, intended: Trajectory, now_s: float) -> bool:
        """Guard what is flown up to a trajectory's start, and that until shortly ahead."""
        situation = self._situation
        start = situation.reference.sample(now_s)
        if start is None:
            return False
        head = self._head(intended, now_s)
        if head is None:
            return False
        for way in ways_to_rest(head, intended, situation.envelope):
            if self._certifies(way, start, now_s, switch=head.final):
                self._guarded, situation.reference.guard = intended, way
                self.certified = True
                self._due_s, self._switch_s = now_s + RENEWAL_S, head.end_s
                self.renewals += 1
                if self.renewals % _MARGIN_EVERY == 1:
                    self._state_margin(way, head.final)
                return True
        self._due_s = now_s
        return False

    def _head(self, intended: Trajectory, now_s: float) -> Trajectory | None:
        """Return what is flown until the intended trajectory starts, and that until the switch."""
        begins_s = max(intended.start_s, now_s)
        ahead = intended.until(now_s + GUARD_AHEAD_S).from_time(begins_s)
        if begins_s <= now_s:
            return ahead
        reference = self._situation.reference
        flown = reference.guard or reference.current
        if flown is None or flown.end_s <= now_s:
            return None
        return flown.from_time(now_s).until(begins_s).followed_by(ahead)

    def _certifies(
        self, way: Trajectory, start: State, now_s: float, *, switch: State | None = None
    ) -> bool:
        limits = self._limits(way, switch or start)
        if not certify_rest(way, start, now_s, limits, self._seen.grid()).valid:
            return False
        return not self._thread.guard.failures(way, limits, now_s)

    def _limits(self, way: Trajectory, switch: State) -> RestLimits:
        """Return the limits of what the induction flies: along the leg, its nose aligned.

        An acceleration that braking has yet to end at the switch leads beyond the cruise speed.
        Sideways speed is bounded by nothing but W, so that the run-on is taken for the greatest
        speed of this very way.
        """
        situation = self._situation
        assessment = situation.assessment
        envelope = envelope_from(switch, situation.envelope)
        speed_mps = envelope.speed_max_mps + _SPEED_TOLERANCE_MPS
        if way.velocity_range_mps(X)[1] <= speed_mps:
            points_mps = velocity_points_mps(way)[:, :, :2].reshape(-1, 2)
            speed_mps = max(speed_mps, float(np.hypot(*points_mps.T).max()))
        limits = assessment.limits
        jerk_x_mps3, jerk_y_mps3, _ = envelope.jerk_max_mps3
        return RestLimits(
            body_radius_m=assessment.terms.body_m,
            speed_max_mps=speed_mps,
            acceleration_max_mps2=(
                limits.brake_mps2,
                limits.forward_mps2,
                limits.left_mps2,
                limits.right_mps2,
            ),
            acceleration_disc_mps2=math.inf,
            jerk_max_mps3=jerk_x_mps3,
            run_on=run_on_of(assessment, speed_mps),
            jerk_y_max_mps3=jerk_y_mps3,
        )

    def _state_margin(self, way: Trajectory, switch: State) -> None:
        """State by how much the body could be larger on a way that has just been certified."""
        limits, grid = self._limits(way, switch), self._seen.grid()
        body_m = limits.body_radius_m
        self.margin_m = largest_margin_m(
            lambda more_m: has_room(way, replace(limits, body_radius_m=body_m + more_m), grid)
        )
