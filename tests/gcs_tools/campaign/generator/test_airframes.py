"""What campaigns' vehicles declare, and how they are simulated."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from gcs_tools.campaign.generator.airframes import (
    ARDUPILOT,
    IDEAL,
    PX4,
    SEEN_LATE_S,
    Airframe,
    airframe_of,
    drawn_airframe,
)
from gcs_tools.campaign.generator.case import FULL
from gcs_tools.scenario import Plant
from onboard.files.contract_file import Contract, load_contract
from sitl.plant.pinned_error import PinnedError
from sitl.vehicle.autopilot import FLAVOURS
from tests.onboard.conftest import CONFIG


def test_an_extent_without_room_for_the_errors_of_the_field_has_ideal_vehicles_only() -> None:
    draw = random.Random(1)
    assert {drawn_airframe(draw, FULL).name for _ in range(60)} == {"ideal", "px4", "ardupilot"}
    assert {drawn_airframe(draw, replace(FULL, ideal=True)) for _ in range(60)} == {IDEAL}


@pytest.mark.parametrize("airframe", [PX4, ARDUPILOT])
def test_what_is_declared_covers_what_the_simulation_does(airframe: Airframe) -> None:
    estimate = FLAVOURS[airframe.name]().field.estimator
    assert airframe.wander_m == estimate.position_m
    for seed in range(20):
        terms = airframe.terms(random.Random(seed), 2.0)
        declared_m = terms["tracking_error_m"]
        # The controller follows the estimate, which wanders on both axes.
        assert declared_m > estimate.position_m * 2.0**0.5
        assert terms["tracking_error_z_m"] > estimate.height_m
        assert terms["velocity_error_mps"][0] >= estimate.velocity_mps


# The largest tracking error seen in the simulation; px4_contract.yaml adds a reserve to it.
@pytest.mark.parametrize(("airframe", "seen_m"), [(PX4, 0.95), (ARDUPILOT, 0.35)])
def test_an_airframe_declares_no_less_than_the_contract_where_one_begins(
    airframe: Airframe, seen_m: float
) -> None:
    begun: Contract = load_contract(CONFIG / f"{airframe.name}_contract.yaml")
    vehicle, speed_mps = begun.vehicle, begun.vehicle.cruise_speed_mps
    terms = airframe.terms(random.Random(3), speed_mps)
    assert min(terms["tracking_error_m"], vehicle.tracking_error_m) >= seen_m
    assert terms["heading_error_deg"] >= vehicle.heading_error_deg
    assert terms["setpoint_loss_run_on_m"] == pytest.approx(
        vehicle.setpoint_loss_run_on_m, rel=0.01
    )


def test_an_ideal_vehicle_is_kept_away_from_its_reference_by_less_than_is_declared() -> None:
    contract = load_contract(CONFIG / "default_contract.yaml")
    pinned = [IDEAL.plant(random.Random(seed), contract)["tracking"] for seed in range(60)]
    assert 0 < sum(each["toward_obstacle"] for each in pinned) < 30
    assert {each["error_m"] < contract.vehicle.tracking_error_m for each in pinned} == {True}


def test_what_telemetry_shows_late_of_a_vehicle_behind_its_setpoint_stays_within_the_contract() -> (
    None
):
    """A fast one with a small tracking error left its contract by the age of its poses alone."""
    contract, velocity_mps = load_contract(CONFIG / "default_contract.yaml"), (4.8, 0.0)
    config = IDEAL.plant(random.Random(1), contract)["tracking"]
    error = PinnedError(config["error_m"], config["seen_late_s"])
    for _ in range(100):
        error.advance((-1.0, 0.0), 0.02, velocity_mps)
    assert abs(error.north_m) + SEEN_LATE_S * velocity_mps[0] <= config["error_m"] + 1e-9
    assert error.north_m < -0.6 * config["error_m"]


@pytest.mark.parametrize("airframe", [IDEAL, PX4, ARDUPILOT])
def test_a_plant_tells_its_airframe(airframe: Airframe) -> None:
    contract = load_contract(CONFIG / "default_contract.yaml")
    plant = Plant.model_validate(airframe.plant(random.Random(1), contract))
    assert airframe_of(plant) is airframe
