"""Parameters: what can be set, in what range, and the gains of an ideal controller."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import (
    GainNames,
    ParameterError,
    ParameterSpec,
    ParameterStore,
    SetResult,
    ideal_gains,
)
from sitl.autopilot.flavours.px4 import Px4
from sitl.plant.controller import ControllerGains

SPECS = (
    ParameterSpec("ZULU", 1.5, 0.0, 2.0, "a float"),
    ParameterSpec("ALFA", 3, 0, 10, "an integer"),
    ParameterSpec("MIKE", 7, 7, 7, "read-only", read_only=True),
)
FLAVOURS: list[Flavour] = [Px4(), Copter()]


def store(**overrides: float) -> ParameterStore:
    return ParameterStore(SPECS, overrides)


def test_names_are_alphabetical_and_values_the_defaults() -> None:
    parameters = store()
    assert parameters.names() == ("ALFA", "MIKE", "ZULU")
    assert len(parameters) == 3
    assert [parameters[name] for name in parameters.names()] == [3, 7, 1.5]
    assert "ALFA" in parameters
    assert "BRAVO" not in parameters


@pytest.mark.parametrize(
    ("name", "value", "result"),
    [
        ("ZULU", 0.0, SetResult.DONE),
        ("ZULU", 2.0, SetResult.DONE),
        ("ZULU", 2.01, SetResult.OUT_OF_RANGE),
        ("ZULU", -0.01, SetResult.OUT_OF_RANGE),
        ("ZULU", math.nan, SetResult.OUT_OF_RANGE),
        ("ZULU", math.inf, SetResult.OUT_OF_RANGE),
        ("ALFA", 4.0, SetResult.DONE),
        ("ALFA", 4.5, SetResult.OUT_OF_RANGE),
        ("ALFA", math.nan, SetResult.OUT_OF_RANGE),
        ("MIKE", 7.0, SetResult.READ_ONLY),
        ("BRAVO", 1.0, SetResult.UNKNOWN),
    ],
)
def test_a_parameter_changes_only_within_its_range(
    name: str, value: float, result: SetResult
) -> None:
    parameters = store()
    before = {each: parameters[each] for each in parameters.names()}
    assert parameters.set(name, value) is result
    after = {each: parameters[each] for each in parameters.names()}
    assert after == ({**before, name: value} if result is SetResult.DONE else before)


def test_integers_stay_integers() -> None:
    parameters = store()
    parameters.set("ALFA", 5.0)
    assert isinstance(parameters["ALFA"], int)
    assert parameters.spec("ALFA").is_integer
    assert not parameters.spec("ZULU").is_integer


@pytest.mark.parametrize(
    ("overrides", "text"),
    [
        ({"ZULU": 3.0}, "parameters.ZULU = 3 is not within 0 to 2"),
        ({"BRAVO": 1.0}, "parameters.BRAVO = 1: BRAVO does not exist"),
        ({"MIKE": 7.0}, "parameters.MIKE = 7: MIKE is read-only"),
    ],
)
def test_a_configured_parameter_that_cannot_be_set_is_an_error_that_names_it(
    overrides: dict[str, float], text: str
) -> None:
    with pytest.raises(ParameterError, match=text):
        store(**overrides)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_default_is_within_its_range_and_short_enough_for_the_wire(flavour: Flavour) -> None:
    specs = flavour.parameter_specs(1)
    assert len({spec.name for spec in specs}) == len(specs)
    for spec in specs:
        assert spec.minimum <= spec.default <= spec.maximum
        assert 0 < len(spec.name) <= 16
        assert spec.meaning


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_system_id_is_a_parameter_that_cannot_be_changed(flavour: Flavour) -> None:
    (own,) = [spec for spec in flavour.parameter_specs(42) if spec.meaning == "system id"]
    assert own.default == 42
    assert own.read_only


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_ideal_gains_reach_the_flight_settings(flavour: Flavour) -> None:
    ideal = ControllerGains()
    parameters = ParameterStore(flavour.parameter_specs(1), flavour.ideal.parameters)
    settings = flavour.settings(parameters)
    assert settings.roll_gain_per_s == ideal.roll_per_s
    assert settings.pitch_gain_per_s == ideal.pitch_per_s
    assert settings.position_gain_per_s == ideal.position_per_s
    assert settings.velocity_gain_per_s == ideal.velocity_per_s


def test_ideal_gains_have_the_names_asked_for() -> None:
    gains = ideal_gains(GainNames("R", "P", "X", "V"))
    ideal = ControllerGains()
    assert dict(gains) == {
        "R": ideal.roll_per_s,
        "P": ideal.pitch_per_s,
        "X": ideal.position_per_s,
        "V": ideal.velocity_per_s,
    }


@given(value=st.floats())
def test_no_number_gets_a_float_out_of_its_range(value: float) -> None:
    parameters = store()
    parameters.set("ZULU", value)
    assert 0.0 <= parameters["ZULU"] <= 2.0
