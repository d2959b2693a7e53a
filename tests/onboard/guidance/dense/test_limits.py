import math

import numpy as np
import pytest

from onboard.contract.assessment import assess
from onboard.contract.run_on import NO_RUN_ON
from onboard.files.contract_file import Contract
from onboard.guidance.dense.limits import (
    rest_limits_of,
    run_on_of,
    shown_half_view_rad,
    turn_max_radps,
)
from onboard.perception.line_of_sight import View, seen_free
from onboard.perception.seen_free import CELL_M


def test_along_the_leg_the_box_of_accelerations_holds(best_effort: Contract) -> None:
    assessment = assess(best_effort)
    limits = rest_limits_of(assessment, any_heading=False)
    w = assessment.limits
    assert limits.acceleration_max_mps2 == (
        w.brake_mps2,
        w.forward_mps2,
        w.left_mps2,
        w.right_mps2,
    )
    assert limits.acceleration_disc_mps2 == math.inf
    assert limits.body_radius_m == assessment.terms.radius_m + assessment.terms.tracking_error_m
    assert limits.speed_max_mps == assessment.terms.cruise_speed_mps


def test_with_any_heading_the_disc_lies_in_every_turned_box(best_effort: Contract) -> None:
    assessment = assess(best_effort)
    limits = rest_limits_of(assessment, any_heading=True)
    assert limits.acceleration_disc_mps2 == min(limits.acceleration_max_mps2)
    fixed = rest_limits_of(assessment, any_heading=False)
    assert limits.acceleration_disc_mps2 <= min(fixed.acceleration_max_mps2)


def test_a_vehicle_that_is_weaker_to_the_side_is_so_in_every_direction_of_the_nose(
    best_effort: Contract,
) -> None:
    vehicle = best_effort.vehicle.model_copy(update={"roll_max_deg": 8.0, "pitch_max_deg": 15.0})
    assessment = assess(best_effort.model_copy(update={"vehicle": vehicle}))
    w = assessment.limits
    box_mps2 = (w.brake_mps2, w.forward_mps2, w.left_mps2, w.right_mps2)
    assert min(box_mps2) < max(box_mps2)
    turned = rest_limits_of(assessment, any_heading=True)
    assert turned.acceleration_max_mps2 == (min(box_mps2),) * 4
    assert rest_limits_of(assessment, any_heading=False).acceleration_max_mps2 == box_mps2


@pytest.mark.parametrize("lag_s", [0.0, 0.15, 0.27, 0.6, 2.0])
def test_a_nose_that_turns_in_flight_leaves_the_body_no_more_jerk_than_it_follows(
    best_effort: Contract, lag_s: float
) -> None:
    """In the body's frame R(-psi) a changes by R(-psi) (j - omega x a)."""
    vehicle = best_effort.vehicle.model_copy(update={"attitude_lag_s": lag_s})
    assessment = assess(best_effort.model_copy(update={"vehicle": vehicle}))
    limits, omega_radps = rest_limits_of(assessment, any_heading=True), turn_max_radps(assessment)
    assert limits.jerk_max_mps3 > 0.0
    assert 0.0 < omega_radps <= math.radians(60.0)
    j, a = limits.jerk_max_mps3, limits.acceleration_disc_mps2
    worst_mps3 = 0.0
    for step in range(360):
        ax, ay = a * math.cos(math.radians(step)), a * math.sin(math.radians(step))
        for jx in (-j, j):
            for jy in (-j, j):
                turned = math.hypot(jx + omega_radps * ay, jy - omega_radps * ax)
                worst_mps3 = max(worst_mps3, turned)
    follows_mps3 = a / max(lag_s, 0.05)
    assert worst_mps3 <= follows_mps3 + 1e-9
    assert worst_mps3 > 0.95 * follows_mps3


