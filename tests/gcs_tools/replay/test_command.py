"""`clearway replay`: what the daemon sees of a recording, against where the pillars stood."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs_tools.logs.flight_log import read_log
from gcs_tools.replay.poses import Telemetry
from gcs_tools.replay.run import _GAP_MAX_S
from onboard.files.obstacle_field import load_field
from onboard.recording.flight_log import FlightLog
from tests.gcs_tools.replay.bags import (
    PILLARS,
    SCAN,
    Message,
    drive,
    write_bag,
    write_mcap,
    write_sqlite,
)
from tests.gcs_tools.running import CONFIG, Clearway
from tests.onboard.perception.ros2.encoding import transforms
from tests.onboard.perception.sources.test_mavlink_ranges import obstacle_distance

LEVEL = (0.0, 0.0, 0.0, 1.0)


def seen(clearway: Clearway, path: Path, *options: object, code: int = 0) -> dict[str, Any]:
    ran = clearway("replay", path, "--format", "json", *options)
    assert (ran.code, ran.err) == (code, "")
    document: dict[str, Any] = json.loads(ran.out)
    return document


def check_places(path: Path) -> None:
    """Check that a field has the pillars where they stood."""
    field = load_field(path)
    assert len(field) == len(PILLARS)
    for north_m, east_m, *_ in PILLARS:
        off_m = abs(field.center_ned_m - (north_m, east_m)).max(axis=1)
        assert off_m.min() < 0.2  # the faces behind are never seen


def test_pillars_are_where_they_stood(clearway: Clearway, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", drive(1.5), drive(3.0)[len(drive(1.5)) :])
    field = tmp_path / "field.yaml"
    document = seen(clearway, bag, "-o", field)
    assert (document["poses"], document["pose_topic"]) == (60, "/odom")
    sensor = document["sensors"]["scan"]
    assert (sensor["messages"], sensor["frames"], sensor["refused"]) == (30, 30, {})
    assert sensor["rate_hz"] == pytest.approx(10.0)
    assert (sensor["obstacles_min"], sensor["obstacles_max"]) == (2, 2)
    assert 0.0 < sensor["latency_max_s"] < 0.05
    assert sensor["violations"] == ["detection_range (scan): 10.00, limit 15.00 m"]
    assert document["obstacles"] == 2
    check_places(field)


def test_a_flight_log_and_stems_are_written(clearway: Clearway, tmp_path: Path) -> None:
    recording = write_mcap(tmp_path / "a.mcap", drive(1.0))
    for name in ("log.mcap", "again.mcap", "stems.csv"):
        ran = clearway("replay", recording, "-o", tmp_path / name)
        assert (ran.code, ran.err) == (0, "")
    for words in ("10 messages, 10.0 Hz, 10 frames", "20 of /odom", "2 obstacles at the end"):
        assert words in ran.out
    assert (tmp_path / "log.mcap").read_bytes() == (tmp_path / "again.mcap").read_bytes()
    log = read_log(tmp_path / "log.mcap")
    assert {state.phase for state in log.states} == {"standby"}
    assert len(log.obstacles[-1].obstacles) == 2
    assert len(load_field(tmp_path / "stems.csv")) == 2


def test_a_robot_at_rest_needs_no_poses(clearway: Clearway, tmp_path: Path) -> None:
    scans = [each for each in drive(1.0) if each.type_name == SCAN]
    document = seen(clearway, write_mcap(tmp_path / "a.mcap", scans))
    assert (document["pose_topic"], document["poses"]) == (None, 0)
    assert document["sensors"]["scan"]["frames"] == 10
    bag = write_sqlite(tmp_path / "a.db3", drive(1.0))
    assert seen(clearway, bag, "--pose", "none")["pose_topic"] is None


def test_stamps_of_another_clock(clearway: Clearway, tmp_path: Path) -> None:
    recording = write_sqlite(tmp_path / "a.db3", drive(1.0, stamp_ahead_s=-1e9))
    sensor = seen(clearway, recording, code=1)["sensors"]["scan"]
    assert (sensor["frames"], sensor["latency_max_s"]) == (0, None)
    assert sum(sensor["refused"].values()) == 10
    assert "no pose at its stamp" in sensor["refused"]
    assert "stamps of another clock: --align-clock" in clearway("replay", recording).out
    sensor = seen(clearway, recording, "--align-clock")["sensors"]["scan"]
    assert sensor["frames"] >= 9  # the first scan may come before the first pose


def test_a_pause_in_the_recording_is_not_waited_for(clearway: Clearway, tmp_path: Path) -> None:
    later = [each._replace(time_s=each.time_s + 5000.0) for each in drive(0.5)]
    shifted = drive(0.5, stamp_ahead_s=5000.0)
    later = [one._replace(payload=other.payload) for one, other in zip(later, shifted, strict=True)]
    document = seen(clearway, write_sqlite(tmp_path / "a.db3", [*drive(0.5), *later]))
    assert document["duration_s"] < 2.0 + _GAP_MAX_S
    assert document["sensors"]["scan"]["frames"] == 10


def test_sources_and_contract_of_a_daemon_s_file(clearway: Clearway, tmp_path: Path) -> None:
    """Mounted by the transforms of the recording; a second sensor is not in it."""
    for name in ("px4_contract.yaml", "default_mission.yaml"):
        shutil.copy(CONFIG / name, tmp_path / name)
    stated = {"range_m": 12.0, "uncertainty_m": 0.1}
    lidar = {"kind": "laserscan", "name": "front", "topic": "/scan", **stated}
    sources = [
        lidar | {"mounting": {"tf_topic": "/tf_static"}},
        lidar | {"name": "rear", "topic": "/rear"},
    ]
    config = tmp_path / "onboard.yaml"
    document = {"contract": "px4_contract.yaml", "mission": "default_mission.yaml"}
    config.write_text(yaml.safe_dump(document | {"sources": sources}), encoding="utf-8")
    static = transforms(("base_link", "laser", (0.0, 0.0, 0.1), LEVEL))
    first = Message(0.0, "/tf_static", "tf2_msgs/msg/TFMessage", static)
    bag = write_sqlite(tmp_path / "a.db3", [first, *drive(1.0)])
    field = tmp_path / "field.yaml"
    found = seen(clearway, bag, "--daemon-config", config, "-o", field, code=1)
    assert found["sensors"]["front"]["frames"] == 10
    assert found["sensors"]["rear"]["messages"] == 0
    check_places(field)


def test_ranges_in_our_own_flight_log(clearway: Clearway, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    telemetry = Telemetry(1)
    with FlightLog(path, {}) as log:
        for step in range(20):
            log.write_mavlink("received", 1.79e9 + step * 0.05, telemetry.heartbeat())
            log.write_mavlink("received", 1.79e9 + step * 0.05, telemetry.at_rest(step * 0.05))
            sectors = obstacle_distance({0: 400, 1: 400})
            log.write_mavlink("received", 1.79e9 + step * 0.05 + 0.01, sectors)
    sensor = seen(clearway, path)["sensors"]["obstacle_distance"]
    assert sensor["frames"] > 15
    assert sensor["obstacles_max"] == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--pose", "/odometry"),
            "--pose /odometry: is not in the recording; expected one of: /od",
        ),
        (("--pose", "/scan"), "carries sensor_msgs/LaserScan"),
        (("-o", "a.txt"), "a.txt: expected a name that ends in .mcap, .yaml or .csv"),
        (("-o", "no/such/a.yaml"), "cannot be written"),
        (("-o", "no/such/a.mcap"), "cannot be written"),
        (("--range", "500"), "range_m [m] = 500"),
    ],
)
def test_mistakes(clearway: Clearway, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    recording = write_sqlite(tmp_path / "a.db3", drive(0.5))
    ran = clearway("replay", recording, *options)
    assert (ran.code, ran.out) == (2, "")
    assert words in ran.err
    assert ran.err.count("\n") == 1


def test_a_recording_without_a_sensor(clearway: Clearway, tmp_path: Path) -> None:
    poses = [each for each in drive(0.5) if each.type_name != SCAN]
    ran = clearway("replay", write_mcap(tmp_path / "a.mcap", poses))
    assert ran.code == 2
    assert "no topic of a sensor that can be read: /odom (nav_msgs/Odometry)" in ran.err
    ran = clearway("replay", write_mcap(tmp_path / "b.mcap", []))
    assert ran.code == 2
    path = write_mcap(tmp_path / "c.mcap", drive(0.5))
    ran = clearway("replay", path, "-o", path)
    assert "would overwrite the recording" in ran.err
    assert ran.code == 2
