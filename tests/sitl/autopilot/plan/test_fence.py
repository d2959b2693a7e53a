"""Which items make a geofence, and where it is breached."""

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.mission import MissionItem
from sitl.autopilot.plan.fence import FenceStore
from sitl.autopilot.settings import FlightSettings, Reaction
from sitl.config import HomeConfig


def item(command: int, param1: float = 4.0, frame: int = mavlink.MAV_FRAME_GLOBAL) -> MissionItem:
    return MissionItem(frame, command, 1, param1, 0.0, 0.0, 0.0, 473_977_420, 85_455_940, 0.0)


@pytest.mark.parametrize(
    "command",
    [
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT,
    ],
)
def test_every_kind_of_fence_item_is_taken(command: int) -> None:
    assert FenceStore(HomeConfig()).refusal(0, item(command)) is None


@pytest.mark.parametrize(
    ("refused", "result"),
    [
        (item(mavlink.MAV_CMD_NAV_WAYPOINT), mavlink.MAV_MISSION_UNSUPPORTED),
        (
            item(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT, frame=mavlink.MAV_FRAME_LOCAL_NED),
            mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        ),
        (
            item(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 2.0),
            mavlink.MAV_MISSION_INVALID_PARAM1,
        ),
        (
            item(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, math.nan),
            mavlink.MAV_MISSION_INVALID_PARAM1,
        ),
        (
            item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 0.0),
            mavlink.MAV_MISSION_INVALID_PARAM1,
        ),
        (
            item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, math.nan),
            mavlink.MAV_MISSION_INVALID_PARAM1,
        ),
    ],
)
def test_an_item_that_bounds_nothing_is_refused(refused: MissionItem, result: int) -> None:
    assert FenceStore(HomeConfig()).refusal(0, refused) == result


def test_a_fence_is_replaced_as_a_whole_and_never_current() -> None:
    store = FenceStore(HomeConfig())
    store.replace((item(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT),))
    assert len(store.items) == 1
    assert not store.is_current(0)
    store.replace(())
    assert not store.items


def at(command: int, north_m: float, east_m: float, param1: float) -> MissionItem:
    place = geographic_from_ned(HomeConfig(), (north_m, east_m, 0.0))
    x, y = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
    return MissionItem(mavlink.MAV_FRAME_GLOBAL, command, 1, param1, 0.0, 0.0, 0.0, x, y, 0.0)


def square(command: int, north_m: float, side_m: float) -> list[MissionItem]:
    """Four corners around a place on the way north."""
    half = side_m / 2.0
    corners = [(-half, -half), (-half, half), (half, half), (half, -half)]
    return [at(command, north_m + north, east, 4.0) for north, east in corners]


IN_POLYGON = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
OUT_POLYGON = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
IN_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
OUT_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
_FLAVOUR = Px4()
WATCHED: FlightSettings = replace(
    _FLAVOUR.settings(ParameterStore(_FLAVOUR.parameter_specs(1), {})),
    fence_reaction=Reaction.HOLD,
)


def breached(
    items: list[MissionItem], north_m: float, height_m: float = 5.0, **changes: Any
) -> bool:
    store = FenceStore(HomeConfig())
    store.replace(tuple(items))
    settings = replace(WATCHED, **changes)
    store.watch((north_m, 0.0, -height_m), (0.0, 0.0, 0.0), settings)
    return store.breached


@pytest.mark.parametrize(
    ("items", "north_m", "outside"),
    [
        ([], 500.0, False),
        (square(IN_POLYGON, 0.0, 20.0), 9.0, False),
        (square(IN_POLYGON, 0.0, 20.0), 11.0, True),
        (square(OUT_POLYGON, 30.0, 10.0), 24.0, False),
        (square(OUT_POLYGON, 30.0, 10.0), 26.0, True),
        ([at(IN_CIRCLE, 0.0, 0.0, 15.0)], 14.0, False),
        ([at(IN_CIRCLE, 0.0, 0.0, 15.0)], 16.0, True),
        ([at(OUT_CIRCLE, 30.0, 0.0, 5.0)], 24.0, False),
        ([at(OUT_CIRCLE, 30.0, 0.0, 5.0)], 26.0, True),
        # Inside of one inclusion is enough; an exclusion holds within an inclusion.
        ([*square(IN_POLYGON, 0.0, 20.0), at(IN_CIRCLE, 30.0, 0.0, 15.0)], 25.0, False),
        ([*square(IN_POLYGON, 0.0, 80.0), at(OUT_CIRCLE, 30.0, 0.0, 5.0)], 30.0, True),
        ([at(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT, 0.0, 0.0, 0.0)], 500.0, False),
        (square(IN_POLYGON, 0.0, 20.0)[:2], 5.0, True),  # two corners enclose nothing
    ],
)
def test_polygons_and_circles_bound_the_flight(
    items: list[MissionItem], north_m: float, outside: bool
) -> None:
    assert breached(items, north_m) is outside


@pytest.mark.parametrize(
    ("changes", "outside"),
    [
        ({"fence_radius_m": 30.0}, False),
        ({"fence_radius_m": 20.0}, True),
        ({"fence_height_m": 6.0}, False),
        ({"fence_height_m": 4.0}, True),
        ({"fence_height_m": 4.0, "fence_reaction": None}, False),
    ],
)
def test_radius_and_height_count_from_home(changes: dict[str, Any], outside: bool) -> None:
    assert breached([], 25.0, **changes) is outside
