import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.assessment import Assessment, assess, assess_terms
from onboard.files.contract_file import Contract
from onboard.guidance.envelope import envelope_of
from onboard.monitoring.adaptation import (
    HEADROOM,
    SPEED_MIN_MPS,
    SPEED_STEP_MPS,
    adapt,
    at_compliant_speed,
    slowing_distance,
    slows_in_time,
)
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.axis_profile import AxisState, coasting_speed
from onboard.motion.trajectory import State
from onboard.planning.closed_form import _HOVER_S, cruise


@pytest.fixture
def assessment(contract: Contract) -> Assessment:
    return assess(contract)


def broken(assumption: Assumption, measured: float, subject: str = "") -> Violation:
    return Violation(assumption, measured, 0.0, "", subject)


def test_what_still_complies_is_flown_as_fast(assessment: Assessment) -> None:
    adaptation = adapt(assessment, broken(Assumption.DETECTION_RANGE, 9.0, "front"))
    assert adaptation is not None
    assert not adaptation.slower
    assert adaptation.assessment.terms.detection_range_m == 9.0
    assert adaptation.assessment.compliant


def test_shorter_sight_is_flown_at_the_fastest_step_that_complies(assessment: Assessment) -> None:
    adaptation = adapt(assessment, broken(Assumption.DETECTION_RANGE, 7.0, "front"))
    assert adaptation is not None
    assert adaptation.slower
    adapted = adaptation.assessment
    assert adapted.compliant
    faster = replace(
        adapted.terms, cruise_speed_mps=adapted.terms.cruise_speed_mps + SPEED_STEP_MPS
    )
    assert not assess_terms(adapted.contract, faster).compliant


@given(st.floats(1.0, 12.0))
def test_bisection_finds_the_speed_that_trying_each_step_finds(range_m: float) -> None:
    before = assess(Contract.model_validate(EXAMPLE))
    seen = replace(before, terms=replace(before.terms, detection_range_m=range_m))
    steps = range(math.floor((2.8 - SPEED_MIN_MPS) / SPEED_STEP_MPS) + 1)
    speeds_mps = [2.8 - step * SPEED_STEP_MPS for step in steps]
    complying_mps = (
        speed_mps
        for speed_mps in speeds_mps
        if assess_terms(before.contract, replace(seen.terms, cruise_speed_mps=speed_mps)).compliant
    )
    expected_mps = next(complying_mps, None)
    adaptation = at_compliant_speed(seen, 2.8)
    if expected_mps is None:
        assert adaptation is None
    else:
        assert adaptation is not None
        assert adaptation.assessment.terms.cruise_speed_mps == expected_mps
        assert adaptation.slower is (expected_mps < 2.8)


def test_sight_too_short_for_any_speed_is_not_adapted_to(assessment: Assessment) -> None:
    assert adapt(assessment, broken(Assumption.DETECTION_RANGE, 0.5, "front")) is None


@pytest.mark.parametrize(
    "assumption",
    [
        Assumption.DETECTION_AGE,
        Assumption.SENSOR_CLOCK,
        Assumption.TELEMETRY_AGE,
        Assumption.ESTIMATOR_RESET,
        Assumption.SECOND_COMMANDER,
        Assumption.TILT_RESPONSE,
        Assumption.TICK_OVERRUN,
        Assumption.PLAN_EXISTS,
    ],
)
def test_what_a_contract_does_not_state_in_numbers_is_not_adapted_to(
    assessment: Assessment, assumption: Assumption
) -> None:
    assert adapt(assessment, broken(assumption, 1.0)) is None


@pytest.mark.parametrize(
    ("assumption", "subject", "measured", "field", "expected"),
    [
        (Assumption.FIELD_OF_VIEW, "front", 100.0, "field_of_view_rad", math.radians(100.0)),
        (Assumption.DETECTION_UNCERTAINTY, "front", 0.08, "position_error_m", 0.08),
        (Assumption.REACTION_TIME, "", 0.2, "reaction_time_s", 0.2 * HEADROOM),
        (Assumption.OBSTACLE_SIZE, "front/1", 4.3, "obstacle_size_max_m", 4.3),
        (Assumption.ROI_INTERSECTION, "a and b", 18.0, "obstacle_separation_min_m", 18.0),
        (Assumption.TRACKING_ERROR, "", 0.3, "tracking_error_m", 0.3 * HEADROOM),
        (Assumption.VELOCITY_ERROR, "x", 0.3, "velocity_error_x_mps", 0.3 * HEADROOM),
        (Assumption.VELOCITY_ERROR, "y", 0.15, "velocity_error_y_mps", 0.15 * HEADROOM),
    ],
)
def test_each_observation_worsens_the_term_it_is_about(
    assessment: Assessment,
    assumption: Assumption,
    subject: str,
    measured: float,
    field: str,
    expected: float,
) -> None:
    adaptation = adapt(assessment, broken(assumption, measured, subject))
    assert adaptation is not None
    assert getattr(adaptation.assessment.terms, field) == pytest.approx(expected)
    assert adaptation.assessment.compliant


