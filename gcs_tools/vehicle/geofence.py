"""A geofence of polygons and circles (MAV_CMD_NAV_FENCE_*), and its margin to a mission."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from shapely import LineString, Point, Polygon

from onboard.geometry import fence
from onboard.geometry.local_frame import GeographicPoint, longitude_difference_deg
from onboard.mission_items.fence_items import FenceError, FenceItem, areas_of

_EARTH_RADIUS_M: Final = 6_371_000.0


class GeographicOrigin(NamedTuple):
    """The origin of local NED on the Earth."""

    latitude_deg: float
    longitude_deg: float

    def north_east_m(self, place: GeographicPoint) -> tuple[float, float]:
        """Return a place in local NED; the Earth is a sphere, good for kilometres."""
        north_m = math.radians(place.latitude_deg - self.latitude_deg) * _EARTH_RADIUS_M
        per_rad_m = _EARTH_RADIUS_M * math.cos(math.radians(self.latitude_deg))
        east_deg = longitude_difference_deg(place.longitude_deg, self.longitude_deg)
        return north_m, math.radians(east_deg) * per_rad_m

    @classmethod
    def of_home(
        cls, latitude_deg: float, longitude_deg: float, home_ned_m: Sequence[float]
    ) -> GeographicOrigin:
        """Return the origin, from a home known in both coordinate systems."""
        per_rad_m = _EARTH_RADIUS_M * math.cos(math.radians(latitude_deg))
        return cls(
            latitude_deg - math.degrees(home_ned_m[0] / _EARTH_RADIUS_M),
            longitude_deg - math.degrees(home_ned_m[1] / per_rad_m),
        )


@dataclass(frozen=True)
class FenceArea(fence.FenceArea):
    """One polygon or circle, in local NED, measured against paths by Shapely."""

    def __str__(self) -> str:
        kind = "inclusion" if self.keeps_in else "exclusion"
        return f"{kind} {'polygon' if self.radius_m is None else 'circle'}"

    def margin_m(self, path: LineString) -> float:
        """Return the greatest half-width [m] of a corridor around a path; negative if none fits.

        Raises:
            FenceError: the polygon's edges cross each other.
        """
        if self.radius_m is not None:
            centre = Point(self.corners_ned_m[0])
            if self.keeps_in:
                return self.radius_m - float(max(centre.distance(Point(at)) for at in path.coords))
            return float(path.distance(centre)) - self.radius_m
        area = Polygon(self.corners_ned_m)
        if not area.is_valid:
            raise FenceError(f"{self}: its edges cross each other, expected a simple polygon")
        right = path.within(area) if self.keeps_in else path.disjoint(area)
        return float(path.distance(area.exterior)) if right else -math.inf


def fence_areas(items: Sequence[FenceItem], origin: GeographicOrigin) -> list[FenceArea]:
    """Assemble the areas of a geofence from its items.

    Raises:
        FenceError: an item does not belong to a geofence, or a polygon is not complete.
    """
    return [
        FenceArea(tuple(map(origin.north_east_m, area.corners)), area.radius_m, area.keeps_in)
        for area in areas_of(items)
    ]
