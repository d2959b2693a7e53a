"""Obstacles as visualization_msgs/MarkerArray, for RViz, Foxglove and others of ROS 2.

Boxes are in east, north, up from the origin of the autopilot's local frame, as MAVROS has it
(REP 103).  The first marker removes those of the message before.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from onboard.perception.ros2.cdr_writer import CdrWriter
from onboard.perception.ros2.keys import published_key
from onboard.recording.messages import KnownObstacle, Obstacles

TYPE_NAME: Final = "visualization_msgs/MarkerArray"
# Over Humble, Jazzy and Kilted.
TYPE_HASH: Final = "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
MARKERS_MAX: Final = 1000
_CUBE: Final = 1
_ADD: Final = 0
_DELETE_ALL: Final = 3
# Obstacles reach past the flight height; how far is not known.
_HEIGHT_M: Final = 4.0
_SIDE_MIN_M: Final = 0.01
_COLOUR: Final = (0.85, 0.3, 0.2, 0.8)
_NAMESPACE: Final = "clearway"


def markers(obstacles: Obstacles, frame_id: str) -> bytes:
    """Return the message of all obstacles.

    Args:
        obstacles: the map.
        frame_id: of the boxes.
    """
    known = [each for each in obstacles.obstacles if each.measured_ned_m][:MARKERS_MAX]
    writer = CdrWriter().u32(1 + len(known))
    stamp = math.floor(obstacles.time_s), math.floor(obstacles.time_s % 1.0 * 1e9)
    _marker(writer, stamp, frame_id, 0, None, 0.0)
    for number, each in enumerate(known):
        _marker(writer, stamp, frame_id, number + 1, each, obstacles.height_m or 0.0)
    return writer.payload()


def _marker(
    writer: CdrWriter,
    stamp: tuple[int, int],
    frame_id: str,
    number: int,
    obstacle: KnownObstacle | None,
    height_m: float,
) -> None:
    """Write one marker; without an obstacle, the one that removes all."""
    writer.i32(stamp[0]).u32(stamp[1]).text(frame_id).text(_NAMESPACE)
    writer.i32(number, _CUBE, _ADD if obstacle else _DELETE_ALL)
    if obstacle is None:
        position_m, yaw_rad, size_m = (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)
    else:
        position_m, yaw_rad, size_m = _box(obstacle, height_m)
    writer.f64(*position_m, 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0), *size_m)
    writer.f32(*_COLOUR).i32(0).u32(0)  # the lifetime: for ever
    writer.u8(0)  # not locked to the frame
    writer.u32(0, 0).text("")  # points, colours, texture
    writer.i32(0).u32(0).text("").text("").u32(0)  # the texture's image
    writer.u32(0)  # its coordinates
    writer.text(obstacle.id if obstacle else "").text("")  # text, mesh
    writer.text("").u32(0).u8(0)  # the mesh's file


def _box(
    obstacle: KnownObstacle, height_m: float
) -> tuple[tuple[float, float, float], float, tuple[float, float, float]]:
    """Return centre, yaw from east to north, and size of a box, east, north, up."""
    corners = obstacle.measured_ned_m
    north_m, east_m = (sum(corner[axis] for corner in corners) / len(corners) for axis in (0, 1))
    (n0, e0), (n1, e1), (n2, e2) = corners[0], corners[1], corners[2]
    along_m, across_m = math.hypot(n1 - n0, e1 - e0), math.hypot(n2 - n1, e2 - e1)
    size_m = (max(along_m, _SIDE_MIN_M), max(across_m, _SIDE_MIN_M), _HEIGHT_M)
    return (east_m, north_m, height_m), math.atan2(n1 - n0, e1 - e0), size_m


def markers_key(topic: str, *, bridged: bool, domain: int) -> str:
    """Return the Zenoh key to publish markers under."""
    return published_key(topic, TYPE_NAME, TYPE_HASH, bridged=bridged, domain=domain)


def attachment(sequence: int, sent_unix_s: float, publisher: bytes) -> bytes:
    """Return what rmw_zenoh expects with a sample; another layout may end the subscriber.

    Args:
        sequence: number of the message, from 1 on.
        sent_unix_s: Unix time.
        publisher: its id, 16 bytes.
    """
    sent_ns = round(sent_unix_s * 1e6) * 1000
    return struct.pack("<qqB", sequence, sent_ns, len(publisher)) + publisher
