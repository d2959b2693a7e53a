"""A grid answers for rectangles what its cells say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.free_grid import FreeGrid

CELL_M = 0.5


def grid_of(free: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> FreeGrid:
    table = np.zeros((free.shape[0] + 1, free.shape[1] + 1), np.int32)
    table[1:, 1:] = np.cumsum(np.cumsum(~free, axis=0), axis=1)
    return FreeGrid((-1.0, 2.0), CELL_M, table)


coordinates = st.integers(-3, 9).map(lambda quarters: quarters * 0.25) | st.integers(
    -2000, 4000
).map(lambda millimetres: millimetres * 1e-3)


@given(st.integers(0, 2**32 - 1), *[coordinates] * 4)
def test_a_rectangle_is_free_if_all_cells_that_it_reaches_into_are(
    seed: int, x0_m: float, x1_m: float, y0_m: float, y1_m: float
) -> None:
    free = np.random.default_rng(seed).random((4, 5)) < 0.8
    x0_m, x1_m = sorted((x0_m, x1_m))
    y0_m, y1_m = sorted((y0_m + 2.0, y1_m + 2.0))
    answer = grid_of(free).is_free(x0_m, x1_m, y0_m, y1_m)
    inside = x0_m >= -1.0 and x1_m <= 1.0 and y0_m >= 2.0 and y1_m <= 4.5
    reached = [
        free[i, j]
        for i in range(4)
        for j in range(5)
        if x0_m < -1.0 + (i + 1) * CELL_M
        and x1_m > -1.0 + i * CELL_M
        and y0_m < 2.0 + (j + 1) * CELL_M
        and y1_m > 2.0 + j * CELL_M
    ]
    if not inside:
        assert not answer
    elif x0_m < x1_m and y0_m < y1_m:
        assert answer == all(reached)
    elif answer:  # a line or a point lies in cells that are free
        assert all(reached)


def test_a_point_on_an_edge_between_unknown_cells_is_not_free() -> None:
    assert not grid_of(np.zeros((4, 5), bool)).is_free(0.0, 0.0, 3.0, 3.0)
    assert grid_of(np.ones((4, 5), bool)).is_free(0.0, 0.0, 3.0, 3.0)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("place", range(4))
def test_what_is_not_finite_is_not_free(wrong: float, place: int) -> None:
    faces = [0.0, 0.1, 3.0, 3.1]
    assert grid_of(np.ones((4, 5), bool)).is_free(*faces)
    faces[place] = wrong
    assert not grid_of(np.ones((4, 5), bool)).is_free(*faces)


def test_an_inverted_rectangle_is_not_free() -> None:
    assert not grid_of(np.ones((4, 5), bool)).is_free(0.5, 0.0, 3.0, 3.1)
    assert not grid_of(np.ones((4, 5), bool)).is_free(0.0, 0.5, 3.1, 3.0)


def test_free_cells_are_counted() -> None:
    free = np.ones((4, 5), bool)
    free[1, 2] = False
    assert grid_of(free).free_cells == 19


def test_one_rectangle_at_the_far_edge_leaves_the_answers_for_the_others() -> None:
    free = np.ones((4, 5), np.bool_)
    free[1, 1] = False
    grid = grid_of(free)
    # A line on the far edge of the grid lies in no cell; a taken cell; a free one.
    x_min_m, x_max_m = np.array([1.0, -0.4, 0.1]), np.array([1.0, -0.1, 0.4])
    y_min_m, y_max_m = np.array([2.1, 2.6, 2.6]), np.array([2.4, 2.9, 2.9])
    answers = grid.are_free(x_min_m, x_max_m, y_min_m, y_max_m)
    assert answers.tolist() == [False, False, True]


@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.integers(0, 4))
def test_without_some_cells_it_answers_as_if_they_were_unknown(seed: int, i: int, j: int) -> None:
    random = np.random.default_rng(seed)
    free = random.random((4, 5)) < 0.8
    shut = random.random((random.integers(1, 5 - i), random.integers(1, 6 - j))) < 0.5
    fewer = free.copy()
    fewer[i : i + shut.shape[0], j : j + shut.shape[1]] &= ~shut
    one, other = grid_of(free).without((i, j), shut), grid_of(fewer)
    x0, x1, y0, y1 = (each.ravel() for each in np.meshgrid(*(np.arange(6.0),) * 4, indexing="ij"))
    faces = [np.float64(-1.0) + CELL_M * each for each in (x0, x1)]
    faces += [np.float64(2.0) + CELL_M * each for each in (y0, y1)]
    assert one.are_free(*faces).tolist() == other.are_free(*faces).tolist()
