"""Plans the avoidance of one obstacle: Eq. 17 as QPs, else the closed form, else braking.

Whatever comes out has passed the certifier.  The QP search is branch and bound over both sides
and a grid of horizons: candidates are taken in the order of their lower bounds (horizons.py), and
once the best plan found is cheaper than the next bound, none of the others can be better.

Deterministic: the same problem gives the same plan, bit for bit, whatever was planned before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from onboard import spline
from onboard.avoidance import DELAY_COST_M2PS4, cost
from onboard.axis_program import AxisTask, across_task, along_task, build
from onboard.axis_solver import AxisSolver
from onboard.certify import Certificate, certify_avoidance, certify_clear
from onboard.horizons import CostBounds, crossing_times
from onboard.manoeuvre import brake_to_hover, vertex_manoeuvre
from onboard.trajectory import Trajectory, X, Y, Z

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from onboard.avoidance import AvoidanceProblem, Side
    from onboard.frames import FloatArray

SIDES: tuple[Side, Side] = ("left", "right")

# Length of the second phase over that of the first.
_RATIOS = tuple(2.0 ** (k / 3.0) for k in range(-4, 9))
_CROSSINGS = 9

# Growth of the pieces where the vehicle stops early and waits.
_GROWTH = 1.2

# Axis QPs solved at most.
_SOLVES_MAX = 12

# A candidate is tried if it may save more than this share of the cost.
_WORTH_IT = 0.98


@dataclass(frozen=True)
class Plan:
    """A certified plan.

    Attributes:
        kind: where it came from.
        trajectory: what to fly, leg frame.
        side: side on which the obstacle is passed; None when braking.
        cost: `onboard.avoidance.cost`; infinite when braking.
        certificate: the certifier's verdict, always valid.
        crossing_s: absolute time of the crossing, for a QP plan; where replanning starts from.
    """

    kind: Literal["qp", "vertex", "brake"]
    trajectory: Trajectory
    side: Side | None
    cost: float
    certificate: Certificate
    crossing_s: float | None = None


@dataclass(frozen=True)
class NoPlan:
    """Nothing certifies.

    Attributes:
        reasons: why, one sentence for each attempt.
    """

    reasons: tuple[str, ...]


class _Bank:
    """Solvers and cost bounds for all ratios, with one growth of the pieces."""

    def __init__(self, growth: float) -> None:
        splines = [spline.TwoPhaseSpline.with_ratio(ratio, growth) for ratio in _RATIOS]
        self.solvers = [AxisSolver(matrices) for matrices in splines]
        self.bounds = CostBounds(splines)


class _Candidate(NamedTuple):
    """One side, crossing time and ratio, with a lower bound on the cost."""

    bound: float
    side: Side
    crossing_s: float
    solver: AxisSolver


class Planner:
    """Plans avoidances.  Holds the solvers' factorisations, and nothing from plan to plan."""

    def __init__(self) -> None:
        self._even, self._front_loaded = _Bank(1.0), _Bank(_GROWTH)

    def plan(self, problem: AvoidanceProblem, current: Plan | None = None) -> Plan | NoPlan:
        """Return the first certified plan: the cheapest QP, the closed form, or braking.

        Args:
            problem: what to avoid, and from where.
            current: the plan being flown, when ``problem`` starts in the middle of it.
        """
        reasons: list[str] = []
        plan = self._plan_by_qp(problem, current, reasons)
        if plan is None:
            plan = _plan_by_formula(problem, reasons)
        if plan is None:
            plan = _plan_to_brake(problem, reasons)
        return NoPlan(tuple(reasons)) if plan is None else plan

    def _plan_by_qp(
        self, problem: AvoidanceProblem, current: Plan | None, reasons: list[str]
    ) -> Plan | None:
        """Branch and bound over the candidates; a plan counts once it certifies."""
        if any(problem.start.axis(Z)[1:]):
            reasons.append("qp: the planar problem starts at rest in height")
            return None
        search = _Search(problem, self._even, self._front_loaded)
        best = search.run(search.candidates(current))
        if best is None:
            reasons.extend(search.reasons)
        return best


