"""Local NED and geographic coordinates agree in both directions."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.autopilot.geodesy import GeographicPosition, geographic_from_ned, ned_from_geographic
from sitl.config import HomeConfig

HOME = HomeConfig(latitude_deg=47.4, longitude_deg=8.5, altitude_m=488.0)
metres = st.floats(-5000.0, 5000.0)


def test_the_origin_is_home() -> None:
    assert geographic_from_ned(HOME, (0.0, 0.0, 0.0)) == GeographicPosition(47.4, 8.5, 488.0)


@given(north_m=metres, east_m=metres, down_m=metres)
def test_there_and_back_is_the_same_place(north_m: float, east_m: float, down_m: float) -> None:
    place = geographic_from_ned(HOME, (north_m, east_m, down_m))
    assert ned_from_geographic(HOME, place) == pytest.approx((north_m, east_m, down_m), abs=1e-6)


@given(
    latitude_deg=st.floats(-85.0, 85.0),
    longitude_deg=st.floats(-180.0, 180.0),
    north_m=metres,
    east_m=metres,
)
def test_the_round_trip_holds_everywhere(
    latitude_deg: float, longitude_deg: float, north_m: float, east_m: float
) -> None:
    home = HomeConfig(latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    back = ned_from_geographic(home, geographic_from_ned(home, (north_m, east_m, 0.0)))
    assert back == pytest.approx((north_m, east_m, 0.0), abs=1e-5)


def test_north_is_a_higher_latitude_and_up_a_higher_altitude() -> None:
    place = geographic_from_ned(HOME, (1000.0, 0.0, -20.0))
    assert place.latitude_deg > HOME.latitude_deg
    assert place.longitude_deg == HOME.longitude_deg
    assert place.altitude_m == HOME.altitude_m + 20.0


def test_a_degree_of_latitude_is_111_km_and_one_of_longitude_shrinks_with_the_cosine() -> None:
    north_m, _, _ = ned_from_geographic(HOME, GeographicPosition(48.4, 8.5, 488.0))
    _, east_m, _ = ned_from_geographic(HOME, GeographicPosition(47.4, 9.5, 488.0))
    assert north_m == pytest.approx(111_195.0, rel=1e-4)
    assert east_m == pytest.approx(north_m * math.cos(math.radians(47.4)), rel=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_east_is_a_higher_longitude(sign: float) -> None:
    place = geographic_from_ned(HOME, (0.0, sign * 100.0, 0.0))
    assert math.copysign(1.0, place.longitude_deg - HOME.longitude_deg) == sign
