"""`clearway-onboard` as a process: files and signals in, MAVLink and Zenoh out."""

import asyncio
import gc
import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import yaml
import zenoh
from mcap.reader import make_reader
from pymavlink.dialects.v20 import common as mavlink

from gcs_tools.export.log_parts import log_metadata
from gcs_tools.export.tlog import write_tlog
from gcs_tools.logs.flight_log import read_log
from onboard.__main__ import main
from onboard.authentication.keys import DaemonKeys
from onboard.daemon import run
from onboard.files.contract_file import Contract, load_contract
from onboard.files.daemon_config import DaemonConfig
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.perception.ros2.cdr import CdrReader
from onboard.perception.ros2.graph import parse_publisher
from onboard.perception.ros2.keys import TYPE_HASHES, decode_attachment
from onboard.recording.recorder import FlightRecorder, LogFileError, LogPlace
from onboard.zenoh_session import open_session
from tests.onboard.mavlink.test_endpoint import Autopilot
from tests.onboard.perception.ros2.encoding import attachment, scan_all_round

CONFIG = Path(__file__).parents[2] / "config"
COMMAND = [sys.executable, "-m", "onboard", "--config"]
SAID = "stderr.txt"
HASH = "RIHS01_" + TYPE_HASHES["sensor_msgs/LaserScan"][0]


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture
def settings() -> dict[str, Any]:
    return {
        "vehicle": "v1",
        "contract": str(CONFIG / "default_contract.yaml"),
        "mission": str(CONFIG / "paper_mission.yaml"),
        "mavlink": {"url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"},
        "zenoh": {"listen": [f"tcp/127.0.0.1:{free_port()}"]},
        "log_file": "flight.mcap",
    }


def write(directory: Path, settings: dict[str, Any]) -> Path:
    path = directory / "onboard.yaml"
    path.write_text(yaml.safe_dump(settings))
    return path


def refused(directory: Path, settings: dict[str, Any]) -> str:
    """Start the daemon, in this process, on settings that it must refuse; return its complaint."""
    # Else this process and all that later tests start would run before everything else.
    priority = mock.patch("onboard.daemon.request_realtime_priority")
    with priority, redirect_stderr(io.StringIO()) as stderr:
        code = main(["--config", str(write(directory, settings))])
    return complaint(code, stderr.getvalue())


def complaint(code: int, said: str) -> str:
    """Return the one line of complaint of a daemon that has ended."""
    assert code == 2
    lines = [line for line in said.splitlines() if line.startswith("clearway-onboard: error: ")]
    assert len(lines) == 1
    assert "Traceback" not in said
    return lines[0]


@contextmanager
def running(directory: Path, settings: dict[str, Any]) -> Iterator[subprocess.Popen[bytes]]:
    said = directory / SAID
    with said.open("w") as stderr:
        daemon = subprocess.Popen([*COMMAND, write(directory, settings)], stderr=stderr)
    try:
        deadline_s = time.monotonic() + 60.0
        while "ready: " not in said.read_text():
            assert daemon.poll() is None, "the daemon ended before it was ready"
            assert time.monotonic() < deadline_s, "the daemon is never ready"
            time.sleep(0.02)
        yield daemon
    finally:
        daemon.kill()
        daemon.wait(timeout=60.0)


@contextmanager
def neighbour(settings: dict[str, Any]) -> Iterator[zenoh.Session]:
    with open_session(ZenohEndpoints(connect=tuple(settings["zenoh"]["listen"]))) as session:
        yield session


