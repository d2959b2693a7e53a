"""Vehicles of a fleet as they are simulated: as their contracts say, with errors and restarts."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from itertools import pairwise

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.fleet.vehicles import beside, boot_of, flight_of, require_preflight, restarts
from gcs_tools.preflight.offline.fleet_files import read_fleet
from onboard.contract.assessment import assess
from tests.gcs_tools.running import CONFIG

_, MEMBERS = read_fleet(CONFIG / "fleet" / "crossing.yaml")


def test_a_vehicle_is_as_its_contract_and_the_fleet_say() -> None:
    south = MEMBERS[1]
    flight = flight_of(south, 1, seed=7, faults=(), time_limit_s=50.0)
    sitl, contract = flight.sitl, south.assessment.contract
    assert (sitl.flavour, sitl.system_id) == ("px4", 2)
    assert sitl.parameters["COM_OF_LOSS_T"] == contract.vehicle.setpoint_loss_timeout_s
    assert sitl.multirotor.radius_m == contract.vehicle.radius_m
    assert sitl.home.latitude_deg == south.vehicle.origin.latitude_deg
    assert sitl.home.longitude_deg == south.vehicle.origin.longitude_deg
    (sensor,) = sitl.sensors
    assert sensor.range_m == contract.sensor.detection_range_m
    assert sensor.uncertainty_m == contract.sensor.position_error_m
    assert sensor.movers_hidden


def test_a_vehicle_that_the_check_refuses_is_not_flown() -> None:
    contract = MEMBERS[0].assessment.contract
    blind = contract.sensor.model_copy(update={"detection_range_m": 3.0})
    refused = replace(MEMBERS[0], assessment=assess(contract.model_copy(update={"sensor": blind})))
    with pytest.raises(CommandError, match="northbound: the pre-flight check refuses: "):
        require_preflight([refused])
    require_preflight(MEMBERS)


def test_a_daemon_that_dies_is_handed_the_vehicle_again() -> None:
    faults = restarts(random.Random(1), 20.0, 400.0)
    deaths = [each for each in faults if each.kind == "daemon_dead"]
    handed = [each for each in faults if each.kind == "operator_takes_over"]
    assert 8 < len(deaths) == len(handed)
    for dead, taken in zip(deaths, handed, strict=True):
        assert dead.start_s == taken.start_s
        assert dead.duration_s is not None
        assert taken.duration_s is not None
        assert dead.duration_s < taken.duration_s
    for one, other in pairwise(handed):
        assert one.duration_s is not None
        assert other.start_s > one.start_s + one.duration_s


def test_a_vehicle_is_beside_its_place_by_no_more_than_its_error() -> None:
    draw = random.Random(2)
    places_m = [beside(draw, 0.5) for _ in range(200)]
    away_m = [math.hypot(*place_m) for place_m in places_m]
    assert 0.45 < max(away_m) <= 0.5
    assert {(north_m > 0.0, east_m > 0.0) for north_m, east_m in places_m} == {
        (one, other) for one in (False, True) for other in (False, True)
    }


def test_no_two_runs_are_named_alike() -> None:
    draw = random.Random(3)
    boots = {boot_of(draw) for _ in range(50)}
    assert len(boots) == 50
    assert all(len(boot) == 16 and int(boot, 16) >= 0 for boot in boots)
