"""Rectangles around groups of points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import LegFrame
from onboard.perception.scan.fitted_boxes import fit_boxes

points = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=12)


@given(st.lists(points, min_size=1, max_size=5))
def test_each_rectangle_holds_its_points(groups: list[list[tuple[float, float]]]) -> None:
    starts = np.cumsum([0, *map(len, groups)])[:-1]
    fitted = fit_boxes(np.array([point for group in groups for point in group]), starts)
    for index, group in enumerate(groups):
        center, yaw = fitted.center_ned_m[index], float(fitted.yaw_rad[index])
        frame = LegFrame((float(center[0]), float(center[1]), 0.0), yaw)
        for north, east in group:
            x_m, y_m, _ = frame.position_leg((north, east, 0.0))
            assert abs(x_m) <= fitted.size_m[index, 0] / 2.0 + 1e-9
            assert abs(y_m) <= fitted.size_m[index, 1] / 2.0 + 1e-9


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 44.0, 75.0])
def test_a_wall_has_a_thin_box(yaw_deg: float) -> None:
    way_m = np.linspace(0.0, 2.0, 20)
    cosine, sine = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    fitted = fit_boxes(np.stack((cosine * way_m, sine * way_m), axis=1), np.array([0]))
    assert fitted.size_m[0].max() == pytest.approx(2.0, abs=0.01)
    assert fitted.size_m[0].min() < 0.08  # half a step of the directions tried: 1.9 degrees


def test_a_single_point_has_the_least_size() -> None:
    fitted = fit_boxes(np.array([[3.0, 4.0]]), np.array([0]))
    assert fitted.center_ned_m.tolist() == [[3.0, 4.0]]
    assert fitted.size_m.tolist() == [[0.02, 0.02]]