@pytest.mark.parametrize(
    ("assumption", "axis"),
    [
        (Assumption.TRACKING_ERROR, ""),
        (Assumption.VELOCITY_ERROR, "x"),
        (Assumption.VELOCITY_ERROR, "y"),
    ],
)
def test_errors_far_beyond_the_declared_are_not_adapted_to(
    assessment: Assessment, assumption: Assumption, axis: str
) -> None:
    assert adapt(assessment, broken(assumption, 0.5, axis)) is None


WIDE: dict[str, Any] = {"obstacle_separation_min_m": 40.0, "wind_max_mps": 1.0}


def stated(vehicle: dict[str, Any], environment: dict[str, Any] | None = None) -> Assessment:
    sections = {"vehicle": vehicle, "environment": environment or {}}
    return assess(
        Contract.model_validate(
            {name: keys | sections.get(name, {}) for name, keys in EXAMPLE.items()}
        ),
        mission_altitude_m=4.0,
    )


@pytest.mark.parametrize(
    ("assumption", "measured", "field", "expected"),
    [
        (Assumption.TRACKING_ERROR_Z, 1.2, "tracking_error_z_m", 1.2 * HEADROOM),
        (Assumption.WIND, 1.2, "wind_max_mps", 1.2 * HEADROOM),
    ],
)
def test_height_and_wind_are_terms_like_any_other(
    assumption: Assumption, measured: float, field: str, expected: float
) -> None:
    before = stated({}, WIDE)
    adaptation = adapt(before, broken(assumption, measured))
    assert adaptation is not None
    assert adaptation.assessment.compliant
    assert getattr(adaptation.assessment.terms, field) == pytest.approx(expected)
    # More than twice what was declared is something else.
    assert adapt(before, broken(assumption, 2.5 * measured)) is None


def test_a_height_error_that_reaches_the_ground_is_not_adapted_to() -> None:
    low = stated({"tracking_error_z_m": 1.8, "radius_m": 0.3}, WIDE).at_altitude(2.2)
    assert low.compliant
    assert adapt(low, broken(Assumption.TRACKING_ERROR_Z, 1.9)) is None


def test_a_wind_that_is_not_declared_is_not_adapted_to(assessment: Assessment) -> None:
    assert adapt(assessment, broken(Assumption.WIND, 0.1)) is None


@pytest.mark.parametrize("subject", ["pointing", "compass", "sightings"])
@pytest.mark.parametrize("measured", [0.1, 1.4, 6.0, 30.0])
def test_what_shows_a_wrong_heading_does_not_measure_its_error(
    subject: str, measured: float
) -> None:
    """A compass ratio of 1.4 is no heading error of 1.4 degrees."""
    before = stated({"heading_error_deg": 5.0}, WIDE)
    assert adapt(before, broken(Assumption.HEADING_ERROR, measured, subject)) is None


def test_wind_leaves_less_to_slow_down_with() -> None:
    drag = {"drag_per_s": 0.5}
    needed_m = stated(drag, WIDE).inflated.required_separation_m
    before = stated(drag, WIDE | {"obstacle_separation_min_m": needed_m + 0.1})
    assert before.compliant
    adaptation = adapt(before, broken(Assumption.WIND, 1.5))
    assert adaptation is not None
    assert adaptation.slower
    after = adaptation.assessment
    assert after.limits.brake_mps2 < before.limits.brake_mps2
    braking_m = 2.8**2 - after.terms.cruise_speed_mps**2
    braking_m /= 2.0 * after.limits.brake_mps2
    late_m = 1.5 * 2.8 * before.terms.attitude_lag_s
    assert slowing_distance(before, 2.8, after) == pytest.approx(braking_m + late_m)


def test_plans_are_certified_with_the_trim(assessment: Assessment) -> None:
    windy = stated({"drag_per_s": 0.5}, WIDE)
    assert envelope_of(windy).trim_mps2 == pytest.approx(0.5)
    assert envelope_of(windy).limits == windy.limits
    assert envelope_of(assessment).trim_mps2 == 0.0
    # What the wind leaves nothing for is not flown, but a forced flight still has its envelope.
    storm = stated({"drag_per_s": 0.5}, WIDE | {"wind_max_mps": 50.0})
    assert not storm.compliant
    assert envelope_of(storm).trim_mps2 == 0.0


@given(
    st.sampled_from([Assumption.VELOCITY_ERROR, Assumption.DETECTION_RANGE, Assumption.WIND]),
    st.floats(0.0, 6.0),
)
def test_a_measured_run_is_never_used_above_its_speed(
    assumption: Assumption, measured: float
) -> None:
    run = {"setpoint_loss_run_on_m": 3.0, "setpoint_loss_run_on_speed_mps": 2.8}
    before = stated(run, WIDE)
    adaptation = adapt(before, broken(assumption, measured, "x"))
    if adaptation is not None:
        terms = adaptation.assessment.terms
        fastest_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
        assert fastest_mps <= 2.8 + 0.20 + 1e-9
        assert adaptation.assessment.inflated.manoeuvre_encounter.run_on_m <= 3.0 + 1e-9


