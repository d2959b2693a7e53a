"""Messages of several sensors: bounded, checked by where they come from, refused by name."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.sensor_sources import AnySource
from onboard.perception.detection import MAX_PENDING_FRAMES
from onboard.perception.intake import DetectionCounters, Refusal
from onboard.perception.ros2.keys import TYPE_HASHES
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.registry import (
    LARGE_PENDING_MAX,
    TRAFFIC_PENDING_MAX,
    zenoh_key,
)
from tests.onboard.perception.ros2.encoding import attachment, point_cloud, scan_all_round
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, pose_at, poses_of
from tests.onboard.perception.sources.test_mavlink_ranges import distance, obstacle_distance

KEY = "0/scan/sensor_msgs::msg::dds_::LaserScan_/"
KNOWN, HUMBLE = (
    KEY + "RIHS01_" + TYPE_HASHES["sensor_msgs/LaserScan"][0],
    KEY + "TypeHashNotSupported",
)
KINDS: dict[str, dict[str, Any]] = {
    "laserscan": {"topic": "/scan"},
    "pointcloud2": {"topic": "/points", "view_deg": [90.0, 60.0]},
    "range": {"topic": "/sonar"},
    "detection3d": {"topic": "/detections", "view_deg": [90.0, 60.0]},
    "tracked_objects": {"topic": "/objects", "objects_frame": "body"},
    "occupancygrid": {"topic": "/map", "grid_frame": "body"},
    "obstacle_distance": {},
    "distance_sensor": {},
}


def source(kind: str, name: str = "", **keys: Any) -> AnySource:
    stated = {"kind": kind, "name": name or kind, "range_m": 10.0, "uncertainty_m": 0.1}
    adapter: TypeAdapter[AnySource] = TypeAdapter(AnySource)
    return adapter.validate_python(stated | KINDS.get(kind, {}) | keys)


def scan(range_m: float = 5.0) -> bytes:
    return scan_all_round(np.full(360, range_m), stamp_unix_s=EPOCH_UNIX_S)


class Bench:
    def __init__(self, *sources: AnySource) -> None:
        self.counters = DetectionCounters()
        self.channels = SensorChannels(sources, poses_of(pose_at()), self.counters)

    def sources_taken(self) -> list[str]:
        return [frame.source for frame in self.channels.take(EPOCH_UNIX_S)]


def test_scans_of_one_publisher_are_read() -> None:
    bench = Bench(source("laserscan"))
    for now_s, key in ((0.0, KNOWN), (0.1, HUMBLE)):
        bench.channels.receive("laserscan", scan(), now_s, key=key, attachment=attachment())
    assert bench.sources_taken() == ["laserscan", "laserscan"]
    assert bench.sources_taken() == []
    assert bench.channels.take_news() == []


def test_each_reason_is_counted_and_said_once() -> None:
    bench = Bench(source("laserscan", "front"))
    for now_s in (0.0, 0.1):
        bench.channels.receive("front", scan(), now_s, key=KEY + "RIHS01_00", attachment=b"")
        bench.channels.receive("front", scan()[:40], now_s, key=KNOWN, attachment=attachment())
    assert bench.sources_taken() == []
    assert bench.counters.malformed_frames == 4
    assert set(bench.channels.take_news()) == {
        Refusal("front", "unknown hash of the type"),
        Refusal("front", "truncated"),
    }
    assert bench.channels.take_news() == []
    assert bench.channels.sensors["front"].input.refused == {
        "unknown hash of the type": 2,
        "truncated": 2,
    }


def test_a_second_publisher_is_refused() -> None:
    bench = Bench(source("laserscan"))
    for publisher in (b"a" * 16, b"b" * 16):
        bench.channels.receive(
            "laserscan", scan(), 0.0, key=KNOWN, attachment=attachment(publisher)
        )
    assert len(bench.sources_taken()) == 1
    assert bench.channels.take_news() == [Refusal("laserscan", "two publishers")]


def test_a_bridge_has_neither_type_nor_attachment() -> None:
    bridged = source("laserscan", middleware="zenoh-bridge-ros2dds")
    bench = Bench(bridged)
    bench.channels.receive("laserscan", scan(), 0.0, key="scan")
    assert bench.sources_taken() == ["laserscan"]
    assert zenoh_key(bridged) == "scan"


@pytest.mark.parametrize(
    ("kind", "limit"), [("laserscan", MAX_PENDING_FRAMES), ("pointcloud2", LARGE_PENDING_MAX)]
)
def test_of_a_flood_the_oldest_are_dropped_counted_and_said(kind: str, limit: int) -> None:
    bench = Bench(source(kind, middleware="zenoh-bridge-ros2dds"))
    cloud = point_cloud(np.full((9, 3), 5.0), stamp_unix_s=EPOCH_UNIX_S)
    for _ in range(limit + 5):
        bench.channels.receive(kind, scan() if kind == "laserscan" else cloud, 0.0)
    assert bench.counters.dropped_frames == 5
    assert bench.channels.take_news() == [Refusal(kind, "comes faster than it is read")]
    taken = sum(len(bench.sources_taken()) for _ in range(limit))
    assert taken == limit


def test_of_large_messages_one_is_read_per_tick() -> None:
    bench = Bench(source("pointcloud2", middleware="zenoh-bridge-ros2dds"))
    for _ in range(2):
        cloud = point_cloud(np.full((9, 3), 5.0), stamp_unix_s=EPOCH_UNIX_S)
        bench.channels.receive("pointcloud2", cloud, 0.0)
    assert [len(bench.sources_taken()) for _ in range(3)] == [1, 1, 0]


def test_mavlink_messages_go_to_those_that_read_their_kind() -> None:
    bench = Bench(source("obstacle_distance"), source("distance_sensor"), source("laserscan"))
    for payload, message_id in ((obstacle_distance({}), 330), (distance(450), 132)):
        bench.channels.receive_mavlink(message_id, payload, 0.2)
    assert bench.sources_taken() == ["obstacle_distance", "distance_sensor"]
    assert bench.channels.mavlink_ids == {330, 132}
    assert Bench(source("laserscan")).channels.mavlink_ids == frozenset()


def test_messages_without_a_clock_are_stamped_by_their_arrival_not_by_their_reading() -> None:
    bench = Bench(source("obstacle_distance", latency_s=0.05))
    bench.channels.receive_mavlink(330, obstacle_distance({}), 0.2)
    (frame,) = bench.channels.take(EPOCH_UNIX_S)
    assert frame.stamp_unix_s == pytest.approx(EPOCH_UNIX_S + 0.15)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_reader_that_refuses_garbage(kind: str) -> None:
    bench = Bench(source(kind))
    reader = bench.channels.sensors[kind].input
    for payload in (b"", b"\x00\x01\x00\x00", b"{}", bytes(64), b"\xff" * 64):
        assert list(reader.read(payload, EPOCH_UNIX_S)) == []
    if zenoh_key(source(kind)):
        assert reader.malformed == 5


def test_many_vehicles_that_are_reported_at_once_all_wait() -> None:
    keys: dict[str, Any] = {
        "messages": ["adsb_vehicle"],
        "mover_class": "drone",
        "latency_s": 0.5,
        "accuracy_m": 5,
    }
    bench = Bench(source("traffic", **keys))
    for _ in range(TRAFFIC_PENDING_MAX):
        bench.channels.receive_mavlink(mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE, b"", 0.0)
    assert bench.counters.dropped_frames == 0
    bench.channels.receive_mavlink(mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE, b"", 0.0)
    assert bench.counters.dropped_frames == 1
