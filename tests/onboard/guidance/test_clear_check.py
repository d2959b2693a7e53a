"""Trajectories against the obstacles that are known now."""

import pytest

from onboard.guidance.clear_check import ClearCheck
from onboard.planning.closed_form import cruise
from tests.onboard.guidance.perfect_flight import PerfectFlight


@pytest.fixture
def check(cruising: PerfectFlight) -> ClearCheck:
    return ClearCheck(cruising.situation)


def test_the_cruise_is_clear_where_nothing_is_known(
    cruising: PerfectFlight, check: ClearCheck
) -> None:
    current = cruising.situation.reference.current
    assert current is not None
    assert check.is_clear(current.from_time(cruising.now_s))
    assert check.room_m(current) == float("inf")


@pytest.mark.parametrize(("y_m", "clear"), [(0.0, False), (0.7, False), (1.2, True), (-1.2, True)])
def test_an_obstacle_counts_with_the_size_of_the_vehicle(
    cruising: PerfectFlight, check: ClearCheck, y_m: float, clear: bool
) -> None:
    obstacle = cruising.see(40.0, y_m)
    current = cruising.situation.reference.current
    assert current is not None
    rest = current.from_time(cruising.now_s)
    assert check.is_clear(rest) is clear
    assert check.is_clear(rest, [obstacle]) is clear
    assert check.is_clear(rest, [])
    faces = obstacle.region.obstacle
    expected_m = max(faces.y_min_m, -faces.y_max_m)
    if clear:
        assert check.room_m(rest) == pytest.approx(expected_m, abs=1e-6)
    else:
        assert check.room_m(rest) < 0.0


def test_a_trajectory_that_is_not_flyable_is_not_clear(
    cruising: PerfectFlight, check: ClearCheck
) -> None:
    fast = cruise(cruising.reference, cruising.now_s, cruising.situation.envelope, 4.0)
    assert not check.is_clear(fast)


def test_speed_from_before_an_adaptation_is_admitted(
    cruising: PerfectFlight, check: ClearCheck
) -> None:
    slower = cruise(cruising.reference, cruising.now_s, cruising.situation.envelope, 1.0)
    assert check.is_clear(slower)


def test_outside_an_avoidance_an_obstacle_is_what_is_known(
    cruising: PerfectFlight, check: ClearCheck
) -> None:
    obstacle = cruising.see(40.0, 0.0)
    assert check.as_planned(obstacle) is obstacle


def test_growth_within_the_error_confirms_what_was_planned(avoiding: PerfectFlight) -> None:
    check, avoidance = ClearCheck(avoiding.situation), avoiding.situation.avoidance
    assert avoidance is not None
    grown = avoiding.see(25.0, 0.2, size_m=(1.04, 1.04))
    assert grown.measured != avoidance.obstacle.measured
    assert check.as_planned(grown).measured == avoidance.obstacle.measured


def test_growth_beyond_the_error_counts_as_it_is(avoiding: PerfectFlight) -> None:
    check = ClearCheck(avoiding.situation)
    grown = avoiding.see(25.0, 0.2, size_m=(1.8, 1.8))
    assert check.as_planned(grown) is grown


def test_another_obstacle_counts_as_it_is(avoiding: PerfectFlight) -> None:
    other = avoiding.see(50.0, 0.0, name="2")
    assert ClearCheck(avoiding.situation).as_planned(other) is other
