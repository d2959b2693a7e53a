"""Conditions on parameters, and the names that releases give to one quantity."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.mavlink.profiles.parameter_rules import (
    Condition,
    ParameterName,
    ReportedParameters,
    Version,
    at_least,
    at_most,
    bit_clear,
    bit_set,
    names_in,
    one_of,
    rules_of_renamed,
)

OLD = ParameterName("OLD_CM", "cm", 100.0, (4, 5), (4, 6))
BOTH = ParameterName("DEV_CM", "cm", 100.0, (4, 5), (4, 7))
NEW = ParameterName("NEW_M", "m", 1.0, (4, 7), (4, 7))
NAMES = (OLD, BOTH, NEW)
KNOWN = ((4, 5), (4, 7))


@given(st.floats(0.1, 1e4), st.floats(1e-3, 10.0))
def test_limits_include_their_value_and_its_round_off(limit: float, beyond: float) -> None:
    least, most = at_least("X", limit, "m"), at_most("X", limit, "m")
    for value in (limit, limit - 5e-7, limit + 5e-7):
        assert least.holds(value)
        assert most.holds(value)
    assert least.holds(limit + beyond)
    assert not least.holds(limit - beyond)
    assert most.holds(limit - beyond)
    assert not most.holds(limit + beyond)


@pytest.mark.parametrize(
    "condition",
    [
        at_least("X", 1.0),
        at_most("X", 1.0),
        one_of("X", 1),
        bit_set("X", 0),
        bit_clear("X", 0),
    ],
)
def test_nan_satisfies_no_condition(condition: Condition) -> None:
    assert not condition.holds(math.nan)


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (at_least("X", 2.0, "m/s"), "X ≥ 2 m/s"),
        (at_least("X", 0.12345), "X ≥ 0.1235"),
        (at_most("X", 0.5, "s"), "X ≤ 0.5 s"),
        (one_of("X", 5), "X = 5"),
        (one_of("X", 0, 3, 7), "X = 0 or 3 or 7"),
        (bit_set("X", 2), "X with bit 2 (value 4)"),
        (bit_clear("X", 4), "X without bit 4 (value 16)"),
    ],
)
def test_a_condition_reads_as_a_demand(condition: Condition, text: str) -> None:
    assert str(condition) == text


@pytest.mark.parametrize("value", [1.0, 3.0])
def test_one_of_accepts_each_of_its_values(value: float) -> None:
    assert one_of("X", 1, 3).holds(value)
    assert not one_of("X", 1, 3).holds(value + 1.0)
    assert not one_of("X", 1, 3).holds(value + 0.1)


@pytest.mark.parametrize("bit", range(24))
def test_bits_are_named_by_number_and_value(bit: int) -> None:
    wanted, unwanted = bit_set("X", bit), bit_clear("X", bit)
    assert wanted.demand == f"with bit {bit} (value {2**bit})"
    assert unwanted.demand == f"without bit {bit} (value {2**bit})"
    for value in (0.0, 2.0**bit, 2.0**24 - 1.0, 2.0**24 - 1.0 - 2.0**bit, -1.0):
        assert wanted.holds(value) is (math.floor(value / 2**bit) % 2 == 1)
        assert unwanted.holds(value) is not wanted.holds(value)


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ((4, 5, 0), [OLD, BOTH]),
        ((4, 6, 9), [OLD, BOTH]),
        ((4, 7, 0), [BOTH, NEW]),
        ((3, 6, 0), [OLD, BOTH]),  # older than any that is known
        ((5, 0, 0), [BOTH, NEW]),  # newer
        (None, [OLD, BOTH, NEW]),
    ],
)
def test_a_release_has_its_names(version: Version | None, expected: list[ParameterName]) -> None:
    assert names_in(NAMES, version, KNOWN) == expected


def renamed(values: dict[str, float]) -> list[list[str]]:
    rules = rules_of_renamed(
        "far enough",
        list(NAMES),
        ReportedParameters(values),
        lambda name: at_least(name.name, 3.0 * name.per_unit, name.unit),
    )
    assert {rule.reason for rule in rules} == {"far enough"}
    return [list(map(str, rule.alternatives)) for rule in rules]


def test_each_reported_name_has_a_rule_of_its_own_in_its_own_unit() -> None:
    assert renamed({"NEW_M": 3.0}) == [["NEW_M ≥ 3 m"]]
    assert renamed({"OLD_CM": 1.0, "NEW_M": 3.0}) == [["OLD_CM ≥ 300 cm"], ["NEW_M ≥ 3 m"]]


def test_without_any_of_the_names_one_rule_asks_for_all() -> None:
    assert renamed({"ELSE": 1.0}) == [["OLD_CM ≥ 300 cm", "DEV_CM ≥ 300 cm", "NEW_M ≥ 3 m"]]
