"""`clearway sensor check`: what it prints, by a scripted observer and once over Zenoh."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs_tools.sensors import command
from gcs_tools.sensors.command import print_check
from gcs_tools.sensors.observation import SensorObserver
from onboard.files.daemon_config import DaemonConfig
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.perception.ros2.graph import publisher_token
from onboard.recording.messages import SensorRecord, StateRecord, as_json
from onboard.zenoh_session import open_session
from tests.gcs_tools.running import Clearway
from tests.gcs_tools.sensors.observers import KNOWN, config, observer, scan, send
from tests.onboard.perception.ros2.encoding import attachment
from tests.sitl.process import free_port

LIDAR = config("laserscan", no_return_is_free_to_m=8.0)


def seen_by(of: DaemonConfig) -> SensorObserver:
    seen = observer(of)
    send(seen, *(scan(number / 10.0) for number in range(5)))
    return seen


def test_a_sensor_is_shown_with_a_picture(capsys: pytest.CaptureFixture[str]) -> None:
    assert print_check(LIDAR, seen_by(LIDAR), form="text")
    out = capsys.readouterr().out
    for words in (
        "ok       laserscan (laserscan, 0/scan/sensor_msgs::msg::dds_::LaserScan_/**)",
        "5 messages, 10.0 Hz, of 00000000",
        "stamps    0.020 to 0.020 s old on arrival, frame_id laser",
        "10.0 m far, 360° wide",
        "nearest   4.9",
        "without telemetry, the vehicle counts as standing level",
    ):
        assert words in out
    picture = [line for line in out.splitlines() if set(line.strip()) <= set("#.^ ") and line]
    assert len(picture) == 21
    assert "#" in picture[5]  # 5 m ahead
    assert "^" in picture[10]
    assert "." in picture[10]


def test_a_sensor_that_delivers_nothing_is_shown_with_its_cure(
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen = observer(LIDAR)
    send(seen, scan(0.0)[:40])
    seen.receive_status({"laserscan": SensorRecord(refused={"truncated": 7})})
    assert not print_check(LIDAR, seen, form="text")
    out = capsys.readouterr().out
    for words in (
        "NOTHING  laserscan",
        "dropped   1: truncated",
        "daemon    never heard; dropped: 7 truncated",
        "all 1 messages were dropped",
        "-> its driver sends what is no valid message",
    ):
        assert words in out


def test_json_for_programs(capsys: pytest.CaptureFixture[str]) -> None:
    assert print_check(LIDAR, seen_by(LIDAR), form="json")
    (sensor,) = json.loads(capsys.readouterr().out)["sensors"]
    assert (sensor["name"], sensor["kind"], sensor["delivers"]) == ("laserscan", "laserscan", True)
    assert (sensor["messages"], sensor["frames"], sensor["refused"]) == (5, 5, {})
    assert sensor["nearest_m"] == pytest.approx(5.0, abs=0.1)
    assert sensor["stamp_age_max_s"] == pytest.approx(0.02)
    assert print_check(config(), observer(config()), form="json") is False
    (sensor,) = json.loads(capsys.readouterr().out)["sensors"]
    assert (sensor["kind"], sensor["rate_hz"], sensor["nearest_m"]) == (None, 0.0, None)


def test_the_arguments(monkeypatch: pytest.MonkeyPatch, clearway: Clearway) -> None:
    calls: list[tuple[Any, ...]] = []

    def check_sensors(*arguments: Any, form: str) -> bool:
        calls.append((*arguments, form))
        return len(calls) == 1

    monkeypatch.setattr(command, "check_sensors", check_sensors)
    assert clearway("sensor", "check").code == 0
    assert clearway("sensor", "check", "a.yaml", "--for", "2", "--format", "json").code == 1
    assert calls == [(Path("onboard.yaml"), 5.0, "text"), (Path("a.yaml"), 2.0, "json")]


class Robot:
    """A daemon that has the ports of a file, and ROS 2 beside it: a scan and a second topic.

    Args:
        listen: endpoint of the daemon.
        link: its port of the vehicle's link.
    """

    def __init__(self, listen: str, link: int) -> None:
        self._listen, self._link = listen, link
        self._stop = threading.Event()

    def __enter__(self) -> None:
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken,
            open_session(ZenohEndpoints(listen=(self._listen,))) as session,
        ):
            taken.bind(("127.0.0.1", self._link))
            token = publisher_token("1", "camera", KNOWN.replace("/scan/", "/front/scan/"))
            tokens = session.liveliness().declare_token(token)
            state = StateRecord(time_s=1.0, sensors={"sectors": SensorRecord(age_s=0.05)})
            while not self._stop.wait(0.05):
                payload = scan(time.time() - 1_790_000_000.0)
                session.put(KNOWN, payload, attachment=attachment())
                session.put("clearway/vehicle/status", as_json(state))
            tokens.undeclare()  # type: ignore[no-untyped-call]  # untyped in its own stubs


def test_beside_a_daemon_over_zenoh(tmp_path: Path, clearway: Clearway) -> None:
    """The daemon has its port of Zenoh and the vehicle's link; one topic is misspelt."""
    listen, link = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}", free_port(socket.SOCK_DGRAM)
    stated = {"range_m": 10.0, "uncertainty_m": 0.1}
    document = {
        "contract": "contract.yaml", "mission": "mission.yaml",
        "zenoh": {"listen": [listen]}, "mavlink": {"url": f"udpin://127.0.0.1:{link}"},
        "sources": [
            {"kind": "laserscan", "name": "lidar", "topic": "/scan", **stated},
            {"kind": "laserscan", "name": "second", "topic": "/scna", **stated},
            {"kind": "obstacle_distance", "name": "sectors", **stated},
        ],
    }  # fmt: skip
    path = tmp_path / "onboard.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    with Robot(listen, link):
        ran = clearway("sensor", "check", path, "--for", "1.5", "--format", "json")
    assert (ran.code, ran.err) == (1, "")
    lidar, second, sectors = json.loads(ran.out)["sensors"]
    assert (lidar["delivers"], lidar["text"], lidar["frame_ids"]) == (True, "", ["laser"])
    assert 0.0 <= lidar["stamp_age_min_s"] < 1.0
    # What arrives after the last reading is counted only.
    assert 3 < lidar["messages"] - 1 <= lidar["frames"] <= lidar["messages"]
    assert lidar["refused"] == {}
    assert (second["delivers"], second["cure"]) == (False, "set topic to /front/scan")
    assert sectors["delivers"]  # the daemon says so
