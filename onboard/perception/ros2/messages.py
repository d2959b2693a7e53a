"""ROS 2 messages as plain numbers: scans, single ranges, grids, detections, transforms.

Units and frames are those of ROS (REP 103): metres, radians, x forward, y left, z up.  A field that
has to be finite for the message to mean anything is checked here; ranges may be anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.perception.ros2.cdr import CdrReader, DecodeError

# Beyond these a message is garbage.
BEAMS_MAX: Final = 100_000
CELLS_MAX: Final = 4_000_000
CELL_MIN_M: Final = 0.02
CELL_MAX_M: Final = 100.0
BOXES_MAX: Final = 10_000
TRANSFORMS_MAX: Final = 10_000
_METRES_MAX: Final = 1e6
# The least that one element takes: two headers, a box and empty strings; a transform likewise.
_DETECTION_BYTES: Final = 100
_HYPOTHESIS_BYTES: Final = 352
_TRANSFORM_BYTES: Final = 70

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Header(NamedTuple):
    """When, in Unix time by the publisher's clock, and in which frame."""

    stamp_unix_s: float
    frame_id: str


@dataclass(frozen=True, eq=False)
class LaserScan:
    """sensor_msgs/LaserScan: beams in the sensor's x-y plane, counter-clockwise from x.

    Attributes:
        header: the stamp is that of the first beam.
        angle_min_rad, angle_increment_rad: of the first beam, and from beam to beam.
        time_increment_s: from beam to beam.
        range_min_m, range_max_m: a range outside is not a measurement.
        ranges_m: (beams,); infinite, NaN or out of range where there is none.
    """

    header: Header
    angle_min_rad: float
    angle_increment_rad: float
    time_increment_s: float
    range_min_m: float
    range_max_m: float
    ranges_m: NDArray[np.float32]


@dataclass(frozen=True)
class RangeReading:
    """sensor_msgs/Range: one cone around the sensor's x axis."""

    header: Header
    field_of_view_rad: float
    range_min_m: float
    range_max_m: float
    range_m: float


class PoseInFrame(NamedTuple):
    """Where something is in a frame: position, and rotation as (x, y, z, w) of unit length."""

    position_m: Vector
    rotation: Quaternion


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """nav_msgs/OccupancyGrid.

    Attributes:
        cell_m: edge of a cell.
        origin: pose of the corner of cell (0, 0).
        cells: (height, width), -1 unknown, 0 to 100 per cent occupied; x runs along a row.
    """

    header: Header
    cell_m: float
    origin: PoseInFrame
    cells: NDArray[np.int8]


class DetectedBox(NamedTuple):
    """One vision_msgs/Detection3D: its box, track (may be empty), best score, and labels."""

    center: PoseInFrame
    size_m: Vector
    id: str
    score: float
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Detection3DArray:
    """vision_msgs/Detection3DArray of vision_msgs 4, since Humble."""

    header: Header
    boxes: tuple[DetectedBox, ...]


class Transform(NamedTuple):
    """One geometry_msgs/TransformStamped: the pose of a child frame in its parent."""

    header: Header
    child_frame_id: str
    pose: PoseInFrame


def read_header(reader: CdrReader) -> Header:
    """Read a std_msgs/Header."""
    seconds, nanoseconds = reader.i32(), reader.u32()
    if nanoseconds >= 1_000_000_000:
        raise DecodeError("nanoseconds beyond a second")
    return Header(seconds + nanoseconds * 1e-9, reader.text())


