"""Plans the next seconds in a dense field: always a plan that ends at rest in seen-free space.

Sequential convex programming that is feasible by construction: every piece of the plan flown gets a
free rectangle around it, grown towards where the guide leads, and two small QPs (one an axis) move
the plan inside these rectangles.  The plan flown, filled up with rest, is always a candidate, and
nothing is proposed that the certifier does not accept.

The work is cut into slices, so that no tick of the service has to wait for a whole plan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import daqp
import numpy as np

from onboard.motion.trajectory import State
from onboard.planning.corridor.guide import Guide, along
from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon, JerkMaps
from onboard.planning.corridor.rectangles import Corridor, Rectangle, unbroken_m
from onboard.planning.rest_certifier import GRID_TOLERANCE_M, RestLimits, certify_rest

if TYPE_CHECKING:
    from collections.abc import Generator

    from numpy.typing import NDArray

    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid

# Plans keep this far inside their rectangles, for what the solver's tolerance takes.
_MARGIN_M: Final = 5e-3
_GUIDE_M: Final = 18.0
# What the axis that leads on may use of the speed; the other gets what is left at each instant.
_LEADING_SHARE: Final = 0.96
_ACCELERATION_SHARE: Final = 0.6
# A candidate must be better than the plan flown by this to replace it: metres times seconds.
_GAIN_MIN: Final = 1e-3
_CLEAR_GAIN: Final = 0.5
_ROUNDS: Final = 2


@dataclass(frozen=True)
class HorizonProblem:
    """What the next plan starts from, and what it may use.

    Attributes:
        flown: the plan that is flown; the next one starts at its second node.
        grid: the seen-free set.
        guide: distances to the goal.
        limits: as the certifier checks them.
        height_m: z of the plan, leg frame.
    """

    flown: Horizon
    grid: FreeGrid
    guide: Guide
    limits: RestLimits
    height_m: float


class HorizonPlan(NamedTuple):
    """A plan and where it comes from.

    Attributes:
        horizon: the plan.
        kind: "kept" (the plan flown), "improved" (moved within its rectangles), "guide" (along the
            guide, another homotopy perhaps).
        cost: integral of the way left, with a little effort.
    """

    horizon: Horizon
    kind: str
    cost: float


class RecedingHorizonPlanner:
    """Keeps the matrices that every plan shares.

    Args:
        limits: of the vehicle; another set of limits needs another planner.
    """

    def __init__(self, limits: RestLimits) -> None:
        self._maps = JerkMaps(limits.run_on)
        self._sense = np.zeros(PIECES + len(self._maps.rows), np.int32)
        self._sense[-2:] = 5  # equality: at rest at the end

    def plan(self, problem: HorizonProblem) -> Generator[None, None, HorizonPlan]:
        """Search for a better plan; yields after each slice of the work.

        Returns:
            The cheapest plan that certifies; at worst the plan flown, filled up with rest, as
            where that cannot be continued at all.
        """
        if not np.isfinite(problem.flown.nodes).all():
            return HorizonPlan(problem.flown.next_node(), "kept", math.inf)
        search = _Search(problem, self._maps, self._sense)
        best = search.kept()
        if search.path_leg_m is None:
            return best
        targets = search.timed_targets()
        yield
        best = yield from self._improved(search, targets[0], best)
        # The slower one only where nothing else was found: it takes as long as a round.
        for timed in targets if best.kind == "kept" else targets[:1]:
            candidate = search.along_guide(timed)
            yield
            if candidate is not None:
                return min(best, candidate, key=lambda plan: plan.cost)
        return best

    def _improved(
        self, search: _Search, timed: _Timed, kept: HorizonPlan
    ) -> Generator[None, None, HorizonPlan]:
        """Move the plan inside its rectangles, a few times over."""
        best = moved = kept
        for _ in range(_ROUNDS):
            rectangles = search.rectangles_around(moved.horizon)
            yield
            found: list[HorizonPlan] = []
            for wanted in (search.clipped(timed, rectangles, moved.horizon), timed.points_m):
                candidate = search.solve(rectangles, wanted, moved.horizon)
                yield
                if candidate is not None:
                    found.append(candidate)
                    if candidate.cost < best.cost - _CLEAR_GAIN:
                        break
            if not found:
                break
            moved = min(found, key=lambda plan: plan.cost)
            if moved.cost < best.cost - _GAIN_MIN:
                best = moved
        return best


class _Timed(NamedTuple):
    """Targets for each node: lengths along the guide, and the points there."""

    ways_m: FloatArray
    points_m: FloatArray


class _Search:
    """The search for one plan."""

    def __init__(self, problem: HorizonProblem, maps: JerkMaps, sense: NDArray[np.int32]) -> None:
        self._problem, self._maps, self._sense = problem, maps, sense
        self._base = problem.flown.next_node()
        self._start = self._base.start
        radius_m = problem.limits.body_radius_m + 2.0 * GRID_TOLERANCE_M
        self._corridor = Corridor(problem.grid, radius_m)
        x_m, y_m = self._start[0].tolist()
        self.path_leg_m = problem.guide.path_leg_m((x_m, y_m), _GUIDE_M)

    def kept(self) -> HorizonPlan:
        """Return the plan flown, which is certified already."""
        return HorizonPlan(self._base, "kept", self._cost(self._base))

    def timed_targets(self) -> list[_Timed]:
        """Return targets along the guide at the full and at half the speed."""
        assert self.path_leg_m is not None  # noqa: S101  the caller checked
        limits = self._problem.limits
        times_s = PIECE_S * np.arange(1, PIECES + 1)
        speed_mps = float(np.hypot(*self._start[1]))
        pull_mps2 = _ACCELERATION_SHARE * min(limits.acceleration_max_mps2)
        targets = []
        for wanted_mps in (limits.speed_max_mps, 0.5 * limits.speed_max_mps):
            change_s = abs(wanted_mps - speed_mps) / pull_mps2
            sign = math.copysign(1.0, wanted_mps - speed_mps)
            early = np.minimum(times_s, change_s)
            ways = speed_mps * early + sign * pull_mps2 * early**2 / 2.0
            ways += wanted_mps * (times_s - early)
            targets.append(_Timed(ways, along(self.path_leg_m, ways)))
        return targets

    def rectangles_around(self, plan: Horizon) -> list[Rectangle]:
        """Return a free rectangle around every piece of a certified plan."""
        swept = plan.swept_m(self._problem.limits.run_on)
        low, high = swept.min(axis=1).tolist(), swept.max(axis=1).tolist()
        found: list[Rectangle] = []
        last: Rectangle | None = None
        leads = self._leads_to(plan.nodes[1:, 0])
        for k in range(PIECES):
            piece = Rectangle(low[k][0], high[k][0], low[k][1], high[k][1])
            if last is not None and k % 3 and k < PIECES - 6 and last.contains(piece):
                found.append(last)
            elif not self._corridor.has_room(piece):  # certified in halves: it stays as it is
                found.append(piece)
                last = None
            else:
                last = self._corridor.grown(piece, leads[k])
                found.append(last)
        return found

    def clipped(self, timed: _Timed, rectangles: list[Rectangle], plan: Horizon) -> FloatArray:
        """Return targets no farther along the guide than each rectangle holds it unbroken.

        Timed targets beyond the next bend pull a plan backwards; clipped ones lead it round.
        """
        path = self.path_leg_m
        assert path is not None  # noqa: S101  the caller checked
        lengths_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
        ways = timed.ways_m.copy()
        last: Rectangle | None = None
        reach_m = 0.0
        for k, rectangle in enumerate(rectangles):
            if rectangle is not last:
                reach_m = unbroken_m(path, lengths_m, rectangle, plan.nodes[k + 1, 0])
                last = rectangle
            ways[k] = min(ways[k], reach_m)
        return along(path, ways)

    def solve(
        self, rectangles: list[Rectangle], targets_m: FloatArray, seed: Horizon | None
    ) -> HorizonPlan | None:
        """Solve both axes inside the rectangles; None unless the result certifies.

        Args:
            rectangles: for each piece.
            targets_m: (n, 2), for each node.
            seed: what this plan does stays allowed.
        """
        bounds = _position_bounds(np.array(rectangles), seed, self._problem.limits)
        leading = 0 if self._leads_along() else 1
        jerks = np.empty((PIECES, 2))
        speed_mps = self._problem.limits.speed_max_mps
        limit = np.full(2 * PIECES - 1, _LEADING_SHARE * speed_mps)
        for axis in (leading, 1 - leading):
            limit = np.maximum(limit, self._floor_mps(axis, seed))
            solution = self._solve_axis(axis, bounds, targets_m[:, axis], limit)
            if solution is None:
                return None
            jerks[:, axis] = solution
            used = self._maps.speeds_mps(self._start[:, axis], solution)
            limit = np.sqrt(np.maximum(speed_mps**2 - used**2, 0.0)) - 1e-7
        plan = Horizon.integrated(self._base.start_s, self._start, jerks)
        return self._certified(plan, "improved" if seed is not None else "guide")

    def along_guide(self, timed: _Timed) -> HorizonPlan | None:
        """Plan along the guide itself, as far as it is free: another side may be better."""
        found = self._rectangles_of(timed.points_m)
        if found is None:
            return None
        rectangles, targets_m = found
        return self.solve(rectangles, targets_m, None)

    def _solve_axis(
        self, axis: int, bounds: _Bounds, targets_m: FloatArray, speed_mps: FloatArray
    ) -> FloatArray | None:
        limits, maps = self._problem.limits, self._maps
        start = self._start[:, axis]
        low_mps2, high_mps2 = _acceleration_limits(limits, axis)
        low = np.concatenate(
            (
                *(block[:, axis] for block in bounds.low),
                -speed_mps,
                np.full(PIECES - 1, low_mps2 + 1e-7),
                (0.0, 0.0),
            )
        )
        high = np.concatenate(
            (
                *(block[:, axis] for block in bounds.high),
                speed_mps,
                np.full(PIECES - 1, high_mps2 - 1e-7),
                (0.0, 0.0),
            )
        )
        offset = maps.free @ start
        jerk_mps3 = np.full(PIECES, limits.jerk_max_mps3 - 1e-6)
        x, _, flag, _ = daqp.solve(
            maps.hessian,
            maps.gradient(start, targets_m),
            maps.rows,
            np.concatenate((jerk_mps3, high - offset)),
            np.concatenate((-jerk_mps3, low - offset)),
            self._sense.copy(),
        )
        # The solver takes what is not a number for solved.
        if flag < 1 or not np.isfinite(x).all():
            return None
        return maps.ending_at_rest(start, np.asarray(x))

    def _floor_mps(self, axis: int, seed: Horizon | None) -> float | FloatArray:
        """What a certified plan flies stays allowed, whatever the split of the speed is."""
        if seed is None:
            return 0.0
        return np.abs(self._maps.speeds_mps(self._start[:, axis], seed.jerk_mps3[:, axis]))

    def _certified(self, plan: Horizon, kind: str) -> HorizonPlan | None:
        problem = self._problem
        cost = self._cost(plan)
        trajectory = plan.trajectory(problem.height_m)
        position, velocity, acceleration = self._start.tolist()
        start = State(
            (position[0], position[1], problem.height_m),
            (velocity[0], velocity[1], 0.0),
            (acceleration[0], acceleration[1], 0.0),
        )
        certificate = certify_rest(
            trajectory, start, self._base.start_s, problem.limits, problem.grid
        )
        return HorizonPlan(plan, kind, cost) if certificate.valid else None

    def _cost(self, plan: Horizon) -> float:
        x_m, y_m = plan.nodes[2::2, 0].T
        left_m = self._problem.guide.distance_m(x_m, y_m)
        effort = float((plan.nodes[:, 2] ** 2).sum())
        return (
            float(left_m.sum()) * 2.0 * PIECE_S + 3.0 * float(left_m[-1]) + 0.05 * effort * PIECE_S
        )

    def _leads_along(self) -> bool:
        ((x, y),) = self._leads_to(self._start[:1])
        return abs(x) >= abs(y)

    def _leads_to(self, points_leg_m: FloatArray) -> list[tuple[float, float]]:
        """Return the direction of the guide near each point (k, 2)."""
        path = self.path_leg_m
        assert path is not None  # noqa: S101  the caller checked
        nearest = ((path - points_leg_m[:, None]) ** 2).sum(axis=2).argmin(axis=1)
        ahead = path[np.minimum(nearest + 6, len(path) - 1)] - points_leg_m
        return [(x_m, y_m) for x_m, y_m in ahead.tolist()]

    def _rectangles_of(self, points_m: FloatArray) -> tuple[list[Rectangle], FloatArray] | None:
        """Return free rectangles along points, and the points up to where that ends."""
        x_m, y_m = self._start[0].tolist()
        if not self._corridor.has_room(Rectangle(x_m, x_m, y_m, y_m)):
            return None
        targets, stopped = points_m.copy(), False
        rectangles: list[Rectangle] = []
        before = (x_m, y_m)
        leads = self._leads_to(points_m)
        for k in range(PIECES):
            to_x, to_y = targets[k].tolist()
            piece = Rectangle(
                min(before[0], to_x),
                max(before[0], to_x),
                min(before[1], to_y),
                max(before[1], to_y),
            )
            if not stopped and not self._corridor.has_room(piece):
                if not rectangles:
                    return None
                stopped = True
            if stopped:
                targets[k] = before
                rectangles.append(rectangles[-1])
                continue
            if rectangles and k % 3 and rectangles[-1].contains(piece):
                rectangles.append(rectangles[-1])
            else:
                rectangles.append(self._corridor.grown(piece, leads[k]))
            before = (to_x, to_y)
        return rectangles, targets


class _Bounds(NamedTuple):
    """Bounds on the path and on each run-on point: lists of (3 n, 2)."""

    low: list[FloatArray]
    high: list[FloatArray]


def _position_bounds(rectangles: FloatArray, seed: Horizon | None, limits: RestLimits) -> _Bounds:
    """Return the bounds on Bernstein points: each in its rectangle, a joint in both."""
    low_m, high_m = rectangles[:, (0, 2)] + _MARGIN_M, rectangles[:, (1, 3)] - _MARGIN_M
    low, high = np.repeat(low_m, 3, axis=0), np.repeat(high_m, 3, axis=0)
    low[2:-1:3] = np.maximum(low_m[:-1], low_m[1:])
    high[2:-1:3] = np.minimum(high_m[:-1], high_m[1:])
    middle = (low + high) / 2.0
    low, high = np.where(low > high, middle, low), np.where(low > high, middle, high)
    count = 1 + len(limits.run_on.gains)
    lows, highs = [low] * count, [high] * count
    if seed is None:
        return _Bounds(lows, highs)
    swept = seed.swept_m(limits.run_on).reshape(PIECES, count, 4, 2)[:, :, 1:]
    for index in range(count):
        flown = swept[:, index].reshape(3 * PIECES, 2)
        lows[index], highs[index] = np.minimum(low, flown), np.maximum(high, flown)
    return _Bounds(lows, highs)


def _acceleration_limits(limits: RestLimits, axis: int) -> tuple[float, float]:
    brake, forward, left, right = limits.acceleration_max_mps2
    low, high = (-brake, forward) if axis == 0 else (-left, right)
    if math.isinf(limits.acceleration_disc_mps2):
        return low, high
    share = limits.acceleration_disc_mps2 * (0.8 if axis == 0 else 0.6)
    return max(low, -share), min(high, share)
