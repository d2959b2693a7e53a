"""Scenario files, what they refer to, and the schemas that describe all files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gcs_tools.fly.live_configuration import Endpoints, write_configuration
from gcs_tools.preflight.command import check
from gcs_tools.preflight.live.bus import BusConfig
from gcs_tools.scenario import Scenario, ScenarioFile, load_scenario, obstacle_list
from gcs_tools.schemas import MODELS
from onboard.files.contract_file import Contract, load_contract
from onboard.files.daemon_config import DaemonConfig
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.yaml_file import FileError, load_yaml
from sitl.config import SitlConfig
from sitl.vehicle.scene import Scene
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.gcs_tools.running import CONFIG, Clearway

SCENARIOS = ("paper", "default", "intersecting_rois")
READERS: dict[str, Callable[[Path], object]] = {
    "contract": load_contract,
    "mission": lambda path: load_yaml(path, Mission),
    "field": load_field,
    "scenario": lambda path: load_yaml(path, ScenarioFile),
    "onboard": lambda path: load_yaml(path, DaemonConfig),
    "bus": lambda path: load_yaml(path, BusConfig),
}


def schema_of(path: Path) -> str:
    """Name of the schema that a file declares for editors."""
    first_line = path.read_text(encoding="utf-8").splitlines()[0]
    prefix, suffix = "# yaml-language-server: $schema=schemas/", ".schema.json"
    assert first_line.startswith(prefix), path
    return first_line.removeprefix(prefix).removesuffix(suffix)


# The simulation's own example is read by its own tests.
SHIPPED = sorted(set(CONFIG.glob("*.yaml")) - set(CONFIG.glob("*sitl.yaml")))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_every_shipped_file_names_its_schema_and_can_be_read(path: Path) -> None:
    READERS[schema_of(path)](path)


def test_published_schemas_are_up_to_date(clearway: Clearway, tmp_path: Path) -> None:
    assert clearway("schema", "-o", tmp_path / "schemas").code == 0
    for name in MODELS:
        now = (tmp_path / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8")
        published = (CONFIG / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8")
        assert published == now, f"run: clearway schema -o {CONFIG.name}/schemas"


def test_schemas_describe_the_keys(clearway: Clearway, tmp_path: Path) -> None:
    clearway("schema", "-o", tmp_path)
    schema = json.loads((tmp_path / "contract.schema.json").read_text(encoding="utf-8"))
    vehicle = schema["$defs"]["VehicleTerms"]
    assert vehicle["additionalProperties"] is False
    assert vehicle["properties"]["cruise_speed_mps"]["exclusiveMinimum"] == 0.0
    assert "setpoint_loss_timeout_s" not in vehicle["required"]


@pytest.mark.parametrize("name", SCENARIOS)
def test_shipped_scenarios_agree_with_their_contract(name: str) -> None:
    scenario = load_scenario(CONFIG / f"{name}.yaml")
    contract, plant = scenario.contract, scenario.plant
    assert plant.multirotor.radius_m == contract.vehicle.radius_m
    assert plant.multirotor.thrust_to_weight == contract.vehicle.thrust_to_weight
    for sensor in plant.sensors:
        assert sensor.range_m >= contract.sensor.detection_range_m
        assert sensor.field_of_view_deg >= contract.sensor.field_of_view_deg
        assert sensor.uncertainty_m <= contract.sensor.position_error_m
        assert sensor.noise_m <= sensor.uncertainty_m


def inline(name: str) -> dict[str, Any]:
    """Return a shipped scenario with the content of its files instead of their names."""
    scenario: dict[str, Any] = yaml.safe_load((CONFIG / f"{name}.yaml").read_text("utf-8"))
    for key in ("contract", "field", "mission"):
        scenario[key] = yaml.safe_load((CONFIG / scenario[key]).read_text("utf-8"))
    return scenario


def as_documents(scenario: Scenario) -> list[Any]:
    models = (scenario.contract, scenario.mission, *obstacle_list(scenario.obstacles))
    return [model.model_dump() for model in models]


def test_files_and_their_content_are_the_same(written: Callable[[str, Any], Path]) -> None:
    by_name = load_scenario(CONFIG / "paper.yaml")
    by_content = load_scenario(written("inline.yaml", inline("paper")))
    assert as_documents(by_name) == as_documents(by_content)
    assert by_content.name == "inline"


def test_a_key_of_before_is_refused_with_the_new_name(
    clearway: Clearway, written: Callable[[str, Any], Path]
) -> None:
    path = written("old.yaml", {**inline("paper"), "force": True})
    ran = clearway("fly", path, "--virtual")
    assert ran.code == 2
    assert ran.err == f"clearway: error: {path}: force was renamed: use fly_outside_contract\n"


def test_faults_are_read_with_their_window_and_amount(written: Callable[[str, Any], Path]) -> None:
    document = inline("paper")
    document["faults"] = [{"kind": "detections_off", "phase": "avoid", "entry": 2, "start_s": 0.5}]
    (fault,) = load_scenario(written("faulty.yaml", document)).faults
    assert (fault.kind, fault.phase, fault.entry) == ("detections_off", "avoid", 2)
    assert (fault.start_s, fault.duration_s) == (0.5, None)


def test_autopilot_follows_mission_and_contract_unless_told_otherwise(
    written: Callable[[str, Any], Path],
) -> None:
    document = inline("paper")
    parameters = load_scenario(written("plain.yaml", document)).sitl_config().parameters
    assert parameters == {"MIS_TAKEOFF_ALT": 4.0, "COM_OF_LOSS_T": 0.5}
    document["sitl"]["parameters"] = {"COM_OF_LOSS_T": 2.0}
    parameters = load_scenario(written("told.yaml", document)).sitl_config().parameters
    assert parameters == {"MIS_TAKEOFF_ALT": 4.0, "COM_OF_LOSS_T": 2.0}


def test_ardupilot_gets_its_own_parameters_and_no_others() -> None:
    scenario = load_scenario(CONFIG / "scenarios" / "ardupilot_three_obstacles.yaml")
    names = set(scenario.sitl_config().parameters)
    assert names == {"GUID_TIMEOUT", "PSC_JERK_XY", "WPNAV_ACCEL"}
    assert scenario.sitl_config().parameters["GUID_TIMEOUT"] == 0.5
    SimulatedVehicle(scenario.sitl_config())  # which refuses parameters that do not exist


def test_obstacles_survive_being_written_down() -> None:
    field = load_field(CONFIG / "default_field.yaml")
    again = ObstacleField.of(obstacle_list(field))
    assert again.ids == field.ids
    np.testing.assert_allclose(again.center_ned_m, field.center_ned_m)
    np.testing.assert_allclose(again.half_size_m, field.half_size_m)
    np.testing.assert_allclose(again.yaw_rad, field.yaw_rad)


def test_a_flight_directory_is_complete_in_itself(tmp_path: Path) -> None:
    scenario = load_scenario(CONFIG / "default.yaml")
    endpoints = Endpoints(14001, 14002, 7001, 7002)
    write_configuration(scenario, endpoints, seed=7, out=tmp_path, fly_outside_contract=False)
    onboard = load_yaml(tmp_path / "onboard.yaml", DaemonConfig)
    sitl = load_yaml(tmp_path / "sitl.yaml", SitlConfig)
    assert load_yaml(tmp_path / onboard.contract, Contract) == scenario.contract
    assert load_yaml(tmp_path / onboard.mission, Mission) == scenario.mission
    assert sitl.field is not None
    assert load_field(tmp_path / sitl.field).ids == scenario.obstacles.ids
    assert onboard.mavlink.url.removeprefix("udpin") == sitl.mavlink[0].removeprefix("udpout")
    assert onboard.vehicle == sitl.vehicle
    assert onboard.zenoh.connect == sitl.zenoh.listen
    assert sitl.sensors == scenario.plant.sensors
    assert (sitl.seed, onboard.fly_outside_contract) == (7, False)


LIDAR = "{kind: laserscan, name: lidar, topic: /scan, range_m: 12.0, uncertainty_m: 0.05}"
BY_LIDAR = f"""
contract: {CONFIG / "default_contract.yaml"}
field: [{{id: oak, center_ned_m: [9.0, 0.0], size_m: [1.0, 1.0]}}]
mission: {{altitude_m: 4.0, legs: [{{end_ned_m: [20.0, 0.0]}}], start_clear_m: 3.0}}
sources: [{LIDAR}]
sitl: {{sensors: [{{source: lidar, publishes: laserscan, ros2: {{topic: /scan}}}}]}}
"""


def test_the_daemon_of_a_live_flight_has_the_scenarios_sensors(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(BY_LIDAR, encoding="utf-8")
    scenario = load_scenario(path)
    write_configuration(
        scenario, Endpoints(1, 2, 3, 4), seed=1, out=tmp_path, fly_outside_contract=False
    )
    daemon = load_yaml(tmp_path / "onboard.yaml", DaemonConfig)
    assert daemon.sources == scenario.sources
    assert [source.name for source in daemon.sources] == ["lidar"]
    sitl = load_yaml(tmp_path / "sitl.yaml", SitlConfig)
    assert sitl.sensors[0].publishes == "laserscan"
    assert sitl.sensors[0].ros2.topic == "/scan"


def test_a_fault_of_detections_that_no_sensor_sends_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(BY_LIDAR + "faults: [{kind: detections_ghost}]", encoding="utf-8")
    with pytest.raises(
        FileError, match=r"faults\[0\].kind = detections_ghost .* publish laserscan"
    ):
        load_scenario(path)
    over_link = BY_LIDAR.replace("publishes: laserscan", "publishes: obstacle_distance")
    path.write_text(over_link + "faults: [{kind: detections_off}]", encoding="utf-8")
    with pytest.raises(FileError, match=r"detections_off .* publish obstacle_distance"):
        load_scenario(path)
    path.write_text(BY_LIDAR + "faults: [{kind: detections_off}]", encoding="utf-8")
    assert load_scenario(path).faults[0].kind == "detections_off"
    path.write_text(BY_LIDAR + "faults: [{kind: position_reset}]", encoding="utf-8")
    assert load_scenario(path).faults[0].kind == "position_reset"


@pytest.mark.parametrize("path", sorted((CONFIG / "scenarios" / "sensors").glob("*.yaml")), ids=str)
def test_each_shipped_scenario_of_a_sensor_keeps_its_contract(path: Path) -> None:
    scenario = load_scenario(path)
    (source,) = scenario.sources
    sensor = scenario.contract.sensor
    # Beside one that sees ahead, the ring may see less far.
    assert source.range_m >= (sensor.all_round_range_m or sensor.detection_range_m)
    assert source.uncertainty_m <= sensor.position_error_m
    assert check(scenario.contract, None, scenario.mission).may_fly or (
        scenario.contract.requirements.progress == "best_effort"
    )


@pytest.mark.parametrize("path", sorted((CONFIG / "scenarios" / "movers").glob("*.yaml")), ids=str)
def test_each_shipped_scenario_of_passing_keeps_its_contract(path: Path) -> None:
    scenario = load_scenario(path)
    # What is passed is avoided, or beside heights flown over.
    over = scenario.contract.vehicle.radius_z_m is not None
    assert scenario.contract.requirements.movers == ("passive" if over else "avoid")
    declared = {each.kind: each for each in scenario.contract.environment.movers}
    assert scenario.plant.movers
    for mover in scenario.plant.movers:
        assert mover.speed_mps <= declared[mover.kind].speed_max_mps
        if over:
            top_max_m = declared[mover.kind].top_max_m
            assert top_max_m is not None
            assert mover.top_m is not None
            assert mover.top_m <= top_max_m
    assert check(scenario.contract, None, scenario.mission).may_fly


def test_the_example_of_the_page_flies(tmp_path: Path) -> None:
    page = (CONFIG.parent / "docs" / "sensors.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (example,) = (each for each in examples if "publishes:" in each)
    rest = BY_LIDAR[: BY_LIDAR.index("sources:")]
    path = tmp_path / "scenario.yaml"
    path.write_text(rest + example, encoding="utf-8")
    scenario = load_scenario(path)
    scene = Scene(scenario.sitl_config(seed=1), scenario.obstacles)
    scene.advance(0.1)
    assert {message.source for message in scene.take_detections()} == {"lidar"}
