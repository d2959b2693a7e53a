"""Eq. 17 by IPOPT (CasADi): the reference for the planner's cost and speed.

Two transcriptions, both with piecewise constant jerk as the planner has it, both with their times
free, both held to their limits only at the nodes, which favours them:

* `TwoPhase`: for each side, short of the front face up to a crossing and beyond the side face from
  it on.  Locally optimal, from several starts: nothing cheaper is known.
* `Direct`: one phase, and at every node a point outside the box, by the multipliers of a separating
  line (the exact form for convex obstacles).  This is Eq. 17 as it is written.  Nothing in it keeps
  what lies between two nodes out of the box, so that it needs more of them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from onboard.motion.trajectory import X, Y
from onboard.planning.problem import DELAY_COST_M2PS4, SIDES, AvoidanceProblem, Side
from onboard.planning.qp.bspline import PIECES, TOTAL_PIECES

# Of the direct form, besides as few as ours: between two nodes a corner of the box is cut by up to
# half the way from one to the other, 0.3 m at the speeds here with 24 pieces, 7 cm with these.
DIRECT_PIECES: Final = 96
_OPTIONS: Final[dict[str, Any]] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 500,
    "ipopt.tol": 1e-6,
}
# Crossing times that are tried first, in times to reach the front face at the starting speed.
_FIRST_GUESSES: Final = (1.0, 2.0)
_PHASE_MIN_S, _PHASE_MAX_S = 0.05, 60.0
# Slower starts than this share of the exit speed count as this fast, for the first guess.
_SLOW_SHARE: Final = 0.3


@dataclass(frozen=True)
class PeerPlan:
    """The best that a transcription found.

    Attributes:
        cost: as `onboard.planning.problem.cost`; infinite if no start converged.
        solve_s: wall time of all starts together, without building the program.
    """

    cost: float
    solve_s: float


class _Program:
    """Variables, bounds and first guess of one nonlinear program, side by side."""

    def __init__(self) -> None:
        self.symbols: list[Any] = []
        self.constraints: list[Any] = []
        self.count = 0

    def variable(self, name: str, rows: int, columns: int = 1) -> tuple[Any, slice]:
        """Add variables; return them, and where they stand, column by column."""
        symbol = ca.SX.sym(name, rows, columns)
        place = slice(self.count, self.count + rows * columns)
        self.count = place.stop
        self.symbols.append(ca.vec(symbol))
        return symbol, place

    def solver(self, name: str, cost: Any, parameters: Any) -> Any:
        """Return the compiled program."""
        problem = {
            "x": ca.vertcat(*self.symbols),
            "f": cost,
            "g": ca.vertcat(*self.constraints),
            "p": parameters,
        }
        return ca.nlpsol(name, "ipopt", problem, _OPTIONS)

    def dynamics(self, states: Any, jerk: Any, durations_s: list[Any]) -> Any:
        """Tie the states (position, velocity, acceleration) together; return the effort."""
        effort = 0.0
        for piece, h in enumerate(durations_s):
            x, v, a = (states[row, piece] for row in range(3))
            j = jerk[piece]
            after = ca.vertcat(
                x + v * h + a * h**2 / 2.0 + j * h**3 / 6.0,
                v + a * h + j * h**2 / 2.0,
                a + j * h,
            )
            self.constraints.append(after - states[:, piece + 1])
            end = states[2, piece + 1]
            effort += h * (a * a + a * end + end * end) / 3.0
        return effort


class _Axis:
    """One axis of a program: where its variables stand."""

    def __init__(self, program: _Program, name: str, durations_s: list[Any]) -> None:
        pieces = len(durations_s)
        self.states, self.states_at = program.variable(f"{name}_states", 3, pieces + 1)
        self.jerk, self.jerk_at = program.variable(f"{name}_jerk", pieces)
        self.effort = program.dynamics(self.states, self.jerk, durations_s)


@dataclass
class _Numbers:
    """Bounds and first guess, as one array each."""

    lower: np.ndarray[Any, Any]
    upper: np.ndarray[Any, Any]
    guess: np.ndarray[Any, Any]

    def fix_axis(
        self,
        axis: _Axis,
        start: tuple[float, float, float],
        limits: tuple[float, float, float],
        speed_mps: tuple[float, float],
        end_speed_mps: float,
    ) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Bound an axis; return its lower and upper bounds and its guess, (3, nodes) views."""
        lower, upper, guess = (
            values[axis.states_at].reshape(-1, 3).T
            for values in (self.lower, self.upper, self.guess)
        )
        lower[:] = [[-math.inf], [speed_mps[0]], [limits[0]]]
        upper[:] = [[math.inf], [speed_mps[1]], [limits[1]]]
        lower[:, 0] = upper[:, 0] = start
        lower[1:, -1] = upper[1:, -1] = end_speed_mps, 0.0
        self.lower[axis.jerk_at], self.upper[axis.jerk_at] = -limits[2], limits[2]
        guess[1] = np.linspace(start[1], end_speed_mps, guess.shape[1])
        return lower, upper, guess


