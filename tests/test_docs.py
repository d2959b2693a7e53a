"""The commands and programs of the documentation run, and do what it says."""

import ast
import math
import queue
import re
import shlex
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import yaml
import zenoh

from gcs_tools.__main__ import main
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.parameters import check_parameters
from onboard.authentication.operator_command import CommandKind
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.daemon_config import DaemonConfig
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml, parse_document, validate
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.mavlink.profiles.parameter_rules import ReportedParameters
from onboard.mavlink.profiles.registry import profile_named
from onboard.perception.intake import DetectionCounters
from onboard.perception.ros2.keys import TYPE_HASHES
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.json_v1 import parse_frame
from onboard.perception.sources.registry import zenoh_key
from onboard.recording.messages import ZENOH_KEYS
from onboard.zenoh_session import open_session
from sitl.config import load_sitl_config
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.onboard.perception.ros2.encoding import attachment, scan_all_round
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, pose_at, poses_of
from tests.sitl.autopilot.protocol.test_mavproxy import mavproxy
from tests.sitl.process import configured, free_port, running
from tests.tools.transcripts import with_answers

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def contract_commands() -> list[str]:
    shell = "".join(block for page in PAGES for block in blocks(page, "sh"))
    return re.findall(r"^clearway contract .*$", shell.replace("\\\n", ""), re.MULTILINE)


