"""The fastest cruise that a contract and a field allow."""

from __future__ import annotations

import pytest

from gcs_tools.contract.keys import contract_key
from gcs_tools.preflight import speed
from gcs_tools.preflight.command import check
from gcs_tools.preflight.speed import fastest_speed_mps
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField, load_field
from onboard.files.yaml_file import load_yaml
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
FIELD = load_field(CONFIG / "paper_field.yaml")
MISSION = load_yaml(CONFIG / "paper_mission.yaml", Mission)
KEY = contract_key("vehicle.cruise_speed_mps")


def boxes(*centers_ned_m: tuple[float, float], size_m: float = 1.0) -> ObstacleField:
    return ObstacleField.of(
        [
            Obstacle(id=str(number), center_ned_m=center, size_m=(size_m, size_m))
            for number, center in enumerate(centers_ned_m)
        ]
    )


def test_the_fastest_speed_complies_and_a_little_more_does_not() -> None:
    fastest_mps = fastest_speed_mps(CONTRACT, FIELD, MISSION, "inner")
    assert fastest_mps is not None
    assert check(KEY.changed(CONTRACT, fastest_mps), FIELD, MISSION).compliant
    faster = KEY.changed(CONTRACT, fastest_mps + 2.0 * speed._RESOLUTION_MPS)
    assert not check(faster, FIELD, MISSION).compliant


def test_without_close_obstacles_the_contract_alone_sets_the_limit() -> None:
    fastest_mps = fastest_speed_mps(CONTRACT, boxes((40.0, 0.0)), None, "inner")
    assert fastest_mps is not None
    assert assess(KEY.changed(CONTRACT, fastest_mps)).compliant
    assert not assess(KEY.changed(CONTRACT, fastest_mps * 1.001)).compliant


@pytest.mark.parametrize(
    "field",
    [
        boxes((20.0, 0.0), size_m=50.0),  # larger than any obstacle may be
        boxes((20.0, 0.0), (22.0, 3.0)),  # closer than any two may be
    ],
)
def test_no_speed_settles_what_does_not_depend_on_it(field: ObstacleField) -> None:
    assert fastest_speed_mps(CONTRACT, field, None, "inner") is None


def test_no_speed_settles_a_clause_that_does_not_depend_on_it() -> None:
    silent = contract_key("sensor.frame_age_max_s").changed(CONTRACT, 1e4)
    assert fastest_speed_mps(silent, boxes((40.0, 0.0)), None, "inner") is None


def test_a_start_inside_a_region_at_any_speed_has_no_fastest() -> None:
    assert fastest_speed_mps(CONTRACT, boxes((0.5, 0.0)), MISSION, "inner") is None