def _numbers(count: int) -> _Numbers:
    return _Numbers(np.full(count, -math.inf), np.full(count, math.inf), np.zeros(count))


def _limits(problem: AvoidanceProblem, side: Side) -> tuple[Any, Any]:
    along, across = problem.envelope.along, problem.sidestep(side).limits
    return tuple(
        (each.acceleration_min_mps2, each.acceleration_max_mps2, each.jerk_max_mps3)
        for each in (along, across)
    )  # type: ignore[return-value]  # of two


class TwoPhase:
    """For each side, from two first guesses each: the best of four local optima."""

    def __init__(self) -> None:
        program = _Program()
        phases_s, self._phases_at = program.variable("phases", 2)
        durations_s = [phases_s[piece // PIECES] / PIECES for piece in range(TOTAL_PIECES)]
        self._along = _Axis(program, "along", durations_s)
        self._across = _Axis(program, "across", durations_s)
        parameters = ca.SX.sym("parameters", 2)
        border_m, exit_mps = parameters[0], parameters[1]
        begin_m, end_m = self._along.states[0, 0], self._along.states[0, -1]
        delay_s = phases_s[0] + phases_s[1] - (end_m - begin_m) / exit_mps
        cost = self._along.effort + self._across.effort + DELAY_COST_M2PS4 * delay_s
        program.constraints.append(border_m - end_m)
        self._dynamics = 6 * TOTAL_PIECES
        self._count = program.count
        self._solver = program.solver("two_phase", cost, parameters)

    def plan(self, problem: AvoidanceProblem) -> PeerPlan:
        """Return the best of all starts."""
        began_s, best = time.perf_counter(), math.inf
        for side in SIDES:
            for numbers in self._starts(problem, side):
                best = min(best, self._solve(problem, numbers))
        return PeerPlan(best, time.perf_counter() - began_s)

    def _solve(self, problem: AvoidanceProblem, numbers: _Numbers) -> float:
        solution = self._solver(
            x0=numbers.guess, lbx=numbers.lower, ubx=numbers.upper,
            lbg=[0.0] * (self._dynamics + 1), ubg=[0.0] * self._dynamics + [math.inf],
            p=[problem.region.x_pob_m, problem.exit_speed_mps],
        )  # fmt: skip
        return float(solution["f"]) if self._solver.stats()["success"] else math.inf

    def _starts(self, problem: AvoidanceProblem, side: Side) -> Iterator[_Numbers]:
        start, sidestep = problem.start.axis(X), problem.sidestep(side)
        front_m = problem.region.keep_out.x_min_m
        along, across = _limits(problem, side)
        speed_mps = max(start.velocity_mps, _SLOW_SHARE * problem.exit_speed_mps)
        for factor in _FIRST_GUESSES:
            numbers = _numbers(self._count)
            crossing_s = max(factor * (front_m - start.position_m) / speed_mps, 0.3)
            numbers.lower[self._phases_at] = _PHASE_MIN_S
            numbers.upper[self._phases_at] = _PHASE_MAX_S
            numbers.guess[self._phases_at] = crossing_s
            lower, upper, guess = numbers.fix_axis(
                self._along, start, along, (0.0, problem.envelope.speed_max_mps),
                problem.exit_speed_mps,
            )  # fmt: skip
            upper[0, 1 : PIECES + 1] = front_m
            guess[0, : PIECES + 1] = np.linspace(start.position_m, front_m, PIECES + 1)
            guess[0, PIECES:] = np.linspace(front_m, problem.region.x_pob_m, PIECES + 1)
            speeds_mps = (-math.inf, sidestep.speed_max_mps)
            lower, upper, guess = numbers.fix_axis(
                self._across, sidestep.start, across, speeds_mps, 0.0
            )
            lower[0, PIECES:], upper[0, 1:] = sidestep.face_m, sidestep.lane_m
            guess[0] = np.linspace(sidestep.start.position_m, sidestep.face_m, TOTAL_PIECES + 1)
            yield numbers


class Direct:
    """One phase; every node outside the box by the multipliers of a separating line.

    Args:
        pieces: of constant jerk.
    """

    def __init__(self, pieces: int = DIRECT_PIECES) -> None:
        program, self._nodes = _Program(), pieces + 1
        duration_s, self._duration_at = program.variable("duration", 1)
        durations_s = [duration_s / pieces] * pieces
        self._along = _Axis(program, "along", durations_s)
        self._across = _Axis(program, "across", durations_s)
        multipliers, self._multipliers_at = program.variable("multipliers", 4, self._nodes)
        self._dynamics = 6 * pieces
        parameters = ca.SX.sym("parameters", 5)
        for node in range(self._nodes):
            x, y, m = self._along.states[0, node], self._across.states[0, node], multipliers
            beyond = ca.vertcat(
                parameters[0] - x, x - parameters[1], parameters[2] - y, y - parameters[3]
            )
            normal = ca.vertcat(m[1, node] - m[0, node], m[3, node] - m[2, node])
            program.constraints += [ca.dot(m[:, node], beyond), ca.dot(normal, normal)]
        begin_m, end_m = self._along.states[0, 0], self._along.states[0, -1]
        delay_s = duration_s - (end_m - begin_m) / parameters[4]
        cost = self._along.effort + self._across.effort + DELAY_COST_M2PS4 * delay_s
        self._count = program.count
        self._solver = program.solver("direct", cost, parameters)

    def plan(self, problem: AvoidanceProblem) -> PeerPlan:
        """Return the better of a start that goes left and one that goes right."""
        began_s, best = time.perf_counter(), math.inf
        box = problem.region.keep_out
        for side in SIDES:
            numbers = self._numbers(problem, side)
            solution = self._solver(
                x0=numbers.guess, lbx=numbers.lower, ubx=numbers.upper,
                lbg=[0.0] * self._dynamics + [0.0, 1.0] * self._nodes,
                ubg=[0.0] * self._dynamics + [math.inf, 1.0] * self._nodes,
                p=[box.x_min_m, box.x_max_m, box.y_min_m, box.y_max_m, problem.exit_speed_mps],
            )  # fmt: skip
            if self._solver.stats()["success"]:
                best = min(best, float(solution["f"]))
        return PeerPlan(best, time.perf_counter() - began_s)

    def _numbers(self, problem: AvoidanceProblem, side: Side) -> _Numbers:
        numbers, region = _numbers(self._count), problem.region
        start, aside = problem.start.axis(X), problem.start.axis(Y)
        along, _ = _limits(problem, side)
        limits = problem.envelope.across
        across = limits.acceleration_min_mps2, limits.acceleration_max_mps2, limits.jerk_max_mps3
        numbers.lower[self._duration_at] = _PHASE_MIN_S
        numbers.upper[self._duration_at] = _PHASE_MAX_S
        way_m = region.x_pob_m - start.position_m
        numbers.guess[self._duration_at] = 1.5 * way_m / problem.exit_speed_mps
        lower, upper, guess = numbers.fix_axis(
            self._along, start, along, (0.0, problem.envelope.speed_max_mps),
            problem.exit_speed_mps,
        )  # fmt: skip
        lower[0, -1] = upper[0, -1] = region.x_pob_m
        guess[0] = np.linspace(start.position_m, region.x_pob_m, self._nodes)
        speed_max_mps = problem.sidestep(side).speed_max_mps
        lower, upper, guess = numbers.fix_axis(
            self._across, aside, across, (-speed_max_mps, speed_max_mps), 0.0
        )
        lower[0, 1:], upper[0, 1:] = region.lane_left_m, region.lane_right_m
        face_m = region.keep_out.y_max_m if side == "right" else region.keep_out.y_min_m
        guess[0] = np.interp(
            np.arange(self._nodes),
            [0, self._nodes // 2, self._nodes - 1],
            [aside.position_m, face_m, face_m],
        )
        numbers.lower[self._multipliers_at] = 0.0
        multipliers = numbers.guess[self._multipliers_at].reshape(self._nodes, 4)
        before = np.arange(self._nodes) < self._nodes // 2
        multipliers[before, 0] = 1.0
        multipliers[~before, 3 if side == "right" else 2] = 1.0
        return numbers
