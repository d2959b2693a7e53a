"""Passes a slow mover ahead in flight: a plan around all the places that it may come to meanwhile.

The mover is an obstacle of its own, as large as it may become until its rear has been passed; it
never enters the obstacle map or the space seen free, and is made again from its track for every
attempt.  A plan is taken only if each stop on its way certifies against the movers that are seen,
and it is flown by the shield, as a cruise is: where that finds no way to rest, the vehicle yields.
No plan replaces it before its end, so that its side is kept until the rear has been passed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from onboard.contract.arithmetic import SCALAR
from onboard.contract.clauses import TICK_S
from onboard.contract.mover_avoidance import class_passing, fastest_mps
from onboard.contract.movers import STAMP_ERROR_S
from onboard.geometry.box import Box
from onboard.guidance.movers.mover_guard import settling_of
from onboard.guidance.situation import GRID_MARGIN_M, RETRY_S
from onboard.motion.trajectory import State, X
from onboard.perception.obstacle_map import Obstacle

if TYPE_CHECKING:
    from collections.abc import Callable

    from onboard.contract.assessment import Assessment
    from onboard.guidance.clear_check import ClearCheck
    from onboard.guidance.induction_planner import InductionPlanner
    from onboard.guidance.situation import Avoidance, Situation
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.mover_certifier import GrowingBox, Movers

# What the cells of the mover-free set take beside a mover: rounding out, and between two of them.
_CELLS_M: Final = 0.5
# So far ahead a plan begins, in which its stops are looked at: so many in a tick, so often on it.
_LEAD_S: Final = 0.2
_STOPS_A_TICK: Final = 4
_STOP_EVERY_S: Final = 0.5
# A plan is sought for so long before the vehicle would have to brake for the mover.
_AHEAD_S: Final = 2.0
_ROUND_OFF_S: Final = 1e-6


class WaysToRest(Protocol):
    """Certifies what is flown: the seam to the shield."""

    @property
    def movers(self) -> Movers | None:
        """What is known of movers; None where the contract has none."""
        ...

    def accepts(self, trajectory: Trajectory, now_s: float) -> bool:
        """Guard what is flown with a trajectory, if that certifies; tell whether it does."""
        ...

    def certifies_start(self, plan: Trajectory, now_s: float) -> bool:
        """Tell whether what a plan from rest begins with, and braking then, certifies."""
        ...

    def meets_mover_after_stop(
        self, plan: Trajectory, begin_s: float, switch_s: float, now_s: float
    ) -> bool:
        """Tell whether a plan that is left for a stop may meet a mover that is seen now."""
        ...


class _Attempt(NamedTuple):
    """How a plan around a mover is sought.

    Attributes:
        settling: for which part of the time that the vehicle may run on the mover grows as well.
        run_on: whether the plan itself keeps away by the run-on; else only its stops have to.
    """

    settling: float
    run_on: bool


_ATTEMPTS: Final = (
    _Attempt(0.5, run_on=True),
    _Attempt(1.0, run_on=True),
    _Attempt(0.0, run_on=True),
    _Attempt(0.5, run_on=False),
    _Attempt(1.0, run_on=False),
)


class MoverPassing:
    """Begins avoidances of movers, where the contract requires it and its clauses hold.

    Args:
        situation: what is flown, and what is known.
        clear_check: certifies a plan against what stands still.
        planner: makes plans.
        shield: certifies what is flown, and knows the movers.
        follow: flies the plan, with a text for the log.
    """

    def __init__(
        self,
        situation: Situation,
        clear_check: ClearCheck,
        planner: InductionPlanner,
        shield: WaysToRest,
        follow: Callable[[Avoidance, float, str], None],
    ) -> None:
        self._situation, self._clear_check, self._planner = situation, clear_check, planner
        self._shield, self._follow = shield, follow
        # Which attempt comes next; the one that succeeded is the first again.
        self._next, self._retry_s = 0, -math.inf
        # What is being looked at, up to which time on its way.
        self._pending: tuple[Avoidance, float] | None = None
        self._ahead_of: tuple[Assessment, float, float] | None = None

    def begin_if_due(self, now_s: float) -> None:
        """Begin to pass the mover that the cruise is headed for, if a plan certifies.

        A plan is made in one tick, and looked at in the ones after it, so that none is late.
        """
        if not self._is_wanted:
            self._pending = None
            return
        if self._pending is not None:
            self._look_at(*self._pending, now_s)
            return
        intended = self._situation.reference.intended
        if intended is None or now_s < self._retry_s:
            return
        self._retry_s = now_s + RETRY_S
        start_s = now_s + _LEAD_S
        found = self._plan(intended.sample(start_s), start_s)
        if found is not None:
            self._pending = (found, start_s)

    def _look_at(self, found: Avoidance, looked_s: float, now_s: float) -> None:
        """Look at more stops of a plan, and have it flown once all have been looked at."""
        plan, self._pending = found.plan.trajectory, None
        if now_s > plan.start_s:
            return  # it comes too late
        until_s = min(looked_s + _STOPS_A_TICK * _STOP_EVERY_S, plan.end_s)
        if not self._stops_clear(plan, looked_s, until_s, now_s):
            self._next = (self._next + 1) % len(_ATTEMPTS)
        elif until_s < plan.end_s or now_s + TICK_S < plan.start_s - _ROUND_OFF_S:
            # Not before its last tick: the guard brakes soon, and a plan has to begin before.
            self._pending = (found, until_s)
        elif self._shield.accepts(plan, now_s):
            side, kind = found.plan.side, found.plan.kind
            self._follow(found, now_s, f"passing {found.obstacle.id} on the {side} ({kind})")

    def leads_on_from_rest(self, now_s: float) -> bool:
        """Tell whether a plan leads past the mover ahead from where the vehicle rests."""
        start = self._situation.reference.sample(now_s)
        if start is None or not self._is_wanted:
            return False
        at_rest = State(start.position_leg_m, (0.0, 0.0, 0.0))
        found = self._plan(at_rest, now_s)
        if found is None:
            return False
        plan = found.plan.trajectory
        if self._stops_clear(plan, plan.start_s, plan.end_s, now_s):
            return self._shield.certifies_start(plan, now_s)
        self._next = (self._next + 1) % len(_ATTEMPTS)
        return False

    # ------------------------------------------------------------------ one attempt

    def _plan(self, start: State, start_s: float) -> Avoidance | None:
        """Return a plan around the mover that is headed for, if the attempt that is due has one."""
        track = self._headed_for(start, start_s)
        if track is None:
            return None
        number, self._next = self._next, (self._next + 1) % len(_ATTEMPTS)
        obstacle = self._obstacle(track, start, start_s, _ATTEMPTS[number])
        region, found = obstacle.region, None
        x_m, y_m, _ = start.position_leg_m
        keep_out = region.keep_out
        inside = x_m > keep_out.x_min_m and keep_out.y_min_m < y_m < keep_out.y_max_m
        ends_beside = region.x_pob_m > self._situation.route.length_m
        if not (inside or ends_beside):
            found = self._planner.plan(obstacle, start, start_s, start.velocity_leg_mps[X])
        if found is None or not self._clear_check.is_clear(found.plan.trajectory):
            return None
        self._next = number
        return replace(found, of_mover=True)

    @property
    def _is_wanted(self) -> bool:
        """Whether movers are to be passed, and all clauses of that hold."""
        assessment, state = self._situation.assessment, self._situation.state
        wanted = assessment.terms.movers_level == "avoid" and not state.changes_mission
        return wanted and assessment.compliant

    def _stops_clear(self, plan: Trajectory, begin_s: float, end_s: float, now_s: float) -> bool:
        """Tell whether none of the stops on a part of a plan may meet a mover that is seen.

        They are samples: what is flown is certified as a whole whenever it is renewed.
        """
        while begin_s < end_s:
            switch_s = min(begin_s + _STOP_EVERY_S, end_s)
            if self._shield.meets_mover_after_stop(plan, begin_s, switch_s, now_s):
                return False
            begin_s = switch_s
        return True

    def _headed_for(self, start: State, start_s: float) -> GrowingBox | None:
        """Return the first mover ahead that may come to be in the way of a straight flight."""
        movers = self._shield.movers
        if movers is None:
            return None
        near_m, aside_m = self._reach_m()
        x_m, y_m, _ = start.position_leg_m
        ahead = []
        for track in movers.tracks:
            box = self._leg_box(track.predicted(start_s, movers.stamp_error_s))
            in_way = box.y_min_m - aside_m <= y_m <= box.y_max_m + aside_m
            if in_way and x_m < box.x_max_m + aside_m and box.x_min_m - x_m <= near_m:
                ahead.append((box.x_min_m, track))
        return min(ahead, key=lambda each: each[0])[1] if ahead else None

    def _reach_m(self) -> tuple[float, float]:
        """Return from how far ahead a plan is sought, and how far beside a mover it is needed.

        The vehicle has to be on it before it would brake for the mover, as the clauses state.
        """
        assessment = self._situation.assessment
        if self._ahead_of is None or self._ahead_of[0] is not assessment:
            terms, derived = assessment.terms, assessment.inflated
            sizes = [class_passing(terms, derived, each, SCALAR) for each in terms.movers]
            clearing_s = max(size.clearing_s for size in sizes)
            ranges_m = [
                clause.required
                for clause in assessment.clauses
                if clause.name.startswith(("passive_", "moving_range")) and "." in clause.name
            ]
            near_m = max(ranges_m) + terms.cruise_speed_mps * (clearing_s + _AHEAD_S)
            aside_m = max(size.headed_for_m for size in sizes) + assessment.inflation_m()
            self._ahead_of = (assessment, near_m, aside_m)
        return self._ahead_of[1:]

    def _obstacle(
        self, track: GrowingBox, start: State, start_s: float, attempt: _Attempt
    ) -> Obstacle:
        """Return a mover as large as it may become until it has been passed, with its region."""
        assessment = self._situation.assessment
        terms, margin_m = assessment.terms, assessment.inflation_m()
        speed_mps = terms.cruise_speed_mps
        forward_mps2 = assessment.limits.forward_mps2
        box = self._leg_box(track.predicted(start_s, STAMP_ERROR_S))
        behind_m = box.x_max_m + margin_m
        slow_s = (speed_mps - min(start.velocity_leg_mps[X], speed_mps)) / forward_mps2
        passing_s = max(behind_m - start.position_leg_m[X], 0.0) / speed_mps
        passing_s += self._clearing_s() + slow_s + terms.attitude_lag_s
        worst_s = passing_s + attempt.settling * self._settling_s()
        # A mover that is hidden behind it comes as fast as the fastest class.
        grown = box.inflated(fastest_mps(terms) * worst_s + _CELLS_M)
        error_m = assessment.face_error_m + GRID_MARGIN_M
        region = assessment.region_around(grown, error_m)
        # A plan begins here, wherever the region of an obstacle of that size would.
        front_m = min(region.manoeuvre.x_min_m, start.position_leg_m[X])
        region = replace(region, manoeuvre=replace(region.manoeuvre, x_min_m=front_m))
        if not attempt.run_on:
            region = replace(region, keep_out=region.obstacle)
        name = f"mover {track.id}"
        return Obstacle(name, (name,), grown, error_m, region)

    def _clearing_s(self) -> float:
        assessment = self._situation.assessment
        return assessment.inflated.manoeuvre_encounter.speed_mps / assessment.limits.brake_mps2

    def _settling_s(self) -> float:
        """Return how long the vehicle may run on after any of its setpoints."""
        assessment = self._situation.assessment
        settling = settling_of(assessment)
        if settling.loss_s is None:
            return settling.rest_settle_s
        if settling.measured_s is not None:
            return settling.measured_s + settling.rest_settle_s
        fastest_mps = assessment.inflated.manoeuvre_encounter.speed_mps
        return settling.loss_s + fastest_mps / settling.brake_mps2 + settling.rest_settle_s

    def _leg_box(self, box: Box) -> Box:
        """Return what encloses a box along north and east in the leg frame."""
        corners = (
            (north_m, east_m, 0.0)
            for north_m in (box.x_min_m, box.x_max_m)
            for east_m in (box.y_min_m, box.y_max_m)
        )
        x_m, y_m, _ = zip(*map(self._situation.leg.position_leg, corners), strict=True)
        return Box(min(x_m), max(x_m), min(y_m), max(y_m))
