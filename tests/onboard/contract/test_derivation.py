"""From terms to the worst encounter: every error on the unsafe side."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import available_limits
from onboard.contract.arithmetic import SCALAR
from onboard.contract.derivation import Derived, derive, face_error_m, worst_encounter
from onboard.contract.region import Encounter
from onboard.contract.terms import Terms
from tests.onboard.contract.example_terms import TERMS


def changed(**changes: Any) -> Terms[float]:
    return replace(TERMS, **changes)


def met(**changes: Any) -> Encounter[float]:
    return worst_encounter(changed(**changes), 2.0, 3.0, SCALAR)


def derived(**changes: Any) -> Derived[float]:
    """The published form."""
    return derive(changed(stop=False, **changes), SCALAR)


def test_the_encounter_is_at_the_highest_speeds() -> None:
    e = met(recentring_speed_mps=0.25)
    assert e.speed_mps == TERMS.cruise_speed_mps + TERMS.velocity_error_x_mps
    assert e.lateral_speed_mps == TERMS.velocity_error_y_mps + 0.25
    assert (e.size_along_m, e.size_across_m) == (2.0, 3.0)
    assert (e.brake_mps2, e.right_mps2) == available_limits(TERMS, SCALAR)
    assert (e.forward_mps2, e.left_mps2) == (e.brake_mps2, e.right_mps2)


def test_without_passive_safety_nothing_runs_on() -> None:
    e = met(passive_safety=False, recentring_speed_mps=0.25)
    assert e.run_on_m == e.coast_time_s == e.coast_drift_m == 0.0


def test_the_modelled_run_is_coasting_then_braking() -> None:
    e = met(recentring_speed_mps=0.25)
    timeout_s = TERMS.setpoint_loss_timeout_s
    coasted_m = e.speed_mps * timeout_s
    assert e.run_on_m == pytest.approx(coasted_m + e.speed_mps**2 / (2.0 * e.brake_mps2))
    assert e.coast_time_s == timeout_s
    assert e.coast_drift_m == pytest.approx(0.25 * timeout_s)


def test_a_measured_run_replaces_the_model_at_its_speed() -> None:
    e = met(setpoint_loss_run_on_m=4.5, setpoint_loss_run_on_speed_mps=2.8)
    assert e.run_on_m == pytest.approx(4.5)
    # Sideways it is read as the coasting that, followed by braking, gives that run.
    coasted_m = e.coast_time_s * e.speed_mps
    assert coasted_m + e.speed_mps**2 / (2.0 * e.brake_mps2) == pytest.approx(4.5)


@pytest.mark.parametrize("stated", [2.8, None])
def test_a_measured_run_is_shorter_below_and_unknown_above_its_speed(stated: float | None) -> None:
    measured = {"setpoint_loss_run_on_m": 4.5, "setpoint_loss_run_on_speed_mps": stated}
    assert met(**measured).run_on_m == pytest.approx(4.5)
    if stated is not None:
        assert met(**measured, cruise_speed_mps=2.0).run_on_m < 4.5
        assert math.isnan(met(**measured, cruise_speed_mps=2.9).run_on_m)


def test_a_short_measured_run_coasts_for_no_time() -> None:
    e = met(setpoint_loss_run_on_m=0.1)
    assert e.coast_time_s == 0.0


@given(st.floats(0.0, 0.5), st.floats(1.0, 30.0))
def test_the_face_error_grows_with_heading_and_range(error_rad: float, range_m: float) -> None:
    terms = changed(heading_error_rad=error_rad, detection_range_m=range_m)
    farthest_m = range_m + math.sqrt(2.0) * TERMS.obstacle_size_max_m
    chord_m = 2.0 * farthest_m * math.sin(error_rad / 2.0)
    assert face_error_m(terms, SCALAR) == pytest.approx(
        math.sqrt(2.0) * TERMS.position_error_m + chord_m
    )


def test_obstacles_are_inflated_by_body_and_twice_the_map_error() -> None:
    margin_m = derived().margin_m
    assert margin_m == pytest.approx(TERMS.body_m + 2.0 * math.sqrt(2.0) * TERMS.position_error_m)
    e = derived().encounter
    assert e.size_across_m == pytest.approx(TERMS.obstacle_size_max_m + 2.0 * margin_m)
    assert e.size_along_m == e.size_across_m


def test_the_range_covers_margin_front_and_tracking() -> None:
    found = derived()
    needed_m = found.margin_m + found.region.front_m + TERMS.tracking_error_m
    assert found.required_detection_range_m == pytest.approx(needed_m)


def test_the_separation_is_the_diagonal_of_length_and_width() -> None:
    found = derived()
    assert found.required_separation_m == pytest.approx(
        math.hypot(found.roi_length_m, found.roi_width_m)
    )
    size_m, region = found.encounter.size_across_m, found.region
    lanes_m = region.overhang_left_m + region.overhang_right_m
    coasts_m = region.coast_left_m + region.coast_right_m
    assert found.roi_width_m == pytest.approx(size_m + lanes_m + coasts_m)


def test_the_thinnest_obstacle_has_its_border_farthest_behind_its_centre() -> None:
    thin, thick = derived(obstacle_size_min_m=0.0), derived(obstacle_size_min_m=4.0)
    assert thin.roi_length_m >= thick.roi_length_m


@pytest.mark.parametrize("size_max_m", [40.0, 1.0])
def test_the_edge_to_see_is_the_far_corner_of_a_front_that_is_just_touched(
    size_max_m: float,
) -> None:
    """Flat or pointed: an avoidance has to know all that it swerves round."""
    found = derived(cruise_speed_mps=9.0, obstacle_size_max_m=size_max_m)
    drift_m = max(found.region.drift_left_m, found.region.drift_right_m)
    assert found.edge_offset_m == pytest.approx(found.margin_m + size_max_m + drift_m)


def test_stopping_counts_reaction_and_lag() -> None:
    found = derived()
    e = found.encounter
    late_m = e.speed_mps * (TERMS.reaction_time_s + TERMS.attitude_lag_s)
    assert found.stopping_distance_m == pytest.approx(e.speed_mps**2 / (2 * e.brake_mps2) + late_m)


def test_a_measured_run_below_its_speed_by_hand() -> None:
    """Shorter by the share of the speed of what a start from rest would not have flown."""
    measured = {"setpoint_loss_run_on_m": 4.5, "setpoint_loss_run_on_speed_mps": 2.8}
    e = met(**measured, cruise_speed_mps=2.0)
    timeout_s, lag_s = TERMS.setpoint_loss_timeout_s, TERMS.attitude_lag_s
    from_rest_m = e.brake_mps2 * timeout_s * (timeout_s + lag_s)
    assert from_rest_m < 4.5
    shorter_m = (4.5 - from_rest_m) * (1.0 - 2.2 / 3.0)
    assert e.run_on_m == pytest.approx(4.5 - shorter_m)
    assert e.coast_time_s == pytest.approx(4.5 / 3.0 - 3.0 / (2.0 * e.brake_mps2))
    # No longer than from rest: it is as long at every speed.
    brief = measured | {"setpoint_loss_run_on_m": 0.9 * from_rest_m}
    assert met(**brief, cruise_speed_mps=2.0).run_on_m == pytest.approx(0.9 * from_rest_m)


@pytest.mark.parametrize("size_min_m", [0.0, 0.5])
@pytest.mark.parametrize("size_max_m", [0.6, 8.0])
def test_the_published_length_by_hand(size_min_m: float, size_max_m: float) -> None:
    found = derived(obstacle_size_min_m=size_min_m, obstacle_size_max_m=size_max_m)
    half_m, region = found.encounter.size_along_m / 2.0, found.region
    thin_m = size_min_m + 2.0 * (TERMS.radius_m + TERMS.tracking_error_m)
    behind_m = region.recovery_m - found.encounter.run_on_m - thin_m / 2.0
    assert found.roi_length_m == pytest.approx(region.front_m + half_m + max(behind_m, half_m))


def test_what_a_region_of_stopping_needs_by_hand() -> None:
    found = derive(changed(recentring_speed_mps=0.4), SCALAR)
    size_m, region = TERMS.obstacle_size_max_m + 2.0 * found.margin_m, found.region
    assert found.roi_length_m == pytest.approx(size_m + region.front_m)
    assert found.roi_width_m == pytest.approx(size_m + 2.0 * region.overhang_left_m)
    assert found.edge_offset_m == pytest.approx(found.margin_m + region.drift_left_m)
    assert region.drift_left_m > 0.0
    swerve = found.manoeuvre
    lanes_m = swerve.overhang_left_m + swerve.overhang_right_m
    coasts_m = swerve.coast_left_m + swerve.coast_right_m
    assert found.manoeuvre_width_m == pytest.approx(size_m + lanes_m + coasts_m)
    late_m = TERMS.cruise_speed_mps * (TERMS.reaction_time_s + TERMS.attitude_lag_s)
    braking_m = TERMS.cruise_speed_mps**2 / (2.0 * found.encounter.brake_mps2)
    assert found.stopping_distance_m == pytest.approx(braking_m + late_m)
