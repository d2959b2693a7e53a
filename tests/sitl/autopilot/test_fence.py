"""Which items make a geofence."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.fence import FenceStore
from sitl.autopilot.mission import MissionItem


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
    assert FenceStore().refusal(0, item(command)) is None


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
    assert FenceStore().refusal(0, refused) == result


def test_a_fence_is_replaced_as_a_whole_and_never_current() -> None:
    store = FenceStore()
    store.replace((item(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT),))
    assert len(store.items) == 1
    assert not store.is_current(0)
    store.replace(())
    assert not store.items
