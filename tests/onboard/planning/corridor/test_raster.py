"""Ways over a raster: no corner is cut, and a gap that is narrower than a cell is a way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from onboard.geometry.frames import FloatArray
from onboard.planning.corridor.raster import (
    CELL_M,
    Axes,
    BoolArray,
    Raster,
    Room,
    Ways,
    covered,
)


def ways_in(open_quarters: BoolArray, goal: tuple[int, int] = (0, 0)) -> Ways:
    """Return the ways where nothing but the blocked quarters costs anything."""
    shape = (open_quarters.shape[0] // 2, open_quarters.shape[1] // 2)
    exits = np.full(shape, math.inf)
    exits[goal] = 0.0
    raster = Raster(shape)
    return raster.ways(raster.graph(Room.of(np.ones(shape), open_quarters), exits))


def test_in_the_open_ways_are_straight_and_diagonal() -> None:
    left_m = ways_in(np.ones((8, 8), bool)).left_m
    assert left_m[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert left_m[3, 0] == pytest.approx(3.0 * CELL_M, abs=1e-6)
    assert left_m[3, 2] == pytest.approx((1.0 + 2.0 * math.sqrt(2.0)) * CELL_M, abs=1e-6)


def test_no_way_cuts_the_corner_between_two_blocked_cells() -> None:
    open_quarters = np.ones((6, 6), bool)
    open_quarters[0:2, 2:4] = open_quarters[2:4, 0:2] = False
    left_m = ways_in(open_quarters).left_m
    assert left_m[0, 0] < 1e-6
    assert math.isinf(left_m[1, 1])


@pytest.mark.parametrize("row", [6, 7])
def test_a_way_of_one_quarter_is_a_way(row: int) -> None:
    open_quarters = np.ones((16, 16), bool)
    open_quarters[4:12] = False
    open_quarters[4:12, row] = True
    left_m = ways_in(open_quarters, (0, 3)).left_m
    assert left_m[7, 3] == pytest.approx(7.0 * CELL_M, abs=1e-6)


@pytest.mark.parametrize("offset", range(4))
def test_blocks_that_touch_at_a_corner_leave_no_way(offset: int) -> None:
    """Two large blocks, corner to corner, at any place of the quarters against the cells."""
    for shift in range(4):
        open_quarters = np.ones((24, 24), bool)
        open_quarters[: 8 + offset, : 8 + shift] = False
        open_quarters[8 + offset :, 8 + shift :] = False
        left_m = ways_in(open_quarters, (0, 11)).left_m
        assert math.isinf(left_m[11, 0])


def test_each_way_leads_through_open_neighbours_to_the_exit() -> None:
    rng = np.random.default_rng(4)
    open_quarters = rng.random((40, 40)) < 0.8
    open_quarters[:2, :2] = True
    ways = ways_in(open_quarters)
    for start in np.argwhere(np.isfinite(ways.left_m)).tolist():
        (i, j), steps = start, 0
        while (i, j) != (0, 0):
            a, b = divmod(int(ways.leads_to[i, j]), 20)
            assert max(abs(a - i), abs(b - j)) == 1
            assert ways.left_m[a, b] < ways.left_m[i, j]
            i, j, steps = a, b, steps + 1
        assert steps < 400


def test_centres_in_boxes_are_found() -> None:
    axes = Axes(np.arange(6.0), np.arange(5.0))
    faces: FloatArray = np.array(((0.5, 2.5, 1.5, 9.0), (2.4, 4.0, -1.0, 1.0)))
    expected = np.zeros((6, 5), bool)
    expected[1:3, 2:] = True
    expected[3:4, :1] = True
    assert np.array_equal(covered(axes, faces), expected)
    assert not covered(axes, np.empty((0, 4))).any()
