"""What the simulated drivers encode, as the daemon's decoder reads it, and byte by byte."""

import math
import struct

import numpy as np
import pytest

from onboard.perception.ros2.messages import decode_laser_scan, decode_range
from onboard.perception.ros2.point_cloud import decode_point_cloud
from sitl.environment.formats.cdr_writer import CdrWriter
from sitl.environment.formats.ros2_messages import (
    BeamFan,
    laser_scan,
    point_cloud,
    range_reading,
)

STAMP_UNIX_S = 1_790_000_000.25


def test_cdr_aligns_each_value_to_its_size_from_behind_the_header() -> None:
    data = CdrWriter().add("B", 1).add("d", 0.5).text("ab").add("H", 2).payload()
    expected = b"\x00\x01\x00\x00" + b"\x01" + bytes(7) + struct.pack("<d", 0.5)
    assert data == expected + b"\x03\x00\x00\x00ab\x00" + b"\x00" + b"\x02\x00"


def test_a_header_has_whole_nanoseconds() -> None:
    data = CdrWriter().header(2.0 - 1e-10, "x").payload()
    assert data[4:12] == struct.pack("<iI", 2, 0)


def test_a_laser_scan() -> None:
    ranges_m = np.array([1.0, math.inf, 2.5])
    fan = BeamFan(-0.5, 0.5, 1e-4, 0.05, 0.1, 25.0)
    scan = decode_laser_scan(laser_scan(STAMP_UNIX_S, "laser", fan, ranges_m))
    assert scan.header.frame_id == "laser"
    assert scan.header.stamp_unix_s == STAMP_UNIX_S
    assert (scan.angle_min_rad, scan.angle_increment_rad) == (-0.5, 0.5)
    assert scan.time_increment_s == pytest.approx(1e-4)
    assert (scan.range_min_m, scan.range_max_m) == pytest.approx((0.1, 25.0))
    assert scan.ranges_m.tolist() == ranges_m.tolist()


def test_a_point_cloud() -> None:
    points_m = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]])
    cloud = decode_point_cloud(point_cloud(STAMP_UNIX_S, "depth", points_m))
    assert cloud.header.frame_id == "depth"
    assert cloud.points_m.T.tolist() == points_m.tolist()


def test_a_cloud_of_nothing_is_a_message_all_the_same() -> None:
    cloud = decode_point_cloud(point_cloud(STAMP_UNIX_S, "depth", np.zeros((0, 3))))
    assert cloud.points_m.shape == (3, 0)


def test_a_range() -> None:
    data = range_reading(STAMP_UNIX_S, "sonar", 3.5, view_rad=0.4, limits_m=(0.2, 6.0))
    reading = decode_range(data)
    assert reading.range_m == 3.5
    assert reading.field_of_view_rad == pytest.approx(0.4)
    assert (reading.range_min_m, reading.range_max_m) == pytest.approx((0.2, 6.0))
