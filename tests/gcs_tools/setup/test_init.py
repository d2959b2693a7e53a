"""`clearway init`: what it writes fits together, checks, and flies."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.bus import load_bus
from gcs_tools.preflight.live.parameters import check_parameters
from gcs_tools.schemas import MODELS
from gcs_tools.setup.command import FILES
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.daemon_config import DaemonConfig, load_daemon_config
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import load_field
from onboard.files.yaml_file import load_yaml
from onboard.mavlink.profiles.parameter_rules import ReportedParameters
from onboard.mavlink.profiles.registry import profile_named
from sitl.config import load_sitl_config
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.gcs_tools.running import CONFIG, Clearway

VEHICLES = ("px4", "ardupilot")


@pytest.fixture(params=VEHICLES)
def folder(
    request: pytest.FixtureRequest,
    clearway: Clearway,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    """Write a set in a folder that was empty, and work there."""
    monkeypatch.chdir(tmp_path)
    ran = clearway("init", "mine", "--vehicle", request.param)
    assert (ran.code, ran.err) == (0, "")
    assert "README.md" in ran.out
    monkeypatch.chdir("mine")
    return Path()


def test_the_set_passes_the_preflight_check_and_its_flight_arrives(
    clearway: Clearway, folder: Path
) -> None:
    files = ("--contract", "contract.yaml", "--field", "field.yaml", "--mission", "mission.yaml")
    checked = clearway("preflight", *files)
    assert checked.code == 0, checked.out
    assert "PROGRESS GUARANTEED" in checked.out
    flown = clearway("fly", "scenario.yaml", "--virtual")
    assert flown.code == 0, flown.out
    assert "expectation of scenario: met" in flown.out
    assert Path("flights/scenario-1/flight.mcap").is_file()


def test_the_processes_find_each_other(folder: Path) -> None:
    daemon = load_yaml(folder / "onboard.yaml", DaemonConfig)
    vehicle, bus = load_sitl_config(folder / "sitl.yaml"), load_bus(folder / "bus.yaml")
    assert daemon.vehicle == vehicle.vehicle == bus.vehicle
    assert daemon.mavlink.system_id == vehicle.system_id
    assert daemon.mavlink.url.replace("udpin", "udpout") in vehicle.mavlink
    assert daemon.zenoh.connect == vehicle.zenoh.listen
    assert set(bus.connect) == {*daemon.zenoh.listen, *vehicle.zenoh.listen}
    for name in (daemon.contract, daemon.mission, vehicle.field):
        assert name is not None
        assert (folder / name).is_file()
    listens = (*daemon.zenoh.listen, *vehicle.zenoh.listen, daemon.mavlink.url)
    assert all("127.0.0.1" in each for each in listens), "nothing listens beyond loopback"


def test_a_first_flight_among_virtual_obstacles_passes_and_says_so(
    clearway: Clearway, folder: Path
) -> None:
    files = ("--contract", "contract.yaml", "--field", "field.yaml")
    virtual = ("--mission", "mission_virtual.yaml", "--daemon-config", "onboard_virtual.yaml")
    checked = clearway("preflight", *files, *virtual)
    assert checked.code == 0, checked.out
    assert "PROGRESS GUARANTEED" in checked.out
    assert "VIRTUAL OBSTACLES: real obstacles are not seen: fly in open ground only" in checked.out
    (source,) = load_daemon_config(folder / "onboard_virtual.yaml").sources
    contract = load_contract(folder / "contract.yaml")
    assert source.range_m == contract.sensor.detection_range_m
    assert source.uncertainty_m <= contract.sensor.position_error_m


def test_the_simulated_vehicle_has_the_parameters_that_the_contract_needs(folder: Path) -> None:
    vehicle = load_sitl_config(folder / "sitl.yaml")
    contract = load_contract(folder / "contract.yaml")
    parameters = SimulatedVehicle(vehicle).autopilot.parameters
    reported = ReportedParameters({name: parameters[name] for name in parameters.names()})
    facts = profile_named(vehicle.flavour).parameters
    assert facts is not None
    mission = load_yaml(folder / "mission.yaml", Mission)
    findings = check_parameters(facts, reported, assess(contract), mission)
    assert [each for each in findings if each.verdict is Verdict.BROKEN] == []
    assert vehicle.multirotor.radius_m == contract.vehicle.radius_m
    (sensor,) = vehicle.sensors
    assert sensor.range_m >= contract.sensor.detection_range_m
    assert sensor.uncertainty_m <= contract.sensor.position_error_m
    assert len(load_field(folder / "field.yaml")) == 2


def test_every_file_names_a_schema_that_is_there(folder: Path) -> None:
    written = sorted(folder.glob("*.yaml"))
    assert len(written) == 9
    for path in written:
        first, *_ = path.read_text(encoding="utf-8").splitlines()
        schema = first.removeprefix("# yaml-language-server: $schema=")
        assert (folder / schema).is_file(), first
    assert {path.name for path in (folder / "schemas").iterdir()} == {
        f"{name}.schema.json" for name in MODELS
    }


def test_the_readme_names_every_file_and_no_other(folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    for path in folder.glob("*.yaml"):
        assert f"`{path.name}`" in text


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_contract_is_the_shipped_one(vehicle: str) -> None:
    ours = (FILES / vehicle / "contract.yaml").read_text(encoding="utf-8")
    assert ours == (CONFIG / f"{vehicle}_contract.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["mission.yaml", "README.md", "schemas/mission.schema.json"])
def test_nothing_is_overwritten_and_nothing_written_beside_it(
    clearway: Clearway, tmp_path: Path, name: str
) -> None:
    mine = tmp_path / "mine" / name
    mine.parent.mkdir(parents=True)
    mine.write_text("mine", encoding="utf-8")
    ran = clearway("init", tmp_path / "mine")
    assert ran.code == 2
    assert ran.err == (
        f"clearway: error: {mine}: exists already; nothing is overwritten or written\n"
    )
    assert mine.read_text(encoding="utf-8") == "mine"
    assert [path for path in (tmp_path / "mine").rglob("*") if path.is_file()] == [mine]


def test_a_folder_that_cannot_be_written_is_one_line(clearway: Clearway, tmp_path: Path) -> None:
    occupied = tmp_path / "occupied"
    occupied.touch()
    ran = clearway("init", occupied)
    assert ran.code == 2
    assert "cannot be written" in ran.err
    assert ran.err.count("\n") == 1


def test_the_default_flight_needs_no_file_of_the_users(
    clearway: Clearway, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scenario is part of the package, and the same as the checkout's."""
    from gcs_tools.fly.command import DEFAULT_SCENARIO  # noqa: PLC0415  as the command does
    from gcs_tools.scenario import load_scenario  # noqa: PLC0415  as the command does

    monkeypatch.chdir(tmp_path)
    shipped, checkout = load_scenario(DEFAULT_SCENARIO), load_scenario(CONFIG / "paper.yaml")
    assert shipped.contract == checkout.contract
    assert shipped.mission == checkout.mission
    names = sorted(path.name for path in DEFAULT_SCENARIO.parent.glob("*.yaml"))
    for name in names:
        ours = yaml.safe_load((DEFAULT_SCENARIO.parent / name).read_text(encoding="utf-8"))
        assert ours == yaml.safe_load((CONFIG / name).read_text(encoding="utf-8"))