def test_without_lag_the_jerk_stays_finite(best_effort: Contract) -> None:
    vehicle = best_effort.vehicle.model_copy(update={"attitude_lag_s": 0.0})
    assessment = assess(best_effort.model_copy(update={"vehicle": vehicle}))
    assert math.isfinite(rest_limits_of(assessment, any_heading=False).jerk_max_mps3)


def test_the_run_on_is_asked_for_only_with_passive_safety(best_effort: Contract) -> None:
    assert run_on_of(assess(best_effort)).reach_m(2.8) > 2.8 * 0.5
    requirements = best_effort.requirements.model_copy(update={"passive_safety": False})
    without = best_effort.model_copy(update={"requirements": requirements})
    assert run_on_of(assess(without)) is NO_RUN_ON


def test_a_measured_run_that_is_longer_than_the_model_counts(best_effort: Contract) -> None:
    update = {"setpoint_loss_run_on_m": 7.0, "setpoint_loss_run_on_speed_mps": 2.8}
    vehicle = best_effort.vehicle.model_copy(update=update)
    assessment = assess(best_effort.model_copy(update={"vehicle": vehicle}))
    assert run_on_of(assessment).reach_m(2.8) == pytest.approx(7.0)


def test_a_measured_run_is_no_shorter_for_a_setpoint_that_brakes(best_effort: Contract) -> None:
    update = {"setpoint_loss_run_on_m": 7.0, "setpoint_loss_run_on_speed_mps": 2.8}
    vehicle = best_effort.vehicle.model_copy(update=update)
    gains = run_on_of(assess(best_effort.model_copy(update={"vehicle": vehicle}))).gains
    braking_m = max(kappa_s * 2.8 + c_s2 * -2.0 for kappa_s, c_s2 in gains)
    assert braking_m == pytest.approx(7.0)


def test_the_run_is_that_of_the_direction_which_brakes_least(best_effort: Contract) -> None:
    kappas = []
    for roll_deg in (15.0, 8.0):
        vehicle = best_effort.vehicle.model_copy(
            update={"roll_max_deg": roll_deg, "pitch_max_deg": 15.0, "setpoint_loss": None}
        )
        assessment = assess(best_effort.model_copy(update={"vehicle": vehicle}))
        kappas.append(run_on_of(assessment).reach_m(1.0))
    assert kappas[1] > kappas[0]


@pytest.mark.parametrize(("position_error_m", "heading_error_deg"), [(0.02, 0.0), (0.1, 2.0)])
@pytest.mark.parametrize("view_deg", [90.0, 110.0, 160.0])
def test_a_look_shows_what_is_near_as_far_off_the_nose_as_stated(
    best_effort: Contract, position_error_m: float, heading_error_deg: float, view_deg: float
) -> None:
    """Against what counts as seen free: each cell at twice the body's radius, near that edge."""
    vehicle = best_effort.vehicle.model_copy(update={"heading_error_deg": heading_error_deg})
    declared = {"position_error_m": position_error_m, "field_of_view_deg": view_deg}
    sensor = best_effort.sensor.model_copy(update=declared)
    assessment = assess(best_effort.model_copy(update={"vehicle": vehicle, "sensor": sensor}))
    terms, shown_rad = assessment.terms, shown_half_view_rad(assessment)
    view = View(
        position_leg_m=(0.0, 0.0),
        heading_leg_rad=0.0,
        half_view_rad=terms.field_of_view_rad / 2.0,
        range_m=12.0,
        boxes=(),
        face_error_m=position_error_m,
        placing_error_m=math.sqrt(2.0) * position_error_m,
        heading_error_rad=terms.heading_error_rad,
    )
    bearings_rad = np.linspace(-shown_rad, shown_rad, 41)
    near_m = 2.0 * terms.body_m
    x_m, y_m = near_m * np.cos(bearings_rad), near_m * np.sin(bearings_rad)
    assert seen_free(view, x_m, y_m, CELL_M).all()
    assert shown_rad > math.radians(view_deg) / 6.0 - terms.heading_error_rad
