"""Local NED to geographic coordinates and back, on a sphere, for areas of a few kilometres."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl.config import HomeConfig
from sitl.plant.truth import Vector

_EARTH_RADIUS_M = 6_371_000.0


@dataclass(frozen=True)
class GeographicPosition:
    """Latitude and longitude, and altitude above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


def geographic_from_ned(home: HomeConfig, position_ned_m: Vector) -> GeographicPosition:
    """Return the geographic coordinates of a local position."""
    scale = math.cos(math.radians(home.latitude_deg))
    return GeographicPosition(
        home.latitude_deg + math.degrees(position_ned_m[0] / _EARTH_RADIUS_M),
        home.longitude_deg + math.degrees(position_ned_m[1] / (_EARTH_RADIUS_M * scale)),
        home.altitude_m - position_ned_m[2],
    )


def ned_from_geographic(home: HomeConfig, position: GeographicPosition) -> Vector:
    """Inverse of :func:`geographic_from_ned`."""
    scale = math.cos(math.radians(home.latitude_deg))
    return (
        math.radians(position.latitude_deg - home.latitude_deg) * _EARTH_RADIUS_M,
        math.radians(position.longitude_deg - home.longitude_deg) * _EARTH_RADIUS_M * scale,
        home.altitude_m - position.altitude_m,
    )
