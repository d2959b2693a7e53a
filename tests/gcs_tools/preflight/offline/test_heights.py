"""What pre-flight makes of obstacles that are lower than the mission."""

from __future__ import annotations

import pytest

from gcs_tools.preflight.command import Preflight, check
from gcs_tools.preflight.offline.heights import obstacles_in_way
from onboard.contract.terms import Terms
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.perception.heights import level_blind_m
from tests.gcs_tools.running import CONFIG

DEFAULT = CONFIG / "default_contract.yaml"
HEIGHTS = (
    "vehicle.radius_z_m=0.25",
    "vehicle.height_drift_m=0.4",
    "sensor.position_error_z_m=0.3",
    "sensor.vertical_field_of_view_deg=[40.0, 40.0]",
)
HEDGE = Obstacle(id="hedge", center_ned_m=(40.0, 0.0), size_m=(1.0, 30.0), down_m=(-1.5, 0.0))
TREE = Obstacle(id="tree", center_ned_m=(70.0, 0.0), size_m=(1.0, 1.0))
FIELD = ObstacleField.of([HEDGE, TREE])


def mission(altitude_m: float = 5.0, start_clear_m: float | None = 4.0) -> Mission:
    return Mission.model_validate(
        {
            "altitude_m": altitude_m,
            "start_clear_m": start_clear_m,
            "legs": [{"end_ned_m": (100.0, 0.0), "target_half_width_m": 8.0}],
        }
    )


def checked(mission: Mission, *overrides: str) -> Preflight:
    return check(load_contract(DEFAULT, overrides), FIELD, mission)


def test_a_hedge_below_the_mission_is_in_no_rule() -> None:
    assert not [rule.name for rule in checked(mission(), *HEIGHTS).field_rules if not rule.holds]
    broken = {rule.name for rule in checked(mission()).field_rules if not rule.holds}
    assert "obstacle_size_max" in broken
    low = {rule.name for rule in checked(mission(3.0), *HEIGHTS).field_rules if not rule.holds}
    assert "obstacle_size_max" in low


def test_what_a_sensor_may_report_too_tall_is_in_the_way() -> None:
    contract = load_contract(DEFAULT, HEIGHTS)
    # Top 1.5 m, measured and told 0.3 m too high, and 1.2 m of band.
    assert obstacles_in_way(FIELD, contract, mission(3.35)).ids == ("tree",)
    assert obstacles_in_way(FIELD, contract, mission(3.25)).ids == ("hedge", "tree")
    assert obstacles_in_way(FIELD, contract, None) is FIELD
    assert obstacles_in_way(FIELD, load_contract(DEFAULT), mission()) is FIELD


@pytest.mark.parametrize("start_clear_m", [None, 2.0])
def test_the_operators_word_has_to_reach_to_where_all_heights_are_seen(
    start_clear_m: float | None,
) -> None:
    rules = {r.name: r for r in checked(mission(5.0, start_clear_m), *HEIGHTS).safety_rules}
    assert not rules["start_clear"].holds
    blind_m = level_blind_m(Terms.of(load_contract(DEFAULT, HEIGHTS)))
    assert rules["start_clear"].required == pytest.approx(blind_m + 0.3)
    enough = {r.name: r for r in checked(mission(5.0, 4.0), *HEIGHTS).safety_rules}
    assert enough["start_clear"].holds
    assert "start_clear" not in {r.name for r in checked(mission(5.0, None)).safety_rules}
