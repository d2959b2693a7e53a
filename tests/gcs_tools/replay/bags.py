"""Small recordings of a lidar that moves past pillars, as rosbag2 and MCAP tools write them."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from mcap.writer import CompressionType, Writer
from zstandard import ZstdCompressor

from tests.onboard.perception.ros2.encoding import odometry, scan_all_round
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, Box, ranges_around

# Centre north, east, extents, yaw.
PILLARS: tuple[Box, ...] = ((8.0, 3.0, 1.0, 1.0, 0.0), (4.0, -3.0, 0.6, 0.6, 0.0))
SPEED_MPS = 1.0
SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"


class Message(NamedTuple):
    """One recorded message: time from the begin, topic, type as ROS 2 names it, payload."""

    time_s: float
    topic: str
    type_name: str
    payload: bytes


def drive(
    seconds: float = 3.0, *, stamp_ahead_s: float = 0.0, heading_rad: float = 0.3
) -> list[Message]:
    """Return 10 scans and 20 poses a second of a robot that drives straight ahead."""
    messages = []
    z, w = math.sin(-heading_rad / 2.0), math.cos(heading_rad / 2.0)
    for step in range(round(seconds * 20.0)):
        time_s = step / 20.0
        along_m = SPEED_MPS * time_s
        north_m, east_m = along_m * math.cos(heading_rad), along_m * math.sin(heading_rad)
        stamp_unix_s = EPOCH_UNIX_S + time_s + stamp_ahead_s
        pose = odometry(
            (north_m, -east_m, 0.3),
            (0.0, 0.0, z, w),
            stamp_unix_s=stamp_unix_s,
            velocity_mps=(SPEED_MPS, 0.0, 0.0),
        )
        messages.append(Message(time_s, "/odom", ODOMETRY, pose))
        if step % 2 == 0:
            ranges_m = ranges_around(PILLARS, (north_m, east_m), heading_rad, beams=360)
            scan = scan_all_round(ranges_m, stamp_unix_s=stamp_unix_s)
            messages.append(Message(time_s + 0.01, "/scan", SCAN, scan))
    return messages


def write_sqlite(path: Path, messages: Sequence[Message], *, compressed: bool = False) -> Path:
    """Write a file as rosbag2_storage_sqlite3 does."""
    connection = sqlite3.connect(path)
    connection.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    connection.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
        " timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
    )
    numbers: dict[str, int] = {}
    for message in messages:
        if message.topic not in numbers:
            numbers[message.topic] = len(numbers) + 1
            connection.execute(
                "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')",
                (numbers[message.topic], message.topic, message.type_name),
            )
        data = ZstdCompressor().compress(message.payload) if compressed else message.payload
        connection.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            (numbers[message.topic], _ns(message.time_s), data),
        )
    connection.commit()
    connection.close()
    return path


def write_mcap(path: Path, messages: Iterable[Message]) -> Path:
    """Write a file as rosbag2_storage_mcap does."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for message in messages:
            if message.topic not in channels:
                schema = writer.register_schema(message.type_name, "ros2msg", b"")
                channels[message.topic] = writer.register_channel(message.topic, "cdr", schema)
            time_ns = _ns(message.time_s)
            writer.add_message(channels[message.topic], time_ns, message.payload, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap left it untyped
    return path


def write_bag(
    folder: Path, *parts: Sequence[Message], compressed: bool = False, mode: str = ""
) -> Path:
    """Write a folder with metadata.yaml and a SQLite file for each part."""
    folder.mkdir()
    names = []
    for number, messages in enumerate(parts):
        name = f"{folder.name}_{number}.db3"
        write_sqlite(folder / name, messages, compressed=compressed)
        names.append(f"{folder.name}/{name}")
    information = {
        "version": 5,
        "starting_time": {"nanoseconds_since_epoch": _ns(0.0)},
        "relative_file_paths": names,
        "compression_mode": mode,
    }
    document = {"rosbag2_bagfile_information": information}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return folder


def _ns(time_s: float) -> int:
    return round((EPOCH_UNIX_S + time_s) * 1e9)
