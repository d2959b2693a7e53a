"""Contracts, fields and faults that generators draw, one by one."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_tools.campaign.generator.airframes import ARDUPILOT, IDEAL, PX4, Airframe
from gcs_tools.campaign.generator.case import FULL, QUICK, Extent
from gcs_tools.campaign.generator.contracts import compliant_contract, required_range_m
from gcs_tools.campaign.generator.faults import (
    _AMOUNT_RANGES,
    _PASSING_S,
    FAULT_KINDS,
    drawn_fault,
    leading_faults,
)
from gcs_tools.campaign.generator.fields import (
    Breach,
    head_on_field,
    obstacles_along_leg,
    with_breaching_field,
)
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.campaign.generator.plants import noise_max_m
from gcs_tools.campaign.generator.scenarios import compliant_scenario, straight_mission
from gcs_tools.preflight.command import check
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from sitl.virtual.faults.schema import Fault

SCENARIO = generated("nominal", 1, 0).scenario
seeds = st.integers(0, 2**32)


def drawn_contract(seed: int, airframe: Airframe = IDEAL, **more: float) -> Contract:
    draw = random.Random(seed)
    while True:
        contract = compliant_contract(draw, FULL, airframe, stop=True, passive_safety=False, **more)
        if contract is not None:
            return contract


# ---------------------------------------------------------------------------- contracts


@settings(max_examples=15, deadline=None)
@given(seeds, st.sampled_from((IDEAL, PX4, ARDUPILOT)))
def test_a_drawn_contract_complies_with_little_to_spare(seed: int, airframe: Airframe) -> None:
    contract = drawn_contract(seed, airframe)
    assessment = assess(contract)
    assert assessment.compliant
    required = {clause.name: clause.required for clause in assessment.clauses}
    separation_m = contract.environment.separation_any_way_m
    assert separation_m == pytest.approx(required["separation"], rel=0.02)
    assert contract.sensor.detection_range_m <= 1.51 * required_range_m(assessment)
    assert FULL.speed_mps[0] <= contract.vehicle.cruise_speed_mps <= FULL.speed_mps[1]


@pytest.mark.parametrize("size_m", [1.0, 3.5])
def test_the_size_may_be_given(size_m: float) -> None:
    contract = drawn_contract(1, size_max_m=size_m)
    assert contract.environment.obstacle_size_max_m == size_m


def test_a_leg_too_short_for_one_obstacle_gives_no_contract() -> None:
    extent = Extent((3.0, 3.0), (4.0, 5.0), airborne=True)
    draw = random.Random(1)
    drawn = [
        compliant_contract(draw, extent, IDEAL, stop=True, passive_safety=True) for _ in range(50)
    ]
    assert drawn == [None] * 50


def test_where_no_range_suffices_for_the_heading_s_error_there_is_no_contract() -> None:
    swinging = replace(
        PX4, terms=lambda draw, mps: PX4.terms(draw, mps) | {"heading_error_deg": 40.0}
    )
    draw = random.Random(1)
    drawn = [
        compliant_contract(draw, FULL, swinging, stop=True, passive_safety=True) for _ in range(5)
    ]
    assert drawn == [None] * 5


# ---------------------------------------------------------------------------- fields


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(-math.pi, math.pi))
def test_obstacles_are_on_the_leg_and_apart(seed: int, heading_rad: float) -> None:
    contract = drawn_contract(seed)
    field = obstacles_along_leg(random.Random(seed), contract, heading_rad, 90.0)
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    along_m = field.center_ned_m @ along
    assert np.all((along_m > 0.0) & (along_m < 90.0))
    apart_m = np.diff(along_m)
    assert np.all(apart_m >= contract.environment.separation_any_way_m)
    sizes_m = np.hypot(*(2.0 * field.half_size_m).T)
    assert np.all(sizes_m <= contract.environment.obstacle_size_max_m * math.sqrt(2.0) + 1e-9)


def test_a_short_leg_has_no_obstacle() -> None:
    assert len(obstacles_along_leg(random.Random(1), drawn_contract(1), 0.0, 1.0)) == 0


@pytest.mark.parametrize("breach", ["larger", "closer"])
def test_a_breach_leaves_the_rest_of_the_field(breach: Breach) -> None:
    for seed in range(20):
        changed = with_breaching_field(random.Random(seed), SCENARIO, breach)
        before, after = SCENARIO.obstacles, changed.obstacles
        assert len(after) == len(before) + (breach == "closer")
        assert after.ids[: len(before)] == before.ids
        assert not changed.field_known
        assert changed.contract is SCENARIO.contract
        if breach == "larger":
            size_max_m = SCENARIO.contract.environment.obstacle_size_max_m
            assert after.half_size_m[0].min() * 2.0 >= 1.2 * size_max_m
            np.testing.assert_array_equal(after.center_ned_m[1:], before.center_ned_m[1:])
        else:
            apart_m = np.hypot(*(after.center_ned_m[-1] - before.center_ned_m[0]))
            assert apart_m < 0.71 * SCENARIO.contract.environment.separation_any_way_m
    # What was drawn before is not changed by it.
    assert len(SCENARIO.obstacles) == len(before)


def test_a_head_on_obstacle_still_keeps_the_contract() -> None:
    assert check(SCENARIO.contract, head_on_field(SCENARIO), SCENARIO.mission).compliant


# ---------------------------------------------------------------------------- scenarios, plants


@pytest.mark.parametrize("extent", [FULL, QUICK])
@pytest.mark.parametrize("passive_safety", [True, False])
def test_a_scenario_has_the_requirements_that_are_asked_for(
    extent: Extent, *, passive_safety: bool
) -> None:
    draw = random.Random(5)
    scenario = compliant_scenario(draw, extent, stop=False, passive_safety=passive_safety)
    assert scenario.contract.requirements.stop is False
    assert scenario.contract.requirements.passive_safety is passive_safety
    assert check(scenario.contract, scenario.obstacles, scenario.mission).compliant


def test_a_mission_is_one_leg_in_its_direction() -> None:
    mission = straight_mission(random.Random(1), SCENARIO.contract, math.pi / 2.0, 40.0)
    (leg,) = mission.legs
    assert leg.end_ned_m == pytest.approx((0.0, 40.0), abs=1e-9)
    assert leg.target_half_width_m > 2.0 * SCENARIO.contract.environment.obstacle_size_max_m


def test_the_body_frame_leaves_less_room_for_noise() -> None:
    in_ned_m = noise_max_m(SCENARIO.contract, "local_ned")
    in_body_m = noise_max_m(SCENARIO.contract, "body_frd")
    assert 0.0 <= in_body_m < in_ned_m
    assert in_ned_m == SCENARIO.contract.sensor.position_error_m * math.sqrt(0.5)


# ---------------------------------------------------------------------------- faults


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_a_fault_of_any_kind_can_be_drawn(kind: str) -> None:
    for seed in range(30):
        fault = drawn_fault(random.Random(seed), kind, SCENARIO)  # type: ignore[arg-type]
        assert fault.kind == kind
        if kind in _AMOUNT_RANGES:
            low, high = _AMOUNT_RANGES[kind]
            assert fault.amount is not None
            assert low <= fault.amount <= high
        if kind in _PASSING_S:
            low, high = _PASSING_S[kind]
            assert fault.duration_s is not None
            assert low <= fault.duration_s <= high


def test_faults_begin_at_any_time_on_a_transition_or_after_it() -> None:
    drawn = [drawn_fault(random.Random(seed), "gust", SCENARIO) for seed in range(200)]
    assert {(fault.phase is None, fault.start_s == 0.0) for fault in drawn} == {
        (True, False), (False, True), (False, False),
    }  # fmt: skip
    assert {fault.duration_s is None for fault in drawn} == {True, False}


@pytest.mark.parametrize(
    ("phase", "kind"),
    [("hold", "detections_off"), ("standby", "operator_takes_over")],
)
def test_a_phase_off_the_nominal_path_is_led_to(phase: str, kind: str) -> None:
    gust = Fault.model_validate({"kind": "gust", "amount": 3.0, "phase": phase})
    (leading,) = leading_faults(random.Random(1), gust, SCENARIO)
    assert leading.kind == kind
    assert leading.phase in {"cruise", "avoid"}
    same = Fault.model_validate({"kind": kind, "phase": phase, "duration_s": 2.0})
    assert leading_faults(random.Random(1), same, SCENARIO) == ()


@pytest.mark.parametrize("phase", ["cruise", "avoid", "arrived", None])
def test_a_phase_on_the_nominal_path_needs_no_lead(phase: str | None) -> None:
    gust = Fault.model_validate({"kind": "gust", "amount": 3.0, "phase": phase})
    assert leading_faults(random.Random(1), gust, SCENARIO) == ()


def test_breaches_of_the_field_are_two_of_all() -> None:
    assert set(get_args(Breach)) == {"larger", "closer", "range", "speed"}
