"""What one frame shows to be free, and that it never shows a place of an obstacle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import BOXES_MAX, View, seen_free
from tests.tools.seen_space_adversary import Adversary

CELL_M = 0.1
AHEAD = View((0.0, 0.0), 0.0, math.radians(45.0), 10.0, (), 0.1)
ALL_ROUND = replace(AHEAD, half_view_rad=math.pi)


def shows(view: View, x_m: float, y_m: float) -> bool:
    """Tell whether the view shows the cell around a point."""
    return bool(seen_free(view, np.array([x_m]), np.array([y_m]), CELL_M)[0])


def test_no_cell_that_holds_a_point_of_an_obstacle_is_seen_free_by_a_hostile_sensor() -> None:
    adversary = Adversary(seed=5)
    assert sum(adversary.false_cells() for _ in range(200)) == 0
    # It attacks frames that say something, and what it reports agrees with the truth.
    assert adversary.freed > 200 * 3000
    assert adversary.contradictions == 0


def test_range_and_view_end_where_errors_may_end_them() -> None:
    assert shows(AHEAD, 9.8, 0.0)
    assert not shows(AHEAD, 9.9, 0.0)
    assert not shows(replace(AHEAD, placing_error_m=0.3), 9.8, 0.0)
    assert not shows(replace(AHEAD, pose_error_m=0.3), 9.8, 0.0)
    assert not shows(replace(AHEAD, heading_error_rad=0.05), 9.8, 0.0)
    assert shows(AHEAD, 5.0, 4.8)
    assert not shows(AHEAD, 5.0, 4.95)
    assert not shows(AHEAD, -5.0, 0.0)
    assert not shows(replace(AHEAD, placing_error_m=0.3), 5.0, 4.8)
    assert not shows(replace(AHEAD, pose_error_m=0.2), 5.0, 4.8)
    assert not shows(replace(AHEAD, heading_error_rad=0.05), 5.0, 4.8)


def test_behind_a_box_and_beside_it_within_the_error_nothing_is_free() -> None:
    view = replace(AHEAD, boxes=(Box(4.0, 5.0, -0.5, 0.5),))
    assert shows(view, 3.8, 0.0)
    assert not shows(view, 3.88, 0.0)  # within the face's error
    assert not shows(view, 8.0, 0.9)  # in its shadow
    assert shows(view, 8.0, 1.6)
    assert shows(view, 4.5, 0.9)
    assert not shows(replace(view, pose_error_m=0.3), 4.5, 0.9)
    assert not shows(replace(view, heading_error_rad=0.1), 4.5, 0.9)


def test_a_view_all_round_has_no_edge_behind() -> None:
    assert shows(ALL_ROUND, -5.0, 0.0)
    astride = replace(ALL_ROUND, boxes=(Box(-5.0, -4.0, -0.5, 0.5),))
    for y_m in (-0.4, -0.05, 0.0, 0.05, 0.4):
        assert not shows(astride, -8.0, y_m)
        assert shows(astride, -3.5, y_m)
    assert shows(astride, -8.0, 2.0)


@pytest.mark.parametrize("view_deg", [350.0, 356.0, 359.9])
def test_a_box_astride_the_gap_of_a_wide_view_shades_both_sides(view_deg: float) -> None:
    half_rad = math.radians(view_deg) / 2.0
    astride = replace(ALL_ROUND, half_view_rad=half_rad, boxes=(Box(-3.0, -2.0, -1.0, 1.0),))
    for y_m in (-2.5, -1.0, -0.3, 0.0, 0.3, 1.0, 2.5):
        assert not shows(astride, -8.0, y_m)
    assert not shows(replace(astride, boxes=()), -8.0, 0.0)  # the gap itself


@pytest.mark.parametrize("place_m", [(0.0, 0.0), (0.55, 0.0), (0.59, 0.59)])
def test_from_within_a_box_or_its_error_nothing_is_seen(place_m: tuple[float, float]) -> None:
    box = Box(-0.5, 0.5, -0.5, 0.5)
    inside = replace(ALL_ROUND, position_leg_m=place_m, boxes=(box,))
    for turn in np.linspace(0.0, 2.0 * math.pi, 12).tolist():
        assert not shows(inside, 4.0 * math.cos(turn), 4.0 * math.sin(turn))


def test_in_a_crowd_nothing_is_seen() -> None:
    crowd = [Box(2.0, 2.1, 2.0, 2.1)] * BOXES_MAX
    assert shows(replace(AHEAD, boxes=crowd), 5.0, 0.0)
    assert not shows(replace(AHEAD, boxes=[*crowd, *crowd]), 5.0, 0.0)
    # What is out of range is not in the crowd.
    far = [Box(20.0, 21.0, 2.0, 2.1)] * BOXES_MAX
    assert shows(replace(AHEAD, boxes=[*crowd, *far]), 5.0, 0.0)


def test_a_scan_says_free_only_as_far_as_it_reaches_and_where_it_knows() -> None:
    scan = replace(AHEAD, free_range_m=(8.0, 0.0, 4.0, 9.0), scan_half_view_rad=AHEAD.half_view_rad)
    left, beside, right = math.radians(-34.0), math.radians(-11.0), math.radians(11.0)
    for turn, free_to_m in ((left, 8.0), (beside, 0.0), (right, 4.0)):
        for distance_m in (2.0, 3.7, 4.3, 7.6, 8.3):
            x_m, y_m = distance_m * math.cos(turn), distance_m * math.sin(turn)
            assert shows(scan, x_m, y_m) == (distance_m < free_to_m - 0.2)
    # Bins divide the sensor's whole view, although the contract counts on a part only.
    narrow = replace(scan, half_view_rad=math.radians(20.0))
    assert not shows(narrow, 2.0 * math.cos(beside), 2.0 * math.sin(beside))
    assert shows(narrow, 3.5 * math.cos(right), 3.5 * math.sin(right))
    # And a box ends it, too.
    boxed = replace(scan, boxes=(Box(2.9, 3.1, 0.3, 0.9),))
    assert not shows(boxed, 3.7 * math.cos(right), 3.7 * math.sin(right))


def test_the_place_of_the_sensor_itself_is_not_seen() -> None:
    assert not shows(ALL_ROUND, 0.0, 0.0)
    assert not shows(replace(ALL_ROUND, pose_error_m=0.3), 0.3, 0.0)
