"""Flights through a stem map: where they lead, and which stems count."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.campaign.command import scenario_document
from gcs_tools.campaign.forest import _BESIDE_M, _LENGTH_M, _OPEN_M, ForestSource, _near
from gcs_tools.preflight.command import check
from onboard.files.obstacle_field import ObstacleField
from onboard.files.yaml_file import FileError


@pytest.fixture(scope="module")
def stems(tmp_path_factory: pytest.TempPathFactory) -> ForestSource:
    """A stem every 12 m on a square of 120 m."""
    path = tmp_path_factory.mktemp("forest") / "stand.csv"
    rows = [f"{12 * n}.0,{12 * e}.0,{20 + n + e}" for n in range(11) for e in range(11)]
    path.write_text("x_m,y_m,dbh_cm\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return ForestSource(str(path))


def test_a_number_determines_the_leg(stems: ForestSource) -> None:
    once, again = (stems.case(1, 2) for _ in range(2))
    assert scenario_document(once.scenario) == scenario_document(again.scenario)
    assert scenario_document(stems.case(1, 3).scenario) != scenario_document(once.scenario)
    assert once.scenario.name == "stand-1-2"


def test_legs_start_in_the_open_and_the_map_is_around_them(stems: ForestSource) -> None:
    for number in range(30):
        scenario = stems.case(1, number).scenario
        assert np.hypot(*scenario.obstacles.center_ned_m.T).min() > _OPEN_M
        (leg,) = scenario.mission.legs
        assert _LENGTH_M[0] <= math.hypot(*leg.end_ned_m) <= _LENGTH_M[1] + 1e-9
        assert 1.0 <= scenario.contract.vehicle.cruise_speed_mps <= 2.5
        largest_m = 2.0 * scenario.obstacles.half_size_m.max() * math.sqrt(2.0)
        assert scenario.contract.environment.obstacle_size_max_m >= largest_m


def test_half_of_the_flights_have_a_map(stems: ForestSource) -> None:
    cases = [stems.case(7, number) for number in range(60)]
    known = [case.scenario.field_known for case in cases]
    assert 15 <= sum(known) <= 45
    for case in cases:
        mapped = case.scenario.field_known
        assert case.variant == ("mapped" if mapped else "unmapped")
        assert case.outcomes == (("arrived",) if mapped else ("arrived", "held", "aborted"))
        assert case.refusable


def test_a_dense_stand_is_refused_if_it_is_known(stems: ForestSource) -> None:
    refused = 0
    for number in range(20):
        scenario = stems.case(3, number).scenario
        refused += not check(scenario.contract, scenario.obstacles, scenario.mission).compliant
    assert refused >= 10


def test_only_stems_near_the_leg_count_and_start_at_its_origin() -> None:
    centers_m = np.array([(10.0, 5.0), (10.0, 5.0 + _BESIDE_M + 0.1), (-_BESIDE_M + 0.1, 0.0)])
    field = ObstacleField(
        ("a", "b", "c"), centers_m, np.full((3, 2), 0.2), np.array([0.1, 0.2, 0.3])
    )
    near = _near(field, np.array([0.0, 5.0]), 0.0, 30.0)
    assert near.ids == ("a",)
    assert near.center_ned_m.tolist() == [[10.0, 0.0]]
    assert near.yaw_rad.tolist() == [0.1]
    wider = _near(field, np.array([0.0, 0.0]), 0.0, 30.0)
    assert wider.ids == ("a", "c")


def test_a_map_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        ForestSource(str(tmp_path / "none.csv")).case(1, 0)
