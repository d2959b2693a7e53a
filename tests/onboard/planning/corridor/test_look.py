"""Where the nose points: along the guide in flight, to each side at rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from onboard.geometry.frames import FloatArray
from onboard.geometry.free_grid import FreeGrid
from onboard.planning.corridor.look import (
    TURN_FAST_RADPS,
    TURN_MAX_RADPS,
    Outlook,
    first_looks_rad,
    heading_in_flight_rad,
    looks_at_rest_rad,
    wrapped_rad,
)

BoolArray = NDArray[np.bool_]

HALF_VIEW_RAD = math.radians(45.0)
PERIOD_S = 0.2
SLOW_RAD, FAST_RAD = TURN_MAX_RADPS * PERIOD_S, TURN_FAST_RADPS * PERIOD_S


def grid_where(unknown: Callable[[FloatArray, FloatArray], BoolArray]) -> FreeGrid:
    """A grid of 20 m about the origin."""
    middles = np.linspace(-9.95, 9.95, 200)
    table = np.zeros((201, 201), np.int32)
    table[1:, 1:] = unknown(middles[:, None], middles[None, :]).cumsum(axis=0).cumsum(axis=1)
    return FreeGrid((-10.0, -10.0), 0.1, table)


ALL_SEEN = grid_where(lambda x, y: np.zeros(np.broadcast_shapes(x.shape, y.shape), bool))
UNSEEN_LEFT = grid_where(lambda x, y: (x < 1.0) & (y < -0.3))


def outlook(
    bearing_rad: float | None, heading_rad: float = 0.0, grid: FreeGrid = ALL_SEEN
) -> Outlook:
    """At the origin, with a straight guide."""
    path = None
    if bearing_rad is not None:
        path = np.outer(np.linspace(0.0, 18.0, 90), (math.cos(bearing_rad), math.sin(bearing_rad)))
    return Outlook((0.0, 0.0), heading_rad, HALF_VIEW_RAD, path, grid, 0.65)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_the_nose_turns_towards_the_guide_and_fast_only_for_long_turns(
    bearing_rad: float, heading_rad: float
) -> None:
    after_rad = heading_in_flight_rad(outlook(bearing_rad, heading_rad), PERIOD_S)
    before = abs(wrapped_rad(bearing_rad - heading_rad))
    most_rad = FAST_RAD if before > math.radians(11.9) else SLOW_RAD
    assert abs(after_rad - heading_rad) <= most_rad + 1e-12
    assert abs(wrapped_rad(bearing_rad - after_rad)) <= before + 1e-9


def test_without_a_guide_the_nose_stays() -> None:
    assert heading_in_flight_rad(outlook(None, 0.7), PERIOD_S) == 0.7


def test_in_flight_the_nose_turns_until_what_is_unseen_beside_the_guide_is_in_view() -> None:
    heading_rad = 0.0
    for _ in range(20):
        heading_rad = heading_in_flight_rad(outlook(0.0, heading_rad, UNSEEN_LEFT), PERIOD_S)
    assert heading_rad < -math.radians(20.0)


@given(st.one_of(st.none(), st.floats(-math.pi, math.pi)), st.floats(-3.0, 3.0))
def test_a_look_all_round_shows_every_bearing(
    bearing_rad: float | None, heading_rad: float
) -> None:
    looks = looks_at_rest_rad(outlook(bearing_rad, heading_rad), all_round=True)
    for bearing in np.linspace(-math.pi, math.pi, 73).tolist():
        nearest = min(abs(wrapped_rad(bearing - look)) for look in (heading_rad, *looks))
        assert nearest < HALF_VIEW_RAD


@pytest.mark.parametrize("shown_deg", [16.0, 24.5, 44.0])
def test_a_look_all_round_shows_what_is_near_at_every_bearing(shown_deg: float) -> None:
    """The nearer a cell is, the more of the view the errors of pose and heading take from it."""
    near = replace(outlook(0.2), shown_half_rad=math.radians(shown_deg))
    looks = looks_at_rest_rad(near, all_round=True)
    for bearing in np.linspace(-math.pi, math.pi, 721).tolist():
        nearest = min(abs(wrapped_rad(bearing - look)) for look in (0.0, *looks))
        assert nearest <= min(math.radians(shown_deg), HALF_VIEW_RAD) + 1e-9


def test_a_pause_looks_at_what_is_unseen_beside_the_guide_then_along_it() -> None:
    *looks, last = looks_at_rest_rad(outlook(0.2, 0.0, UNSEEN_LEFT), all_round=False)
    assert last == pytest.approx(0.2)
    assert looks
    assert all(look < -math.radians(30.0) for look in looks)


def test_where_a_turn_shows_nothing_no_look_is_made() -> None:
    assert looks_at_rest_rad(outlook(0.2), all_round=False) == pytest.approx((0.2,))


@given(st.floats(-3.0, 3.0))
def test_a_turn_on_the_spot_shows_all_bearings_and_ends_where_it_began(heading_rad: float) -> None:
    looks = first_looks_rad(heading_rad, HALF_VIEW_RAD)
    assert wrapped_rad(looks[-1] - heading_rad) == pytest.approx(0.0, abs=1e-9)
    turns = np.diff((heading_rad, *looks))
    assert (turns > 0.0).all()
    assert (turns < 2.0 * HALF_VIEW_RAD).all()
