"""Latitude and longitude to an autopilot's local NED frame, as that autopilot itself computes it.

The two autopilots do not take the Earth for the same sphere, and neither takes it for an ellipsoid:
their local frames differ by 0.11 %, a metre in 900 m.  A mission is flown in the local frame, so
its places have to be converted as the autopilot converts its own position.
"""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple

Autopilot = Literal["px4", "ardupilot"]

# CONSTANTS_RADIUS_OF_EARTH of PX4's geo library; RADIUS_OF_EARTH of ArduPilot's AP_Math.
_RADIUS_M: Final[dict[Autopilot, float]] = {"px4": 6_371_000.0, "ardupilot": 6_378_100.0}
LATITUDE_MAX_DEG: Final = 90.0
LONGITUDE_MAX_DEG: Final = 180.0


class GeographicPoint(NamedTuple):
    """A place on the Earth.

    Attributes:
        latitude_deg, longitude_deg: WGS84.
        altitude_m: above mean sea level; NaN where it is not known.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = math.nan

    def problem(self) -> str | None:
        """Return what is wrong with latitude or longitude; None if nothing is."""
        for name, value_deg, limit_deg in (
            ("latitude", self.latitude_deg, LATITUDE_MAX_DEG),
            ("longitude", self.longitude_deg, LONGITUDE_MAX_DEG),
        ):
            if not abs(value_deg) <= limit_deg:
                return f"{name} [°] = {value_deg:g}, expected {-limit_deg:g} to {limit_deg:g}"
        return None

    def __str__(self) -> str:
        above = "" if math.isnan(self.altitude_m) else f", {self.altitude_m:.1f} m AMSL"
        return f"{self.latitude_deg:.7f}, {self.longitude_deg:.7f}{above}"


def longitude_difference_deg(to_deg: float, from_deg: float) -> float:
    """Return how far east one longitude is of another, the short way: -180 to 180."""
    return math.remainder(to_deg - from_deg, 360.0)


class LocalFrame(NamedTuple):
    """The local NED frame of an autopilot.

    Attributes:
        origin: of the frame (GPS_GLOBAL_ORIGIN).
        autopilot: whose arithmetic counts.
    """

    origin: GeographicPoint
    autopilot: Autopilot = "px4"

    def north_east_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return a place in local NED (north, east)."""
        latitude_rad, origin_rad = math.radians(latitude_deg), math.radians(self.origin[0])
        east_rad = math.radians(longitude_difference_deg(longitude_deg, self.origin[1]))
        radius_m = _RADIUS_M[self.autopilot]
        if self.autopilot == "ardupilot":
            # Location::get_distance_NE: longitudes are scaled at the latitude halfway.
            scale = math.cos(0.5 * (latitude_rad + origin_rad))
            return radius_m * (latitude_rad - origin_rad), radius_m * scale * east_rad
        # MapProjection::project: azimuthal equidistant, with the angle from its sine and cosine,
        # since the arc cosine alone is coarse near the origin.
        sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
        origin_sine, origin_cosine = math.sin(origin_rad), math.cos(origin_rad)
        north = origin_cosine * sine - origin_sine * cosine * math.cos(east_rad)
        east = cosine * math.sin(east_rad)
        away = math.hypot(north, east)
        angle_rad = math.atan2(
            away, origin_sine * sine + origin_cosine * cosine * math.cos(east_rad)
        )
        scale = angle_rad / away if away > 0.0 else 1.0
        return radius_m * scale * north, radius_m * scale * east

    def latitude_longitude_deg(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return the latitude and longitude of a place in local NED: the inverse of the above."""
        radius_m, origin_rad = _RADIUS_M[self.autopilot], math.radians(self.origin[0])
        if self.autopilot == "ardupilot":
            latitude_rad = origin_rad + north_m / radius_m
            scale = math.cos(0.5 * (latitude_rad + origin_rad))
            east_rad = east_m / (radius_m * scale)
        else:
            # MapProjection::reproject.
            away_m = math.hypot(north_m, east_m)
            if away_m == 0.0:
                return self.origin[0], self.origin[1]
            angle_rad = away_m / radius_m
            sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
            origin_sine, origin_cosine = math.sin(origin_rad), math.cos(origin_rad)
            north, east = north_m / away_m, east_m / away_m
            latitude_rad = math.asin(cosine * origin_sine + north * sine * origin_cosine)
            east_rad = math.atan2(east * sine, origin_cosine * cosine - north * origin_sine * sine)
        longitude_deg = self.origin[1] + math.degrees(east_rad)
        return math.degrees(latitude_rad), longitude_difference_deg(longitude_deg, 0.0)
