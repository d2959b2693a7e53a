"""Boxes are closed rectangles in the leg frame."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.box import Box

NUMBERS = st.floats(-1e3, 1e3)
LENGTHS = st.floats(0.0, 50.0)
BOXES = st.builds(
    lambda x_m, y_m, along_m, across_m: Box(x_m, x_m + along_m, y_m, y_m + across_m),
    NUMBERS,
    NUMBERS,
    LENGTHS,
    LENGTHS,
)


def contains(box: Box, x_m: float, y_m: float) -> bool:
    return box.x_min_m <= x_m <= box.x_max_m and box.y_min_m <= y_m <= box.y_max_m


def test_boxes() -> None:
    box = Box(1.0, 3.0, -2.0, 5.0)
    assert box.size_m == (2.0, 7.0)
    assert box.inflated(0.5) == Box(0.5, 3.5, -2.5, 5.5)
    assert box.enclosing(Box(2.0, 4.0, -3.0, 1.0)) == Box(1.0, 4.0, -3.0, 5.0)
    assert box.enclosing(Box(0.0, 2.0, 0.0, 9.0)) == Box(0.0, 3.0, -2.0, 9.0)


@pytest.mark.parametrize(
    ("other", "touches"),
    [
        (Box(3.0, 4.0, 0.0, 1.0), True),
        (Box(3.001, 4.0, 0.0, 1.0), False),
        (Box(0.0, 1.0, 0.0, 1.0), True),
        (Box(0.0, 0.999, 0.0, 1.0), False),
        (Box(1.0, 2.0, 5.0, 6.0), True),
        (Box(1.0, 2.0, 5.001, 6.0), False),
        (Box(1.0, 2.0, -3.0, -2.0), True),
        (Box(1.0, 2.0, -3.0, -2.001), False),
        (Box(0.0, 9.0, -9.0, 9.0), True),
    ],
)
def test_closed_boxes_touch(other: Box, touches: bool) -> None:
    box = Box(1.0, 3.0, -2.0, 5.0)
    assert box.intersects(other) is touches
    assert other.intersects(box) is touches


@pytest.mark.parametrize("corners", [(2.0, 1.0, 0.0, 1.0), (0.0, 1.0, 2.0, 1.0), (math.nan,) * 4])
def test_boxes_have_an_inside(corners: tuple[float, float, float, float]) -> None:
    with pytest.raises(ValueError, match="not a box"):
        Box(*corners)


def test_a_point_is_a_box() -> None:
    assert Box(1.0, 1.0, 2.0, 2.0).size_m == (0.0, 0.0)


@given(BOXES, BOXES, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_boxes_that_share_a_point_intersect(one: Box, other: Box, u: float, v: float) -> None:
    x_m = one.x_min_m + u * one.size_m[0]
    y_m = one.y_min_m + v * one.size_m[1]
    if contains(one, x_m, y_m) and contains(other, x_m, y_m):
        assert one.intersects(other)


@given(BOXES, BOXES)
def test_intersection_is_overlap_on_both_axes(one: Box, other: Box) -> None:
    x_m, y_m = max(one.x_min_m, other.x_min_m), max(one.y_min_m, other.y_min_m)
    shared = contains(one, x_m, y_m) and contains(other, x_m, y_m)
    assert one.intersects(other) == other.intersects(one) == shared


@given(BOXES, BOXES)
def test_the_enclosing_box_holds_both_and_touches_on_every_side(one: Box, other: Box) -> None:
    around = one.enclosing(other)
    assert around == other.enclosing(one)
    for box in (one, other):
        assert contains(around, box.x_min_m, box.y_min_m)
        assert contains(around, box.x_max_m, box.y_max_m)
    assert around.x_min_m in (one.x_min_m, other.x_min_m)
    assert around.x_max_m in (one.x_max_m, other.x_max_m)
    assert around.y_min_m in (one.y_min_m, other.y_min_m)
    assert around.y_max_m in (one.y_max_m, other.y_max_m)


@given(BOXES, NUMBERS, NUMBERS)
def test_a_shift_moves_every_face(box: Box, x_m: float, y_m: float) -> None:
    moved = box.shifted_by(x_m, y_m)
    assert moved == Box(box.x_min_m + x_m, box.x_max_m + x_m, box.y_min_m + y_m, box.y_max_m + y_m)
    assert moved.size_m == pytest.approx(box.size_m, abs=1e-9)


@given(BOXES, st.floats(0.0, 5.0))
def test_inflation_grows_every_side_by_the_margin(box: Box, margin_m: float) -> None:
    inflated = box.inflated(margin_m)
    along_m, across_m = box.size_m
    assert inflated.size_m == pytest.approx((along_m + 2 * margin_m, across_m + 2 * margin_m))
    assert inflated.enclosing(box) == inflated


def test_a_negative_inflation_cannot_turn_a_box_inside_out() -> None:
    assert Box(0.0, 2.0, 0.0, 2.0).inflated(-1.0) == Box(1.0, 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="not a box"):
        Box(0.0, 2.0, 0.0, 2.0).inflated(-1.001)
