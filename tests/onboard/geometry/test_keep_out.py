"""Keep-outs: a box is the constant case, a moving box shifts with the time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.box import Box, Coefficients
from onboard.geometry.keep_out import KeepOut, MovingBox

NUMBERS = st.floats(-50.0, 50.0)
LENGTHS = st.floats(0.0, 9.0)
TIMES_S = st.floats(0.0, 200.0)
BOXES = st.builds(
    lambda x_m, y_m, along_m, across_m: Box(x_m, x_m + along_m, y_m, y_m + across_m),
    NUMBERS,
    NUMBERS,
    LENGTHS,
    LENGTHS,
)
VELOCITIES = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
MOVING = st.builds(MovingBox, BOXES, TIMES_S, VELOCITIES)
KEEP_OUTS: st.SearchStrategy[KeepOut] = st.one_of(BOXES, MOVING)


def value_at(face: Coefficients, elapsed_s: float) -> float:
    return sum(c * elapsed_s**power for power, c in enumerate(face))


@given(KEEP_OUTS, TIMES_S, st.floats(0.0, 20.0))
def test_the_faces_are_those_of_the_box_at_the_time(
    keep_out: KeepOut, begin_s: float, elapsed_s: float
) -> None:
    faces, box = keep_out.faces_from(begin_s), keep_out.box_at(begin_s + elapsed_s)
    found = [value_at(face, elapsed_s) for face in faces]
    expected = [box.x_min_m, box.x_max_m, box.y_min_m, box.y_max_m]
    assert found == pytest.approx(expected, abs=1e-9)
    assert all(1 <= len(face) <= 4 for face in faces)


@given(KEEP_OUTS, TIMES_S, st.floats(0.0, 20.0), st.floats(0.0, 1.0))
def test_what_is_swept_encloses_the_box_at_every_time(
    keep_out: KeepOut, begin_s: float, duration_s: float, share: float
) -> None:
    swept = keep_out.swept(begin_s, begin_s + duration_s)
    box = keep_out.box_at(begin_s + share * duration_s)
    around = swept.inflated(1e-9)
    assert around.enclosing(box) == around


@given(BOXES, TIMES_S, TIMES_S)
def test_a_box_is_the_same_at_all_times(box: Box, one_s: float, other_s: float) -> None:
    assert box.box_at(one_s) is box
    assert box.swept(one_s, other_s) is box
    assert box.faces_from(one_s) == box.faces_from(other_s)
    assert value_at(box.faces_from(0.0).x_max, other_s) == box.x_max_m


@given(BOXES, TIMES_S, TIMES_S)
def test_a_box_that_moves_at_no_speed_is_a_box(box: Box, reference_s: float, now_s: float) -> None:
    resting = MovingBox(box, reference_s, (0.0, 0.0))
    assert resting.box_at(now_s) == box
    assert resting.swept(reference_s, now_s) == box


def test_a_moving_box_by_hand() -> None:
    mover = MovingBox(Box(10.0, 11.0, -1.0, 1.0), 100.0, (-2.0, 0.5))
    assert mover.box_at(100.0) == Box(10.0, 11.0, -1.0, 1.0)
    assert mover.box_at(102.0) == Box(6.0, 7.0, 0.0, 2.0)
    assert mover.box_at(98.0) == Box(14.0, 15.0, -2.0, 0.0)
    assert mover.swept(100.0, 102.0) == Box(6.0, 11.0, -1.0, 2.0)
    assert mover.faces_from(102.0).x_min == (6.0, -2.0)
    assert mover.faces_from(102.0).y_max == (2.0, 0.5)


@given(MOVING, st.floats(0.0, 5.0), st.floats(0.0, 5.0))
def test_a_moving_box_keeps_its_size(mover: MovingBox, one_s: float, other_s: float) -> None:
    for time_s in (one_s, other_s):
        assert mover.box_at(time_s).size_m == pytest.approx(mover.box.size_m, abs=1e-9)
