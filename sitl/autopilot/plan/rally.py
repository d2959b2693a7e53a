"""Rally points: places beside home that a return may end at."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import ABSOLUTE_FRAMES, RELATIVE_FRAMES, MissionItem
from sitl.autopilot.plan.places import place_ned_m
from sitl.config import HomeConfig
from sitl.plant.truth import Vector

_DISTANCE_MAX_M = 100_000.0

Place = tuple[float, float]


class RallyStore:
    """The rally points on board.

    Args:
        origin: geographic position of local NED's origin.

    Attributes:
        items: as uploaded.
    """

    def __init__(self, origin: HomeConfig) -> None:
        self.items: tuple[MissionItem, ...] = ()
        self._origin = origin
        self._places_m: tuple[Place, ...] = ()

    def refusal(self, _: int, item: MissionItem) -> int | None:
        """Return why an item is no rally point, as MAV_MISSION_RESULT; None if it is one."""
        if item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if item.frame not in ABSOLUTE_FRAMES | RELATIVE_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if not math.hypot(*place_ned_m(item, self._origin)[:2]) <= _DISTANCE_MAX_M:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        return None

    def is_current(self, _: int) -> bool:
        """Whether an item is being flown: never, among rally points."""
        return False

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Take new points, or none."""
        self.items = items
        self._places_m = tuple(place_ned_m(item, self._origin)[:2] for item in items)

    def destination_m(
        self, here_ned_m: Vector, home_ned_m: Vector, limit_m: float, *, or_home: bool
    ) -> Place:
        """Return where a return ends, north and east: at the nearest point, or at home.

        Args:
            here_ned_m: where the return begins.
            home_ned_m: the destination where no point is near enough.
            limit_m: points farther away do not count.
            or_home: whether home is preferred to a point that is farther away.
        """
        here, home = here_ned_m[:2], (home_ned_m[0], home_ned_m[1])
        near = [place for place in self._places_m if math.dist(place, here) <= limit_m]
        if or_home or not near:
            near.insert(0, home)
        return min(near, key=lambda place: math.dist(place, here))
