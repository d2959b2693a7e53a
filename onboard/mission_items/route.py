"""Interprets a ground station's items as legs at one height, and says what it does with each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from onboard.files.mission_file import LEG_LENGTH_MIN_M
from onboard.files.stem_map import DISTANCE_MAX_M
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from onboard.mission_items import commands
from onboard.mission_items.planned_flight import (
    HOME_FRAMES,
    SEA_LEVEL_FRAMES,
    TERRAIN_FRAMES,
    FileItem,
)

# Altitudes that differ by less are the same height, written by different programs.
ALTITUDE_TOLERANCE_M: Final = 0.1
# A take-off or landing item this near the last point is not another place.
SAME_PLACE_M: Final = 1.0

Kind = Literal["leg", "start", "end", "not done", "REFUSED"]
Point = tuple[float, float]


class Remark(NamedTuple):
    """What is done with one item.

    Attributes:
        item: its name.
        command: its MAV_CMD.
        kind: what it becomes.
        text: in words.
    """

    item: str
    command: int
    kind: Kind
    text: str


class RouteLeg(NamedTuple):
    """The end of a leg, in local NED (north, east), and the item that states it."""

    item: str
    end_ned_m: Point


@dataclass(frozen=True)
class Site:
    """Where a mission is flown.

    Attributes:
        frame: the autopilot's local frame.
        home: from which home-relative altitudes count, and where the flight begins.
    """

    frame: LocalFrame
    home: GeographicPoint

    @property
    def start_ned_m(self) -> Point:
        """Where the vehicle stands before take-off."""
        return self.frame.north_east_m(*self.home[:2])

    @property
    def home_height_m(self) -> float:
        """Height of home above the local origin; NaN where it is not known."""
        if self.frame.origin is self.home:
            return 0.0
        return self.home.altitude_m - self.frame.origin.altitude_m


@dataclass
class Route:
    """Legs, and a remark on every item; built by `route_of`.

    Attributes:
        site: where it is flown.
        altitude_m: height above the local origin that the operator prescribes for all legs; None
            to take the items' own, which must then agree.
        legs: in order.
        remarks: one or more for each item.
        height_m: at which the legs are flown; None before the first.
    """

    site: Site
    altitude_m: float | None = None
    legs: list[RouteLeg] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    height_m: float | None = None
    _ended_by: str | None = None

    @property
    def refusals(self) -> list[Remark]:
        """Remarks on items that cannot be flown."""
        return [each for each in self.remarks if each.kind == "REFUSED"]

    @property
    def last_ned_m(self) -> Point:
        """Where the next leg begins."""
        return self.legs[-1].end_ned_m if self.legs else self.site.start_ned_m

    def take(self, item: FileItem) -> None:
        """Interpret the next item."""
        if item.command in commands.NOT_DONE:
            self._say(item, "not done", commands.NOT_DONE[item.command])
        elif self._ended_by is not None:
            self._say(item, "REFUSED", f"comes after the end of the mission ({self._ended_by})")
        elif item.command == commands.TAKE_OFF:
            self._take_off(item)
        elif item.command == commands.RETURN_TO_LAUNCH:
            self._end(item, "hovers at the end of the last leg; the return is the autopilot's")
        elif item.command == commands.LAND:
            self._land(item)
        elif item.command == commands.LOITER_UNLIMITED:
            self._fly_to(item, self._height_m(item))
            self._end(item, "hovers there until the pilot takes over")
        elif item.command in (commands.WAYPOINT, commands.LOITER_TIME):
            self._fly_to(item, self._height_m(item))
            if item.parameters[0] > 0.0:
                self._say(item, "not done", f"does not wait for {item.parameters[0]:g} s")
        else:
            reason = commands.CANNOT_FLY.get(item.command, "not known to Clearway")
            self._say(item, "REFUSED", reason)

    def _say(self, item: FileItem, kind: Kind, text: str) -> None:
        self.remarks.append(Remark(item.name, item.command, kind, text))

    def _end(self, item: FileItem, text: str) -> None:
        self._ended_by = item.name
        self._say(item, "end", text)

    def _take_off(self, item: FileItem) -> None:
        if self.legs:
            self._say(item, "REFUSED", "take-off after a leg: the vehicle flies already")
            return
        climb = "take off by hand or by the autopilot's mode, to the height of the legs"
        if self.site.frame.autopilot == "px4" and self._is_elsewhere(item):
            self._say(item, "start", f"{climb}; PX4 then flies to its place")
            self._fly_to(item, self._height_m(item))
            return
        beside = ", at home; ArduPilot ignores its place" if self._is_elsewhere(item) else ""
        self._say(item, "start", climb + beside)

    def _land(self, item: FileItem) -> None:
        """Autopilots fly to its place at the height that they have, and then descend."""
        height_m = self.altitude_m if self.height_m is None else self.height_m
        if not self._is_elsewhere(item):
            self._end(item, "hovers at the end of the last leg; the landing is the autopilot's")
        elif height_m is None:
            self._say(item, "REFUSED", "lands elsewhere before any waypoint says at which height")
        else:
            self._fly_to(item, height_m)
            self._end(item, "hovers there; the landing is the autopilot's")

    def _is_elsewhere(self, item: FileItem) -> bool:
        if not item.states_place or item.place.problem() is not None:
            return False
        at_m = self.site.frame.north_east_m(*item.place[:2])
        return math.dist(at_m, self.last_ned_m) > SAME_PLACE_M

    def _fly_to(self, item: FileItem, height_m: float | None) -> None:
        if height_m is None:
            return  # refused already
        if not item.states_place:
            self._say(item, "REFUSED", "states no latitude and longitude")
            return
        if (problem := item.place.problem()) is not None:
            self._say(item, "REFUSED", problem)
            return
        end_m = self.site.frame.north_east_m(*item.place[:2])
        if math.dist(end_m, (0.0, 0.0)) > DISTANCE_MAX_M:
            text = f"is {math.hypot(*end_m) / 1e3:,.0f} km from the local origin: check home"
            self._say(item, "REFUSED", text)
            return
        length_m = math.dist(end_m, self.last_ned_m)
        if length_m < LEG_LENGTH_MIN_M:
            self._say(item, "not done", "is where the vehicle already is: no leg")
            return
        if self.height_m is None:
            self.height_m = height_m
        self.legs.append(RouteLeg(item.name, end_m))
        place = f"{end_m[0]:.1f} m north, {end_m[1]:.1f} m east"
        self._say(item, "leg", f"leg {len(self.legs)}: to {place}, {length_m:.1f} m long")

    def _height_m(self, item: FileItem) -> float | None:
        """Return the height of an item above the local origin; None after saying why not."""
        if self.altitude_m is not None:
            return self.altitude_m
        height_m, problem = self._own_height_m(item)
        if problem is None and not height_m > 0.0:
            problem = f"its height above the local origin [m] is {height_m:.1f}, expected above 0"
        first_m = height_m if self.height_m is None else self.height_m
        if problem is None and abs(height_m - first_m) > ALTITUDE_TOLERANCE_M:
            problem = (
                f"its height is {height_m:.1f} m, that of the first leg {first_m:.1f} m: a "
                "mission flies one height; --altitude M flies all legs at M metres"
            )
        if problem is not None:
            self._say(item, "REFUSED", problem)
            return None
        return height_m

    def _own_height_m(self, item: FileItem) -> tuple[float, str | None]:
        """Return the height [m] that an item states, and what is wrong with it."""
        zero_m, lacking = math.nan, f"frame {item.frame} (MAV_FRAME) is not read"
        if item.frame in TERRAIN_FRAMES:
            lacking = (
                "its altitude counts from the terrain, which Clearway does not know; plan it "
                "relative to home, or say --altitude M"
            )
        elif item.frame in HOME_FRAMES:
            zero_m = self.site.home_height_m
            lacking = "home and --origin need altitudes: --home LAT,LON,ALT"
        elif item.frame in SEA_LEVEL_FRAMES:
            zero_m = -self.site.frame.origin.altitude_m
            lacking = (
                "its altitude counts from sea level, but that of the local origin is not known: "
                "--home or --origin LAT,LON,ALT"
            )
        if math.isnan(zero_m):
            return math.nan, lacking
        height_m = item.place.altitude_m + zero_m
        return height_m, "states no altitude" if math.isnan(height_m) else None


def route_of(items: tuple[FileItem, ...], site: Site, altitude_m: float | None = None) -> Route:
    """Interpret all items of a mission.

    Args:
        items: in order.
        site: where it is flown.
        altitude_m: height above the local origin for all legs, in place of the items' own.
    """
    route = Route(site, altitude_m)
    for item in items:
        route.take(item)
    return route
