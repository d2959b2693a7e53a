"""Plans one step of the induction, under the contract in force."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

from onboard.contract.region import RegionOfInfluence
from onboard.guidance.situation import Avoidance, Situation
from onboard.motion.trajectory import State, Y
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.planner import Plan, Planner
from onboard.planning.problem import AvoidanceProblem, exit_speeds_mps


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
        self.plan_times_s: list[float] = []

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
        """Return the region to plan in; before it, one with the lane that leads to the target.

        A leg is flown to its end only if it ends within the target: a side on which no way back to
        it is needed comes first.  Without a way to rest the paper's choice is kept.
        """
        region = obstacle.region
        # Well within: what is flown after the step may not end exactly beside it.
        terms = self._situation.assessment.terms
        half_m = self._situation.route.leg.target_half_width_m - terms.body_m
        if not self._situation.shielded or abs(start.position_leg_m[Y]) >= half_m:
            return [region]
        left_m, right_m = max(region.lane_left_m, -half_m), min(region.lane_right_m, half_m)
        return [replace(region, lane_left_m=left_m, lane_right_m=right_m), region]

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
