"""A sector leaves out no cell that a view shows, and most of what it does not."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import View, seen_free
from onboard.perception.seen_free import SeenFree
from onboard.perception.view_sector import in_sector, of_whole_cells

CELL_M = 0.1
HALF_PI = math.pi / 2.0


def centres_m(middle_m: float, reach_m: float = 2.8) -> FloatArray:
    first = math.floor((middle_m - reach_m) / CELL_M)
    count = round(2.0 * reach_m / CELL_M)
    return (np.arange(count, dtype=np.float64) + first + 0.5) * CELL_M


@given(
    x_m=st.floats(-3.0, 3.0),
    y_m=st.floats(-3.0, 3.0),
    heading_rad=st.floats(-7.0, 7.0),
    half_view_rad=st.one_of(st.floats(0.05, 3.14), st.sampled_from((HALF_PI, math.pi))),
    range_m=st.floats(0.3, 2.5),
)
@example(0.0, 0.0, 0.0, HALF_PI, 2.5)
@example(0.0, 0.0, math.pi, math.nextafter(HALF_PI, 4.0), 2.5)
@example(0.05, 0.05, HALF_PI, math.nextafter(math.pi, 0.0), 2.5)
def test_no_cell_that_is_shown_is_left_out(
    x_m: float, y_m: float, heading_rad: float, half_view_rad: float, range_m: float
) -> None:
    view = View((x_m, y_m), heading_rad, half_view_rad, range_m, (), 0.0)
    xs_m, ys_m = centres_m(x_m), centres_m(y_m)
    sector = in_sector(view, xs_m, ys_m)
    i, j = np.indices(sector.shape).reshape(2, -1)
    shown = seen_free(view, xs_m[i], ys_m[j], CELL_M)
    assert sector[i[shown], j[shown]].all()
    # And of the circle it takes about the share that the view does.
    share = half_view_rad / math.pi * math.pi * range_m**2 / CELL_M**2
    assert abs(np.count_nonzero(sector) - share) <= 8.0 + 6.0 * range_m / CELL_M


@given(
    heading_rad=st.floats(-7.0, 7.0),
    half_view_rad=st.one_of(st.floats(0.2, 3.14), st.sampled_from((HALF_PI, math.pi))),
    range_m=st.floats(0.5, 2.7),
    face_error_m=st.floats(0.0, 0.4),
    pose_error_m=st.floats(0.0, 0.1),
    placing_error_m=st.floats(0.0, 0.4),
    heading_error_rad=st.floats(0.0, 0.1),
)
@example(0.3, 1.0, 2.7, 0.0, 0.0, 0.0, 0.0)
def test_whole_cells_lie_in_a_smaller_view(
    heading_rad: float,
    half_view_rad: float,
    range_m: float,
    face_error_m: float,
    pose_error_m: float,
    placing_error_m: float,
    heading_error_rad: float,
) -> None:
    view = View(
        (0.03, -0.02),
        heading_rad,
        half_view_rad,
        range_m,
        (),
        face_error_m,
        pose_error_m,
        placing_error_m,
        heading_error_rad,
    )
    xs_m = ys_m = centres_m(0.0)
    i, j = np.indices((xs_m.size, ys_m.size)).reshape(2, -1)
    shown = seen_free(view, xs_m[i], ys_m[j], CELL_M)
    smaller = of_whole_cells(view, CELL_M)
    if smaller is None:
        assert not shown.any()
        return
    sector = in_sector(smaller, xs_m, ys_m)
    assert sector[i[shown], j[shown]].all()
    assert np.count_nonzero(sector) < np.count_nonzero(in_sector(view, xs_m, ys_m))


@pytest.mark.parametrize("degrees", [30.0, 60.0, 100.0, 150.0])
def test_a_sector_is_what_bearing_and_distance_say(degrees: float) -> None:
    heading_rad, half_rad = math.radians(217.3), math.radians(degrees)
    view = View((0.513, -0.271), heading_rad, half_rad, 2.013, (), 0.0)
    xs_m, ys_m = centres_m(0.513), centres_m(-0.271)
    dx_m, dy_m = xs_m[:, None] - 0.513, ys_m[None, :] + 0.271
    aside_rad = (np.arctan2(dy_m, dx_m) - heading_rad + math.pi) % (2.0 * math.pi) - math.pi
    expected = (np.hypot(dx_m, dy_m) <= 2.013) & (np.abs(aside_rad) <= half_rad)
    assert (in_sector(view, xs_m, ys_m) == expected).all()
    assert expected.any()


def test_however_far_a_sensor_sees_and_turns_a_frame_costs_what_the_grid_does() -> None:
    seen = SeenFree()
    cells = round(2.0 * seen.reach_m / CELL_M) ** 2
    tracemalloc.start()
    for number, range_m in enumerate((30.0, 100.0, 1e3, 1e6)):
        seen.see(View((0.0, 0.0), math.radians(37.0 * number), 1.0, range_m, (), 0.05))
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 100 * cells


@pytest.mark.parametrize("position_leg_m", [(0.0, 0.0), (15.9, -15.9), (-25.0, 4.0)])
def test_a_frame_frees_the_same_as_one_that_looks_at_every_cell(
    position_leg_m: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    few, every = SeenFree(frames_needed=2), SeenFree(frames_needed=2)
    views = [
        View(position_leg_m, math.radians(1.5 * step), 1.0, 30.7 + 0.1 * step, (), 0.05)
        for step in range(3)
    ]
    for view in views:
        few.see(view)
    monkeypatch.setattr(
        "onboard.perception.seen_free.in_sector",
        lambda _, xs_m, ys_m: np.ones((xs_m.size, ys_m.size), np.bool_),
    )
    for view in views:
        every.see(view)
    assert few.size == every.size > 1000
    assert (few.grid().unknown_sum == every.grid().unknown_sum).all()
