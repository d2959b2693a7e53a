"""The numeric keys of a contract, and what is said of a key that does not exist."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.errors import CommandError
from gcs_tools.contract.keys import contract_key, numeric_keys, suggestion
from onboard.contract.assessment import Terms
from onboard.files.contract_file import load_contract
from onboard.files.yaml_file import FileError
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "default_contract.yaml")


@pytest.mark.parametrize(
    ("unknown", "meant"),
    [
        ("vehicle.cruise_speed", "vehicle.cruise_speed_mps"),
        ("vehicle.cruise_sped_mps", "vehicle.cruise_speed_mps"),
        ("cruise_speed_mps", "vehicle.cruise_speed_mps"),
        ("sensor.range_m", "sensor.detection_range_m"),
        ("separation", "environment.obstacle_separation_min_m"),
        ("vehicle.velocity_error_mps", "vehicle.velocity_error_mps.0"),
    ],
)
def test_a_key_that_is_nearly_right_is_put_right(unknown: str, meant: str) -> None:
    with pytest.raises(CommandError) as refused:
        contract_key(unknown)
    message = str(refused.value)
    assert message.startswith(f"unknown numeric contract key {unknown!r}; did you mean ")
    assert meant in message
    assert message.endswith("?")
    assert len(message) < 250


@pytest.mark.parametrize("unknown", ["", "colour", "vehicle", "vehicle.", "requirements.stop"])
def test_for_any_other_key_all_are_listed(unknown: str) -> None:
    with pytest.raises(CommandError) as refused:
        contract_key(unknown)
    assert str(refused.value).endswith(f"; expected one of {', '.join(numeric_keys())}")


@given(st.text())
def test_a_suggestion_is_one_of_what_there_is(unknown: str) -> None:
    names = ("alpha", "beta_m", "gamma_mps")
    said = suggestion(unknown, names)
    assert any(name in said for name in names)
    assert said.startswith(("did you mean ", "expected one of "))


@pytest.mark.parametrize("path", numeric_keys())
def test_every_key_leads_to_a_term(path: str) -> None:
    key = contract_key(path)
    assert key.path == path
    names = {field.name for field in fields(Terms)}
    if key.term not in names:  # kept by the contract alone
        assert key.term in ("clearance_wish_m", "rest_speed_mps", "yield_max_s")
    assert key.term_per_unit == (math.radians(1.0) if "_deg" in path else 1.0)


@pytest.mark.parametrize("path", numeric_keys())
def test_a_changed_key_has_its_value_and_the_others_theirs(path: str) -> None:
    key = contract_key(path)
    before = key.value_in(CONTRACT)
    if before is None:
        return
    changed = key.changed(CONTRACT, before)
    assert changed == CONTRACT
    value = before * 1.0001
    try:
        changed = key.changed(CONTRACT, value)
    except FileError:
        return  # a value that depends on another
    assert key.value_in(changed) == value
    others = [each for each in numeric_keys().values() if each is not key]
    assert all(each.value_in(changed) == each.value_in(CONTRACT) for each in others)


def test_an_inadmissible_value_names_key_and_value() -> None:
    with pytest.raises(FileError, match=r"vehicle.roll_max_deg = 95: .*less than 90"):
        contract_key("vehicle.roll_max_deg").changed(CONTRACT, 95.0)


def test_bounds_come_from_the_model() -> None:
    roll = contract_key("vehicle.roll_max_deg")
    assert (roll.lower, roll.upper, roll.lower_admitted, roll.upper_admitted) == (
        0.0, 90.0, False, False,
    )  # fmt: skip
    size = contract_key("environment.obstacle_size_min_m")
    assert (size.lower, size.lower_admitted, size.upper) == (0.0, True, math.inf)


def test_units_are_those_of_the_file() -> None:
    units = {path: contract_key(path).unit for path in numeric_keys()}
    assert units["vehicle.roll_max_deg"] == "°"
    assert units["vehicle.velocity_error_mps.1"] == "m/s"
    assert units["vehicle.reaction_time_s"] == "s"
    assert all(units.values())
