"""The narrowest gap that a path leads through."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.preflight.rehearsal.narrowest_gap import narrowest_gap_m

PATH_M = np.column_stack((np.arange(0.0, 20.0, 0.5), np.zeros(40)))


def box(x_m: float, y_m: float, half_m: float = 0.5) -> tuple[float, float, float, float]:
    return (x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)


def test_a_gap_is_between_faces_on_either_side() -> None:
    boxes_m = np.array([box(10.0, 2.0), box(10.0, -3.0), box(4.0, 3.0), box(4.0, -4.0)])
    assert narrowest_gap_m(PATH_M, boxes_m) == pytest.approx(4.0)


def test_obstacles_on_one_side_make_no_gap() -> None:
    assert narrowest_gap_m(PATH_M, np.array([box(25.0, 2.0), box(25.0, 4.0)])) is None
    assert narrowest_gap_m(PATH_M, np.array([box(10.0, 2.0)])) is None
    assert narrowest_gap_m(PATH_M, np.zeros((0, 4))) is None


def test_far_obstacles_make_no_gap() -> None:
    assert narrowest_gap_m(PATH_M, np.array([box(10.0, 2.0), box(10.0, -30.0)])) is None
