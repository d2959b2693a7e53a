"""Areas of boxes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.fleet.area import along, around, distance_m, meet, meeting

COORDINATE = st.floats(-100.0, 100.0)
PLACE = st.tuples(COORDINATE, COORDINATE)


@given(PLACE, PLACE, st.floats(0.1, 5.0), st.integers(1, 20), st.floats(0.0, 1.0))
def test_boxes_along_a_way_hold_all_within_reach_of_it(
    start_m: tuple[float, float],
    end_m: tuple[float, float],
    reach_m: float,
    count: int,
    share: float,
) -> None:
    boxes = along(start_m, end_m, reach_m, count)
    assert len(boxes) == count
    place = tuple(a + share * (b - a) for a, b in zip(start_m, end_m, strict=True))
    corner = (place[0] + reach_m, place[1] - reach_m)
    assert distance_m(boxes, corner) < 1e-9


@given(PLACE, PLACE, st.floats(0.1, 50.0), st.floats(0.1, 50.0))
def test_two_boxes_meet_if_they_are_near_on_both_axes(
    one_m: tuple[float, float], other_m: tuple[float, float], reach_m: float, also_m: float
) -> None:
    apart_m = max(abs(a - b) for a, b in zip(one_m, other_m, strict=True))
    if abs(apart_m - reach_m - also_m) > 1e-9:
        found = meet(around(one_m, reach_m), around(other_m, also_m))
        assert found == (apart_m < reach_m + also_m)


def test_boxes_that_touch_meet() -> None:
    assert meet(np.array([[0.0, 1.0, 0.0, 1.0]]), np.array([[1.0, 2.0, 1.0, 2.0]]))


def test_which_boxes_of_an_area_meet_another() -> None:
    way = along((0.0, 0.0), (30.0, 0.0), 1.0, 3)
    found = meeting(way, np.concatenate((around((25.0, 0.0), 1.0), around((0.0, 50.0), 1.0))))
    assert found.tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("place_m", "away_m"), [((0.5, 0.5), 0.0), ((4.0, 5.0), 5.0), ((0.0, -2.0), 2.0)]
)
def test_the_distance_of_a_place(place_m: tuple[float, float], away_m: float) -> None:
    area = np.array([[0.0, 1.0, 0.0, 1.0], [50.0, 60.0, 0.0, 1.0]])
    assert distance_m(area, place_m) == pytest.approx(away_m)


def test_an_empty_area_is_nowhere() -> None:
    empty = np.zeros((0, 4))
    assert distance_m(empty, (0.0, 0.0)) == math.inf
    assert not meet(empty, around((0.0, 0.0), 9.0))
