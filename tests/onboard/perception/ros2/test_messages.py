"""Each message as another implementation encodes it; and what a message must not contain."""

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import (
    decode_detections,
    decode_laser_scan,
    decode_occupancy_grid,
    decode_range,
    decode_transforms,
)
from onboard.perception.ros2.point_cloud import decode_point_cloud
from tests.onboard.perception.ros2.encoding import laser_scan, occupancy_grid, point_cloud
from tests.onboard.perception.ros2.recorded import ORDERS, encoded

STAMP_UNIX_S = 1_790_000_000.25
DECODERS: dict[str, Callable[[bytes], Any]] = {
    "sensor_msgs/LaserScan": decode_laser_scan,
    "sensor_msgs/PointCloud2": decode_point_cloud,
    "sensor_msgs/Range": decode_range,
    "vision_msgs/Detection3DArray": decode_detections,
    "nav_msgs/OccupancyGrid": decode_occupancy_grid,
    "tf2_msgs/TFMessage": decode_transforms,
}


@pytest.mark.parametrize("order", ORDERS)
def test_laser_scan(order: str) -> None:
    (payload,) = encoded("sensor_msgs/LaserScan", order)
    scan = decode_laser_scan(payload)
    assert scan.header == (STAMP_UNIX_S, "laser")
    assert (scan.angle_min_rad, scan.angle_increment_rad) == (-0.5, 0.25)
    assert scan.time_increment_s == pytest.approx(0.001)
    assert (scan.range_min_m, scan.range_max_m) == pytest.approx((0.1, 20.0))
    np.testing.assert_array_equal(scan.ranges_m, [1.0, 2.0, math.inf, math.nan, 5.0])


@pytest.mark.parametrize("order", ORDERS)
def test_point_cloud(order: str) -> None:
    (payload,) = encoded("sensor_msgs/PointCloud2", order)
    cloud = decode_point_cloud(payload)
    assert cloud.header == (STAMP_UNIX_S, "laser")
    assert cloud.points_m.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]


@pytest.mark.parametrize("order", ORDERS)
def test_range_of_humble_and_of_jazzy(order: str) -> None:
    payloads = encoded("sensor_msgs/Range", order)
    assert len(payloads) == 2
    for payload in payloads:
        reading = decode_range(payload)
        assert reading.header == (STAMP_UNIX_S, "laser")
        assert (reading.field_of_view_rad, reading.range_m) == (0.5, 3.5)
        assert (reading.range_min_m, reading.range_max_m) == pytest.approx((0.2, 10.0))


@pytest.mark.parametrize("order", ORDERS)
def test_detections(order: str) -> None:
    (payload,) = encoded("vision_msgs/Detection3DArray", order)
    tree, unnamed = decode_detections(payload).boxes
    assert tree.id == "42"
    assert tree.center.position_m == (5.0, 1.0, 0.5)
    assert tree.center.rotation == pytest.approx((0.0, 0.0, math.sin(0.25), math.cos(0.25)))
    assert tree.size_m == (1.0, 2.0, 3.0)
    assert tree.score == 0.75
    assert (unnamed.id, unnamed.size_m, unnamed.score) == ("", (0.5, 0.25, 3.0), 1.0)


@pytest.mark.parametrize("order", ORDERS)
def test_occupancy_grid(order: str) -> None:
    (payload,) = encoded("nav_msgs/OccupancyGrid", order)
    grid = decode_occupancy_grid(payload)
    assert grid.cell_m == 0.5
    assert grid.origin.position_m == (5.0, 1.0, 0.5)
    assert grid.cells.tolist() == [[0, 100, -1], [50, 0, 0]]


@pytest.mark.parametrize("order", ORDERS)
def test_transforms(order: str) -> None:
    (payload,) = encoded("tf2_msgs/TFMessage", order)
    (transform,) = decode_transforms(payload)
    assert transform.header == (STAMP_UNIX_S, "base_link")
    assert transform.child_frame_id == "laser"
    assert transform.pose == ((0.125, 0.0, -0.25), (0.0, 0.0, 1.0, 0.0))


@pytest.mark.parametrize("type_name", DECODERS)
@pytest.mark.parametrize("order", ORDERS)
def test_whatever_is_cut_off_is_refused(type_name: str, order: str) -> None:
    payload = min(encoded(type_name, order), key=len)
    for length in range(len(payload)):
        with pytest.raises(DecodeError):
            DECODERS[type_name](payload[:length])


