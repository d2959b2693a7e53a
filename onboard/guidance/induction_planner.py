"""Plans one step of the induction, under the contract in force."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.contract.region import RegionOfInfluence
from onboard.contract.stop_region import OVERHANG_M, PASSIVE_OVERHANG_M
from onboard.geometry.frames import FloatArray
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.situation import Avoidance, Situation
from onboard.motion.trajectory import State, Y
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.planner import Plan, Planner
from onboard.planning.problem import AvoidanceProblem, exit_speeds_mps

# Steps, and how far to either side at most, in which the space seen free is measured.
_ASIDE_STEP_M: Final = 0.2
_ASIDE_MAX_M: Final = 16.0
# As far ahead, of the detection range, the sides matter: farther on they are out of range as yet.
_AHEAD_SHARE: Final = 0.7


class InductionPlanner:
    """Plans around one obstacle under the contract in force.

    Args:
        situation: what is flown, and what is known.
        planner: Eq. 17.
        stopwatch: reads a clock in seconds, only to report how long planning took.

    Attributes:
        plan_times_s: duration of each planning, in order.
    """

    def __init__(
        self, situation: Situation, planner: Planner, stopwatch: Callable[[], float]
    ) -> None:
        self._situation, self._planner, self._stopwatch = situation, planner, stopwatch
        self._seen: Callable[[], FreeGrid] | None = None
        self.plan_times_s: list[float] = []

    def see_by(self, seen: Callable[[], FreeGrid]) -> None:
        """Prefer plans that lead no farther aside than was seen free, as this returns it."""
        self._seen = seen

    def plan(
        self, obstacle: Obstacle, start: State, start_s: float, entry_mps: float
    ) -> Avoidance | None:
        """Return the first plan that certifies and passes the obstacle.

        Args:
            obstacle: what to avoid.
            start: where the plan starts, leg frame.
            start_s: when it starts.
            entry_mps: speed along the leg at the beginning of the step; exit speeds are tried
                from it downwards.
        """
        current = None if self._situation.avoidance is None else self._situation.avoidance.plan
        began_s, found = self._stopwatch(), None
        exits_mps = exit_speeds_mps(entry_mps, self._situation.envelope.speed_max_mps)
        for region, exit_mps in itertools.product(self._regions(obstacle, start), exits_mps):
            problem = self._problem(region, start, start_s, exit_mps)
            plan = self._planner.plan(problem, current)
            if isinstance(plan, Plan) and plan.kind != "brake":
                found = Avoidance(obstacle, plan, entry_mps, exit_mps)
                break
        self.plan_times_s.append(self._stopwatch() - began_s)
        return found

    def _regions(self, obstacle: Obstacle, start: State) -> list[RegionOfInfluence]:
        """Return the region to plan in; before it, one with lanes that lead to the leg's end.

        A leg is flown to its end only if it ends within the target: a side on which no way back to
        it is needed comes first.  What leads farther aside than was seen free is not flown to its
        end either: the shield would stop it there, so that a lane within that comes first.
        Without a way to rest the paper's choice is kept.
        """
        region = obstacle.region
        if not self._situation.shielded:
            return [region]
        # Well within: what is flown after the step may not end exactly beside it.
        terms = self._situation.assessment.terms
        half_m = self._situation.route.leg.target_half_width_m - terms.body_m
        regions = [region]
        if abs(start.position_leg_m[Y]) < half_m:
            regions.insert(0, _within(region, -half_m, half_m))
        if self._seen is not None:
            seen = _within(regions[0], *self._seen_lanes_m(self._seen(), region, start))
            if seen != regions[0]:
                regions.insert(0, seen)
        return regions

    def _seen_lanes_m(
        self, grid: FreeGrid, region: RegionOfInfluence, start: State
    ) -> tuple[float, float]:
        """Return between which y the vehicle may fly where it was seen free.

        Up to the obstacle, and beside it as far as is well within range.  The body and the overhang
        of a sidestep have room beside that.
        """
        terms, obstacle = self._situation.assessment.terms, region.obstacle
        x_m, y_m, _ = start.position_leg_m
        front_m = max(obstacle.x_min_m, x_m)
        rear_m = max(front_m, min(obstacle.x_max_m, x_m + _AHEAD_SHARE * terms.detection_range_m))
        beside_m = terms.body_m + (PASSIVE_OVERHANG_M if terms.passive_safety else OVERHANG_M)
        lanes_m = []
        for sign, face_m in ((-1.0, obstacle.y_min_m), (1.0, obstacle.y_max_m)):
            edges_m = y_m + sign * np.arange(_ASIDE_STEP_M, _ASIDE_MAX_M, _ASIDE_STEP_M)
            before = _are_free(grid, (x_m, front_m), y_m, edges_m)
            beyond = sign * (edges_m - face_m) > 0.0
            beside = _are_free(grid, (front_m, rear_m), np.where(beyond, face_m, edges_m), edges_m)
            count = int(np.logical_and.accumulate(before & (beside | ~beyond)).sum())
            lanes_m.append(y_m + sign * (_ASIDE_STEP_M * count - beside_m))
        return lanes_m[0], lanes_m[1]

    def _problem(
        self, region: RegionOfInfluence, start: State, start_s: float, exit_speed_mps: float
    ) -> AvoidanceProblem:
        # The set is seen at one height.
        climb_max_m = self._situation.route.mission.climb_max_m * (not self._situation.shielded)
        return AvoidanceProblem(
            start=start,
            start_s=start_s,
            region=region,
            envelope=self._situation.envelope,
            exit_speed_mps=exit_speed_mps,
            climb_m=climb_max_m,
            climb_preferred=climb_max_m > 0.0,
            coast_time_s=self._situation.assessment.inflated.manoeuvre_encounter.coast_time_s,
        )


def _within(region: RegionOfInfluence, left_m: float, right_m: float) -> RegionOfInfluence:
    """Return a region whose lanes lead no farther aside than a y on either side."""
    return replace(
        region,
        lane_left_m=max(region.lane_left_m, left_m),
        lane_right_m=min(region.lane_right_m, right_m),
    )


def _are_free(
    grid: FreeGrid, x_m: tuple[float, float], from_y_m: FloatArray | float, to_y_m: FloatArray
) -> NDArray[np.bool_]:
    """Tell of rectangles, between two x and from a y to another, whether each was seen free."""
    ones = np.ones_like(to_y_m)
    low_m, high_m = np.minimum(from_y_m, to_y_m), np.maximum(from_y_m, to_y_m)
    return grid.are_free(x_m[0] * ones, x_m[1] * ones, low_m, high_m)
