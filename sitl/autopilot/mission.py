"""A mission: its items as uploaded, their meaning, and progress through them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import GeographicPosition, ned_from_geographic
from sitl.config import HomeConfig
from sitl.plant.truth import Vector

ITEMS_MAX = 500
_DISTANCE_MAX_M = 100_000.0
_HEIGHT_MAX_M = 10_000.0
_POSITIONED = {
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_TAKEOFF,
}
_SUPPORTED = _POSITIONED | {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_NAV_DELAY,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
    mavlink.MAV_CMD_DO_JUMP,
}
ABSOLUTE_FRAMES = {mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT}
RELATIVE_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
}


class MissionItem(NamedTuple):
    """The content of one MISSION_ITEM_INT; ``x`` and ``y`` in 1e-7 degrees, ``z`` in metres."""

    frame: int
    command: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float

    @classmethod
    def of(cls, message: Any) -> MissionItem:
        """Return the content of a MISSION_ITEM_INT, or of the older MISSION_ITEM."""
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            x, y = (_scaled(value) for value in (x, y))
        return cls(
            message.frame,
            message.command,
            message.autocontinue,
            message.param1,
            message.param2,
            message.param3,
            message.param4,
            x,
            y,
            message.z,
        )

    def refusal(self, origin: HomeConfig) -> int | None:
        """Return why the item cannot be flown, as MAV_MISSION_RESULT; None if it can."""
        if self.command not in _SUPPORTED:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if self.command == mavlink.MAV_CMD_DO_CHANGE_SPEED and math.isnan(self.param2):
            return int(mavlink.MAV_MISSION_INVALID_PARAM2)
        if self.command == mavlink.MAV_CMD_DO_JUMP:
            return self._jump_refusal()
        return self._place_refusal(origin) if self.command in _POSITIONED else None

    def _jump_refusal(self) -> int | None:
        if not (self.param1 >= 0.0 and float(self.param1).is_integer()):
            return int(mavlink.MAV_MISSION_INVALID_PARAM1)
        if not float(self.param2).is_integer():
            return int(mavlink.MAV_MISSION_INVALID_PARAM2)
        return None

    def _place_refusal(self, origin: HomeConfig) -> int | None:
        if self.frame not in ABSOLUTE_FRAMES | RELATIVE_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if self.has_height and not abs(self.z) <= _HEIGHT_MAX_M:
            return int(mavlink.MAV_MISSION_INVALID_PARAM7)
        north_m, east_m, _ = target_ned_m(self, origin, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        if not math.hypot(north_m, east_m) <= _DISTANCE_MAX_M:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        return None

    @property
    def has_place(self) -> bool:
        """Whether latitude and longitude are given; by convention two zeros mean none."""
        return self.command in _POSITIONED and (self.x, self.y) != (0, 0)

    @property
    def moves(self) -> bool:
        """Whether flying the item takes the vehicle somewhere."""
        return self.command in _POSITIONED or self.returns_home or self.jump is not None

    @property
    def has_height(self) -> bool:
        """Whether the altitude is meant."""
        return self.command in _POSITIONED and self.command != mavlink.MAV_CMD_NAV_LAND

    @property
    def takes_off(self) -> bool:
        """Whether the item lifts the vehicle off the ground."""
        return bool(self.command == mavlink.MAV_CMD_NAV_TAKEOFF)

    @property
    def lands(self) -> bool:
        """Whether the item ends on the ground."""
        return bool(self.command == mavlink.MAV_CMD_NAV_LAND)

    @property
    def returns_home(self) -> bool:
        """Whether the item hands over to the return mode."""
        return bool(self.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)

    @property
    def jump(self) -> tuple[int, float] | None:
        """Number of the item to jump to, and how often; a negative number means for ever."""
        if self.command != mavlink.MAV_CMD_DO_JUMP:
            return None
        return int(self.param1), self.param2 if self.param2 >= 0.0 else math.inf

    @property
    def speed_mps(self) -> float | None:
        """Speed from here on, if the item sets one; negative values leave it unchanged."""
        changes = self.command == mavlink.MAV_CMD_DO_CHANGE_SPEED and self.param2 > 0.0
        return self.param2 if changes else None

    @property
    def dwell_s(self) -> float:
        """How long to stay at the item's position."""
        if self.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return math.inf
        stays = self.command in {
            mavlink.MAV_CMD_NAV_WAYPOINT,
            mavlink.MAV_CMD_NAV_LOITER_TIME,
            mavlink.MAV_CMD_NAV_DELAY,
        }
        return self.param1 if stays and self.param1 > 0.0 else 0.0

    @property
    def acceptance_radius_m(self) -> float:
        """Acceptance radius; 0 for the vehicle's own."""
        given = self.command == mavlink.MAV_CMD_NAV_WAYPOINT and self.param2 > 0.0
        return self.param2 if given else 0.0

    @property
    def yaw_rad(self) -> float | None:
        """Heading to take; None for the direction of flight."""
        given = self.command in _POSITIONED and math.isfinite(self.param4)
        return math.radians(self.param4) if given else None