@pytest.mark.parametrize("type_name", DECODERS)
def test_a_message_of_another_type_is_refused(type_name: str) -> None:
    for other in DECODERS:
        if other != type_name:
            with pytest.raises(DecodeError):
                DECODERS[type_name](encoded(other, "le")[0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"angle_increment_rad": 0.0}, "angle increment"),
        ({"angle_increment_rad": math.nan}, "not finite"),
        ({"angle_min_rad": math.inf}, "not finite"),
        ({"angle_increment_rad": 0.1}, "angles do not fit"),
        ({"angle_increment_rad": 2.0, "ranges_m": [5.0] * 8}, "angle increment"),
        ({"time_increment_s": -0.001}, "time increment"),
        ({"time_increment_s": 1.0}, "time increment"),
        ({"range_min_m": math.nan}, "range limits"),
        ({"range_max_m": 0.0}, "range limits"),
        ({"ranges_m": []}, "number of beams"),
        ({"nanoseconds": 1_000_000_000}, "nanoseconds"),
    ],
)
def test_a_scan_that_means_nothing_is_refused(change: dict[str, Any], reason: str) -> None:
    decode_laser_scan(laser_scan())
    with pytest.raises(DecodeError, match=reason):
        decode_laser_scan(laser_scan(**change))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"height": 1001, "width": 1000}, "number of points"),
        ({"step": 0}, "steps do not fit"),
        ({"row_step": 17}, "steps do not fit"),
        ({"fields": (("x", 0, 7, 1), ("y", 4, 7, 1))}, "no coordinates"),
        ({"fields": (("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 2, 1))}, "type of the coordinates"),
        ({"fields": (("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 3))}, "type of the coordinates"),
        ({"fields": (("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 13, 7, 1))}, "beyond their point"),
        ({"fields": (("x", 0, 7, 1),) * 3}, "no coordinates"),
    ],
)
def test_a_cloud_that_means_nothing_is_refused(change: dict[str, Any], reason: str) -> None:
    points_m = np.zeros((4, 3), np.float32)
    decode_point_cloud(point_cloud(points_m))
    with pytest.raises(DecodeError, match=reason):
        decode_point_cloud(point_cloud(points_m, **change))


def test_a_cloud_in_rows_with_gaps_and_in_double_precision() -> None:
    fields = (("z", 16, 8, 1), ("x", 0, 8, 1), ("y", 8, 8, 1))
    data = struct.pack("<3d8x", 1.0, 2.0, 3.0) + bytes(16)
    payload = point_cloud(
        np.empty((0, 3), np.float32), fields=fields, step=24, row_step=48, width=1, data=data * 2
    )
    with pytest.raises(DecodeError, match="steps do not fit"):
        decode_point_cloud(payload)  # two rows of data, one declared
    payload = point_cloud(
        np.empty((0, 3), np.float32),
        fields=fields,
        step=24,
        row_step=48,
        height=2,
        width=1,
        data=data * 2,
    )
    assert decode_point_cloud(payload).points_m.tolist() == [[1, 1], [2, 2], [3, 3]]


def test_a_cloud_without_points_is_an_empty_one() -> None:
    assert decode_point_cloud(point_cloud(np.empty((0, 3)))).points_m.shape == (3, 0)


@pytest.mark.parametrize("cell_m", [0.0, 1e-9, 0.019, 1e3, math.nan, math.inf])
def test_a_grid_of_absurd_cells_is_refused(cell_m: float) -> None:
    cells = np.zeros((3, 4), np.int8)
    assert decode_occupancy_grid(occupancy_grid(cells, cell_m=0.05)).cells.shape == (3, 4)
    with pytest.raises(DecodeError, match=r"resolution|not finite"):
        decode_occupancy_grid(occupancy_grid(cells, cell_m=cell_m))


def test_a_rotation_of_no_length_is_refused() -> None:
    (payload,) = encoded("tf2_msgs/TFMessage", "le")
    with pytest.raises(DecodeError, match="not a rotation"):
        decode_transforms(payload[:-32] + bytes(32))
    with pytest.raises(DecodeError, match="not a rotation"):
        decode_transforms(payload[:-32] + struct.pack("<4d", math.nan, 0.0, 0.0, 1.0))


def test_a_detection_of_negative_size_is_refused() -> None:
    (payload,) = encoded("vision_msgs/Detection3DArray", "le")
    with pytest.raises(DecodeError, match="negative size"):
        decode_detections(payload.replace(struct.pack("<d", 0.25), struct.pack("<d", -0.25)))
