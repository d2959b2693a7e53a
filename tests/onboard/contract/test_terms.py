"""The numbers of a contract in SI units."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest

from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract
from tests.onboard.contract.example_terms import TERMS

IDEAL_IN_THE_PAPER = (
    "radius_m",
    "tracking_error_m",
    "tracking_error_z_m",
    "velocity_error_x_mps",
    "velocity_error_y_mps",
    "reaction_time_s",
    "attitude_lag_s",
    "position_error_m",
    "recentring_speed_mps",
    "heading_error_rad",
)


def test_every_number_of_the_file_is_a_term(contract: Contract) -> None:
    """By name, but for units of angles and for the pair of velocity errors."""
    terms = Terms.of(contract)
    for section in (contract.vehicle, contract.sensor, contract.environment):
        for key in type(section).model_fields:
            value = getattr(section, key)
            if key == "velocity_error_mps":
                assert (terms.velocity_error_x_mps, terms.velocity_error_y_mps) == value
            elif key == "setpoint_loss":
                assert terms.setpoint_loss_model == "coast"
                assert value is None
            elif key in ("clearance_wish_m", "rest_speed_mps"):
                assert not hasattr(terms, key), "nothing in the contract follows from it"
            elif key in ("terrain_max_m", "terrain_error_m"):
                assert (value, getattr(terms, key)) == (0.0, None), "the plane of the origin"
            elif key == "vertical_field_of_view_deg":
                assert (value, terms.view_up_rad, terms.view_down_rad) == (None, None, None)
            elif key.endswith("_deg"):
                radians = getattr(terms, key.replace("_deg", "_rad"))
                assert radians == pytest.approx(math.radians(value))
            else:
                assert getattr(terms, key) == value
    assert terms.stop == contract.requirements.stop
    assert terms.passive_safety == contract.requirements.passive_safety


def test_set_and_altitude_come_with_the_question(contract: Contract) -> None:
    assert Terms.of(contract).input_set == "inner"
    assert Terms.of(contract).mission_altitude_m is None
    asked = Terms.of(contract, "paper", 4.0)
    assert (asked.input_set, asked.mission_altitude_m) == ("paper", 4.0)


def test_the_body_is_radius_and_tracking_error() -> None:
    assert TERMS.body_m == TERMS.radius_m + TERMS.tracking_error_m


def test_the_trim_is_drag_at_the_strongest_wind() -> None:
    assert TERMS.trim_mps2 == 0.0
    windy = replace(TERMS, drag_per_s=0.4, wind_max_mps=5.0)
    assert windy.trim_mps2 == pytest.approx(2.0)


def test_the_sure_view_is_the_view_less_the_heading_error_on_either_side() -> None:
    turned = replace(TERMS, field_of_view_rad=2.0, heading_error_rad=0.1)
    assert turned.sure_view_rad == pytest.approx(1.8)


def test_the_ideal_has_no_size_no_errors_no_delays_and_no_wind() -> None:
    real = replace(TERMS, wind_max_mps=4.0, recentring_speed_mps=0.3, heading_error_rad=0.1)
    ideal = real.idealised()
    assert all(getattr(ideal, name) == 0.0 for name in IDEAL_IN_THE_PAPER)
    assert ideal.wind_max_mps is None
    assert not ideal.passive_safety
    kept = {f.name for f in fields(Terms)} - {*IDEAL_IN_THE_PAPER, "wind_max_mps"}
    kept -= {"passive_safety", "stop"}
    assert not ideal.stop
    assert all(getattr(ideal, name) == getattr(real, name) for name in kept)
    assert ideal.idealised() == ideal


def test_a_drift_of_the_frame_counts_with_the_body_and_with_the_map() -> None:
    drifting = replace(TERMS, position_drift_mps=0.01, flight_time_max_s=100.0)
    assert drifting.drift_m == pytest.approx(1.0)
    assert drifting.body_m == pytest.approx(TERMS.body_m + 1.0)
    assert drifting.map_error_m == pytest.approx(TERMS.position_error_m + 1.0)
    assert replace(TERMS, position_drift_mps=0.01).drift_m == 0.0
    assert replace(TERMS, flight_time_max_s=100.0).drift_m == 0.0
    assert TERMS.stops
    assert not replace(TERMS, stop=False).stops
    assert not replace(TERMS, input_set="paper").stops


def test_terms_made_from_fields_are_those_that_the_constructor_makes(contract: Contract) -> None:
    for terms in (Terms.of(contract), Terms.of(contract, "paper", 4.0), TERMS.idealised()):
        assert Terms(**vars(terms)) == terms
        assert {field.name: getattr(terms, field.name) for field in fields(Terms)} == vars(
            replace(terms)
        )
        with pytest.raises(AttributeError):
            terms.radius_m = 1.0  # type: ignore[misc]
