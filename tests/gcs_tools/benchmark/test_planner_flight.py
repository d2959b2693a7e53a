"""Flights of the planner alone, through small fields."""

from __future__ import annotations

import pytest

from gcs_tools.benchmark.planner_flight import Flight
from gcs_tools.benchmark.vehicles import Vehicle, vehicles
from onboard.planning.corridor.horizon import Horizon
from tests.gcs_tools.benchmark.small_scene import scene


def test_a_small_field_is_flown_and_nothing_is_touched() -> None:
    field = scene((5.0, 0.1), (7.0, -1.8), (8.5, 1.2))
    outcome = Flight(field, vehicles()["ardupilot"], 1).fly()
    assert outcome.end == "arrived"
    assert outcome.clearance_min_m > 0.0
    assert outcome.certified_min_m > 0.0
    assert outcome.false_cells == 0
    assert outcome.losses > 0
    assert outcome.losses_unsafe == 0
    assert outcome.speed_mps(field.length_m) > 1.0


def test_a_wish_for_clearance_is_kept_where_there_is_room() -> None:
    field = scene((6.0, 0.1))
    near, far = (Flight(field, Vehicle(), 1, wish_m=wish_m).fly() for wish_m in (0.0, 1.5))
    assert near.end == far.end == "arrived"
    assert near.clearance_min_m < 1.0
    assert far.clearance_min_m >= 1.5


def test_a_flight_of_one_seed_is_always_the_same() -> None:
    field = scene((5.0, 0.1), (7.0, -1.8))
    first, second = (Flight(field, Vehicle(), 1).fly(3.0).track for _ in range(2))
    assert first == second


@pytest.mark.parametrize(("error_m", "end"), [(0.35, ""), (0.70, "collision")])
def test_a_collision_is_found_out(error_m: float, end: str) -> None:
    flight = Flight(scene((5.0, 0.0)), Vehicle(tracking_error_m=error_m), 1)
    flight._horizon = Horizon.at_rest(0.0, 3.9, 0.0)
    assert flight._period(0.0) == end
