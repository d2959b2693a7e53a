"""Plans for dense fields: certified, at rest at the end, getting on, and the same each time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.benchmark.run_on_models import coasting_run_on
from onboard.contract.run_on import NO_RUN_ON, RunOn
from onboard.geometry.box import Box
from onboard.geometry.free_grid import FreeGrid
from onboard.planning.corridor.guide import Guide
from onboard.planning.corridor.horizon import PIECES, Horizon
from onboard.planning.corridor.receding_horizon import (
    HorizonPlan,
    HorizonProblem,
    RecedingHorizonPlanner,
)
from onboard.planning.rest_certifier import RestLimits, certify_rest

COAST = coasting_run_on(
    0.2, lag_s=0.19, brake_mps2=2.63, speed_max_mps=2.8, acceleration_max_mps2=2.63
)
SIDE, CELL_M = 300, 0.1


def limits(run_on: RunOn = NO_RUN_ON) -> RestLimits:
    return RestLimits(0.65, 2.8, (2.63,) * 4, 2.63, 5.8, run_on)


def grid_of(*boxes: Box, seen_to_m: float = 14.0) -> FreeGrid:
    """All is seen up to an x, but the boxes."""
    middles = np.linspace(-14.95, 14.95, SIDE)
    x, y = middles[:, None], middles[None, :]
    unknown = np.broadcast_to(x > seen_to_m, (SIDE, SIDE)).copy()
    for box in boxes:
        inside_x = (x > box.x_min_m - 0.05) & (x < box.x_max_m + 0.05)
        unknown |= inside_x & (y > box.y_min_m - 0.05) & (y < box.y_max_m + 0.05)
    table = np.zeros((SIDE + 1, SIDE + 1), np.int32)
    table[1:, 1:] = unknown.cumsum(axis=0).cumsum(axis=1)
    return FreeGrid((-15.0, -15.0), CELL_M, table)


class Course:
    """A field that is seen from the beginning, and the planner flying it."""

    def __init__(self, *boxes: Box, run_on: RunOn = NO_RUN_ON, seen_to_m: float = 14.0) -> None:
        self.limits = limits(run_on)
        self.grid = grid_of(*boxes, seen_to_m=seen_to_m)
        self.guide = Guide((12.0, 0.0), 0.75)
        self.guide.update((0.0, 0.0), boxes)
        self.planner = RecedingHorizonPlanner(self.limits)
        self.flown = Horizon.at_rest(0.0, 0.0, 0.0)
        self.plans: list[HorizonPlan] = []

    def plan(self) -> HorizonPlan:
        problem = HorizonProblem(self.flown, self.grid, self.guide, self.limits, -5.0)
        search = self.planner.plan(problem)
        while True:
            try:
                next(search)
            except StopIteration as stop:
                plan: HorizonPlan = stop.value
                return plan

    def fly(self, periods: int) -> None:
        """Fly; every plan has to certify anew."""
        for _ in range(periods):
            plan = self.plan()
            due = self.flown.trajectory(-5.0).sample(plan.horizon.start_s)
            certificate = certify_rest(
                plan.horizon.trajectory(-5.0),
                due,
                plan.horizon.start_s,
                self.limits,
                self.grid,
            )
            assert certificate.valid, certificate.failures
            self.plans.append(plan)
            self.flown = plan.horizon


@pytest.mark.parametrize("run_on", [NO_RUN_ON, COAST])
def test_it_flies_round_a_box_to_the_goal(run_on: RunOn) -> None:
    course = Course(Box(5.0, 6.0, -2.0, 0.4), run_on=run_on)
    course.fly(40)
    assert course.flown.nodes[0, 0] == pytest.approx((12.0, 0.0), abs=0.3)
    assert max(np.hypot(*plan.horizon.nodes[0, 1]) for plan in course.plans) > 2.0


def test_it_comes_to_rest_before_what_is_unseen() -> None:
    course = Course(seen_to_m=6.0)
    course.fly(30)
    x_m = float(course.flown.nodes[0, 0, 0])
    assert 6.0 - 0.65 - 0.5 < x_m < 6.0 - 0.65
    assert np.hypot(*course.flown.nodes[0, 1]) < 0.05


@pytest.mark.parametrize("run_on", [NO_RUN_ON, COAST])
def test_it_gets_away_from_where_only_the_disc_of_the_body_is_free(run_on: RunOn) -> None:
    """A way to rest is certified for the disc, so that it may end without any margin."""
    beside = Box(-2.0, 2.0, -0.98, -0.72)
    corners = [Box(x_m, x_m + 0.06, -0.58, -0.52) for x_m in (-0.58, 0.52)]
    course = Course(beside, *corners, run_on=run_on)
    assert not course.grid.is_free(-0.65, 0.65, -0.65, 0.65)
    course.fly(40)
    assert course.flown.nodes[0, 0, 0] > 11.5


def test_without_room_it_keeps_the_plan_flown() -> None:
    walls = (Box(0.8, 1.2, -1.4, 1.4), Box(-1.2, -0.8, -1.4, 1.4))
    course = Course(*walls, Box(-1.2, 1.2, 0.8, 1.4), Box(-1.2, 1.2, -1.4, -0.8))
    course.fly(3)
    assert np.abs(course.flown.nodes[0, 0]).max() < 0.2


def test_without_a_way_it_keeps_the_plan_flown() -> None:
    course = Course()
    walls = [Box(4.0, 5.0, -5.0, 5.0), Box(-5.0, -4.0, -5.0, 5.0)]
    walls += [Box(-5.0, 5.0, 4.0, 5.0), Box(-5.0, 5.0, -5.0, -4.0)]
    course.guide.update((0.0, 0.0), walls)
    assert course.plan().kind == "kept"


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_gives_no_proposal(value: float) -> None:
    course = Course(Box(5.0, 6.0, -2.0, 0.4))
    for row in range(3):
        course.flown = Horizon.at_rest(0.0, 0.0, 0.0)
        course.flown.nodes[1, row, 1] = value
        assert course.plan().kind == "kept"


@pytest.mark.parametrize("flag", [1, -1])
def test_a_solution_that_is_not_finite_or_none_gives_no_proposal(
    flag: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    course = Course(Box(5.0, 6.0, -2.0, 0.4))
    solution = np.full(PIECES, math.nan if flag == 1 else 0.0)
    monkeypatch.setattr("daqp.solve", lambda *_: (solution, 0.0, flag, {"iterations": 1}))
    assert course.plan().kind == "kept"


@pytest.mark.parametrize(
    "state",
    [
        ((0.0, 0.0), (9.0, 0.0), (0.0, 0.0)),  # faster than the limit
        ((0.0, 0.0), (2.0, 0.0), (9.0, -9.0)),  # accelerates harder than the limit
        ((5.5, 0.0), (0.0, 0.0), (0.0, 0.0)),  # inside the box
        ((400.0, 0.0), (0.0, 0.0), (0.0, 0.0)),  # outside of every grid
    ],
)
def test_a_start_that_allows_no_plan_gives_no_proposal(
    state: tuple[tuple[float, float], ...],
) -> None:
    course = Course(Box(5.0, 6.0, -2.0, 0.4))
    course.flown = Horizon.integrated(0.0, np.array(state), np.zeros((PIECES, 2)))
    assert course.plan().kind == "kept"


def test_the_same_inputs_give_the_same_plan_bit_for_bit() -> None:
    flown = []
    for _ in range(2):
        course = Course(Box(5.0, 6.0, -2.0, 0.4), Box(8.0, 8.5, 0.5, 3.0))
        course.fly(12)
        flown.append(b"".join(plan.horizon.nodes.tobytes() for plan in course.plans))
    assert flown[0] == flown[1]
