"""The limits of plans, and the speeds derived from them."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.assessment import Assessment, assess, assess_terms
from onboard.files.contract_file import Contract
from onboard.guidance.envelope import (
    AT_REST_MAX_MPS,
    AT_REST_MPS,
    at_rest_speed_mps,
    broken_clauses,
    envelope_from,
    envelope_of,
    has_best_effort,
    peak_speed_mps,
)
from onboard.motion.trajectory import State
from onboard.planning.closed_form import brake_to_hover
from tests.onboard.monitoring.test_adaptation import stated


@pytest.fixture
def assessment(contract: Contract) -> Assessment:
    return assess(contract)


def test_full_acceleration_builds_up_within_the_attitude_lag(assessment: Assessment) -> None:
    envelope, limits = envelope_of(assessment), assessment.limits
    lag_s = assessment.terms.attitude_lag_s
    x_mps3, y_mps3, z_mps3 = envelope.jerk_max_mps3
    assert x_mps3 * lag_s == pytest.approx(max(limits.brake_mps2, limits.forward_mps2))
    assert y_mps3 * lag_s == pytest.approx(max(limits.left_mps2, limits.right_mps2))
    assert z_mps3 == y_mps3
    assert envelope.limits == limits
    assert envelope.speed_max_mps == assessment.terms.cruise_speed_mps
    assert envelope.thrust_max_mps2 == pytest.approx(2.0 * 9.80665)


def test_without_lag_acceleration_may_jump(assessment: Assessment) -> None:
    terms = replace(assessment.terms, attitude_lag_s=0.0)
    envelope = envelope_of(assess_terms(assessment.contract, terms))
    assert not envelope.jerk_is_limited


@pytest.mark.parametrize("lag_s", [0.0, 0.15])
@pytest.mark.parametrize("acceleration_mps2", [-1.0, 0.0, 1.0])
def test_the_peak_is_what_ending_an_acceleration_leads_to(
    assessment: Assessment, lag_s: float, acceleration_mps2: float
) -> None:
    terms = replace(assessment.terms, attitude_lag_s=lag_s)
    envelope = envelope_of(assess_terms(assessment.contract, terms))
    state = State((0.0,) * 3, (2.0, 0.0, 0.0), (acceleration_mps2, 0.0, 0.0))
    gained_mps = 0.0
    if lag_s and acceleration_mps2 > 0.0:
        gained_mps = acceleration_mps2**2 / (2.0 * envelope.jerk_max_mps3[0])
    assert peak_speed_mps(state, envelope) == pytest.approx(2.0 + gained_mps)


@given(st.floats(0.0, 6.0))
def test_the_envelope_admits_the_speed_to_slow_down_from(speed_mps: float) -> None:
    envelope = envelope_of(stated({}))
    state = State((0.0,) * 3, (speed_mps, 0.0, 0.0))
    wider = envelope_from(state, envelope)
    assert wider.speed_max_mps == max(speed_mps, envelope.speed_max_mps)
    assert replace(wider, speed_max_mps=envelope.speed_max_mps) == envelope


@given(st.floats(0.05, 3.0), st.floats(0.0, 1.0))
def test_what_counts_as_at_rest_stops_within_the_tracking_error(
    tracking_error_m: float, lag_s: float
) -> None:
    before = stated({})
    terms = replace(before.terms, tracking_error_m=tracking_error_m, attitude_lag_s=lag_s)
    assessment = assess_terms(before.contract, terms)
    speed_mps = at_rest_speed_mps(assessment)
    assert AT_REST_MPS <= speed_mps <= AT_REST_MAX_MPS
    if speed_mps > AT_REST_MPS:
        stopping_m = speed_mps * lag_s + speed_mps**2 / (2.0 * assessment.limits.brake_mps2)
        assert stopping_m <= tracking_error_m + 1e-9


def test_braking_from_what_counts_as_at_rest_is_short(assessment: Assessment) -> None:
    speed_mps = at_rest_speed_mps(assessment)
    state = State((0.0,) * 3, (speed_mps, 0.0, 0.0))
    stop = brake_to_hover(state, 0.0, envelope_of(assessment))
    assert stop.final.position_leg_m[0] <= assessment.terms.tracking_error_m
    assert math.hypot(*stop.final.velocity_leg_mps) == pytest.approx(0.0, abs=1e-9)


def required(assessment: Assessment, **requirements: object) -> Assessment:
    """Return a contract for obstacles too near to each other, with other requirements."""
    contract = assessment.contract
    environment = contract.environment.model_copy(update={"obstacle_separation_min_m": 1.0})
    changed = contract.requirements.model_copy(update=requirements)
    update = {"requirements": changed, "environment": environment}
    return assess(contract.model_copy(update=update), mission_altitude_m=4.0)


def test_with_best_effort_only_clauses_of_safety_keep_the_vehicle_from_flying(
    assessment: Assessment,
) -> None:
    assert broken_clauses(required(assessment)) == ["separation"]
    best_effort = required(assessment, progress="best_effort", stop=True)
    assert has_best_effort(best_effort)
    assert broken_clauses(best_effort) == []


def test_without_a_way_to_rest_there_is_no_best_effort(assessment: Assessment) -> None:
    unstopped = required(assessment, progress="best_effort", stop=False)
    assert not has_best_effort(unstopped)
    assert "separation" in broken_clauses(unstopped)
