"""What the service flies counts as a way to rest once it has been certified, and not before."""

from __future__ import annotations

from dataclasses import replace

from gcs_tools.campaign.flight import fly_case
from gcs_tools.campaign.oracles.rest import rest_held
from gcs_tools.campaign.sources import FileSource
from gcs_tools.scenario import load_scenario
from onboard.files.obstacle_field import Obstacle, ObstacleField
from tests.onboard.conftest import CONFIG


def test_where_a_start_is_looked_at_no_way_is_held_and_once_it_is_seen_free_one_is() -> None:
    """A post beside the start, within body and tracking error, is nothing that a way leads into."""
    scenario = load_scenario(CONFIG / "scenarios" / "no_passage.yaml")
    case = replace(FileSource("near", scenario).case(1, 0), time_limit_s=3.0)
    near = fly_case(case)
    assert near.states[-1].phase == "pause"
    assert not near.ways
    assert list(rest_held(near)) == []

    post = Obstacle(id="post", center_ned_m=(0.0, 4.0), size_m=(0.3, 0.3), yaw_deg=0.0)
    mission = scenario.mission.model_copy(update={"start_clear_m": 3.0})
    clear = replace(scenario, obstacles=ObstacleField.of([post]), mission=mission)
    assert fly_case(replace(case, scenario=clear)).ways
