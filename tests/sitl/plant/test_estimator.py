"""What the autopilot believes, under ``realism: field``: wander, dead reckoning, jumps."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.px4 import Px4
from sitl.config import EstimatorConfig
from sitl.plant.estimator import IDEAL, EstimateError, Estimator, EstimatorProfile
from sitl.plant.truth import VehicleTruth

PROFILES = {"px4": Px4.field.estimator, "ardupilot": Copter.field.estimator}
NOTHING = (0.0, 0.0, 0.0)


def truth_at(time_s: float, north_mps: float = 1.0, yaw_rad: float = 0.0) -> VehicleTruth:
    half_rad = yaw_rad / 2.0
    attitude = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
    place_ned_m = (north_mps * time_s, 2.0, -5.0)
    return VehicleTruth(
        time_s, place_ned_m, (north_mps, 0.0, 0.0), NOTHING, attitude, NOTHING, (0.0,) * 4
    )


def errors(
    estimator: Estimator, duration_s: float, step_s: float = 0.1, north_mps: float = 1.0
) -> list[EstimateError]:
    found = []
    for index in range(round(duration_s / step_s)):
        estimator.update(truth_at(index * step_s, north_mps), 0.0, 0.0)
        found.append(estimator.error)
    return found


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(sorted(PROFILES)))
def test_wander_uses_its_bounds_and_never_exceeds_them(seed: int, flavour: str) -> None:
    profile = PROFILES[flavour]
    found = errors(Estimator(profile, seed), 200.0, 0.5)
    bounds = (
        *(profile.position_m, profile.position_m, profile.height_m),
        *(profile.velocity_mps, profile.velocity_mps, profile.climb_mps, profile.heading_rad),
    )
    for column, bound in zip(zip(*found, strict=True), bounds, strict=True):
        assert 0.25 * bound < max(map(abs, column)) <= bound


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_the_heading_swings_nearly_to_its_bound_on_both_sides(seed: int) -> None:
    profile = EstimatorProfile(heading_rad=math.radians(18.0))
    found_rad = [error.yaw_rad for error in errors(Estimator(profile, seed), 100.0, 0.5)]
    assert min(found_rad) < -0.6 * profile.heading_rad
    assert max(found_rad) > 0.6 * profile.heading_rad


def test_the_same_seed_wanders_alike_at_any_rate_and_another_otherwise() -> None:
    coarse, fine = (errors(Estimator(PROFILES["px4"], 7), 30.0, step_s) for step_s in (0.1, 0.02))
    assert coarse[-1] == pytest.approx(fine[-5], abs=0.01)
    assert errors(Estimator(PROFILES["px4"], 8), 30.0)[-1] != pytest.approx(coarse[-1], abs=0.01)


def test_at_rest_there_is_hardly_any_wander_and_it_grows_after_the_take_off() -> None:
    estimator = Estimator(PROFILES["px4"], 3)
    resting = errors(estimator, 60.0, north_mps=0.0)
    moving = [
        estimator.error
        for time_s in range(60, 120)
        if estimator.update(truth_at(float(time_s)), 0.0, 0.0)
    ]
    span = [max(abs(one.velocity_east_mps) for one in each) for each in (resting, moving)]
    assert span[0] <= 0.1 * PROFILES["px4"].velocity_mps + 1e-9 < span[1]


def test_an_ideal_estimator_returns_the_truth() -> None:
    truth = truth_at(12.0, yaw_rad=1.0)
    assert Estimator(IDEAL).update(truth, 0.0, 0.0) is truth


def test_a_heading_error_turns_the_attitude_and_nothing_else() -> None:
    profile = EstimatorProfile(heading_rad=0.3)
    estimator = Estimator(profile, 1)
    errors(estimator, 40.0)
    estimate = estimator.estimate(truth_at(40.0, yaw_rad=0.5))
    assert estimate.yaw_rad - 0.5 == pytest.approx(estimator.error.yaw_rad)
    assert abs(estimator.error.yaw_rad) > 0.01
    assert estimate.position_ned_m == truth_at(40.0).position_ned_m


@pytest.mark.parametrize(("flavour", "at_least_m"), [("px4", 3.0), ("ardupilot", 0.3)])
def test_without_gps_velocity_drifts_and_position_is_its_integral(
    flavour: str, at_least_m: float
) -> None:
    wandering = PROFILES[flavour]
    profile = EstimatorProfile(
        drift_mps2=wandering.drift_mps2, drift_max_mps=wandering.drift_max_mps
    )
    estimator = Estimator(profile, 5)
    step_s, integral_m, before_mps = 0.01, 0.0, 0.0
    for index in range(600):
        estimator.update(truth_at(0.0), index * step_s, 0.0)
        speed_mps = math.hypot(*estimator.error[3:5])
        integral_m += step_s * (speed_mps + before_mps) / 2.0
        before_mps = speed_mps
        assert speed_mps <= profile.drift_max_mps + 1e-9
    assert math.hypot(*estimator.error[:2]) == pytest.approx(integral_m, abs=0.01)
    assert integral_m > at_least_m
    assert estimator.resets == 0
    estimator.update(truth_at(0.0), 0.0, 0.0)
    assert (estimator.resets, estimator.error) == (1, EstimateError())


def test_jumps_and_a_wrong_gps_are_resets() -> None:
    estimator = Estimator(IDEAL)
    estimator.update(truth_at(1.0), 0.0, 5.0)
    estimator.jump(0.0, 0.0, 4.0)
    estimate = estimator.update(truth_at(1.0), 0.0, 5.0)
    assert estimate.position_ned_m == (6.0, 2.0, -1.0)
    assert estimator.resets == 2


def test_a_configuration_overrides_what_it_states_only() -> None:
    changed = EstimatorConfig(heading_deg=18.0, position_m=0.0).applied_to(PROFILES["px4"])
    assert changed.heading_rad == pytest.approx(math.radians(18.0))
    assert changed.position_m == 0.0
    assert changed.velocity_mps == PROFILES["px4"].velocity_mps
