"""In which region a step is planned: within the target and what was seen free, where that is."""

from __future__ import annotations

import numpy as np
import pytest

from onboard.contract.stop_region import OVERHANG_M
from onboard.files.contract_file import Contract
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.induction_planner import InductionPlanner
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle
from tests.onboard.guidance.perfect_flight import PerfectFlight, mission_to

CELL_M, SIDE = 0.1, 600
HALF_WIDTH_M = 8.0


def seen_between(
    left_m: float, right_m: float, *, beside_left_m: float = 30.0, beside_from_m: float = 30.0
) -> FreeGrid:
    """Seen free between two y, and from some x on no farther to the left than stated."""
    middles = (np.arange(SIDE) + 0.5) * CELL_M - 30.0
    x, y = middles[:, None], middles[None, :]
    free = (y > left_m) & (y < right_m) & ((x < beside_from_m) | (y > -beside_left_m))
    table = np.zeros((SIDE + 1, SIDE + 1), np.int32)
    table[1:, 1:] = (~np.broadcast_to(free, (SIDE, SIDE))).cumsum(axis=0).cumsum(axis=1)
    return FreeGrid((-30.0, -30.0), CELL_M, table)


@pytest.fixture
def flight(contract: Contract) -> PerfectFlight:
    """A vehicle that holds a way to rest; it swerves without passive safety."""
    requirements = contract.requirements.model_copy(update={"stop": True, "passive_safety": False})
    stopping = contract.model_copy(update={"requirements": requirements})
    return PerfectFlight(stopping, mission_to((60.0, 0.0), half_width_m=HALF_WIDTH_M))


def planned(flight: PerfectFlight, grid: FreeGrid | None) -> tuple[InductionPlanner, Obstacle]:
    """Plan around a box from the front of its region."""
    planner = InductionPlanner(flight.situation, flight.planner, lambda: 0.0)
    if grid is not None:
        planner.see_by(lambda: grid)
    obstacle = flight.situation.to_avoid(flight.see(12.0, 0.2))
    start = State((obstacle.region.approach_x_m, 0.0, 0.0), (2.8, 0.0, 0.0), (0.0, 0.0, 0.0))
    planner.plan(obstacle, start, 0.0, 2.8)
    return planner, obstacle


def test_without_a_view_the_target_bounds_the_lanes(flight: PerfectFlight) -> None:
    planned(flight, None)
    region = flight.planner.problems[0].region
    body_m = flight.navigator.assessment.terms.body_m
    assert -region.lane_left_m <= HALF_WIDTH_M - body_m
    assert region.lane_right_m <= HALF_WIDTH_M - body_m


def test_lanes_leave_room_for_the_body_and_a_run_within_what_was_seen(
    flight: PerfectFlight,
) -> None:
    planned(flight, seen_between(-3.5, 5.0))
    (problem,) = flight.planner.problems
    beside_m = flight.navigator.assessment.terms.body_m + OVERHANG_M
    assert problem.region.lane_left_m == pytest.approx(-3.5 + beside_m, abs=0.21)
    assert problem.region.lane_left_m >= -3.5 + beside_m - 1e-9
    assert problem.region.lane_right_m <= 5.0 - beside_m + 1e-9


def test_what_was_not_seen_beside_the_obstacle_bounds_a_lane(flight: PerfectFlight) -> None:
    _, obstacle = planned(flight, seen_between(-30.0, 30.0))
    front_m = obstacle.region.obstacle.x_min_m
    planned(flight, seen_between(-30.0, 30.0, beside_left_m=3.0, beside_from_m=front_m + 0.5))
    wide, *_, narrow = (problem.region.lane_left_m for problem in flight.planner.problems)
    assert wide < -3.0
    assert -3.0 < narrow < -1.5


def test_where_no_plan_keeps_within_it_any_lane_is_taken(flight: PerfectFlight) -> None:
    _, obstacle = planned(flight, seen_between(-1.5, 1.5))
    assert flight.planner.problems[-1].region.lane_left_m < -1.5
    assert len({problem.region.lane_left_m for problem in flight.planner.problems}) > 1
    assert obstacle.region.lane_left_m <= flight.planner.problems[-1].region.lane_left_m
