"""Fuzz the decoders of sensor messages: ``python -m tests.tools.fuzz_sensors [--inputs N]``.

Valid messages are damaged: bits flipped, words replaced by extreme ones, parts cut out, doubled or
exchanged.  A decoder either returns a message or raises `DecodeError`, and the input of a sensor
returns frames or counts a refusal; anything else is a defect.
"""

from __future__ import annotations

import argparse
import math
import random
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.keys import decode_attachment
from onboard.perception.ros2.messages import (
    decode_detections,
    decode_laser_scan,
    decode_occupancy_grid,
    decode_range,
    decode_transforms,
)
from onboard.perception.ros2.point_cloud import decode_point_cloud
from onboard.perception.ros2.tracked_objects import decode_tracked_objects
from onboard.perception.ros2.transform_tree import TransformTree
from onboard.perception.sources.registry import MAVLINK_IDS, sensor
from onboard.perception.sources.sensor_input import SensorInput
from tests.onboard.perception.ros2.encoding import attachment, point_cloud, scan_all_round
from tests.onboard.perception.ros2.recorded import ORDERS, encoded
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, pose_at, poses_of
from tests.onboard.perception.sources.test_mavlink_ranges import distance, obstacle_distance
from tests.onboard.perception.test_sensor_channels import KINDS, source

WORDS = tuple(
    struct.pack("<I", word)
    for word in (
        0,
        1,
        0x7F,
        0xFFFF,
        0x7FFFFFFF,
        0x80000000,
        0xFFFFFFFF,
        0x7F800000,
        0x7FC00000,
        0x7F800001,
    )
)
DECODERS: dict[str, Callable[[bytes], Any]] = {
    "sensor_msgs/LaserScan": decode_laser_scan,
    "sensor_msgs/PointCloud2": decode_point_cloud,
    "sensor_msgs/Range": decode_range,
    "vision_msgs/Detection3DArray": decode_detections,
    "autoware_perception_msgs/TrackedObjects": decode_tracked_objects,
    "nav_msgs/OccupancyGrid": decode_occupancy_grid,
    "tf2_msgs/TFMessage": decode_transforms,
}


VALID: dict[str, list[bytes]] = {
    "laserscan": [
        scan_all_round([5.0, 4.0, math.inf] * 60, stamp_unix_s=EPOCH_UNIX_S),
        scan_all_round([5.0] * 90, stamp_unix_s=EPOCH_UNIX_S, time_increment_s=0.001, order=">"),
        *encoded("sensor_msgs/LaserScan", "le"),
    ],
    "pointcloud2": [
        point_cloud(np.linspace((2, -1, -1), (5, 1, 1), 40), stamp_unix_s=EPOCH_UNIX_S),
        *encoded("sensor_msgs/PointCloud2", "be"),
    ],
    "range": encoded("sensor_msgs/Range", "le"),
    "detection3d": encoded("vision_msgs/Detection3DArray", "le"),
    "tracked_objects": encoded("autoware_perception_msgs/TrackedObjects", "le"),
    "occupancygrid": encoded("nav_msgs/OccupancyGrid", "le"),
    "obstacle_distance": [obstacle_distance({3: 400, 4: 420})],
    "distance_sensor": [distance(450)],
}


def damaged(valid: bytes, draw: random.Random) -> bytes:
    """Return a message with one to four defects."""
    data = bytearray(valid)
    for _ in range(draw.randint(1, 4)):
        at = draw.randrange(len(data) + 1)
        match draw.randrange(6):
            case 0:
                if at < len(data):
                    data[at] ^= 1 << draw.randrange(8)
            case 1:
                at -= at % 4
                data[at : at + 4] = draw.choice(WORDS)
            case 2:
                del data[at:]
            case 3:
                del data[at : at + draw.randint(1, 16)]
            case 4:
                data[at:at] = data[at : at + draw.randint(1, 16)]
            case _:
                data[at:at] = draw.randbytes(draw.randint(1, 8))
    return bytes(data)


def with_checksum(frame: bytes, message_id: int) -> bytes:
    """Return a damaged MAVLink frame as one that is whole: only its fields are damaged."""
    fields = frame[10:-2][:255]
    header = bytes((0xFD, len(fields), 0, 0, 0, 1, 195)) + message_id.to_bytes(3, "little")
    extra = bytes((mavlink.mavlink_map[message_id].crc_extra,))
    checksum: int = mavlink.x25crc(header[1:] + fields + extra).crc
    return header + fields + checksum.to_bytes(2, "little")


def targets() -> Iterator[tuple[str, Callable[[bytes], Any], list[bytes]]]:
    """Yield each decoder with valid messages."""
    for type_name, decode in DECODERS.items():
        yield type_name, decode, [one for order in ORDERS for one in encoded(type_name, order)]
    yield "transform tree", mounting_of_transforms, encoded("tf2_msgs/TFMessage", "le")
    yield "attachment", decode_attachment, [attachment()]


def mounting_of_transforms(payload: bytes) -> None:
    """Take transforms as a sensor that they mount does, and look a pose up."""
    tree = TransformTree()
    tree.add(decode_transforms(payload))
    for frame in sorted(tree.frames):
        tree.pose(frame, "base_link")
        tree.root_of(frame)


def inputs_of_sensors() -> Iterator[tuple[str, Callable[[bytes], Any], list[bytes]]]:
    """Yield the whole way of each kind of message, from bytes to frames, with valid messages."""
    for kind in KINDS:
        keys: dict[str, Any] = {
            "mounting": {"x_m": 0.1, "pitch_deg": 3.0},
            # A tracker shows nothing free.
            "no_return_is_free_to_m": None if kind == "tracked_objects" else 8.0,
        }
        reader = sensor(source(kind, **keys), poses_of(pose_at())).input

        assert reader.read(VALID[kind][0], EPOCH_UNIX_S + 0.3)  # the first one says whose it is
        message_id = MAVLINK_IDS.get(kind)

        def read(
            payload: bytes, reader: SensorInput = reader, message_id: int | None = message_id
        ) -> None:
            before = reader.malformed
            if message_id is not None:
                payload = with_checksum(payload, message_id)
            if not reader.read(payload, EPOCH_UNIX_S + 0.3):
                reason = "no frame" if reader.malformed == before else "refused"
                raise DecodeError(reason)

        yield f"input {kind}", read, VALID[kind]


def fuzz(
    inputs: int,
    seed: int,
    chosen: Iterable[tuple[str, Callable[[bytes], Any], list[bytes]]] | None = None,
) -> Counter[str]:
    """Feed damaged messages to every decoder; return how many it decoded and refused."""
    found: Counter[str] = Counter()
    for name, decode, valid in targets() if chosen is None else chosen:
        draw = random.Random(f"{name} {seed}")
        for _ in range(inputs):
            try:
                decode(damaged(draw.choice(valid), draw))
                found[f"{name} decoded"] += 1
            except DecodeError as error:
                found[f"{name} refused"] += 1
                found[f"{name}: {error.reason}"] += 1
    return found


def main() -> int:
    """Fuzz, and print what came of it; an exception is the finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="for each decoder")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    found = fuzz(options.inputs, options.seed)
    # A frame takes a hundred times as long.
    found += fuzz(options.inputs // 10, options.seed, inputs_of_sensors())
    for what, count in sorted(found.items()):
        print(f"{count:9d}  {what}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
