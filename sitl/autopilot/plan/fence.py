"""The geofence: polygons and circles as uploaded, and whether a position breaches them.

The vehicle must be inside any of the inclusions, if there are some, outside of every exclusion, and
within radius and height of the parameters (PX4's rule).  A breach is noticed when it has happened;
PX4's prediction (GF_PREDICT) and ArduPilot's margin are not simulated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import ABSOLUTE_FRAMES, RELATIVE_FRAMES, MissionItem
from sitl.autopilot.plan.places import place_ned_m
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.truth import Vector

_POLYGONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
}
_CIRCLES = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
}
_INCLUSIONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
}
_COMMANDS = _POLYGONS | _CIRCLES | {mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT}
_CORNERS_MIN = 3

Corner = tuple[float, float]


class _Area(NamedTuple):
    """One polygon, or one circle: a single corner and a radius."""

    includes: bool
    corners_m: tuple[Corner, ...]
    radius_m: float

    def contains(self, north_m: float, east_m: float) -> bool:
        """Whether a place is inside."""
        if self.radius_m > 0.0:
            return math.dist((north_m, east_m), self.corners_m[0]) < self.radius_m
        inside = False
        for (north_a, east_a), (north_b, east_b) in pairwise((*self.corners_m, self.corners_m[0])):
            if (east_a > east_m) is not (east_b > east_m):
                share = (east_m - east_a) / (east_b - east_a)
                inside ^= north_m < north_a + share * (north_b - north_a)
        return inside


class FenceStore:
    """The geofence on board.

    Args:
        origin: geographic position of local NED's origin.

    Attributes:
        items: as uploaded.
        breached: whether the vehicle was outside when it was watched last.
    """

    def __init__(self, origin: HomeConfig) -> None:
        self.items: tuple[MissionItem, ...] = ()
        self.breached = False
        self._origin = origin
        self._areas: tuple[_Area, ...] = ()

    def refusal(self, _: int, item: MissionItem) -> int | None:
        """Return why an item cannot be part of a fence, as MAV_MISSION_RESULT; None if it can."""
        if item.command not in _COMMANDS:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if item.frame not in ABSOLUTE_FRAMES | RELATIVE_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if item.command in _POLYGONS and not item.param1 >= _CORNERS_MIN:
            return int(mavlink.MAV_MISSION_INVALID_PARAM1)
        if item.command in _CIRCLES and not item.param1 > 0.0:
            return int(mavlink.MAV_MISSION_INVALID_PARAM1)
        return None

    def is_current(self, _: int) -> bool:
        """Whether an item is being flown: never, in a fence."""
        return False

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Take a new fence, or none."""
        self.items = items
        self._areas = tuple(self._areas_of(items))

    def watch(self, position_ned_m: Vector, home_ned_m: Vector, settings: FlightSettings) -> None:
        """Note whether the vehicle is outside; a fence without a reaction is not watched."""
        far_m = math.dist(position_ned_m[:2], home_ned_m[:2])
        high_m = home_ned_m[2] - position_ned_m[2]
        self.breached = settings.fence_reaction is not None and (
            far_m > settings.fence_radius_m
            or high_m > settings.fence_height_m
            or not self._allows(*position_ned_m[:2])
        )

    def _allows(self, north_m: float, east_m: float) -> bool:
        """Whether a place is inside the polygons and circles."""
        inside = {area.includes for area in self._areas if area.contains(north_m, east_m)}
        confined = any(area.includes for area in self._areas)
        return False not in inside and (True in inside or not confined)

    def _areas_of(self, items: tuple[MissionItem, ...]) -> Iterator[_Area]:
        """Yield the areas; corners of a polygon follow each other, each with their number."""
        at = 0
        while at < len(items):
            item = items[at]
            count = int(item.param1) if item.command in _POLYGONS else 1
            part = [one for one in items[at : at + count] if one.command == item.command]
            at += max(len(part), 1)
            corners_m = tuple(place_ned_m(one, self._origin)[:2] for one in part)
            if item.command in _POLYGONS or item.command in _CIRCLES:
                radius_m = item.param1 if item.command in _CIRCLES else 0.0
                yield _Area(item.command in _INCLUSIONS, corners_m, radius_m)
