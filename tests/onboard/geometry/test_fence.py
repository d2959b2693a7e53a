"""Clearances of a geofence, against shapely."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from onboard.geometry.fence import Fence, FenceArea

L_SHAPE = ((0.0, 0.0), (0.0, 30.0), (10.0, 30.0), (10.0, 10.0), (30.0, 10.0), (30.0, 0.0))
INSIDE = FenceArea(L_SHAPE, None, keeps_in=True)
OUTSIDE = FenceArea(L_SHAPE, None, keeps_in=False)
CIRCLE = FenceArea(((5.0, 5.0),), 20.0, keeps_in=True)
HOLE = FenceArea(((5.0, 5.0),), 2.0, keeps_in=False)
coordinate = st.floats(-40.0, 40.0)


def clearance_m(fence: Fence | FenceArea, north_m: float, east_m: float) -> float:
    return float(fence.clearance_m(np.array(north_m), np.array(east_m)))


@given(coordinate, coordinate)
def test_a_polygon_agrees_with_shapely(north_m: float, east_m: float) -> None:
    polygon, place = Polygon(L_SHAPE), Point(north_m, east_m)
    away_m = polygon.exterior.distance(place)
    expected_m = away_m if polygon.contains(place) else -away_m
    assert clearance_m(INSIDE, north_m, east_m) == pytest.approx(expected_m, abs=1e-9)
    assert clearance_m(OUTSIDE, north_m, east_m) == pytest.approx(-expected_m, abs=1e-9)


def test_all_areas_count_together() -> None:
    fence = Fence((CIRCLE, HOLE))
    assert clearance_m(fence, 5.0, 5.0) == -2.0
    assert clearance_m(fence, 5.0, 11.0) == pytest.approx(4.0)
    assert clearance_m(fence, 5.0, 24.0) == pytest.approx(1.0)
    assert clearance_m(fence, 5.0, 26.0) == pytest.approx(-1.0)


def test_a_leg_between_two_places_inside_may_leave_the_fence() -> None:
    fence = Fence((INSIDE,))
    assert fence.leg_clearance_m((5.0, 5.0), (5.0, 25.0)) == pytest.approx(5.0, abs=0.3)
    assert fence.leg_clearance_m((5.0, 25.0), (25.0, 5.0)) < 0.0
    places = [(5.0, 5.0), (5.0, 25.0), (25.0, 5.0)]
    assert fence.crossed_leg(places, [1.0, 1.0]) == 1
    assert fence.crossed_leg(places, [6.0, 1.0]) == 0
    assert fence.crossed_leg(places[:2], [4.0]) is None


@pytest.mark.parametrize("side", [48, 41, 84])
@pytest.mark.parametrize("turn_rad", [0.0, 0.7])
def test_the_allowed_cells_are_those_that_lie_wholly_inside(side: int, turn_rad: float) -> None:
    """In a grid of any size, turned; each corner of an allowed cell has a clearance."""
    fence, cell_m = Fence((INSIDE, HOLE)), 0.5
    xs_m = (np.arange(side) + 0.5) * cell_m - 4.0
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    north_m = cosine * xs_m[:, None] - sine * xs_m[None, :]
    east_m = sine * xs_m[:, None] + cosine * xs_m[None, :]
    allowed = fence.allowed_cells(north_m, east_m, cell_m)
    assert allowed is not None
    one_by_one = fence.clearance_m(north_m, east_m) >= cell_m / math.sqrt(2.0)
    assert (allowed == one_by_one).all()
    assert 0 < allowed.sum() < allowed.size


def test_far_from_the_border_no_cell_is_looked_at() -> None:
    fence = Fence((FenceArea(((0.0, 0.0),), 1000.0, keeps_in=True),))
    grid_m = np.zeros((40, 40))
    assert fence.allowed_cells(grid_m, grid_m, 0.1) is None
