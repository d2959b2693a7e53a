"""Where an uploaded item is."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.mission import MissionItem
from sitl.autopilot.plan.places import place_ned_m
from sitl.config import HomeConfig


def test_an_item_is_where_its_coordinates_say() -> None:
    origin = HomeConfig()
    there = geographic_from_ned(origin, (120.0, -40.0, -15.0))
    x, y = round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)
    item = MissionItem(mavlink.MAV_FRAME_GLOBAL, 16, 1, 0.0, 0.0, 0.0, 0.0, x, y, there.altitude_m)
    assert place_ned_m(item, origin) == pytest.approx((120.0, -40.0, -15.0), abs=0.02)
