"""True obstacles, and what a sensor sees of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.scenes import drawn_walls

TWO = Obstacles.stems(np.array(((5.0, 0.2), (8.0, 0.3))), np.array((0.3, 0.2)))


def test_distances_to_stems_and_turned_boxes() -> None:
    box = Obstacles(
        np.array(((0.0, 0.0),)), np.array(((2.0, 1.0),)), np.array((math.pi / 2,)), np.zeros(1)
    )
    points = np.array(((3.0, 0.0), (0.0, 3.0), (0.0, 0.0)))
    assert box.distance_m(points) == pytest.approx((2.0, 1.0, -1.0))
    assert TWO.distance_m(np.array(((5.0, 3.2),))) == pytest.approx(2.7)


def test_the_worst_error_leads_toward_the_nearest_obstacle() -> None:
    points = np.array(((3.0, 0.2), (5.0, 2.2)))
    moved = TWO.toward_nearest(points, 0.35)
    assert moved == pytest.approx(np.array(((3.35, 0.2), (5.0, 1.85))))
    turned = TWO.along_leg(np.array((1.0, 1.0)), 0.7)
    assert turned.distance_m(turned.toward_nearest(np.zeros((1, 2)), 0.35)) == pytest.approx(
        turned.distance_m(np.zeros((1, 2))) - 0.35
    )


def test_what_stands_behind_another_is_hidden() -> None:
    assert TWO.visible((0.0, 0.0), 0.0, math.radians(45.0), 12.0).tolist() == [0]
    assert TWO.visible((0.0, 6.0), -0.5, math.radians(45.0), 12.0).tolist() == [0, 1]
    assert not TWO.visible((0.0, 0.0), math.pi, math.radians(45.0), 12.0).size
    assert not TWO.visible((-9.0, 0.0), 0.0, math.radians(45.0), 12.0).size


def test_reported_faces_are_wrong_by_no_more_than_declared() -> None:
    for report, exact in zip(
        TWO.reports(np.random.default_rng(1), 0.1),
        TWO.reports(np.random.default_rng(1), 0.0),
        strict=True,
    ):
        assert report != exact
        assert abs(report.x_min_m - exact.x_min_m) <= 0.1
        assert abs(report.y_max_m - exact.y_max_m) <= 0.1


def test_surface_points_lie_in_the_obstacles() -> None:
    for obstacles in (TWO, drawn_walls("trap").obstacles):
        distance_m = obstacles.distance_m(obstacles.surface_points_m())
        assert distance_m.max() < 0.0
