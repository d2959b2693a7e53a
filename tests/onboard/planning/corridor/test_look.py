"""Where the nose points: along the guide in flight, to each side at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.free_grid import FreeGrid
from onboard.planning.corridor.look import (
    Outlook,
    first_looks_rad,
    heading_in_flight_rad,
    looks_at_rest_rad,
    wrapped_rad,
)

UNKNOWN = FreeGrid((-5.0, -5.0), 0.1, np.add.outer(np.arange(101.0), np.arange(101.0)))
HALF_VIEW_RAD = math.radians(45.0)


def outlook(bearing_rad: float | None, heading_rad: float = 0.0) -> Outlook:
    """At the origin, with a straight guide."""
    path = None
    if bearing_rad is not None:
        path = np.outer(np.linspace(0.0, 18.0, 90), (math.cos(bearing_rad), math.sin(bearing_rad)))
    return Outlook((0.0, 0.0), heading_rad, HALF_VIEW_RAD, path, UNKNOWN, 0.65)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), st.floats(0.0, 1.0))
def test_the_nose_turns_towards_the_guide_and_no_faster_than_allowed(
    bearing_rad: float, heading_rad: float, step_rad: float
) -> None:
    after_rad = heading_in_flight_rad(outlook(bearing_rad, heading_rad), step_rad)
    assert abs(after_rad - heading_rad) <= step_rad + 1e-12
    before = abs(wrapped_rad(bearing_rad - heading_rad))
    assert abs(wrapped_rad(bearing_rad - after_rad)) <= before + 1e-9


def test_without_a_guide_the_nose_stays() -> None:
    assert heading_in_flight_rad(outlook(None, 0.7), 0.1) == 0.7


@given(st.one_of(st.none(), st.floats(-math.pi, math.pi)), st.floats(-3.0, 3.0))
def test_a_look_all_round_shows_every_bearing_and_ends_where_it_began(
    bearing_rad: float | None, heading_rad: float
) -> None:
    looks = looks_at_rest_rad(outlook(bearing_rad, heading_rad), all_round=True)
    assert looks[-1] == heading_rad
    for bearing in np.linspace(-math.pi, math.pi, 73).tolist():
        assert min(abs(wrapped_rad(bearing - look)) for look in looks) < HALF_VIEW_RAD


def test_the_first_pause_looks_along_the_guide_only() -> None:
    assert looks_at_rest_rad(outlook(0.8), all_round=False) == pytest.approx((0.8, 0.8, 0.0))


def test_where_the_guide_leads_straight_on_a_look_goes_all_round() -> None:
    assert len(looks_at_rest_rad(outlook(0.0), all_round=False)) == 5


def test_the_first_look_shows_what_is_aside_and_ends_ahead() -> None:
    left, right, ahead = first_looks_rad(0.3, HALF_VIEW_RAD)
    assert ahead == 0.3
    assert left - ahead == pytest.approx(ahead - right) == pytest.approx(math.radians(70.0))
