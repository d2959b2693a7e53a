"""The items of a geofence (MAV_CMD_NAV_FENCE_*) as polygons and circles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from onboard.geometry.local_frame import GeographicPoint
from onboard.mission_items.planned_flight import GeographicArea

_RETURN_POINT: Final = 5000
_POLYGON: Final = {5001: True, 5002: False}  # whether the vehicle must stay inside
_CIRCLE: Final = {5003: True, 5004: False}


class FenceError(ValueError):
    """Items that do not form a geofence; the message is for the operator."""


class FenceItem(NamedTuple):
    """One item of the geofence on board.

    Attributes:
        command: MAV_CMD.
        amount: number of corners of its polygon, or radius of its circle [m].
        latitude_deg, longitude_deg: its position.
    """

    command: int
    amount: float
    latitude_deg: float
    longitude_deg: float

    @property
    def place(self) -> GeographicPoint:
        """Where it is; no item of a geofence has an altitude."""
        return GeographicPoint(self.latitude_deg, self.longitude_deg)


def areas_of(items: Sequence[FenceItem]) -> list[GeographicArea]:
    """Assemble the areas of a geofence from its items.

    Raises:
        FenceError: an item does not belong to a geofence, or a polygon is not complete.
    """
    areas, left = [], list(items)
    while left:
        first = left[0]
        if first.command in _POLYGON:
            count = _corner_count(first)
            corners, left = left[:count], left[count:]
            if len(corners) < count or {each[:2] for each in corners} != {first[:2]}:
                raise FenceError(f"a polygon has {len(corners)} corners in a row, expected {count}")
            outline = tuple(each.place for each in corners)
            areas.append(GeographicArea(outline, None, _POLYGON[first.command]))
            continue
        del left[0]
        if first.command in _CIRCLE:
            if not 0.0 < first.amount < math.inf:
                raise FenceError(f"a circle has radius {first.amount:g} m, expected more than 0 m")
            areas.append(GeographicArea((first.place,), first.amount, _CIRCLE[first.command]))
        elif first.command != _RETURN_POINT:
            raise FenceError(f"MAV_CMD {first.command} does not belong to a geofence")
    return areas


def _corner_count(item: FenceItem) -> int:
    if not (math.isfinite(item.amount) and item.amount >= 3):
        raise FenceError(f"a polygon has {item.amount:g} corners, expected 3 or more")
    return int(item.amount)
