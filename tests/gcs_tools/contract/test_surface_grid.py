"""Axes and quantities of contract surfaces, and blocks of the grid."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.contract import surface_grid
from gcs_tools.contract.surface_grid import Axis, evaluate, quantity_called
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
SPEEDS = Axis.parse("vehicle.cruise_speed_mps=0.5:4:8")
RANGES = Axis.parse("sensor.detection_range_m=5:20:7")


def test_an_axis_has_its_keys_ends_and_number() -> None:
    axis = Axis.parse("vehicle.roll_max_deg+vehicle.pitch_max_deg=5:30:6")
    assert axis.name == "vehicle.roll_max_deg+vehicle.pitch_max_deg"
    assert axis.unit == "°"
    assert axis.values.tolist() == [5.0, 10.0, 15.0, 20.0, 25.0, 30.0]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("vehicle.cruise_speed_mps", "expected KEY=LO:HI:N"),
        ("vehicle.cruise_speed_mps=1:2", "expected KEY=LO:HI:N"),
        ("vehicle.cruise_speed_mps=1:2:x", "expected KEY=LO:HI:N"),
        ("vehicle.cruise_speed_mps=1:2:2.5", "expected KEY=LO:HI:N"),
        ("vehicle.cruise_speed_mps=2:1:5", "expected LO less than HI"),
        ("vehicle.cruise_speed_mps=1:1:5", "expected LO less than HI"),
        ("vehicle.cruise_speed_mps=1:2:1", "N at least 2"),
        ("vehicle.cruise_speed_mps=1:inf:5", "expected LO less than HI"),
        ("vehicle.roll_max_deg+vehicle.radius_m=1:2:3", "keys of one axis must have the same unit"),
        ("vehicle.cruise_sped_mps=1:2:3", "did you mean vehicle.cruise_speed_mps"),
    ],
)
def test_what_is_not_an_axis_is_refused(text: str, problem: str) -> None:
    with pytest.raises(CommandError, match=problem):
        Axis.parse(text)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("margn", "did you mean margin?"),
        ("roi_length", "did you mean roi_length_m?"),
        ("colour", "expected one of margin, collision_set_depth_m"),
    ],
)
def test_an_unknown_quantity_is_refused_with_the_likely_ones(name: str, meant: str) -> None:
    with pytest.raises(CommandError) as refused:
        quantity_called(name, {"stop": "m"})
    assert str(refused.value).startswith(f"unknown quantity {name!r}; ")
    assert meant in str(refused.value)


def test_a_clause_is_a_quantity_with_its_unit() -> None:
    quantity = quantity_called("sensor_silence", {"sensor_silence": "m"})
    assert (quantity.label, quantity.unit, quantity.clause) == (
        "sensor silence required", "m", "sensor_silence",
    )  # fmt: skip


@pytest.mark.parametrize("name", ["margin", "roi_length_m", "separation", "detection_range"])
def test_every_point_of_the_grid_is_what_the_contract_says_there(name: str) -> None:
    surface = evaluate(CONTRACT, SPEEDS, RANGES, name)
    for row in (0, 3, 6):
        for column in (0, 4, 7):
            changed = SPEEDS.keys[0].changed(CONTRACT, float(SPEEDS.values[column]))
            changed = RANGES.keys[0].changed(changed, float(RANGES.values[row]))
            assessment = assess(changed)
            assert surface.compliant[row, column] == assessment.compliant
            clauses = {clause.name: clause for clause in assessment.clauses}
            if name in clauses:
                assert surface.values[row, column] == pytest.approx(clauses[name].required)
                assert surface.safe[row, column] == clauses[name].holds
            elif name == "margin":
                binding = assessment.binding
                share = binding.margin / binding.declared
                assert surface.values[row, column] == pytest.approx(share)
            else:
                length_m = assessment.inflated.roi_length_m
                assert surface.values[row, column] == pytest.approx(length_m)


@pytest.mark.parametrize("points", [1, 8, 20, 10_000])
def test_the_size_of_blocks_changes_nothing(points: int, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = evaluate(CONTRACT, SPEEDS, RANGES, "separation")
    monkeypatch.setattr(surface_grid, "_BLOCK_POINTS", points)
    again = evaluate(CONTRACT, SPEEDS, RANGES, "separation")
    np.testing.assert_array_equal(again.values, expected.values)
    np.testing.assert_array_equal(again.margin, expected.margin)
    np.testing.assert_array_equal(again.compliant, expected.compliant)


def test_declared_is_stated_where_it_is_the_same_everywhere() -> None:
    declared_m = CONTRACT.environment.obstacle_separation_min_m
    assert evaluate(CONTRACT, SPEEDS, RANGES, "separation").declared == declared_m
    assert evaluate(CONTRACT, SPEEDS, RANGES, "detection_range").declared is None
    assert evaluate(CONTRACT, SPEEDS, RANGES, "margin").declared is None


def test_a_key_cannot_be_on_both_axes() -> None:
    with pytest.raises(CommandError, match="cruise_speed_mps cannot be on both axes"):
        evaluate(CONTRACT, SPEEDS, SPEEDS, "margin")
