"""Decodes autoware_perception_msgs/TrackedObjects: boxes with velocities, of a tracker.

https://github.com/autowarefoundation/autoware_msgs; the twist is in the object's own axes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from onboard.geometry.frames import Vector
from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.messages import Header, PoseInFrame, read_header, read_pose

OBJECTS_MAX: Final = 1000
LABELS: Final = (
    "unknown", "car", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian", "animal",
    "hazard", "over_drivable", "under_drivable",
)  # fmt: skip
_OBJECT_BYTES: Final = 16 + 4 + 4
_CLASS_BYTES: Final = 8
_POINT_BYTES: Final = 12
_KNOWN_ORIENTATION, _KNOWN_BUT_FOR_SIGN = 2, 1
_POLYGON: Final = 2
_METRES_MAX: Final = 1e3
_SPEED_MAX_MPS: Final = 300.0


class TrackedObject(NamedTuple):
    """One object of a tracker.

    Attributes:
        id: hexadecimal.
        labels: all that it may be.
        center: in the frame of the message.
        size_m: along its own axes: length, width, height.
        position_sigma_m: standard deviation of its position, along the worse axis.
        velocity_mps: along its own axes, over ground.
        velocity_sigma_mps: standard deviation, along the worse axis.
        axis_known: whether its axes are known up to a half turn.
        heading_known: whether it is known which way it faces.
    """

    id: str
    labels: tuple[str, ...]
    center: PoseInFrame
    size_m: Vector
    position_sigma_m: float
    velocity_mps: tuple[float, float]
    velocity_sigma_mps: float
    axis_known: bool
    heading_known: bool


class TrackedObjects(NamedTuple):
    """autoware_perception_msgs/TrackedObjects."""

    header: Header
    objects: tuple[TrackedObject, ...]


def decode_tracked_objects(payload: bytes) -> TrackedObjects:
    """Decode one message.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    count = reader.count(_OBJECT_BYTES, OBJECTS_MAX, "objects")
    objects = tuple(_read_object(reader) for _ in range(count))
    reader.end()
    return TrackedObjects(header, objects)


def _read_object(reader: CdrReader) -> TrackedObject:
    name = bytes(reader.u8() for _ in range(16)).hex()
    reader.f32()  # how probable it is that there is one: every object counts
    labels = tuple(_read_label(reader) for _ in range(reader.count(_CLASS_BYTES)))
    center, position_sigma_m = read_pose(reader), _sigma(reader.f64s(36))
    linear_mps = reader.f64s(6)[:2]
    velocity_sigma_mps = _sigma(reader.f64s(36))
    reader.f64s(6 + 36)  # acceleration
    orientation = reader.u8()
    reader.flag()  # whether it stands still now, which claims nothing
    size_m = _read_shape(reader)
    if not all(abs(value) <= _SPEED_MAX_MPS for value in linear_mps):  # NaN compares false
        raise DecodeError("velocity")
    return TrackedObject(
        name,
        labels,
        center,
        size_m,
        position_sigma_m,
        (linear_mps[0], linear_mps[1]),
        velocity_sigma_mps,
        axis_known=orientation in (_KNOWN_BUT_FOR_SIGN, _KNOWN_ORIENTATION),
        heading_known=orientation == _KNOWN_ORIENTATION,
    )


def _read_label(reader: CdrReader) -> str:
    number = reader.u8()
    reader.f32()  # its probability
    return LABELS[number] if number < len(LABELS) else f"label {number}"


def _read_shape(reader: CdrReader) -> Vector:
    """Read a shape; of a polygon, return what encloses it around the object's centre."""
    kind = reader.u8()
    points_m = [
        (abs(reader.f32()), abs(reader.f32()), reader.f32())
        for _ in range(reader.count(_POINT_BYTES))
    ]
    length_m, width_m, height_m = reader.f64s(3)
    if kind == _POLYGON:
        # NaN is neither greatest nor least, but makes every sum one.
        if not points_m or not math.isfinite(sum(x_m + y_m for x_m, y_m, _ in points_m)):
            raise DecodeError("dimensions")
        length_m, width_m = (2.0 * max(each[axis] for each in points_m) for axis in (0, 1))
    if not all(0.0 <= side_m <= _METRES_MAX for side_m in (length_m, width_m, height_m)):
        raise DecodeError("dimensions")
    return length_m, width_m, height_m


def _sigma(covariance: tuple[float, ...]) -> float:
    """Return the standard deviation along the worse horizontal axis; the trace is no less."""
    variance = covariance[0] + covariance[7]
    if not (covariance[0] >= 0.0 and covariance[7] >= 0.0 and math.isfinite(variance)):
        raise DecodeError("covariance")
    return math.sqrt(variance)
