"""The band of heights, the clauses about it, and which statements of a contract belong together."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from onboard.contract.arithmetic import SCALAR
from onboard.contract.assessment import assess, assess_terms
from onboard.contract.heights import LEVEL_M, HeightBand, half_band_m, view_needed_rad
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract, load_contract
from onboard.files.contract_terms.later_keys import LATER_KEYS
from onboard.files.yaml_file import FileError

ROOT = Path(__file__).parents[3]
DEFAULT = ROOT / "config" / "default_contract.yaml"
HEIGHTS = (
    "vehicle.radius_z_m=0.25",
    "vehicle.height_drift_m=0.4",
    "sensor.position_error_z_m=0.3",
    "sensor.vertical_field_of_view_deg=[35.0, 40.0]",
)


def contract(*overrides: str) -> Contract:
    return load_contract(DEFAULT, (*HEIGHTS, *overrides))


def clause(name: str, contract: Contract, altitude_m: float = 5.0) -> Any:
    found = assess(contract, mission_altitude_m=altitude_m).clauses
    return next((each for each in found if each.name == name), None)


def test_the_band_is_what_body_control_and_drift_fill() -> None:
    assert half_band_m(Terms.of(contract())) == pytest.approx(0.25 + 0.5 + 0.4 + LEVEL_M)
    assert half_band_m(Terms.of(load_contract(DEFAULT))) == math.inf


@pytest.mark.parametrize(
    ("down_m", "meets"),
    [
        ((-3.9, 0.0), False),
        ((-4.0, 0.0), True),
        ((-9.0, -6.0), True),
        ((-9.0, -6.1), False),
        ((-math.inf, -6.1), False),
        ((-3.9, math.inf), False),
        ((-math.inf, math.inf), True),
    ],
)
def test_an_obstacle_meets_the_band_that_it_touches(
    down_m: tuple[float, float], *, meets: bool
) -> None:
    assert HeightBand.around(-5.0, 1.0).meets(down_m) is meets


def test_among_pillars_every_obstacle_is_in_the_way() -> None:
    assert HeightBand.around(-5.0, math.inf).meets((0.0, 0.0))


def test_terrain_is_what_lies_below_the_lowest_part_of_the_vehicle() -> None:
    ground = ("environment.terrain_max_m=1.5", "environment.terrain_error_m=0.2")
    found = clause("terrain", contract(*ground))
    assert found.required == pytest.approx(0.25 + 0.5 + 0.4 + 1.5 + 0.2)
    assert found.declared == 5.0
    assert found.concerns == "safety"
    assert not clause("terrain", contract(*ground), altitude_m=2.8).holds
    flat = clause("terrain", load_contract(DEFAULT, ground))
    assert flat.required == pytest.approx(0.3 + 0.5 + 1.5 + 0.2)
    assert clause("terrain", load_contract(DEFAULT)) is None


def test_the_band_has_to_be_seen_before_the_fixed_margin() -> None:
    found = clause("top_visibility", contract())
    assessment = assess(contract())
    ahead_m = 12.0 - assessment.inflated.margin_m - 0.35
    steep_deg = math.degrees(math.atan((2.0 * (0.25 + 0.5 + 0.4) + 0.6) / ahead_m))
    trim_deg = math.degrees(math.atan(0.45 * 2.8 / 9.80665))
    assert found.required == pytest.approx(steep_deg + trim_deg + 2.0, abs=1e-3)
    assert found.declared == pytest.approx(35.0)
    assert found.concerns == "progress"
    narrow = contract("sensor.vertical_field_of_view_deg=[35.0, 15.0]")
    assert clause("top_visibility", narrow).margin < 0.0
    assert clause("top_visibility", load_contract(DEFAULT)) is None


def test_wind_tilts_the_view() -> None:
    terms = Terms.of(contract())
    derived = assess_terms(contract(), terms).inflated
    calm = view_needed_rad(terms, derived, SCALAR)
    windy = view_needed_rad(replace(terms, wind_max_mps=4.0), derived, SCALAR)
    assert calm is not None
    assert windy is not None
    assert windy > calm + math.radians(5.0)


def test_a_contract_without_heights_keeps_its_hash_and_its_clauses() -> None:
    """As they were before there were keys of heights."""
    stated = load_contract(DEFAULT)
    assert stated.sha256 == "9769489e3b0d8048d790bbcd62e9ca3b25d0680deb56ecaba79b439cace44935"
    named = {each.name for each in assess(stated, mission_altitude_m=5.0).clauses}
    assert not named & {"terrain", "top_visibility"}
    at_default = load_contract(DEFAULT, ("environment.terrain_max_m=0.0",))
    assert at_default.sha256 == stated.sha256
    assert contract().sha256 != stated.sha256
    assert "radius_z_m" in LATER_KEYS["vehicle"]


@pytest.mark.parametrize("left_out", HEIGHTS)
def test_heights_are_stated_as_a_whole(left_out: str) -> None:
    others = tuple(each for each in HEIGHTS if each != left_out)
    key = left_out.partition("=")[0]
    with pytest.raises(FileError, match=rf"{key} \[.*\] not stated") as refused:
        load_contract(DEFAULT, others)
    assert "pillars of any height" in str(refused.value)


def test_heights_need_a_way_to_rest_at_one_height() -> None:
    with pytest.raises(FileError, match=r"requirements.stop = false .*expected true"):
        contract("requirements.stop=false")


def test_the_body_reaches_as_high_as_its_tilt_lifts_its_rim() -> None:
    with pytest.raises(FileError, match=r"radius_z_m = 0.1 m .*0.106 m"):
        contract("vehicle.radius_z_m=0.1")
