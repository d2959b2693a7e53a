"""Local frames of both autopilots, and the antimeridian."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.local_frame import (
    Autopilot,
    GeographicPoint,
    LocalFrame,
    longitude_difference_deg,
)

ZURICH = GeographicPoint(47.397742, 8.545594, 488.0)
LATITUDES = st.floats(-70.0, 70.0)
SMALL = st.floats(-0.02, 0.02)


@pytest.mark.parametrize(("autopilot", "radius_m"), [("px4", 6_371_000.0), ("ardupilot", 6.3781e6)])
def test_a_minute_north_is_a_minute_of_that_autopilots_earth(
    autopilot: Autopilot, radius_m: float
) -> None:
    frame = LocalFrame(ZURICH, autopilot)
    north_m, east_m = frame.north_east_m(ZURICH.latitude_deg + 1.0 / 60.0, ZURICH.longitude_deg)
    assert north_m == pytest.approx(radius_m * math.radians(1.0 / 60.0), abs=1e-6)
    assert east_m == pytest.approx(0.0, abs=1e-6)


def test_the_autopilots_disagree_by_a_metre_in_900() -> None:
    place = (ZURICH.latitude_deg + 0.0081, ZURICH.longitude_deg)
    px4_m, _ = LocalFrame(ZURICH, "px4").north_east_m(*place)
    ardupilot_m, _ = LocalFrame(ZURICH, "ardupilot").north_east_m(*place)
    assert 0.9 < ardupilot_m - px4_m < 1.1


@given(LATITUDES, SMALL, SMALL)
def test_distances_from_the_origin_are_those_on_the_sphere(
    latitude: float, north: float, east: float
) -> None:
    """The azimuthal equidistant projection keeps them; checked by the haversine formula."""
    frame = LocalFrame(GeographicPoint(latitude, 10.0), "px4")
    found_m = math.hypot(*frame.north_east_m(latitude + north, 10.0 + east))
    half_north, half_east = math.radians(north) / 2.0, math.radians(east) / 2.0
    scale = math.cos(math.radians(latitude)) * math.cos(math.radians(latitude + north))
    haversine = math.sin(half_north) ** 2 + scale * math.sin(half_east) ** 2
    assert found_m == pytest.approx(2.0 * 6_371_000.0 * math.asin(math.sqrt(haversine)), abs=1e-5)


@given(LATITUDES, SMALL, SMALL, st.sampled_from(["px4", "ardupilot"]))
def test_the_antimeridian_changes_nothing(
    latitude: float, north: float, east: float, autopilot: Autopilot
) -> None:
    there = LocalFrame(GeographicPoint(latitude, 179.999), autopilot)
    here = LocalFrame(GeographicPoint(latitude, 9.999), autopilot)
    across = 179.999 + east
    wrapped = across - 360.0 if across > 180.0 else across
    assert there.north_east_m(latitude + north, wrapped) == pytest.approx(
        here.north_east_m(latitude + north, 9.999 + east), abs=1e-4
    )


def test_longitudes_differ_by_the_short_way() -> None:
    assert longitude_difference_deg(-179.5, 179.5) == pytest.approx(1.0)
    assert longitude_difference_deg(179.5, -179.5) == pytest.approx(-1.0)
    assert longitude_difference_deg(10.0, 8.0) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("point", "word"),
    [
        ((91.0, 0.0), "latitude"),
        ((-90.5, 0.0), "latitude"),
        ((0.0, 181.0), "longitude"),
        ((math.nan, 0.0), "latitude"),
        ((0.0, math.inf), "longitude"),
    ],
)
def test_what_is_no_place_on_earth(point: tuple[float, float], word: str) -> None:
    problem = GeographicPoint(*point).problem()
    assert problem is not None
    assert problem.startswith(word)
    assert ZURICH.problem() is None


@given(LATITUDES, SMALL, SMALL, st.sampled_from(["px4", "ardupilot"]))
def test_the_way_back_is_the_inverse(
    latitude: float, north: float, east: float, autopilot: Autopilot
) -> None:
    frame = LocalFrame(GeographicPoint(latitude, 179.995), autopilot)
    place_m = frame.north_east_m(latitude + north, 179.995 + east)
    found_deg = frame.latitude_longitude_deg(*place_m)
    assert found_deg[0] == pytest.approx(latitude + north, abs=1e-9)
    assert longitude_difference_deg(found_deg[1], 179.995) == pytest.approx(east, abs=1e-8)
    assert abs(found_deg[1]) <= 180.0


def test_the_origin_is_its_own_inverse() -> None:
    assert LocalFrame(ZURICH).latitude_longitude_deg(0.0, 0.0) == ZURICH[:2]
