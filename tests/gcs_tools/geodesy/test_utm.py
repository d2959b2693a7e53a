"""UTM against pyproj 3.8 (PROJ, EPSG:326xx and 327xx), whose numbers stand here."""

from __future__ import annotations

import math

import pytest

from gcs_tools.geodesy.utm import UtmZone

PLACES = [
    ("32N", 47.397742, 8.545594, 465710.7585838812, 5249465.363835202),
    ("60N", 5.25, 179.999, 832473.2860721496, 581095.7509345971),
    ("1S", -16.5, -179.5, 233124.8696493397, 8174101.733034125),
    ("33N", 69.65, 18.95, 653210.0894824817, 7731796.830377409),
    ("17N", 43.642567, -79.387139, 630084.3008341494, 4833438.585674325),
    ("31N", 0.001, 3.0, 500000.0, 110.5300461113784),
    ("56S", -33.8567844, 151.2152967, 334900.2343061051, 6252290.477565816),
    ("32N", 60.0, 5.9, 327131.36387748364, 6655462.683925023),
]
MICROMETRE_DEG = 1e-11


@pytest.mark.parametrize(("zone", "latitude", "longitude", "easting", "northing"), PLACES)
def test_a_place_is_where_proj_puts_it(
    zone: str, latitude: float, longitude: float, easting: float, northing: float
) -> None:
    found = UtmZone.named(zone).latitude_longitude_deg(easting, northing)
    assert found == pytest.approx((latitude, longitude), abs=10 * MICROMETRE_DEG)


def test_beyond_the_antimeridian_the_longitude_wraps() -> None:
    _, west = UtmZone(60, south=False).latitude_longitude_deg(860_000.0, 581_095.0)
    assert -180.0 < west < -179.0


def test_grid_north_is_not_north_away_from_the_central_meridian() -> None:
    """At 47° and 3° from it they are 2.2° apart: a metre in 26."""
    zone = UtmZone(32, south=False)
    at = zone.latitude_longitude_deg(270_000.0, 5_210_000.0)
    north = zone.latitude_longitude_deg(270_000.0, 5_211_000.0)
    east_m = math.radians(north[1] - at[1]) * 6.37e6 * math.cos(math.radians(at[0]))
    assert abs(east_m) > 35.0


@pytest.mark.parametrize(
    ("text", "zone"),
    [("32N", (32, False)), (" 32 n ", (32, False)), ("01S", (1, True)), ("60s", (60, True))],
)
def test_names_of_zones(text: str, zone: tuple[int, bool]) -> None:
    assert UtmZone.named(text) == zone


@pytest.mark.parametrize("text", ["", "N", "0N", "61N", "32T", "32U", "320N", "utm32", "32"])
def test_what_is_not_a_zone_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 32N"):
        UtmZone.named(text)


@pytest.mark.parametrize(
    ("easting", "northing", "word"),
    [
        (5_249_465.0, 465_710.0, "easting"),
        (465_710.0, -3.0, "northing"),
        (465_710.0, math.nan, "northing"),
        (47.4, 8.5, "easting"),
    ],
)
def test_numbers_of_another_system_are_noticed(easting: float, northing: float, word: str) -> None:
    problem = UtmZone(32, south=False).problem(easting, northing)
    assert problem is not None
    assert problem.startswith(word)
    assert UtmZone(32, south=False).problem(465_710.0, 5_249_465.0) is None
