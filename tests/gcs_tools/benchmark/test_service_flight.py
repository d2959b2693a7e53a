"""Flights through the whole service."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.service_flight import (
    field_of,
    fly_by_service,
    scenario_of,
    service_contract,
    service_margin_m,
)
from gcs_tools.preflight.command import check
from tests.gcs_tools.benchmark.small_scene import scene


def test_the_service_flies_the_same_field_wherever_the_leg_heads() -> None:
    obstacles = Obstacles(
        np.array(((5.0, 1.0), (9.0, -2.0))), np.array(((1.0, 0.4), (0.0, 0.0))),
        np.array((0.3, 0.0)), np.array((0.0, 0.2)),
    )  # fmt: skip
    heading_rad = 0.8
    field = field_of(obstacles, heading_rad)
    again = Obstacles(field.center_ned_m, field.half_size_m, field.yaw_rad, np.zeros(2))
    points = np.array(((4.0, 4.0), (7.0, 0.0), (9.0, -5.0)))
    back = again.along_leg(np.zeros(2), heading_rad)
    assert back.distance_m(points) == pytest.approx(obstacles.distance_m(points))
    assert field.center_ned_m[0] == pytest.approx(
        (5.0 * math.cos(0.8) - math.sin(0.8), 5.0 * math.sin(0.8) + math.cos(0.8))
    )


def test_a_small_field_is_flown_by_the_whole_service() -> None:
    served = fly_by_service(scene((5.0, 0.1), (8.0, -1.8)), 1)
    assert served.arrived
    assert served.result.clearance_min_m is not None
    assert 0.0 < served.result.clearance_min_m < 1.5
    assert 5.0 < served.first_look_s < 20.0
    assert served.speed_mps > 1.0


@pytest.mark.parametrize(
    ("vehicle", "radius_m", "heading_deg"), [("ardupilot", 0.3, 0.5), ("px4", 0.4, 4.0)]
)
def test_contracts_of_the_service_accept_dense_fields(
    vehicle: str, radius_m: float, heading_deg: float
) -> None:
    contract = service_contract(vehicle, 0.7)
    assert contract.requirements.progress == "best_effort"
    assert contract.requirements.passive_safety
    assert contract.vehicle.clearance_wish_m == 0.7
    assert (contract.vehicle.radius_m, contract.vehicle.heading_error_deg) == (
        radius_m, heading_deg,
    )  # fmt: skip
    assert (
        service_margin_m(scene((5.0, 0.1)), vehicle) > radius_m + contract.vehicle.tracking_error_m
    )
    scenario = scenario_of(scene((5.0, 0.1)), 0.5, vehicle)
    assert check(scenario.contract, None, scenario.mission).may_fly
    plant = scenario.sitl_config(seed=1)
    assert (plant.flavour, plant.realism, plant.multirotor.radius_m) == (
        vehicle, "field", radius_m,
    )  # fmt: skip
