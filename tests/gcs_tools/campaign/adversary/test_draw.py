"""What an adversary draws: everything at its limit, and nothing beyond."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.campaign.adversary.contract import SLACK, Timing, timing_of
from gcs_tools.campaign.adversary.draw import adversary_case, adversary_genes
from gcs_tools.campaign.adversary.genes import Genes
from gcs_tools.campaign.adversary.plant import USED
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import face_distances_m
from onboard.contract.assessment import assess
from onboard.files.contract_file import FrozenSetpoint

CASES = [adversary_case(3, number) for number in range(40)]


def lanes() -> list[FlightCase]:
    return [case for case in CASES if case.variant == "lane"]


def test_a_number_means_one_flight() -> None:
    assert adversary_case(3, 1).scenario.contract == CASES[1].scenario.contract
    assert adversary_case(3, 1).seed == CASES[1].seed
    assert adversary_case(4, 1).scenario.contract != CASES[1].scenario.contract


def test_every_kind_and_variant_of_the_attack_is_drawn() -> None:
    assert {case.variant for case in CASES} == {"lane", "corner", "forest"}
    contracts = [case.scenario.contract for case in CASES]
    assert {contract.requirements.passive_safety for contract in contracts} == {True, False}
    assert {assess(contract).nominal.region.flat for contract in contracts} == {True, False}
    sensors = [case.scenario.plant.sensors[0] for case in CASES]
    assert {sensor.frame for sensor in sensors} == {"local_ned", "body_frd"}
    assert any(sensor.scanner for sensor in sensors)
    assert any(sensor.errors.empty_every for sensor in sensors)
    assert any(sensor.errors.confirm_frames == 3 for sensor in sensors)
    assert any(contract.vehicle.heading_error_deg for contract in contracts)
    assert any(case.scenario.plant.estimator.position_m for case in CASES)
    assert len({case.trigger for case in CASES}) >= 6
    assert any(len(case.scenario.mission.legs) == 2 for case in CASES)


@pytest.mark.parametrize("case", lanes(), ids=lambda case: case.scenario.name)
def test_a_lane_is_a_hair_within_its_contract(case: FlightCase) -> None:
    scenario = case.scenario
    assert check(scenario.contract, scenario.obstacles, scenario.mission).compliant
    assert case.adversary is not None
    assert all(1.0 / SLACK - 1e-9 <= share <= 1.0 for share in case.adversary.by_draw.values())


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.scenario.name)
def test_errors_of_the_plant_are_those_of_the_contract(case: FlightCase) -> None:
    contract, plant = case.scenario.contract, case.scenario.plant
    (sensor,) = plant.sensors
    assert plant.tracking.kinematic
    assert plant.tracking.error_m is not None
    assert 0.97 <= plant.tracking.error_m / contract.vehicle.tracking_error_m <= USED + 1e-9
    e = contract.sensor.position_error_m
    assert (sensor.face_noise_m or 0.0) + math.sqrt(2.0) * (plant.estimator.position_m or 0.0) <= e
    assert sensor.range_m == contract.sensor.detection_range_m
    # A box may be missing in two successive frames: the service waits for a third.
    missing = max(sensor.errors.confirm_frames - 1, sensor.errors.empty_frames - 1)
    assert missing <= 2
    worst_s = (missing + 1) / sensor.rate_hz + sensor.latency_s
    assert worst_s <= contract.vehicle.reaction_time_s
    if contract.requirements.passive_safety:
        assert isinstance(contract.vehicle.setpoint_loss, FrozenSetpoint)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.scenario.name)
def test_what_the_operator_says_of_the_start_is_true(case: FlightCase) -> None:
    scenario = case.scenario
    distances_m = face_distances_m(scenario.obstacles, scenario.mission.start_ned_m)
    assert scenario.mission.start_clear_m is not None
    assert distances_m.min() >= scenario.mission.start_clear_m


def test_the_reaction_counts_every_frame_that_may_be_missing() -> None:
    assert Timing(0.1, 0.04, 1, None).reaction_s == pytest.approx(0.14)
    assert Timing(0.1, 0.04, 3, None).reaction_s == pytest.approx(0.34)
    assert Timing(0.1, 0.04, 1, 6).reaction_s == pytest.approx(0.34)
    assert timing_of(Genes("x")) == timing_of(Genes("x"))


def test_moved_genes_move_the_field_and_not_the_contract() -> None:
    number = CASES.index(lanes()[0])
    genes = adversary_genes(3, number)
    across = 1.0 - genes.value("across_0")
    moved = adversary_case(3, number, {"across_0": across})
    assert moved.scenario.contract == CASES[number].scenario.contract
    assert not np.array_equal(
        moved.scenario.obstacles.center_ned_m, CASES[number].scenario.obstacles.center_ned_m
    )
    assert moved.refusable
    assert moved.adversary is not None
    assert moved.adversary.genes == {"across_0": across}
    assert f"across_0={across:.4f}" in moved.scenario.name