def decode_laser_scan(payload: bytes) -> LaserScan:
    """Decode sensor_msgs/LaserScan.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    start_rad, end_rad, step_rad, step_s = (_finite(reader.f32()) for _ in range(4))
    reader.f32()  # the time of a scan
    least_m, most_m = _range_limits(reader)
    ranges_m = reader.f32s()
    reader.f32s()  # intensities
    reader.end()
    if not 1 <= len(ranges_m) <= BEAMS_MAX:
        raise DecodeError("number of beams")
    whole_rad = abs(step_rad) * len(ranges_m)
    if step_rad == 0.0 or whole_rad > 2.0 * math.pi + 2.0 * abs(step_rad):
        raise DecodeError("angle increment")
    # Drivers disagree whether the last angle is that of the last beam or the one after it.
    if abs(start_rad + step_rad * len(ranges_m) - end_rad) > 2.5 * abs(step_rad):
        raise DecodeError("angles do not fit the number of beams")
    if not 0.0 <= step_s * len(ranges_m) <= 2.0:
        raise DecodeError("time increment")
    return LaserScan(header, start_rad, step_rad, step_s, least_m, most_m, ranges_m)


def decode_range(payload: bytes) -> RangeReading:
    """Decode sensor_msgs/Range, with the variance (since Jazzy) or without.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    reader.u8()  # ultrasound or infrared
    view_rad = _finite(reader.f32())
    least_m, most_m = _range_limits(reader)
    range_m = reader.f32()
    if reader.left >= 4:
        reader.f32()
    reader.end()
    if not 0.0 < view_rad < math.pi:
        raise DecodeError("field of view")
    return RangeReading(header, view_rad, least_m, most_m, range_m)


def decode_occupancy_grid(payload: bytes) -> OccupancyGrid:
    """Decode nav_msgs/OccupancyGrid.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    reader.i32()  # when the map was loaded
    reader.u32()
    cell_m, width, height = _finite(reader.f32()), reader.u32(), reader.u32()
    origin = read_pose(reader)
    cells = np.frombuffer(reader.blob(), np.int8)
    reader.end()
    if not CELL_MIN_M <= cell_m <= CELL_MAX_M:
        raise DecodeError("resolution")
    if width * height != cells.size or not 0 < cells.size <= CELLS_MAX:
        raise DecodeError("number of cells")
    return OccupancyGrid(header, cell_m, origin, cells.reshape(height, width))


def decode_detections(payload: bytes) -> Detection3DArray:
    """Decode vision_msgs/Detection3DArray.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    count = reader.count(_DETECTION_BYTES, BOXES_MAX, "detections")
    boxes = tuple(_read_detection(reader) for _ in range(count))
    reader.end()
    return Detection3DArray(header, boxes)


def decode_transforms(payload: bytes) -> tuple[Transform, ...]:
    """Decode tf2_msgs/TFMessage.

    Raises:
        DecodeError: it is not one.
    """
    reader = CdrReader(payload)
    count = reader.count(_TRANSFORM_BYTES, TRANSFORMS_MAX, "transforms")
    found = tuple(
        Transform(read_header(reader), reader.text(), read_pose(reader)) for _ in range(count)
    )
    reader.end()
    return found


def _read_detection(reader: CdrReader) -> DetectedBox:
    read_header(reader)  # repeats that of the array
    scores, labels = [], []
    for _ in range(reader.count(_HYPOTHESIS_BYTES)):
        labels.append(reader.text())
        scores.append(_finite(reader.f64()))
        reader.f64s(7 + 36)  # its pose and covariance
    center, size_m = read_pose(reader), _read_vector(reader)
    if min(size_m) < 0.0:
        raise DecodeError("negative size")
    return DetectedBox(center, size_m, reader.text(), max(scores, default=1.0), tuple(labels))


def _read_vector(reader: CdrReader) -> Vector:
    x, y, z = reader.f64s(3)
    if not all(abs(value) <= _METRES_MAX for value in (x, y, z)):  # NaN compares false
        raise DecodeError("not a position")
    return x, y, z


def read_pose(reader: CdrReader) -> PoseInFrame:
    """Read a geometry_msgs/Pose or Transform: both are a position and a rotation."""
    position_m, (x, y, z, w) = _read_vector(reader), reader.f64s(4)
    length = math.sqrt(x * x + y * y + z * z + w * w) if max(map(abs, (x, y, z, w))) < 10 else 0.0
    if not 0.9 <= length <= 1.1:
        raise DecodeError("not a rotation")
    return PoseInFrame(position_m, (x / length, y / length, z / length, w / length))


def _range_limits(reader: CdrReader) -> tuple[float, float]:
    least_m, most_m = reader.f32(), reader.f32()
    if not 0.0 <= least_m < most_m:
        raise DecodeError("range limits")
    return least_m, most_m


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise DecodeError("not finite")
    return value