def target_ned_m(
    item: MissionItem, origin: HomeConfig, home_ned_m: Vector, here_ned_m: Vector
) -> Vector:
    """Return where an item is, in local NED; missing coordinates are those of ``here_ned_m``."""
    above_sea_m = item.z
    if item.frame in RELATIVE_FRAMES:
        above_sea_m += origin.altitude_m - home_ned_m[2]
    place = GeographicPosition(item.x * 1e-7, item.y * 1e-7, above_sea_m)
    north_m, east_m, down_m = ned_from_geographic(origin, place)
    if not item.has_place:
        north_m, east_m = here_ned_m[:2]
    return north_m, east_m, down_m if item.has_height else here_ned_m[2]


@dataclass
class MissionStore:
    """The mission on board and how far it has been flown.

    Attributes:
        origin: geographic position of local NED's origin.
        first: number of the first item to fly; ArduPilot keeps home in item 0.
        items: as uploaded.
        current: number of the item flown, or to be flown next.
        finished: whether the last item has been flown.
        reached: items reached and not yet announced.
        announce_current: whether the change of ``current`` is still to be announced.
    """

    origin: HomeConfig
    first: int
    items: tuple[MissionItem, ...] = ()
    current: int = 0
    finished: bool = False
    reached: list[int] = field(default_factory=list)
    announce_current: bool = False
    _jumped: dict[int, int] = field(default_factory=dict)

    @property
    def flyable(self) -> bool:
        """Whether there is anything to fly."""
        return len(self.items) > self.first

    @property
    def current_item(self) -> MissionItem | None:
        """The item to fly."""
        return self.items[self.current] if self.first <= self.current < len(self.items) else None

    @property
    def at_last(self) -> bool:
        """Whether nothing follows the current item."""
        return self.current >= len(self.items) - 1

    @property
    def stops_here(self) -> bool:
        """Whether the vehicle goes nowhere after the current item."""
        return not any(item.moves for item in self.items[self.current + 1 :])

    @property
    def following(self) -> MissionItem | None:
        """The next item that goes somewhere."""
        rest = self.items[self.current + 1 :]
        return next((item for item in rest if item.moves), None)

    @property
    def starts_without_take_off(self) -> bool:
        """Whether a vehicle on the ground has to climb before it can fly the current item."""
        item = self.current_item
        return item is not None and not item.takes_off

    def refusal(self, number: int, item: MissionItem) -> int | None:
        """Return why an item cannot be flown, as MAV_MISSION_RESULT; None if it can."""
        return None if number < self.first else item.refusal(self.origin)

    def is_current(self, number: int) -> bool:
        """Whether an item is flown, or to be flown next."""
        return number == self.current

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Take a new mission, or none."""
        self.items = items
        self.finished = False
        self._jumped.clear()
        self._go_to(self.first if self.flyable else 0)

    def select(self, number: int) -> bool:
        """Make an item the current one; False if the number is out of range."""
        if not 0 <= number < len(self.items):
            return False
        self.finished = False
        self._go_to(max(number, self.first))
        return True

    def resume(self) -> None:
        """Get ready to fly: from the start if the mission was finished."""
        if self.finished or self.current < self.first:
            self.finished = False
            self._jumped.clear()
            self._go_to(self.first)

    def jump(self, number: int, times: float) -> None:
        """Go on at another item, or at the next one after so many times."""
        done = self._jumped.get(self.current, 0)
        if done >= times or not self.first <= number < len(self.items):
            self.item_done()
            return
        self._jumped[self.current] = done + 1
        self._go_to(number)

    def item_done(self) -> None:
        """Note that the current item has been flown."""
        self.reached.append(self.current)
        if self.at_last:
            self.finished = True
        else:
            self._go_to(self.current + 1)

    def _go_to(self, number: int) -> None:
        self.current = number
        self.announce_current = True


def _scaled(degrees: float) -> int:
    return round(degrees * 1e7) if abs(degrees) <= 360.0 else 0
