"""Geofence areas against a mission's path."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString

from gcs_tools.vehicle.geofence import (
    FenceArea,
    GeographicOrigin,
    fence_areas,
)
from onboard.mission_items.fence_items import FenceError, FenceItem

ORIGIN = GeographicOrigin(47.397742, 8.545594)
PATH = LineString([(0.0, 0.0), (40.0, 0.0), (40.0, 20.0)])
M_PER_DEG = math.radians(1.0) * 6_371_000.0
EAST_M_PER_DEG = M_PER_DEG * math.cos(math.radians(ORIGIN.latitude_deg))
KEEP_IN, KEEP_OUT = (5001, 5003), (5002, 5004)


def item(command: int, amount: float, north_m: float, east_m: float) -> FenceItem:
    return FenceItem(
        command,
        amount,
        ORIGIN.latitude_deg + north_m / M_PER_DEG,
        ORIGIN.longitude_deg + east_m / EAST_M_PER_DEG,
    )


def box(command: int, *sides_m: float) -> list[FenceItem]:
    south, north, west, east = sides_m
    corners = ((south, west), (north, west), (north, east), (south, east))
    return [item(command, 4, *corner) for corner in corners]


def only(items: list[FenceItem]) -> FenceArea:
    (area,) = fence_areas(items, ORIGIN)
    return area


@pytest.mark.parametrize(
    ("items", "margin_m"),
    [
        (box(5001, -10.0, 50.0, -8.0, 27.0), 7.0),
        (box(5001, -10.0, 39.0, -8.0, 27.0), -math.inf),
        (box(5002, 10.0, 20.0, 3.0, 12.0), 3.0),
        (box(5002, 10.0, 20.0, -3.0, 12.0), -math.inf),
        # The legs lie in it altogether, and cross no edge.
        (box(5002, -10.0, 50.0, -8.0, 27.0), -math.inf),
        ([item(5003, 50.0, 0.0, 0.0)], 50.0 - math.hypot(40.0, 20.0)),
        ([item(5003, 44.0, 0.0, 0.0)], 44.0 - math.hypot(40.0, 20.0)),
        ([item(5004, 5.0, 20.0, 9.0)], 4.0),
        ([item(5004, 10.0, 20.0, 9.0)], -1.0),
    ],
)
def test_margins_by_hand(items: list[FenceItem], margin_m: float) -> None:
    assert only(items).margin_m(PATH) == pytest.approx(margin_m, abs=1e-5)


def test_areas_are_told_apart() -> None:
    items = [
        *box(5001, -10.0, 50.0, -8.0, 27.0),
        FenceItem(5000, 0.0, 47.0, 8.0),
        item(5004, 5.0, 20.0, 9.0),
        *box(5001, -20.0, 60.0, -18.0, 37.0),
    ]
    kinds = ["inclusion polygon", "exclusion circle", "inclusion polygon"]
    assert [str(each) for each in fence_areas(items, ORIGIN)] == kinds
    assert fence_areas([], ORIGIN) == []


@pytest.mark.parametrize(
    "items",
    [
        box(5001, -10.0, 50.0, -8.0, 27.0)[:3],
        [*box(5001, -10.0, 50.0, -8.0, 27.0)[:3], item(5002, 4, 0.0, 0.0)],
        [item(5001, 2, 0.0, 0.0), item(5001, 2, 1.0, 0.0)],
        [item(5001, math.nan, 0.0, 0.0)],
        [item(5001, math.inf, 0.0, 0.0)],
        [item(5003, 0.0, 0.0, 0.0)],
        [item(5003, math.nan, 0.0, 0.0)],
        [item(16, 0.0, 0.0, 0.0)],
    ],
)
def test_what_makes_no_fence_is_refused(items: list[FenceItem]) -> None:
    with pytest.raises(FenceError):
        fence_areas(items, ORIGIN)


def test_crossing_edges_bound_nothing() -> None:
    first, second, third, fourth = box(5001, -10.0, 50.0, -8.0, 27.0)
    with pytest.raises(FenceError, match="cross"):
        only([first, third, second, fourth]).margin_m(PATH)


@given(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
def test_the_origin_follows_from_home_anywhere(north_m: float, east_m: float) -> None:
    home = item(0, 0.0, north_m, east_m)
    origin = GeographicOrigin.of_home(
        home.latitude_deg, home.longitude_deg, (north_m, east_m, -2.0)
    )
    # A degree of longitude is a little shorter at home than at the origin.
    assert origin.latitude_deg == pytest.approx(ORIGIN.latitude_deg, abs=1e-9)
    away_m = abs(origin.longitude_deg - ORIGIN.longitude_deg) * EAST_M_PER_DEG
    assert away_m <= abs(east_m) * 1.1 * abs(north_m) / 6_371_000.0 + 1e-6


def test_an_area_across_the_antimeridian_stays_in_one_piece() -> None:
    origin = GeographicOrigin(-16.5, 179.9999)
    sides = (-16.501, -16.499, 179.999, -179.999)
    south, north, west, east = sides
    corners = ((south, west), (north, west), (north, east), (south, east))
    (area,) = fence_areas([FenceItem(5001, 4, *corner) for corner in corners], origin)
    easts_m = [east_m for _, east_m in area.corners_ned_m]
    assert max(easts_m) - min(easts_m) < 250.0
    assert area.margin_m(LineString([(0.0, 0.0), (40.0, 0.0)])) > 50.0
