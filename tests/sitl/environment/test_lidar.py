"""The scanning range finder: rays against geometry, and what a scan makes of a scene."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.environment.lidar import ScannerConfig, enclosing_box, ray_ranges_m
from sitl.environment.sensor import ObstacleSensor, SensorConfig
from sitl.environment.world import distance_to_box_m
from sitl.plant.truth import VehicleTruth

ANYTHING = np.arange(10)


def field_of(*boxes: tuple[float, float, float, float, float]) -> ObstacleField:
    return ObstacleField.of(
        [
            Obstacle(id=str(i), center_ned_m=(n, e), size_m=(dx, dy), yaw_deg=yaw)
            for i, (n, e, dx, dy, yaw) in enumerate(boxes)
        ]
    )


def at(north_m: float = 0.0, east_m: float = 0.0, yaw_rad: float = 0.0) -> VehicleTruth:
    return VehicleTruth(
        0.0,
        (north_m, east_m, -4.0),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0)),
        (0.0, 0.0, 0.0),
        (0.0,) * 4,
    )


def scan(
    field: ObstacleField, truth: VehicleTruth | None = None, view_deg: float = 120.0, **keys: Any
) -> list[dict[str, Any]]:
    config = SensorConfig(
        scanner=ScannerConfig(**keys), latency_s=0.0, range_m=20.0, field_of_view_deg=view_deg
    )
    (payload,) = ObstacleSensor(config, field, seed=3).sense(0.0, truth or at())
    obstacles: list[dict[str, Any]] = json.loads(payload)["obstacles"]
    return obstacles


coordinate = st.floats(-15.0, 15.0)
box = st.tuples(
    coordinate, coordinate, st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(0.0, 180.0)
)


@given(st.lists(box, min_size=1, max_size=4), st.floats(-math.pi, math.pi))
@settings(max_examples=200, deadline=None)
def test_a_ray_ends_on_the_surface_that_it_meets_first(
    boxes: list[tuple[float, float, float, float, float]], bearing_rad: float
) -> None:
    field = field_of(*boxes)
    (range_m,) = ray_ranges_m((0.0, 0.0), np.array([bearing_rad]), field, np.arange(len(boxes)))

    def clearance_m(distance_m: float) -> float:
        point = (distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad))
        away = distance_to_box_m(point, field.center_ned_m, field.half_size_m, field.yaw_rad)
        return float(away.min())

    free_m = min(float(range_m), 40.0)
    assert all(clearance_m(s) > -1e-6 for s in np.linspace(0.0, free_m, 60)[:-1] if range_m > 0.0)
    if math.isfinite(range_m):
        assert clearance_m(float(range_m)) == pytest.approx(0.0, abs=1e-6) or range_m == 0.0


def test_only_the_visible_face_is_known() -> None:
    (seen,) = scan(field_of((10.0, 0.0, 3.0, 2.0, 0.0)), resolution_deg=0.1)
    assert seen["center_m"] == pytest.approx([8.5, 0.0], abs=0.03)
    assert min(seen["size_m"]) < 0.05
    assert max(seen["size_m"]) == pytest.approx(2.0, abs=0.05)


def test_two_visible_faces_give_the_whole_box() -> None:
    (seen,) = scan(field_of((10.0, 6.0, 2.0, 2.0, 0.0)), resolution_deg=0.1)
    assert seen["center_m"] == pytest.approx([10.0, 6.0], abs=0.1)
    assert seen["size_m"] == pytest.approx([2.0, 2.0], abs=0.15)


def test_what_stands_behind_is_not_seen() -> None:
    near, hidden = (5.0, 0.0, 1.0, 4.0, 0.0), (9.0, 0.0, 1.0, 2.0, 0.0)
    assert len(scan(field_of(near, hidden))) == 1
    assert len(scan(field_of(hidden))) == 1


def test_neighbours_are_told_apart_by_the_gap_between_them() -> None:
    posts = field_of((8.0, -0.6, 0.3, 0.3, 0.0), (8.0, 0.6, 0.3, 0.3, 0.0))
    assert len(scan(posts)) == 2
    assert len(scan(posts, cluster_gap_m=1.5)) == 1


def test_range_and_view_end_the_scan() -> None:
    assert scan(field_of((25.0, 0.0, 1.0, 1.0, 0.0))) == []
    assert scan(field_of((-5.0, 0.0, 1.0, 1.0, 0.0))) == []
    assert len(scan(field_of((-5.0, 0.0, 1.0, 1.0, 0.0)), view_deg=360.0)) == 1


def test_nothing_is_seen_in_a_blind_sector() -> None:
    post = field_of((8.0, 3.0, 0.5, 0.5, 0.0))  # about 20 degrees to the right
    assert len(scan(post)) == 1
    assert scan(post, blind_sectors_deg=((10.0, 30.0),)) == []
    assert len(scan(post, blind_sectors_deg=((-30.0, -10.0),))) == 1


def test_noise_moves_hits_and_dropouts_lose_them() -> None:
    wall = field_of((8.0, 0.0, 0.5, 6.0, 0.0))
    assert scan(wall, dropout=0.999) == []
    (clean,), (noisy,) = scan(wall), scan(wall, range_noise_m=0.05)
    assert min(clean["size_m"]) < 0.03
    assert 0.1 < min(noisy["size_m"]) < 0.5


def test_an_object_keeps_its_name_while_the_vehicle_passes() -> None:
    field = field_of((10.0, 2.0, 1.0, 1.0, 0.0))
    config = SensorConfig(scanner=ScannerConfig(), latency_s=0.0, rate_hz=20.0)
    sensor = ObstacleSensor(config, field, seed=3)
    names = set()
    for step in range(60):
        for payload in sensor.sense(0.05 * step, at(north_m=0.14 * step)):
            names |= {obstacle["id"] for obstacle in json.loads(payload)["obstacles"]}
    assert names == {"scan-1"}


def test_body_frame_turns_with_the_vehicle() -> None:
    config = SensorConfig(scanner=ScannerConfig(), latency_s=0.0, frame="body_frd")
    field = field_of((0.0, 6.0, 1.0, 1.0, 0.0))
    (payload,) = ObstacleSensor(config, field, seed=3).sense(0.0, at(yaw_rad=math.pi / 2.0))
    (seen,) = json.loads(payload)["obstacles"]
    assert seen["center_m"] == pytest.approx([5.5, 0.0], abs=0.05)


@given(
    st.floats(0.3, 5.0),
    st.floats(0.3, 5.0),
    st.floats(0.0, 89.0),
    st.floats(-5, 5),
    st.floats(-5, 5),
)
@settings(max_examples=60, deadline=None)
def test_the_box_around_two_sides_of_a_rectangle_is_the_rectangle(
    length: float, width: float, yaw_deg: float, north: float, east: float
) -> None:
    yaw = math.radians(yaw_deg)
    share = np.linspace(-0.5, 0.5, 40)
    sides = np.concatenate(
        (
            np.column_stack((share * length, np.full(40, -0.5 * width))),
            np.column_stack((np.full(40, 0.5 * length), share * width)),
        )
    )
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    points = sides @ turn.T + (north, east)
    center, size, _ = enclosing_box(points)
    assert center == pytest.approx((north, east), abs=0.05)
    assert sorted(size) == pytest.approx(sorted((length, width)), abs=0.09)
