"""Eq. 17 by QPs: a search over both sides and a grid of horizons.

Horizons are tried in the order of their estimated costs (crossing_times.py), until the best plan
found is cheaper than the next estimate.  A plan counts once it certifies.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from onboard.motion.trajectory import CannotCoastError, Trajectory, X, Y, Z
from onboard.planning.certifier import certify_avoidance
from onboard.planning.plan import Plan, reason
from onboard.planning.problem import DELAY_COST_M2PS4, SIDES, cost
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import AxisTask, across_task, along_task, build
from onboard.planning.qp.climb_program import ClimbProgram, Coupling, coupling_of
from onboard.planning.qp.crossing_times import CostEstimates, crossing_times
from onboard.planning.qp.solver import QpBackend, QpSolver, solver_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from onboard.geometry.frames import FloatArray, IntArray
    from onboard.planning.problem import AvoidanceProblem, Side

# Length of the second phase over that of the first.
_RATIOS = tuple(2.0 ** (k / 3.0) for k in range(-3, 8))
_RELATIVE_DURATIONS = 1.0 + np.array(_RATIOS)[:, None]
_CROSSINGS = 16

# Replanning after the crossing: the phase that remains is all one.
_REMAINING_MIN_S = 0.1

# Growth of the pieces where the vehicle stops early and waits.
_GROWTH = 1.2

# Axis QPs solved at most: until something certifies, and to better what does.
_SOLVES_UNTIL_FOUND = 18
_SOLVES_MAX = 4

# Agility that a climb may add, for crossing times that level flight cannot make.
_LIFT = 1.2

# Horizons for which the coupled QP is solved at most.
_CLIMBS_MAX = 3

# Vertical speeds and accelerations up to this are round-off.
_LEVEL = 1e-9

# A candidate is tried if it may save more than this share of the cost.
_WORTH_IT = 0.06


class _Shape(NamedTuple):
    """One shape of horizon: its matrices, and the solver for the QPs that they make."""

    matrices: bspline.TwoPhaseSpline
    solver: QpSolver


class SplineLibrary:
    """Shapes and cost estimates for all ratios, with one growth of the pieces."""

    def __init__(self, growth: float, solver: type[QpSolver]) -> None:
        splines = [bspline.TwoPhaseSpline.with_ratio(ratio, growth) for ratio in _RATIOS]
        self.shapes = [_Shape(each, solver(each.hessian, each.rows)) for each in splines]
        self.estimates = CostEstimates(splines)


@functools.cache
def spline_library(growth: float, solver: type[QpSolver]) -> SplineLibrary:
    """Return the library of a growth: one for all planners, since solvers keep no state."""
    return SplineLibrary(growth, solver)


class _Candidate(NamedTuple):
    """One side, crossing time and ratio, and what it should cost, in all and along x."""

    estimate: float
    along_estimate: float
    side: Side
    crossing_s: float
    shape: _Shape


class _Ranked(NamedTuple):
    """The candidates of one side: ratios by crossing times, and their order by what they cost."""

    side: Side
    shapes: list[_Shape]
    crossings_s: FloatArray
    estimates: FloatArray
    along_estimates: FloatArray
    order: IntArray

    @classmethod
    def of(
        cls,
        library: SplineLibrary,
        side: Side,
        crossings_s: FloatArray,
        along: FloatArray,
        across: FloatArray,
    ) -> Self:
        """Add up the costs of the axes and of the delay."""
        estimates = along + across + DELAY_COST_M2PS4 * crossings_s * _RELATIVE_DURATIONS
        order = estimates.argsort(axis=None, kind="stable")
        return cls(side, library.shapes, crossings_s, estimates, along, order)

    def cheapest_first(self) -> Iterator[_Candidate]:
        """Yield the candidates."""
        for place in self.order.tolist():
            ratio, crossing = divmod(place, len(self.crossings_s))
            yield _Candidate(
                float(self.estimates[ratio, crossing]),
                float(self.along_estimates[ratio, crossing]),
                self.side,
                float(self.crossings_s[crossing]),
                self.shapes[ratio],
            )


class QpPlanner:
    """Holds the solvers' factorisations, and nothing else from plan to plan.

    Args:
        backend: name of the QP solver.
    """

    def __init__(self, backend: QpBackend = "osqp") -> None:
        self._solver = solver_of(backend)
        self._even, self._front_loaded = (
            spline_library(growth, self._solver) for growth in (1.0, _GROWTH)
        )
        self._climbs: dict[tuple[bspline.TwoPhaseSpline, Coupling], ClimbProgram] = {}

    def plan(
        self,
        problem: AvoidanceProblem,
        current: Plan | None,
        incumbent: Plan | None,
        reasons: list[str],
    ) -> Plan | None:
        """Return the cheapest certified plan that is found.

        Args:
            problem: what to avoid, and from where.
            current: the plan being flown, whose horizon is tried too.
            incumbent: a certified plan for ``problem`` that has to be bettered.
            reasons: what does not certify is added to it, if nothing is found.
        """
        search = _Search(problem, self._even, self._front_loaded, incumbent)
        search.rank(current)
        if max(map(abs, problem.start.axis(Z)[1:])) > _LEVEL:
            # Not level: only the coupled QP has a state in height to continue.
            best = self._plan_to_climb(search, search.promising(), incumbent)
        else:
            best = search.run()
            if problem.climb_m > 0.0:
                best = self._plan_to_climb(search, search.promising(), best)
        if best is None:
            reasons.extend(search.reasons)
        return best

    def _plan_to_climb(
        self, search: _Search, candidates: Iterable[_Candidate], best: Plan | None
    ) -> Plan | None:
        """Solve the coupled QP of the first candidates; keep what is better, or preferred."""
        for candidate in itertools.islice(candidates, _CLIMBS_MAX):
            plan = search.climb(candidate, self._climb_program)
            if plan is None:
                continue
            if best is None or plan.cost < best.cost or search.problem.climb_preferred:
                return plan
        return best

    def _climb_program(self, spline: bspline.TwoPhaseSpline, coupling: Coupling) -> ClimbProgram:
        key = spline, coupling
        if key not in self._climbs:
            self._climbs[key] = ClimbProgram(spline, coupling, self._solver)
        return self._climbs[key]


class _Search:
    """The QP search for one problem."""

    def __init__(
        self,
        problem: AvoidanceProblem,
        even: SplineLibrary,
        front_loaded: SplineLibrary,
        incumbent: Plan | None = None,
    ) -> None:
        self.reasons: list[str] = []
        self.problem = problem
        self._libraries = even, front_loaded
        self._tasks: dict[Side, tuple[AxisTask, AxisTask]] = {}
        alongs = {clear: along_task(problem, clear=clear) for clear in (False, True)}
        for side in SIDES:
            clear = problem.sidestep(side).is_clear
            self._tasks[side] = alongs[clear], across_task(problem, side, clear=clear)
        # Crossing times between which nothing has failed yet.
        self._window_s: dict[Side, tuple[float, float]] = dict.fromkeys(SIDES, (0.0, math.inf))
        self._best = incumbent
        self._best_candidate: _Candidate | None = None
        self._library_of: dict[Side, SplineLibrary] = {}
        self._ranked: list[_Ranked] = []
        self._solves = 0

    def rank(self, current: Plan | None) -> None:
        """Estimate the costs of everything that could be tried.

        Args:
            current: the plan being flown, whose crossing time is tried too.
        """
        crossings_s: dict[Side, FloatArray] = {}
        for side in SIDES:
            times_s, waiting = crossing_times(*self._tasks[side], _CROSSINGS)
            if len(times_s) == 0 and self.problem.climb_m > 0.0:
                along, across = (task.lifted(_LIFT) for task in self._tasks[side])
                times_s, waiting = crossing_times(along, across, _CROSSINGS)
            self._library_of[side] = self._libraries[waiting]
            if current is not None and current.side == side and current.crossing_s is not None:
                remaining_s = max(current.crossing_s - self.problem.start_s, _REMAINING_MIN_S)
                times_s = np.append(times_s, remaining_s)
            if len(times_s) > 0:
                crossings_s[side] = times_s
            else:
                self.reasons.append(f"qp, {side}: no time both clears the side and stays short")
        for library in self._libraries:
            sides = [side for side in crossings_s if self._library_of[side] is library]
            if not sides:
                continue
            queries = [(task, crossings_s[side]) for side in sides for task in self._tasks[side]]
            costs = library.estimates.of(queries)
            for side, *axes in zip(sides, costs[::2], costs[1::2], strict=True):
                self._ranked.append(_Ranked.of(library, side, crossings_s[side], *axes))

    def promising(self) -> Iterable[_Candidate]:
        """Return the best candidate; without one, all in the order of their estimates."""
        return self._cheapest_first() if self._best_candidate is None else [self._best_candidate]

    def climb(
        self,
        candidate: _Candidate,
        program_of: Callable[[bspline.TwoPhaseSpline, Coupling], ClimbProgram],
    ) -> Plan | None:
        """Solve the coupled QP of a candidate.

        Args:
            candidate: side and horizon.
            program_of: gives the QP of a spline and a coupling.
        """
        matrices, _ = candidate.shape
        along, across = self._tasks[candidate.side]
        program = program_of(matrices, coupling_of(self.problem, along, across))
        piece_s = candidate.crossing_s / bspline.PIECES
        nodes_mps2 = program.solve(self.problem, along, across, piece_s)
        if nodes_mps2 is None:
            return None
        return self._complete(candidate, matrices.durations * piece_s, nodes_mps2)

    def _cheapest_first(self) -> Iterator[_Candidate]:
        """Yield both sides' candidates; few are ever asked for."""
        return heapq.merge(
            *(ranked.cheapest_first() for ranked in self._ranked),
            key=lambda candidate: candidate.estimate,
        )

    def run(self) -> Plan | None:
        """Solve candidates in order, until none left can be better or enough have been solved."""
        for candidate in self._cheapest_first():
            soonest_s, latest_s = self._window_s[candidate.side]
            if not soonest_s < candidate.crossing_s < latest_s:
                continue
            if self._solves >= (_SOLVES_UNTIL_FOUND if self._best is None else _SOLVES_MAX):
                break
            if not self._may_be_better(candidate.estimate):
                break
            self._try(candidate)
        return self._best

    def _may_be_better(self, estimate: float) -> bool:
        return self._best is None or estimate < self._best.cost - _WORTH_IT * abs(self._best.cost)

    def _try(self, candidate: _Candidate) -> None:
        """Solve both axes of a candidate; keep what certifies and is cheaper than the best."""
        matrices, solver = candidate.shape
        piece_s = np.array(candidate.crossing_s / bspline.PIECES)
        durations_s = matrices.durations * piece_s
        total_cost = DELAY_COST_M2PS4 * float(durations_s.sum())
        nodes_mps2 = np.zeros((bspline.TOTAL_PIECES + 1, 3))
        # Sideways first: where anything is impossible, that is.
        for axis, task in zip((Y, X), reversed(self._tasks[candidate.side]), strict=True):
            if axis == X and not self._may_be_better(total_cost + candidate.along_estimate):
                return
            self._solves += 1
            program = build(matrices, task, piece_s)
            optimum = solver.solve(program.gradient, program.lower, program.upper)
            if optimum is None:
                self._narrow(candidate, axis)
                return
            total_cost += program.cost(optimum.objective)
            nodes_mps2[:, axis] = task.unit_mps2 * matrices.accelerations(
                optimum.variables, program.ends
            )
        if self._best is not None and total_cost >= self._best.cost:
            return
        plan = self._complete(candidate, durations_s, nodes_mps2)
        if plan is not None:
            self._best, self._best_candidate = plan, candidate

    def _narrow(self, candidate: _Candidate, axis: int) -> None:
        """Rule out what is harder than a candidate that failed: sooner sideways, later along.

        A front face out of reach was not what failed: there was too little time to get back below
        the greatest speed by as much as the solver is off.
        """
        soonest_s, latest_s = self._window_s[candidate.side]
        along, _ = self._tasks[candidate.side]
        reach_m = along.speed_before_mps[1] * candidate.crossing_s
        if axis == Y or reach_m < along.crossing_m[1]:
            soonest_s = max(soonest_s, candidate.crossing_s)
        else:
            latest_s = min(latest_s, candidate.crossing_s)
        self._window_s[candidate.side] = soonest_s, latest_s

    def _complete(
        self, candidate: _Candidate, durations_s: FloatArray, nodes_mps2: FloatArray
    ) -> Plan | None:
        """Make a trajectory up to the border, y still mirrored; None unless it certifies."""
        problem = self.problem
        mirror = (1.0, -1.0 if candidate.side == "left" else 1.0, 1.0)
        try:
            trajectory = Trajectory.from_accelerations(
                problem.start_s,
                problem.start,
                durations_s,
                nodes_mps2 * mirror,
                coast_to_x_m=problem.region.x_pob_m,
            )
        except CannotCoastError as error:  # beyond the border by what the solver is off
            self.reasons.append(f"qp, {candidate.side}: {error}")
            return None
        certificate = certify_avoidance(trajectory, problem)
        if not certificate.valid:
            self.reasons.append(reason(f"qp, {candidate.side}", certificate))
            return None
        crossing_s = problem.start_s + candidate.crossing_s
        total_cost = cost(trajectory, problem)
        return Plan("qp", trajectory, candidate.side, total_cost, certificate, crossing_s)