def test_a_larger_speed_error_takes_from_the_speed_that_a_run_covers() -> None:
    before = stated({"setpoint_loss_run_on_m": 3.0}, WIDE)
    adaptation = adapt(before, broken(Assumption.VELOCITY_ERROR, 0.3, "x"))
    assert adaptation is not None
    assert adaptation.slower
    assert adaptation.assessment.terms.cruise_speed_mps == pytest.approx(2.60)
    modelled = adapt(stated({}, WIDE), broken(Assumption.VELOCITY_ERROR, 0.3, "x"))
    assert modelled is not None
    assert not modelled.slower


def test_better_than_assumed_changes_nothing(assessment: Assessment) -> None:
    adaptation = adapt(assessment, broken(Assumption.OBSTACLE_SIZE, 1.0, "front/1"))
    assert adaptation is not None
    assert adaptation.assessment.terms == assessment.terms


observations = st.one_of(
    st.builds(broken, st.just(Assumption.DETECTION_RANGE), st.floats(0.0, 20.0)),
    st.builds(broken, st.just(Assumption.OBSTACLE_SIZE), st.floats(0.0, 20.0)),
    st.builds(broken, st.just(Assumption.TRACKING_ERROR), st.floats(0.0, 2.0)),
    st.builds(broken, st.just(Assumption.REACTION_TIME), st.floats(0.0, 2.0)),
    st.builds(broken, st.just(Assumption.ROI_INTERSECTION), st.floats(0.0, 30.0)),
)


@given(st.lists(observations, max_size=30))
def test_adaptation_cannot_chatter(seen: list[Violation]) -> None:
    """Speed and terms only ever worsen, and speed in steps: a bounded number of changes."""
    assessment = assess(Contract.model_validate(EXAMPLE))
    slowings = 0
    for violation in seen:
        adaptation = adapt(assessment, violation)
        if adaptation is None:
            break
        before, after = assessment.terms, adaptation.assessment.terms
        assert adaptation.assessment.compliant
        assert after.detection_range_m <= before.detection_range_m
        assert after.tracking_error_m >= before.tracking_error_m
        assert after.obstacle_size_max_m >= before.obstacle_size_max_m
        if adaptation.slower:
            slowings += 1
            assert after.cruise_speed_mps <= before.cruise_speed_mps - SPEED_STEP_MPS + 1e-9
        else:
            assert after.cruise_speed_mps == before.cruise_speed_mps
        assessment = adaptation.assessment
    start_mps = EXAMPLE["vehicle"]["cruise_speed_mps"]
    assert isinstance(start_mps, float)
    assert slowings <= (start_mps - SPEED_MIN_MPS) / SPEED_STEP_MPS


@given(st.floats(0.3, 2.8), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_slowing_distance_covers_every_way_to_slow_down(
    speed_mps: float, pushing: float, slower: float
) -> None:
    before = assess(Contract.model_validate(EXAMPLE))
    final_mps = max(slower * speed_mps, SPEED_MIN_MPS / 2.0)
    terms = replace(before.terms, cruise_speed_mps=final_mps)
    envelope = envelope_of(before)
    x = AxisState(0.0, speed_mps, pushing * before.limits.forward_mps2 / 2.0)
    start = State((0.0,) * 3, (speed_mps, 0.0, 0.0), (x.acceleration_mps2, 0.0, 0.0))
    slowing = cruise(start, 0.0, envelope, final_mps)
    peak_mps = max(speed_mps, coasting_speed(x, envelope.jerk_max_mps3[0]))
    bound_m = slowing_distance(before, peak_mps, replace(before, terms=terms))
    if final_mps < speed_mps:
        assert slowing.final.position_leg_m[0] - final_mps * _HOVER_S <= bound_m + 1e-9
    assert slowing.velocity_range_mps(0)[1] <= peak_mps + 1e-9


def test_it_slows_in_time_only_within_what_is_known(assessment: Assessment) -> None:
    adaptation = adapt(assessment, broken(Assumption.DETECTION_RANGE, 7.0))
    assert adaptation is not None
    assert slows_in_time(assessment, 2.8, adaptation.assessment)
    blind = replace(assessment, terms=replace(assessment.terms, detection_range_m=5.5))
    assert not slows_in_time(blind, 2.8, adaptation.assessment)


EXAMPLE: dict[str, dict[str, object]] = {
    "vehicle": {
        "roll_max_deg": 15.0,
        "pitch_max_deg": 15.0,
        "thrust_to_weight": 2.0,
        "cruise_speed_mps": 2.8,
        "radius_m": 0.30,
        "tracking_error_m": 0.25,
        "velocity_error_mps": (0.20, 0.10),
        "reaction_time_s": 0.15,
        "attitude_lag_s": 0.15,
        "setpoint_loss_timeout_s": 0.5,
    },
    "sensor": {
        "detection_range_m": 12.0,
        "field_of_view_deg": 120.0,
        "frame_age_max_s": 0.30,
        "position_error_m": 0.05,
    },
    "environment": {
        "obstacle_size_max_m": 4.0,
        "obstacle_size_min_m": 0.0,
        "obstacle_separation_min_m": 20.0,
    },
}
