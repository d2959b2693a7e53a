"""What an autopilot keeps on board, as a ground station's file would hold it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from onboard.geometry.local_frame import Autopilot, GeographicPoint
from onboard.mission_items.fence_items import FenceError, FenceItem, areas_of
from onboard.mission_items.planned_flight import FileItem, PlannedFlight

_AUTOPILOTS: Final[tuple[Autopilot, ...]] = ("px4", "ardupilot")
_SCALE_DEG: Final = 1e-7
_SCALE_M: Final = 1e-3


class OnBoardError(ValueError):
    """The items on board form no mission or geofence; the message is for the operator."""


class OnBoard(NamedTuple):
    """What an autopilot has sent.

    Attributes:
        autopilot: key of its profile.
        items: of the mission, as MISSION_ITEM_INT states them.
        fence: of the geofence, likewise.
        home: fields of HOME_POSITION; None if it sent none.
        origin: fields of GPS_GLOBAL_ORIGIN; None if it sent none.
    """

    autopilot: str
    items: Sequence[Any]
    fence: Sequence[Any]
    home: dict[str, Any] | None
    origin: dict[str, Any] | None


def planned_of(on_board: OnBoard) -> PlannedFlight:
    """Return what an autopilot has sent as the content of a ground station's file would be.

    Raises:
        OnBoardError: it has no mission, or items of a geofence that do not form one.
    """
    items = list(on_board.items)
    autopilot = next((each for each in _AUTOPILOTS if each == on_board.autopilot), None)
    if autopilot == "ardupilot":
        items = items[1:]  # item 0 is home
    if not items:
        raise OnBoardError("the vehicle has no mission on board")
    try:
        fence = tuple(areas_of([_fence_item(each) for each in on_board.fence]))
    except FenceError as error:
        raise OnBoardError(f"the geofence of the vehicle: {error}") from error
    home, origin = _point(on_board.home), _point(on_board.origin)
    return PlannedFlight(home, autopilot, tuple(map(_item, items)), fence, origin=origin)


def _item(item: Any) -> FileItem:
    place = GeographicPoint(item.x * _SCALE_DEG, item.y * _SCALE_DEG, item.z)
    parameters = (item.param1, item.param2, item.param3, item.param4)
    return FileItem(f"item {item.seq}", item.command, item.frame, parameters, place)


def _fence_item(item: Any) -> FenceItem:
    return FenceItem(item.command, item.param1, item.x * _SCALE_DEG, item.y * _SCALE_DEG)


def _point(fields: dict[str, Any] | None) -> GeographicPoint | None:
    """Return the place of HOME_POSITION or GPS_GLOBAL_ORIGIN; None without one."""
    if fields is None:
        return None
    latitude_deg = float(fields["latitude"]) * _SCALE_DEG
    longitude_deg = float(fields["longitude"]) * _SCALE_DEG
    point = GeographicPoint(latitude_deg, longitude_deg, float(fields["altitude"]) * _SCALE_M)
    return point if all(map(math.isfinite, point)) else None
