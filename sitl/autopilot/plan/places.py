"""Where an uploaded item is."""

from __future__ import annotations

from sitl.autopilot.geodesy import GeographicPosition, ned_from_geographic
from sitl.autopilot.mission import MissionItem
from sitl.config import HomeConfig
from sitl.plant.truth import Vector


def place_ned_m(item: MissionItem, origin: HomeConfig) -> Vector:
    """Return the place of an item in local NED, its altitude taken as above mean sea level."""
    place = GeographicPosition(item.x * 1e-7, item.y * 1e-7, item.z)
    return ned_from_geographic(origin, place)
