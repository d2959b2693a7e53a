"""Obstacles as visualization_msgs/MarkerArray, for RViz, Foxglove and others of ROS 2.

Boxes are in east, north, up from the origin of the autopilot's local frame, as MAVROS has it
(REP 103).  The first marker removes those of the message before.  What moves has namespaces of its
own: where each mover may be by now, and what it may reach until the vehicle rests.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from itertools import islice
from typing import Final, NamedTuple

from onboard.perception.ros2.cdr_writer import CdrWriter
from onboard.perception.ros2.keys import published_key
from onboard.recording.messages import Obstacles, Outline
from onboard.recording.mover_record import MoversRecord, box_at

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
_NAMESPACE: Final = "clearway"
_COLOUR: Final = (0.85, 0.3, 0.2, 0.8)
_MOVER: Final = (0.85, 0.2, 0.75, 0.9)
_REACH: Final = (0.85, 0.2, 0.75, 0.25)


class _Shape(NamedTuple):
    """A box to draw.

    Attributes:
        namespace: of its marker.
        outline_ned_m: corners.
        colour: red, green, blue, alpha.
        text: its name.
    """

    namespace: str
    outline_ned_m: Outline
    colour: tuple[float, float, float, float]
    text: str


def markers(obstacles: Obstacles, frame_id: str, movers: MoversRecord | None = None) -> bytes:
    """Return the message of all obstacles and movers.

    Args:
        obstacles: the map; its time is the message's.
        frame_id: of the boxes.
        movers: what moves, as recorded last; None where nothing does.
    """
    known = list(islice(_shapes(obstacles, movers), MARKERS_MAX))
    writer = CdrWriter().u32(1 + len(known))
    stamp = math.floor(obstacles.time_s), math.floor(obstacles.time_s % 1.0 * 1e9)
    _marker(writer, stamp, frame_id, 0, None, 0.0)
    for number, each in enumerate(known):
        _marker(writer, stamp, frame_id, number + 1, each, obstacles.height_m or 0.0)
    return writer.payload()


def _shapes(obstacles: Obstacles, movers: MoversRecord | None) -> Iterator[_Shape]:
    for mover in () if movers is None else movers.movers:
        text = f"{mover.id} ({mover.kind})"
        now_ned_m = box_at(mover, obstacles.time_s, 0.0 if movers is None else movers.stamp_error_s)
        for part, outline, colour in (
            ("movers", now_ned_m, _MOVER),
            ("reach", mover.reach_ned_m, _REACH),
        ):
            if outline:
                yield _Shape(f"{_NAMESPACE}/{part}", outline, colour, text)
    for each in obstacles.obstacles:
        if each.measured_ned_m:
            yield _Shape(_NAMESPACE, each.measured_ned_m, _COLOUR, each.id)


def _marker(
    writer: CdrWriter,
    stamp: tuple[int, int],
    frame_id: str,
    number: int,
    shape: _Shape | None,
    height_m: float,
) -> None:
    """Write one marker; without a shape, the one that removes all."""
    writer.i32(stamp[0]).u32(stamp[1]).text(frame_id).text(shape.namespace if shape else _NAMESPACE)
    writer.i32(number, _CUBE, _ADD if shape else _DELETE_ALL)
    if shape is None:
        position_m, yaw_rad, size_m = (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)
    else:
        position_m, yaw_rad, size_m = _box(shape.outline_ned_m, height_m)
    writer.f64(*position_m, 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0), *size_m)
    writer.f32(*(shape.colour if shape else _COLOUR)).i32(0).u32(0)  # the lifetime: for ever
    writer.u8(0)  # not locked to the frame
    writer.u32(0, 0).text("")  # points, colours, texture
    writer.i32(0).u32(0).text("").text("").u32(0)  # the texture's image
    writer.u32(0)  # its coordinates
    writer.text(shape.text if shape else "").text("")  # text, mesh
    writer.text("").u32(0).u8(0)  # the mesh's file


def _box(
    corners: Outline, height_m: float
) -> tuple[tuple[float, float, float], float, tuple[float, float, float]]:
    """Return centre, yaw from east to north, and size of a box, east, north, up."""
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
