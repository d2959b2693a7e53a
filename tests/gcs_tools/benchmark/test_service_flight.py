"""Flights through the whole service."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.service_flight import field_of, fly_by_service
from tests.gcs_tools.benchmark.small_scene import scene


def test_the_service_flies_the_same_field_wherever_the_leg_heads() -> None:
    obstacles = Obstacles(
        np.array(((5.0, 1.0), (9.0, -2.0))), np.array(((1.0, 0.4), (0.0, 0.0))),
        np.array((0.3, 0.0)), np.array((0.0, 0.2)),
    )  # fmt: skip
    heading_rad = 0.8
    field = field_of(obstacles, heading_rad)
    again = Obstacles(field.center_ned_m, field.half_size_m, field.yaw_rad, np.zeros(2))
    points = np.array(((4.0, 4.0), (7.0, 0.0), (9.0, -5.0)))
    back = again.along_leg(np.zeros(2), heading_rad)
    assert back.distance_m(points) == pytest.approx(obstacles.distance_m(points))
    assert field.center_ned_m[0] == pytest.approx(
        (5.0 * math.cos(0.8) - math.sin(0.8), 5.0 * math.sin(0.8) + math.cos(0.8))
    )


def test_a_small_field_is_flown_by_the_whole_service() -> None:
    served = fly_by_service(scene((5.0, 0.1), (8.0, -1.8)), 1)
    assert served.arrived
    assert served.result.clearance_min_m is not None
    assert 0.0 < served.result.clearance_min_m < 1.5
    assert 5.0 < served.first_look_s < 20.0
    assert served.speed_mps > 1.0
