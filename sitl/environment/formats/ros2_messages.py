"""Messages of ROS 2 in CDR; their axes are forward, left, up, and angles counter-clockwise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from onboard.files.obstacle_field import FloatArray
from sitl.environment.formats.cdr_writer import CdrWriter

_FLOAT32 = 7  # sensor_msgs/PointField
_POINT_BYTES = 16  # x, y, z, and four bytes that drivers leave empty
_INFRARED = 1  # sensor_msgs/Range


class BeamFan(NamedTuple):
    """The beams of a sensor_msgs/LaserScan.

    Attributes:
        first_rad, step_rad: angle of the first beam, and from beam to beam.
        beam_s: time from beam to beam.
        period_s: time from scan to scan.
        range_min_m, range_max_m: between which ranges are measurements.
    """

    first_rad: float
    step_rad: float
    beam_s: float
    period_s: float
    range_min_m: float
    range_max_m: float


def laser_scan(stamp_unix_s: float, frame_id: str, fan: BeamFan, ranges_m: FloatArray) -> bytes:
    """Return a sensor_msgs/LaserScan without intensities.

    Args:
        stamp_unix_s: of the first beam.
        frame_id: of the sensor.
        fan: of the beams.
        ranges_m: (n,), infinite where nothing returned.
    """
    count = len(ranges_m)
    writer = CdrWriter().header(stamp_unix_s, frame_id)
    last_rad = fan.first_rad + (count - 1) * fan.step_rad
    writer.add("fff", fan.first_rad, last_rad, fan.step_rad)
    writer.add("ffff", fan.beam_s, fan.period_s, fan.range_min_m, fan.range_max_m)
    writer.add("I", count).raw(np.asarray(ranges_m, "<f4").tobytes())
    return writer.add("I", 0).payload()


def point_cloud(stamp_unix_s: float, frame_id: str, points_m: FloatArray) -> bytes:
    """Return a dense sensor_msgs/PointCloud2 of x, y and z.

    Args:
        stamp_unix_s: of all points.
        frame_id: of the sensor.
        points_m: (n, 3) in the sensor's axes.
    """
    count = len(points_m)
    packed = np.zeros((count, _POINT_BYTES // 4), "<f4")
    packed[:, :3] = points_m
    writer = CdrWriter().header(stamp_unix_s, frame_id).add("III", 1, count, 3)
    for offset, name in ((0, "x"), (4, "y"), (8, "z")):
        writer.text(name).add("IBI", offset, _FLOAT32, 1)
    data = packed.tobytes()
    writer.add("BIII", 0, _POINT_BYTES, len(data), len(data)).raw(data)
    return writer.add("B", 1).payload()


def range_reading(
    stamp_unix_s: float,
    frame_id: str,
    range_m: float,
    *,
    view_rad: float,
    limits_m: tuple[float, float],
) -> bytes:
    """Return a sensor_msgs/Range, of Jazzy and later: with a variance, which is unknown."""
    writer = CdrWriter().header(stamp_unix_s, frame_id)
    return writer.add("Bfffff", _INFRARED, view_rad, *limits_m, range_m, 0.0).payload()