@pytest.mark.parametrize("command", contract_commands())
def test_contract_commands_work_as_written(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    assert main(shlex.split(command, comments=True)[1:]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("vehicle", ["px4", "px4_default_parameters", "ardupilot"])
def test_contracts_to_start_from_comply(vehicle: str) -> None:
    contract = load_contract(ROOT / "config" / f"{vehicle}_contract.yaml")
    assessment = assess(contract, mission_altitude_m=5.0)
    assert assessment.compliant
    assert contract.vehicle.setpoint_loss_run_on_speed_mps == contract.vehicle.cruise_speed_mps
    plan_jerk_mps3 = assessment.limits.right_mps2 / assessment.terms.attitude_lag_s
    assert plan_jerk_mps3 <= 10.0  # as the vehicles' numbers were measured


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*_contract.yaml")), ids=str)
def test_shipped_contracts_keep_clear_of_what_the_readme_names(path: Path) -> None:
    """They have room to stop, a wide view and passive safety, except the paper's own."""
    assessment = assess(load_contract(path), mission_altitude_m=4.0)
    assert assessment.compliant
    assert math.degrees(assessment.terms.sure_view_rad) > 60.0
    roomy = bool(assessment.inflated.region.flat)
    covered = roomy and assessment.terms.passive_safety
    assert covered is (path.name != "paper_contract.yaml")


@pytest.mark.parametrize(
    ("sitl", "contract"),
    [("sitl", "px4_contract"), ("ardupilot_sitl", "ardupilot_contract")],
)
def test_the_shipped_vehicles_are_set_up_for_the_contract_that_they_name(
    sitl: str, contract: str
) -> None:
    text = (ROOT / "config" / f"{sitl}.yaml").read_text(encoding="utf-8")
    assert f"config/{contract}.yaml" in text
    vehicle = load_sitl_config(ROOT / "config" / f"{sitl}.yaml")
    terms = load_contract(ROOT / "config" / f"{contract}.yaml")
    assert vehicle.realism == "field"
    assert vehicle.multirotor.radius_m == terms.vehicle.radius_m
    assert vehicle.multirotor.thrust_to_weight == terms.vehicle.thrust_to_weight
    (sensor,) = vehicle.sensors
    assert sensor.range_m >= terms.sensor.detection_range_m
    assert sensor.field_of_view_deg >= terms.sensor.field_of_view_deg
    assert sensor.uncertainty_m <= terms.sensor.position_error_m
    autopilot = SimulatedVehicle(vehicle).autopilot
    # Boxes of the body are placed by the estimate, which wanders by as much on either axis.
    wander_m = autopilot.flavour.field.estimator.position_m
    assert wander_m + math.sqrt(2.0) * sensor.noise_m < terms.sensor.position_error_m
    assert math.sqrt(2.0) * wander_m < terms.vehicle.tracking_error_m
    assert autopilot.flavour.field.estimator.heading_rad <= assess(terms).terms.heading_error_rad
    parameters = autopilot.parameters
    reported = ReportedParameters({name: parameters[name] for name in parameters.names()})
    facts = profile_named(vehicle.flavour).parameters
    assert facts is not None
    mission = load_yaml(ROOT / "config" / "default_mission.yaml", Mission)
    findings = check_parameters(facts, reported, assess(terms), mission)
    broken = [each for each in findings if each.verdict is Verdict.BROKEN]
    assert not broken


def test_the_shipped_daemon_flies_the_contract_of_the_shipped_vehicle() -> None:
    daemon = load_yaml(ROOT / "config" / "onboard.yaml", DaemonConfig)
    assert daemon.contract.name == "px4_contract.yaml"


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_mavsdk_flies_as_the_readme_says(tmp_path: Path, flavour: str) -> None:
    (program,), (said,) = blocks(ROOT / "README.md", "python"), blocks(ROOT / "README.md", "text")
    port = free_port(socket.SOCK_DGRAM)
    links = [f"udpout://127.0.0.1:{port}"]
    path, _ = configured(tmp_path, flavour=flavour, mavlink=links, speed_factor=3.0)
    with running(path):
        done = subprocess.run(
            [sys.executable, "-c", program.replace("14550", str(port))],
            capture_output=True,
            text=True,
            timeout=60.0,
            check=True,
        )
    printed = [line for line in done.stdout.splitlines() if "|" not in line]  # MAVSDK's own log
    assert printed == said.splitlines()


def test_mavproxy_flies_as_the_readme_says(tmp_path: Path) -> None:
    (transcript,) = blocks(ROOT / "README.md", "console")
    example = yaml.safe_load((ROOT / "config" / "ardupilot_sitl.yaml").read_text(encoding="utf-8"))
    changes = {key: example[key] for key in ("flavour", "parameters")}
    with mavproxy(tmp_path, **changes) as (console, observer):
        for line in transcript.splitlines()[1:]:
            prompt, is_typed, command = line.partition("> ")
            if is_typed:
                console.expect(f"{prompt}> ")
                console.say(command)
                if command.startswith("param set"):  # MAVProxy sends it a little later
                    observer.wait_for("PARAM_VALUE", "PARAM_VALUE.param_id == 'GUID_TIMEOUT'")
            else:
                console.expect(line)
            if "Takeoff" in line:  # MAVProxy does not report the height
                observer.wait_for("LOCAL_POSITION_NED", "abs(LOCAL_POSITION_NED.z + 5) < 0.1")
        observer.wait_for("HEARTBEAT", "not HEARTBEAT.base_mode & 128")


def test_the_preflight_page_shows_what_is_printed(tmp_path: Path) -> None:
    """Checks the one transcript that needs no vehicle."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    page = ROOT / "docs" / "preflight.md"
    (block,) = (each for each in blocks(page, "console") if "cruise_speed_mps=6" in each)
    transcript = f"```console\n{block}```"
    assert with_answers(transcript, tmp_path) == transcript


def test_the_sensor_of_the_vehicle_page_meets_the_shipped_daemon_and_its_operator() -> None:
    (program,) = blocks(ROOT / "docs" / "vehicles.md", "python")
    shipped = load_yaml(ROOT / "config" / "onboard.yaml", DaemonConfig)
    # The same program on free ports.
    ports = {"7447": str(free_port(socket.SOCK_STREAM)), "7448": str(free_port(socket.SOCK_STREAM))}
    key = f"clearway/{shipped.vehicle}/obstacles"

    def moved(text: str) -> str:
        return re.sub("|".join(ports), lambda found: ports[found[0]], text)

    def receive(received: queue.Queue[bytes], sample: zenoh.Sample) -> None:
        received.put(sample.payload.to_bytes())

    daemon = ZenohEndpoints(
        connect=tuple(map(moved, shipped.zenoh.connect)),
        listen=tuple(map(moved, shipped.zenoh.listen)),
    )
    operator = ZenohEndpoints(connect=daemon.listen)
    with open_session(daemon) as onboard, open_session(operator) as ground:
        heard: list[queue.Queue[bytes]] = [queue.Queue(), queue.Queue()]
        for session, received in zip((onboard, ground), heard, strict=True):
            session.declare_subscriber(key, partial(receive, received))
        sensor = subprocess.Popen([sys.executable, "-c", moved(program)])
        try:
            for received in heard:
                frames = [parse_frame(received.get(timeout=60.0)) for _ in range(3)]
                assert [frame.sequence - frames[0].sequence for frame in frames] == [0, 1, 2]
                assert frames[0].obstacles[0].id == "7"
        finally:
            sensor.terminate()
            sensor.wait()


SHIPPED = (ROOT / "config" / "onboard.yaml").read_text(encoding="utf-8")


def snippets() -> list[str]:
    """What the sensors' page has a user add to the daemon's file, and what the file suggests."""
    of_scenarios = re.compile(r"^sitl:", re.MULTILINE)
    page = [
        block
        for block in blocks(ROOT / "docs" / "sensors.md", "yaml")
        if not of_scenarios.search(block)
    ]
    suggested = re.findall(
        r"^# ((?:sources|outputs):\n(?:#(?: -|   ).*\n)+)", SHIPPED, re.MULTILINE
    )
    assert len(suggested) == 2
    return [*page, *(each.replace("\n# ", "\n") for each in suggested)]


@pytest.mark.parametrize("snippet", snippets())
def test_what_the_sensors_page_states_is_read_by_the_shipped_daemon(
    snippet: str, tmp_path: Path
) -> None:
    path = tmp_path / "onboard.yaml"
    path.write_text(SHIPPED + snippet, encoding="utf-8")
    config = load_yaml(path, DaemonConfig)
    shown = config.outputs.obstacle_distance is not None and config.outputs.markers is not None
    assert config.sources or shown


def test_the_lidar_of_the_sensors_page_meets_the_shipped_daemon() -> None:
    """A scan on the page's topic, from a node that connects to the daemon as the page says."""
    config = validate(
        parse_document(SHIPPED + snippets()[0], source="the page"), DaemonConfig, source="the page"
    )
    address = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    (router,) = config.zenoh.connect  # the port of rmw_zenohd is the one that is shipped
    assert router.endswith(":7447")
    (lidar,) = (each for each in config.sources if each.kind == "laserscan")
    key = zenoh_key(lidar)
    assert key is not None
    heard: queue.Queue[tuple[str, bytes, bytes]] = queue.Queue()

    def receive(sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        heard.put((str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes()))

    with (
        open_session(ZenohEndpoints(listen=(address,))) as ros,
        open_session(ZenohEndpoints(connect=(address,))) as daemon,
    ):
        daemon.declare_subscriber(key, receive)
        published = key.replace("**", "RIHS01_" + TYPE_HASHES["sensor_msgs/LaserScan"][0])
        scan = scan_all_round([5.0] * 360, stamp_unix_s=EPOCH_UNIX_S)
        while heard.empty():
            ros.put(published, scan, attachment=attachment())
            time.sleep(0.02)
        found, payload, attached = heard.get()
    channels = SensorChannels(config.sources, poses_of(pose_at()), DetectionCounters())
    channels.receive(lidar.name, payload, 0.0, key=found, attachment=attached)
    (frame,) = channels.take(EPOCH_UNIX_S)
    assert (frame.source, len(frame.obstacles) > 0) == (lidar.name, True)


def test_the_example_publisher_connects_where_the_shipped_daemon_listens() -> None:
    program = (ROOT / "examples" / "detection_publisher.py").read_text(encoding="utf-8")
    shipped = load_yaml(ROOT / "config" / "onboard.yaml", DaemonConfig)
    (address,) = shipped.zenoh.listen
    assert f'"--connect", default="{address}"' in program
    assert f'"--vehicle", default="{shipped.vehicle}"' in program


FINDINGS = (ROOT / "docs" / "field_findings.md").read_text(encoding="utf-8")
NAMED_TESTS = sorted(set(re.findall(r"`([\w/]+\.py)::(test_\w+)(?:\[(\w+)\])?`", FINDINGS)))


@pytest.mark.parametrize(("file", "test", "case"), NAMED_TESTS, ids="::".join)
def test_the_findings_name_tests_that_exist(file: str, test: str, case: str) -> None:
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    assert test in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    if case:  # a scenario: the test flies all that there are
        assert (ROOT / "config" / "scenarios" / f"{case}.yaml").is_file()


def test_every_finding_has_its_test_or_is_said_to_be_open() -> None:
    tables = [line for line in FINDINGS.splitlines() if line.startswith("| ")]
    rows = [line for line in tables if "---" not in line and not line.endswith("| test |")]
    assert len(rows) > 60
    for row in rows:
        assert ".py::test_" in row or "*not yet*" in row.lower(), row
    assert len(re.findall(r"::test_", FINDINGS)) == len(
        re.findall(r"`[\w/]+\.py::test_\w+(?:\[\w+\])?`", FINDINGS)
    )


CONTRIBUTORS_PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *(ROOT / "docs" / name for name in ("architecture.md", "glossary.md")),
]


@pytest.mark.parametrize("page", CONTRIBUTORS_PAGES, ids=lambda page: page.name)
def test_files_and_modules_that_a_page_names_exist(page: Path) -> None:
    quoted = re.findall(
        r"`((?:onboard|sitl|gcs_tools|tests|config|docs|examples)[/.][\w/.]*)`", page.read_text()
    )
    for name in (each for each in quoted if not re.fullmatch(r"\w+\.yaml", each)):
        dotted = "/" not in name
        path = ROOT / (name.replace(".", "/") if dotted else name)
        is_there = path.exists() or (dotted and path.with_suffix(".py").is_file())
        is_attribute = dotted and path.parent.with_suffix(".py").is_file()
        assert is_there or is_attribute, name


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    """Files and headings; `mkdocs build --strict` checks only what the site shows."""
    for target, anchor in re.findall(
        r"\]\((?!https?:)([^)#\s]*)(?:#([\w-]+))?\)", page.read_text()
    ):
        file = page.parent / target if target else page
        assert file.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", file.read_text(), re.MULTILINE)
            slugs = [re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings]
            assert anchor in slugs, f"{target}#{anchor}"


def test_the_readme_stays_an_entrance() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 350


def test_the_page_of_the_bus_names_every_key() -> None:
    page = (ROOT / "docs" / "bus.md").read_text(encoding="utf-8")
    for record_type, key in ZENOH_KEYS.items():
        (row,) = re.findall(rf"^\| `{key}` \|.*$", page, re.MULTILINE)
        assert record_type.__name__ in row
    for kind in CommandKind:
        assert f"`{kind.value}`" in page
    for block in blocks(ROOT / "docs" / "bus.md", "python"):
        ast.parse(block)
