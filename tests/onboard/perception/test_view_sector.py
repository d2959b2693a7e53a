"""A coarse sector leaves out no cell that a view shows."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import View, seen_free
from onboard.perception.view_sector import Sectors

CELL_M = 0.1


@given(
    x_m=st.floats(-3.0, 3.0),
    y_m=st.floats(-3.0, 3.0),
    heading_rad=st.floats(-math.pi, math.pi),
    half_view_rad=st.one_of(st.floats(0.1, 3.1), st.just(math.pi)),
    range_m=st.floats(0.3, 2.5),
)
def test_no_cell_that_is_shown_is_left_out(
    x_m: float, y_m: float, heading_rad: float, half_view_rad: float, range_m: float
) -> None:
    view = View((x_m, y_m), heading_rad, half_view_rad, range_m, (), 0.0)
    corner = math.floor(x_m / CELL_M) - 27, math.floor(y_m / CELL_M) - 27
    half = min(math.floor(1.1 * range_m / CELL_M), 27)
    window = slice(27 - half, 28 + half)
    sector = Sectors(CELL_M).around(view, corner, window, window)
    middles = np.arange(window.start, window.stop, dtype=np.float64) + 0.5
    xs_m: FloatArray = (middles + corner[0]) * CELL_M
    ys_m: FloatArray = (middles + corner[1]) * CELL_M
    i, j = np.nonzero(np.ones_like(sector))
    shown = seen_free(view, xs_m[i], ys_m[j], CELL_M)
    assert sector[i[shown], j[shown]].all()
    assert not sector.all() or range_m < 0.5 or half_view_rad > 2.0


def test_what_lies_behind_is_left_out_and_sectors_are_kept() -> None:
    sectors = Sectors(CELL_M)
    window = slice(0, 41)
    for x_m in (0.02, 0.09):
        view = View((x_m, 0.05), math.radians(90.2), math.radians(60.0), 2.0, (), 0.0)
        sector = sectors.around(view, (-20, -20), window, window)
        assert sector[20, 39]
        assert not sector[20, 5]
        assert not sector[:, :15].any()
    assert len(sectors._kept) == 1
    for degrees in range(40):
        turned = View((0.0, 0.0), math.radians(degrees), 1.0, 2.0, (), 0.0)
        sectors.around(turned, (-20, -20), window, window)
    assert len(sectors._kept) <= 32