class _Search:
    """The QP search for one problem."""

    def __init__(self, problem: AvoidanceProblem, even: _Bank, front_loaded: _Bank) -> None:
        self.reasons: list[str] = []
        self._problem = problem
        self._banks = even, front_loaded
        self._tasks: dict[Side, tuple[AxisTask, AxisTask]] = {}
        for side in SIDES:
            clear = problem.sidestep(side).is_clear
            along = along_task(problem, clear=clear)
            self._tasks[side] = along, across_task(problem, side, clear=clear)
        # Crossing times between which nothing has failed yet.
        self._window_s: dict[Side, tuple[float, float]] = dict.fromkeys(SIDES, (0.0, math.inf))
        self._best: Plan | None = None
        self._solves_left = _SOLVES_MAX

    def candidates(self, current: Plan | None) -> Iterator[_Candidate]:
        """Yield what to try, both sides, cheapest bound first."""
        costs: list[FloatArray] = []
        origins: list[tuple[Side, FloatArray, _Bank]] = []
        for side in SIDES:
            along, across = self._tasks[side]
            crossings_s, waiting = crossing_times(along, across, _CROSSINGS)
            if current is not None and current.side == side and current.crossing_s is not None:
                remaining_s = current.crossing_s - self._problem.start_s
                if remaining_s > 0.0:
                    crossings_s = np.append(crossings_s, remaining_s)
            if len(crossings_s) == 0:
                self.reasons.append(f"qp, {side}: no time both clears the side and stays short")
                continue
            bank = self._banks[waiting]
            durations_s = crossings_s * (1.0 + np.array(_RATIOS)[:, None])
            total = bank.bounds.of(along, crossings_s) + bank.bounds.of(across, crossings_s)
            costs.append((total + DELAY_COST_M2PS4 * durations_s).ravel())
            origins.append((side, crossings_s, bank))
        if not costs:
            return
        sizes = [len(cost) for cost in costs]
        bounds = np.concatenate(costs)
        for index in np.argsort(bounds, kind="stable").tolist():
            second = index >= sizes[0]
            side, crossings_s, bank = origins[second]
            ratio, crossing = divmod(index - second * sizes[0], len(crossings_s))
            crossing_s = float(crossings_s[crossing])
            yield _Candidate(float(bounds[index]), side, crossing_s, bank.solvers[ratio])

    def run(self, candidates: Iterable[_Candidate]) -> Plan | None:
        """Solve candidates in order until none left can be better."""
        for candidate in candidates:
            soonest_s, latest_s = self._window_s[candidate.side]
            if not soonest_s < candidate.crossing_s < latest_s:
                continue
            if self._solves_left <= 0:
                break
            if self._best is not None and candidate.bound >= self._best.cost * _WORTH_IT:
                break
            self._try(candidate)
        return self._best

    def _try(self, candidate: _Candidate) -> None:
        """Solve both axes of a candidate; keep what certifies and is cheaper than the best."""
        solver = candidate.solver
        piece_s = np.array(candidate.crossing_s / spline.PIECES)
        durations_s = solver.matrices.durations * piece_s
        price = DELAY_COST_M2PS4 * float(durations_s.sum())
        nodes_mps2 = np.zeros((spline.TOTAL_PIECES + 1, 3))
        # Sideways first: where anything is impossible, that is.
        for axis, task in zip((Y, X), reversed(self._tasks[candidate.side]), strict=True):
            self._solves_left -= 1
            program = build(solver.matrices, task, piece_s)
            optimum = solver.solve(program)
            if optimum is None:
                self._narrow(candidate, axis)
                return
            price += program.cost(optimum.objective)
            nodes_mps2[:, axis] = task.unit_mps2 * solver.matrices.accelerations(
                optimum.free, program.ends
            )
        if self._best is not None and price >= self._best.cost:
            return
        if candidate.side == "left":
            nodes_mps2[:, Y] *= -1.0
        self._offer(candidate, durations_s, nodes_mps2)

    def _narrow(self, candidate: _Candidate, axis: int) -> None:
        """Rule out what is harder than a candidate that failed: sooner sideways, later along."""
        soonest_s, latest_s = self._window_s[candidate.side]
        if axis == Y:
            soonest_s = max(soonest_s, candidate.crossing_s)
        else:
            latest_s = min(latest_s, candidate.crossing_s)
        self._window_s[candidate.side] = soonest_s, latest_s

    def _offer(
        self, candidate: _Candidate, durations_s: FloatArray, nodes_mps2: FloatArray
    ) -> None:
        """Complete a trajectory up to the border, and keep it if it certifies."""
        problem = self._problem
        avoiding = Trajectory.from_accelerations(
            problem.start_s, problem.start, durations_s, nodes_mps2
        )
        left_m = problem.region.x_pob_m - avoiding.final.position_leg_m[X]
        if left_m <= 0.0:
            return
        trajectory = avoiding.coasting_for(left_m / problem.exit_speed_mps)
        certificate = certify_avoidance(trajectory, problem)
        if certificate.valid:
            crossing_s = problem.start_s + candidate.crossing_s
            price = cost(trajectory, problem)
            self._best = Plan("qp", trajectory, candidate.side, price, certificate, crossing_s)
        else:
            self.reasons.append(_reason(f"qp, {candidate.side}", certificate))


def _plan_by_formula(problem: AvoidanceProblem, reasons: list[str]) -> Plan | None:
    """The closed form on the nearer side, else on the other."""
    start, keep_out = problem.start.axis(Y), problem.region.keep_out
    nearer_is_left = 2.0 * start.position_m < keep_out.y_min_m + keep_out.y_max_m
    for side in SIDES if nearer_is_left else SIDES[::-1]:
        trajectory = vertex_manoeuvre(problem, side)
        if trajectory is None:
            reasons.append(f"vertex, {side}: no member of the family fits")
            continue
        certificate = certify_avoidance(trajectory, problem)
        if certificate.valid:
            return Plan("vertex", trajectory, side, cost(trajectory, problem), certificate)
        reasons.append(_reason(f"vertex, {side}", certificate))
    return None


def _plan_to_brake(problem: AvoidanceProblem, reasons: list[str]) -> Plan | None:
    """Brake to a hover short of the obstacle."""
    trajectory = brake_to_hover(problem.start, problem.start_s, problem.envelope)
    certificate = certify_clear(
        trajectory, problem.start, problem.start_s, problem.envelope, [problem.region.keep_out]
    )
    if certificate.valid:
        return Plan("brake", trajectory, None, math.inf, certificate)
    reasons.append(_reason("brake", certificate))
    return None


def _reason(attempt: str, certificate: Certificate) -> str:
    return f"{attempt}: {', '.join(certificate.failures)}"
