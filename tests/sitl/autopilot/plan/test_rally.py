"""Rally points, and which of them a return ends at."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.mission import MissionItem
from sitl.autopilot.plan.rally import Place, RallyStore
from sitl.config import HomeConfig

ORIGIN = HomeConfig()
HOME = (0.0, 0.0, 0.0)


def rally_point(
    north_m: float,
    east_m: float = 0.0,
    command: int = mavlink.MAV_CMD_NAV_RALLY_POINT,
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
) -> MissionItem:
    place = geographic_from_ned(ORIGIN, (north_m, east_m, 0.0))
    x, y = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
    return MissionItem(frame, command, 1, 0.0, 0.0, 0.0, 0.0, x, y, 20.0)


@pytest.mark.parametrize(
    ("item", "result"),
    [
        (rally_point(10.0), None),
        (
            rally_point(10.0, command=mavlink.MAV_CMD_NAV_WAYPOINT),
            mavlink.MAV_MISSION_UNSUPPORTED,
        ),
        (
            rally_point(10.0, frame=mavlink.MAV_FRAME_LOCAL_NED),
            mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        ),
        (rally_point(150_000.0), mavlink.MAV_MISSION_INVALID_PARAM5_X),
    ],
)
def test_which_items_are_rally_points(item: MissionItem, result: int | None) -> None:
    store = RallyStore(ORIGIN)
    assert store.refusal(0, item) == result
    assert not store.is_current(0)


@pytest.mark.parametrize(
    ("points", "limit_m", "or_home", "destination"),
    [
        ((), math.inf, True, (0.0, 0.0)),
        ((), math.inf, False, (0.0, 0.0)),
        ((30.0,), math.inf, True, (30.0, 0.0)),  # from 20 m north: nearer than home
        ((100.0, 30.0), math.inf, True, (30.0, 0.0)),
        ((100.0,), math.inf, True, (0.0, 0.0)),
        ((100.0,), math.inf, False, (100.0, 0.0)),
        ((100.0,), 50.0, False, (0.0, 0.0)),
    ],
)
def test_a_return_ends_at_the_nearest_place_that_counts(
    points: tuple[float, ...], limit_m: float, or_home: bool, destination: Place
) -> None:
    store = RallyStore(ORIGIN)
    store.replace(tuple(map(rally_point, points)))
    found = store.destination_m((20.0, 0.0, -5.0), HOME, limit_m, or_home=or_home)
    assert found == pytest.approx(destination, abs=0.05)
