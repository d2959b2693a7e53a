"""The geofence's polygons and circles.

Simulation shortcut: fences are stored and can be downloaded, but are not enforced.
"""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import ABSOLUTE_FRAMES, RELATIVE_FRAMES, MissionItem

_POLYGONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
}
_CIRCLES = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
}
_COMMANDS = _POLYGONS | _CIRCLES | {mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT}
_CORNERS_MIN = 3


@dataclass
class FenceStore:
    """The geofence on board.

    Attributes:
        items: as uploaded.
    """

    items: tuple[MissionItem, ...] = ()

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