def test_missing_key_names_file_and_key(tmp_path: Path, settings: dict[str, Any]) -> None:
    """The process itself says so, and ends with that code."""
    del settings["contract"]
    command = [*COMMAND, str(write(tmp_path, settings))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    said = complaint(done.returncode, done.stderr)
    assert "onboard.yaml: contract is missing" in said


def test_unknown_key_is_named(tmp_path: Path, settings: dict[str, Any]) -> None:
    settings["mavlink"]["baud"] = 57600
    assert "mavlink.baud is not a known key" in refused(tmp_path, settings)


def test_bad_contract_names_file_key_value_and_unit(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    contract = yaml.safe_load((CONFIG / "default_contract.yaml").read_text())
    contract["vehicle"]["cruise_speed_mps"] = -1.0
    (tmp_path / "contract.yaml").write_text(yaml.safe_dump(contract))
    settings["contract"] = "contract.yaml"
    message = refused(tmp_path, settings)
    assert "contract.yaml: vehicle.cruise_speed_mps [m/s] = -1.0" in message


def test_missing_file_is_named(tmp_path: Path, settings: dict[str, Any]) -> None:
    settings["mission"] = "nowhere.yaml"
    assert "nowhere.yaml: cannot be read: No such file" in refused(tmp_path, settings)


def test_mavlink_port_in_use_names_the_url(tmp_path: Path, settings: dict[str, Any]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        settings["mavlink"]["url"] = f"udpin://127.0.0.1:{holder.getsockname()[1]}"
        assert settings["mavlink"]["url"] in refused(tmp_path, settings)


def test_unusable_mavlink_url_is_one_error(tmp_path: Path, settings: dict[str, Any]) -> None:
    url = settings["mavlink"]["url"] = "serial:///dev/null:57600"
    assert f"{url}: cannot be opened: not a serial device" in refused(tmp_path, settings)
    assert not list(tmp_path.glob("flight*")), "a daemon that cannot start leaves no log"


def test_zenoh_port_in_use_is_one_error(tmp_path: Path, settings: dict[str, Any]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        settings["zenoh"]["listen"] = [f"tcp/127.0.0.1:{holder.getsockname()[1]}"]
        assert "Zenoh" in refused(tmp_path, settings)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_it_cleanly_with_a_finished_log(
    tmp_path: Path, settings: dict[str, Any], number: signal.Signals
) -> None:
    with running(tmp_path, settings) as daemon:
        daemon.send_signal(number)
        assert daemon.wait(timeout=60.0) == 0
    with (tmp_path / "flight.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > 0


def test_neither_a_dropped_terminal_nor_a_second_start_does_harm(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    with running(tmp_path, settings) as daemon:
        daemon.send_signal(signal.SIGHUP)
        assert "cannot be opened" in refused(tmp_path, settings)
        assert "SIGHUP ignored" in (tmp_path / SAID).read_text()
        assert daemon.poll() is None
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(timeout=60.0) == 0
    assert read_log(tmp_path / "flight.mcap").complete
    assert {path.name for path in tmp_path.glob("flight*")} == {"flight.mcap"}
    # It holds the traffic of the link: at the least, what the daemon itself has sent.
    frames, problems = write_tlog([tmp_path / "flight.mcap"], tmp_path / "flight.tlog")
    assert frames > 0
    assert problems == []
    assert log_metadata(tmp_path / "flight.mcap")["log_id"]


def test_logs_take_the_next_free_name(tmp_path: Path) -> None:
    old = tmp_path / "flight.mcap"
    old.write_text("yesterday's")
    paths = []
    for _ in range(3):
        with FlightRecorder(tmp_path / "flight.mcap", {}) as recorder:
            paths.append(recorder.path.name)
    assert paths == ["flight-2.mcap", "flight-3.mcap", "flight-4.mcap"]
    assert old.read_text() == "yesterday's"
    assert len(list(tmp_path.iterdir())) == 4


def test_logs_make_their_directory(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "a" / "b" / "flight.mcap", {}) as recorder:
        assert recorder.path.is_file()


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("file/flight.mcap", "File exists"),
        ("file/sub/flight.mcap", "Not a directory"),
        ("/proc/flight.mcap", "No such file or directory"),
        ("x" * 300 + ".mcap", "File name too long"),
    ],
)
def test_a_log_that_cannot_be_begun_is_one_error(tmp_path: Path, path: str, reason: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LogFileError, match=f"flight log cannot be written: {reason}"):
        FlightRecorder(tmp_path / path, {})
    assert len(list(tmp_path.iterdir())) == 1


def test_a_log_file_that_cannot_be_written_is_refused(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    settings["log_file"] = "onboard.yaml/flight.mcap"
    assert "flight log cannot be written" in refused(tmp_path, settings)


def test_metrics_are_served_only_where_that_is_meant(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    port = free_port()
    settings["metrics"] = {"listen": f"127.0.0.1:{port}"}
    with running(tmp_path, settings):
        assert f"metrics: http://127.0.0.1:{port}/metrics" in (tmp_path / SAID).read_text()
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20.0) as answer:
            text = answer.read().decode()
        assert 'clearway_phase{clearway_phase="standby"} 1.0' in text
        assert "clearway_tick_duration_seconds_count" in text
        url = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
        other = {"mavlink": {"url": url}, "zenoh": {"listen": [f"tcp/127.0.0.1:{free_port()}"]}}
        said = refused(tmp_path, settings | other | {"log_file": "second.mcap"})
        assert not (tmp_path / "second.mcap").exists(), "it leaves no log"
        assert f"metrics.listen = 127.0.0.1:{port}: Address already in use" in said


@pytest.mark.parametrize("listen", ["9464", "127.0.0.1", "127.0.0.1:0", "::1:9464", "a:99999"])
def test_an_address_of_metrics_that_is_none_is_one_error(
    tmp_path: Path, settings: dict[str, Any], listen: str
) -> None:
    settings["metrics"] = {"listen": listen}
    assert f"metrics.listen = '{listen}'" in refused(tmp_path, settings)


def test_it_starts_without_any_zenoh_peer(tmp_path: Path, settings: dict[str, Any]) -> None:
    settings["zenoh"] = {"connect": [f"tcp/127.0.0.1:{free_port()}"]}
    with running(tmp_path, settings) as daemon:
        assert daemon.poll() is None


def test_contract_is_served_with_its_hash(tmp_path: Path, settings: dict[str, Any]) -> None:
    contract = load_contract(CONFIG / "default_contract.yaml")
    with running(tmp_path, settings), neighbour(settings) as session:
        reply = next(iter(session.get("clearway/v1/contract", timeout=5.0)))
        assert reply.ok is not None
        answer = json.loads(reply.ok.payload.to_bytes())
    assert answer["sha256"] == contract.sha256
    assert answer["contract"]["vehicle"]["cruise_speed_mps"] == 2.8


def test_garbage_on_both_sides_is_counted_and_survived(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    _, _, port = settings["mavlink"]["url"].rpartition(":")
    with (
        running(tmp_path, settings) as daemon,
        neighbour(settings) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
    ):
        statuses = session.declare_subscriber("clearway/v1/status")
        autopilot.connect(("127.0.0.1", int(port)))
        expected = ("frames_malformed", "mavlink_garbage_bytes")
        counted: set[str] = set()
        deadline_s = time.monotonic() + 60.0
        while not counted.issuperset(expected) and time.monotonic() < deadline_s:
            session.put("clearway/v1/obstacles", b"\xff not a frame")
            autopilot.send(b"\x00\x01 not MAVLink")
            dropped = json.loads(statuses.recv().payload.to_bytes())["dropped"]
            counted = {name for name, count in dropped.items() if count > 0}
        assert counted == set(expected)
        assert daemon.poll() is None


def test_a_full_disk_is_said_and_survived(tmp_path: Path, settings: dict[str, Any]) -> None:
    (tmp_path / settings["log_file"]).symlink_to("/dev/full")
    with running(tmp_path, settings) as daemon, neighbour(settings) as session:
        # The event is said once, perhaps before we listen; the status says it again and again.
        statuses = session.declare_subscriber("clearway/v1/status")
        ended = [json.loads(statuses.recv().payload.to_bytes())["log_ended"] for _ in range(5)]
        assert ended[-1] is True
        assert daemon.poll() is None
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(timeout=60.0) == 0
    said = (tmp_path / SAID).read_text()
    for line in ("the flight log ends here: [Errno 28]", "flying on without a log: [Errno 28]"):
        assert said.count(line) == 1
    assert said.count("[Errno 28]") == 2
    assert "Traceback" not in said


def test_a_disk_that_is_full_only_at_the_end_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "flight.mcap").symlink_to("/dev/full")
    with FlightRecorder(tmp_path / "flight.mcap", {}):
        pass
    assert "the flight log ends here: [Errno 28]" in caplog.text


@pytest.mark.parametrize("allowed", [True, False])
def test_another_mission_is_taken_only_where_that_is_meant(
    tmp_path: Path, settings: dict[str, Any], *, allowed: bool
) -> None:
    settings["accept_mission_updates"] = allowed
    with running(tmp_path, settings), neighbour(settings) as session:
        statuses = session.declare_subscriber("clearway/v1/status")
        counted = []
        for _ in range(5):
            session.put("clearway/v1/mission", b"not a mission")
            counted.append(json.loads(statuses.recv().payload.to_bytes())["dropped"])
    assert (counted[-1]["missions_malformed"] > 0) is allowed


def test_autopilot_hears_a_heartbeat_of_component_196(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(60.0)
        settings["mavlink"]["url"] = f"udpout://127.0.0.1:{autopilot.getsockname()[1]}"
        with running(tmp_path, settings):
            data = autopilot.recv(2048)
    (message,) = mavlink.MAVLink(None).parse_buffer(data)
    assert message.get_type() == "HEARTBEAT"
    assert message.get_srcComponent() == mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE


def test_collections_walk_nothing_that_start_up_left(
    tmp_path: Path, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    frozen = []

    async def serve(*_: object) -> None:
        frozen.append(gc.get_freeze_count())

    monkeypatch.setattr("onboard.daemon._serve", serve)
    config = load_yaml(write(tmp_path, settings), DaemonConfig)
    contract = load_yaml(Path(settings["contract"]), Contract)
    mission = load_yaml(Path(settings["mission"]), Mission)
    try:
        place = LogPlace(tmp_path / "flight.mcap")
        asyncio.run(run(config, contract, mission, place, DaemonKeys()))
    finally:
        gc.unfreeze()
    assert frozen[0] > 10_000
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_it_runs_before_others_where_that_is_allowed(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    with running(tmp_path, settings) as daemon:
        policy = os.sched_getscheduler(daemon.pid)
    assert policy == (os.SCHED_RR if os.geteuid() == 0 else os.SCHED_OTHER)


@pytest.mark.parametrize("middleware", ["rmw_zenoh", "zenoh-bridge-ros2dds"])
def test_a_ros_2_lidar_is_heard_as_its_middleware_publishes_it(
    tmp_path: Path, settings: dict[str, Any], middleware: str
) -> None:
    lidar = {"kind": "laserscan", "name": "lidar", "topic": "/scan", "middleware": middleware}
    settings["sources"] = [lidar | {"range_m": 12.0, "uncertainty_m": 0.05}]
    ground_port = free_port(socket.SOCK_DGRAM)
    settings["outputs"] = {
        "obstacle_distance": {"url": f"udpout://127.0.0.1:{ground_port}"},
        "markers": {"topic": "/drawn", "middleware": middleware},
    }
    key, attached = "scan", None
    if middleware == "rmw_zenoh":
        key, attached = "0/scan/sensor_msgs::msg::dds_::LaserScan_/" + HASH, attachment()
    _, _, port = settings["mavlink"]["url"].rpartition(":")
    vehicle = Autopilot()
    with (
        running(tmp_path, settings),
        neighbour(settings) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground,
    ):
        ground.bind(("127.0.0.1", ground_port))
        statuses = session.declare_subscriber("clearway/v1/status")
        drawn = session.declare_subscriber("**/drawn/**")
        autopilot.connect(("127.0.0.1", int(port)))
        heard: dict[str, Any] = {"lidar": {"age_s": None}}
        deadline_s = time.monotonic() + 60.0
        while heard["lidar"]["age_s"] is None and time.monotonic() < deadline_s:
            autopilot.send(vehicle.heartbeat(0, armed=False))
            autopilot.send(vehicle.attitude())
            autopilot.send(vehicle.position(0.0))
            scan = scan_all_round([5.0] * 360, stamp_unix_s=time.time())
            session.put(key, scan, attachment=attached)
            heard = json.loads(statuses.recv().payload.to_bytes())["sensors"]
        assert set(heard) == {"lidar"}
        assert heard["lidar"]["age_s"] < 5.0
        check_ground(ground)
        check_markers(session, drawn.recv(), bridged=middleware != "rmw_zenoh")


def check_ground(ground: socket.socket) -> None:
    """Check that a ground station gets the obstacles in use from component 196."""
    ground.settimeout(20.0)
    codec, kinds = mavlink.MAVLink(None), set()
    while "OBSTACLE_DISTANCE" not in kinds:
        for message in codec.parse_buffer(ground.recv(4096)) or []:
            kinds.add(message.get_type())
            assert message.get_srcComponent() == 196
    assert kinds <= {"HEARTBEAT", "OBSTACLE_DISTANCE"}


def check_markers(session: zenoh.Session, sample: zenoh.Sample, *, bridged: bool) -> None:
    """Check that markers come, and that ROS 2 sees who publishes them."""
    assert CdrReader(sample.payload.to_bytes()).u32() >= 1
    if bridged:
        assert (str(sample.key_expr), sample.attachment) == ("drawn", None)
        return
    assert sample.attachment is not None
    assert len(decode_attachment(sample.attachment.to_bytes()).publisher) == 16
    replies = session.liveliness().get("@ros2_lv/**", timeout=20.0)
    tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
    (found,) = (each for each in map(parse_publisher, tokens) if each is not None)
    assert (found.topic, found.type_name) == ("/drawn", "visualization_msgs/MarkerArray")
    assert str(sample.key_expr).endswith(found.type_hash)


def test_a_source_that_is_not_stated_rightly_is_one_error(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    settings["sources"] = [
        {"kind": "laserscan", "name": "lidar", "topic": "/scan", "range_m": -1.0}
    ]
    said = refused(tmp_path, settings)
    assert "sources.0.laserscan.range_m [m] = -1.0" in said
    assert "sources.0.laserscan.uncertainty_m [m] is missing" in said
