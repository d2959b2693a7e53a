"""Each reason why a vehicle sees nothing is one sentence with its cure."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.sensors.command import _facts
from gcs_tools.sensors.diagnosis import Diagnosis, diagnose
from gcs_tools.sensors.observation import SensorObserver
from onboard.files.daemon_config import DaemonConfig
from onboard.perception.ros2.graph import Publisher
from onboard.perception.ros2.keys import TYPE_HASHES
from onboard.recording.messages import SensorRecord
from tests.gcs_tools.sensors.observers import KEY, config, observer, scan, send
from tests.onboard.perception.messages import frame
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S
from tests.onboard.perception.sources.test_mavlink_ranges import distance, obstacle_distance
from tests.onboard.perception.sources.test_traffic import origin, position

LIDAR = config("laserscan")
SCAN = "sensor_msgs/LaserScan"
HASH = "RIHS01_" + TYPE_HASHES[SCAN][0]


def json_frame(**changes: Any) -> bytes:
    return json.dumps(frame(**changes)).encode()


def only(of: DaemonConfig, seen: SensorObserver) -> Diagnosis:
    (found,) = diagnose(of, seen)
    return found


def check(found: Diagnosis, text: str, cure: str, *, delivers: bool = False) -> None:
    assert (text in found.text, cure in found.cure, found.delivers) == (True, True, delivers), found


def test_a_sensor_that_delivers_has_no_fault() -> None:
    seen = observer(LIDAR)
    send(seen, *(scan(number / 10.0) for number in range(5)))
    assert only(LIDAR, seen) == Diagnosis("laserscan", delivers=True)
    heard = seen.heard["laserscan"]
    assert heard.rate_hz == pytest.approx(10.0)
    assert heard.frame_ids == {"laser"}
    assert heard.ahead_s == pytest.approx([-0.02] * 5, abs=1e-6)
    assert heard.publishers == {"00" * 16}
    assert len(heard.frames) == 5


# ---------------------------------------------------------------------------- all is dropped


@pytest.mark.parametrize(
    ("keys", "payload", "text", "cure"),
    [
        ({"key": KEY + "RIHS01_00"}, scan(0.0), "unknown hash of the type", "Humble, Jazzy"),
        ({"key": KEY.replace("LaserScan", "Image") + "x"}, scan(0.0), "another type", "kind"),
        ({}, scan(0.0)[:50], "truncated", "no valid message"),
        ({}, b"PCAP" + bytes(40), "not plain CDR", "middleware"),
        ({}, scan(-7.5), "its stamps are 7.5 s behind this computer's clock", "chrony"),
        ({}, scan(3.0), "its stamps are 3.0 s ahead of this computer's clock", "chrony"),
        ({}, scan(0.0, range_m=0.0), "mostly blind", "uncover"),
        ({}, scan(0.0, angle_increment_rad=0.0), "angle increment", "update it"),
    ],
)
def test_messages_that_are_all_dropped(
    keys: dict[str, Any], payload: bytes, text: str, cure: str
) -> None:
    seen = observer(LIDAR)
    send(seen, payload, **keys)
    check(only(LIDAR, seen), text, cure)
    assert only(LIDAR, seen).text.startswith("all 1 messages were dropped")


def test_another_frame_id_names_both() -> None:
    of = config("laserscan", frame_id="front_laser")
    seen = observer(of)
    send(seen, scan(0.0, frame_id="base_laser"))
    check(only(of, seen), "they name base_laser, the file says front_laser", "set frame_id")


def test_a_mounting_that_no_transform_tells() -> None:
    of = config("laserscan", mounting={"tf_topic": "/tf_static"})
    seen = observer(of)
    send(seen, scan(0.0))
    check(only(of, seen), "mounting not known yet", "publish the transform from base_frame")


# ---------------------------------------------------------------------------- some of it is


def test_a_sensor_that_delivers_but_not_all() -> None:
    seen = observer(LIDAR)
    send(seen, scan(0.0), scan(0.1)[:50], scan(0.2))
    check(only(LIDAR, seen), "1 of 3 messages were dropped: truncated", "update", delivers=True)


def test_two_publishers() -> None:
    seen = observer(LIDAR)
    send(seen, scan(0.0))
    send(seen, scan(0.0), by=b"x" * 16)
    check(only(LIDAR, seen), "two publishers", "stop one", delivers=True)


def test_a_clock_that_is_a_little_behind() -> None:
    seen = observer(LIDAR)
    send(seen, scan(-1.5))
    check(only(LIDAR, seen), "1.52 s behind this computer's clock", "chrony", delivers=True)


# ---------------------------------------------------------------------------- nothing on the key


def publisher(**changes: Any) -> Publisher:
    return Publisher(0, "/scan", SCAN, HASH, "/rplidar")._replace(**changes)


@pytest.mark.parametrize(
    ("around", "text", "cure"),
    [
        ({"keys": {"scan"}}, "comes by zenoh-bridge-ros2dds", "middleware: zenoh-bridge-ros2dds"),
        ({"keys": {KEY.replace("0/", "7/", 1) + HASH}}, "in ROS domain 7", "domain_id: 7"),
        ({"keys": {KEY.replace("LaserScan", "Image") + HASH}}, "another type", "kind"),
        ({"keys": {"0/front/" + KEY[2:] + HASH}}, "but on 0/front/scan", "set topic"),
        ({"publishers": {publisher(topic="/front/scan")}}, "is on /front/scan", "/front/scan"),
        ({"publishers": {publisher(type_name="sensor_msgs/Image")}}, "carries sensor_msgs/Image",
         "kind"),
        ({"publishers": {publisher(domain=4)}}, "in ROS domain 4", "domain_id: 4"),
        ({"publishers": {publisher(type_hash="RIHS01_00")}}, "another definition", "Humble"),
        ({"publishers": {publisher()}}, "/rplidar announces, was silent", "ros2 topic hz"),
        ({"peers": 1}, "nothing is published on /scan", "start the driver"),
        ({}, "no Zenoh peer or router has joined", "rmw_zenohd"),
    ],
)  # fmt: skip
def test_nothing_on_the_key(around: dict[str, Any], text: str, cure: str) -> None:
    seen = observer(LIDAR)
    for name, value in around.items():
        setattr(seen.around, name, value)
    check(only(LIDAR, seen), text, cure)


def test_a_bridge_is_named_where_rmw_zenoh_publishes() -> None:
    of = config("laserscan", middleware="zenoh-bridge-ros2dds")
    seen = observer(of)
    seen.receive_stray(KEY + HASH)
    check(only(of, seen), "comes by rmw_zenoh", "middleware: rmw_zenoh")


def test_strays_are_bounded() -> None:
    seen = observer(LIDAR)
    for number in range(1000):
        seen.receive_stray(f"{number}/scan")
        seen.receive_json(f"v{number}", b"", 0.0)
    assert len(seen.around.keys) == len(seen.around.vehicles) == 100


def test_json_under_the_name_of_a_sensor() -> None:
    seen = observer(LIDAR)
    seen.receive_json("vehicle", json_frame(source="laserscan"), 0.0)
    check(only(LIDAR, seen), "JSON detections under its name", "another name")


def test_a_daemon_that_hears_it_is_believed() -> None:
    of = config("obstacle_distance")
    seen = observer(of)
    seen.around.link_problem = "udpin://0.0.0.0:14540: address already in use"
    check(only(of, seen), "address already in use", "stop the daemon")
    seen.receive_status({})
    check(only(of, seen), "the daemon has the vehicle's link, and has read no OBSTACLE", "stop")
    seen.receive_status({"obstacle_distance": SensorRecord(age_s=0.1)})
    assert only(of, seen) == Diagnosis("obstacle_distance", delivers=True)


# ---------------------------------------------------------------------------- MAVLink


def heartbeat(system: int) -> bytes:
    autopilot = mavlink.MAVLink(None, system, 1)
    packed: bytes = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(autopilot)
    return packed


@pytest.mark.parametrize(
    ("data", "text", "cure"),
    [
        (b"", "the vehicle's link is silent", "wiring"),
        (heartbeat(1), "is heard, but sends no OBSTACLE_DISTANCE", "PRX1_TYPE"),
        (heartbeat(9), "only other systems", "mavlink.system_id"),
        (bytes(range(1, 200)), "no MAVLink", "baud rate"),
    ],
)
def test_nothing_on_the_vehicle_s_link(data: bytes, text: str, cure: str) -> None:
    of = config("obstacle_distance")
    seen = observer(of)
    seen.receive_mavlink(data, 0.1)
    check(only(of, seen), text, cure)


def test_ranges_on_the_vehicle_s_link() -> None:
    of = config("obstacle_distance", "distance_sensor")
    seen = observer(of)
    seen.receive_mavlink(obstacle_distance({3: 400}), 0.1)
    seen.receive_mavlink(distance(450, orientation=mavlink.MAV_SENSOR_ROTATION_PITCH_270), 0.1)
    seen.tick(0.12)
    sectors, beam = diagnose(of, seen)
    assert sectors == Diagnosis("obstacle_distance", delivers=True)
    check(beam, "1 messages arrived, of sensors that look down", "orientation 0")
    assert not seen.has_telemetry


# ---------------------------------------------------------------------------- JSON


def test_detections_as_json() -> None:
    of = config()
    seen = observer(of)
    check(only(of, seen), "the file has no `sources`; no Zenoh peer", "zenoh.listen")
    seen.receive_json("other", json_frame(), 0.0)
    check(only(of, seen), "but on clearway/other/obstacles", "set vehicle: other")
    seen.receive_json("vehicle", b"{}", 0.0)
    check(only(of, seen), "1 frames are malformed", "Publish detections")
    seen.malformed_json.clear()
    seen.receive_json("vehicle", json_frame(stamp_unix_s=EPOCH_UNIX_S), 0.02)
    assert only(of, seen) == Diagnosis("front", delivers=True)


def test_other_vehicles_that_say_nothing_are_no_fault_but_a_missing_origin_is() -> None:
    of = config(
        "traffic", messages=["global_position_int"], mover_class="drone", latency_s=0.5,
        accuracy_m=5.0,
    )  # fmt: skip
    seen = observer(of)
    check(only(of, seen), "link is silent", "mavlink.url")
    seen.receive_mavlink(heartbeat(1), 0.1)
    check(only(of, seen), "no other vehicle reports itself", "", delivers=True)
    seen.receive_mavlink(position(3.0, 4.0), 0.2)
    seen.tick(0.2)
    check(only(of, seen), "local origin not known yet", "GPS_GLOBAL_ORIGIN")
    seen.receive_mavlink(origin() + position(3.0, 4.0), 0.3)
    seen.tick(0.3)
    check(only(of, seen), "", "", delivers=True)
    (report,) = seen.heard["traffic"].frames
    assert report.obstacles[0].id == "system-7"
    assert (
        "1 movers, within 10 m; shows nothing free"
        in dict(_facts(seen.heard["traffic"]))["reports"]
    )
    # The origin is no report.
    assert len(seen.heard["traffic"].arrivals_s) == 2
