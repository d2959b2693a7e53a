"""Strips around faces, and boxes that hold turned ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.perception.face_strips import enclosing_boxes, strip_around

COORDINATES = st.floats(-20.0, 20.0)


@given(
    st.tuples(COORDINATES, COORDINATES),
    st.tuples(COORDINATES, COORDINATES),
    st.floats(0.01, 0.5),
    st.floats(0.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)
def test_a_strip_covers_all_within_the_margin_of_its_line(
    begin: tuple[float, float],
    end: tuple[float, float],
    margin_m: float,
    share: float,
    along: float,
    across: float,
) -> None:
    begin_m, end_m = np.array(begin), np.array(end)
    line_m = begin_m + share * (end_m - begin_m)
    length_m = math.dist(begin, end)
    unit = (end_m - begin_m) / length_m if length_m > 0.0 else np.array([1.0, 0.0])
    point_m = line_m + margin_m * (along * unit + across * np.array([-unit[1], unit[0]]))
    low_x, high_x, low_y, high_y = strip_around(begin_m, end_m, margin_m)
    within = (low_x - 1e-9 <= point_m[0]) & (point_m[0] <= high_x + 1e-9)
    within &= (low_y - 1e-9 <= point_m[1]) & (point_m[1] <= high_y + 1e-9)
    assert within.any()


@pytest.mark.parametrize("turn_deg", [0.0, 10.0, 45.0, 80.0])
def test_a_turned_box_is_held_with_its_faces_off_by_the_error(turn_deg: float) -> None:
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    turn, error_m = np.array([[cosine, -sine], [sine, cosine]]), 0.2
    corners_m = np.array([(-1.0, -2.0), (1.0, -2.0), (1.0, 2.0), (-1.0, 2.0)])
    grown_m = (corners_m + error_m * np.sign(corners_m)) @ turn.T
    (box,) = enclosing_boxes((corners_m @ turn.T)[None], error_m)
    held = box.inflated(error_m)  # what the caller adds
    assert held.x_min_m - 1e-9 <= grown_m[:, 0].min()
    assert grown_m[:, 0].max() <= held.x_max_m + 1e-9
    assert held.y_min_m - 1e-9 <= grown_m[:, 1].min()
    assert grown_m[:, 1].max() <= held.y_max_m + 1e-9
