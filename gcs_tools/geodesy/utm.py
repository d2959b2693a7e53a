"""UTM coordinates to latitude and longitude.

The inverse of the transverse Mercator projection as Krüger's series in the third flattening, to the
fourth order: exact to a micrometre within a zone.  See C. F. F. Karney, "Transverse Mercator with
an accuracy of a few nanometers", Journal of Geodesy 85 (2011), equations 10 to 15 and 36.
"""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

_SEMI_MAJOR_AXIS_M: Final = 6_378_137.0
_FLATTENING: Final = 1.0 / 298.257223563
_N: Final = _FLATTENING / (2.0 - _FLATTENING)
_RECTIFYING_RADIUS_M: Final = _SEMI_MAJOR_AXIS_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
# Of sin(2 j ξ) cosh(2 j η), from the plane to the sphere, for j = 1 to 4.
_TO_SPHERE: Final = (
    _N / 2.0 - 2.0 / 3.0 * _N**2 + 37.0 / 96.0 * _N**3 - _N**4 / 360.0,
    _N**2 / 48.0 + _N**3 / 15.0 - 437.0 / 1440.0 * _N**4,
    17.0 / 480.0 * _N**3 - 37.0 / 840.0 * _N**4,
    4397.0 / 161_280.0 * _N**4,
)
# Of sin(2 j χ), from conformal to geodetic latitude.
_TO_GEODETIC: Final = (
    2.0 * _N - 2.0 / 3.0 * _N**2 - 2.0 * _N**3 + 116.0 / 45.0 * _N**4,
    7.0 / 3.0 * _N**2 - 8.0 / 5.0 * _N**3 - 227.0 / 45.0 * _N**4,
    56.0 / 15.0 * _N**3 - 136.0 / 35.0 * _N**4,
    4279.0 / 630.0 * _N**4,
)
_SCALE: Final = 0.9996
_FALSE_EASTING_M: Final = 500_000.0
_FALSE_NORTHING_SOUTH_M: Final = 10_000_000.0
_ZONES: Final = 60
# Beyond these a coordinate is of another zone, another system, or swapped.
EASTING_M: Final = (100_000.0, 900_000.0)
NORTHING_M: Final = (0.0, 10_000_000.0)
_NAME: Final = re.compile(r"0*([1-9][0-9]?)\s*([NnSs])")


class UtmZone(NamedTuple):
    """A zone of the Universal Transverse Mercator grid.

    Attributes:
        number: 1 to 60.
        south: whether its northings count from 10,000 km south of the equator.
    """

    number: int
    south: bool

    @classmethod
    def named(cls, name: str) -> UtmZone:
        """Return the zone of a name such as ``32N``; N and S are hemispheres, no latitude bands.

        Raises:
            ValueError: the text is not such a name.
        """
        match = _NAME.fullmatch(name.strip())
        if match is None or int(match[1]) > _ZONES:
            raise ValueError(
                f"{name!r} is not a UTM zone: expected 1 to 60 and the hemisphere, such as 32N"
            )
        return cls(int(match[1]), match[2] in "Ss")

    def __str__(self) -> str:
        return f"{self.number}{'S' if self.south else 'N'}"

    def problem(self, easting_m: float, northing_m: float) -> str | None:
        """Return why a pair of numbers is not a place in this zone; None if it may be one."""
        for name, value_m, (least_m, most_m) in (
            ("easting", easting_m, EASTING_M),
            ("northing", northing_m, NORTHING_M),
        ):
            if not least_m <= value_m <= most_m:
                return f"{name} [m] = {value_m:.10g}, expected {least_m:,.0f} to {most_m:,.0f}"
        return None

    def latitude_longitude_deg(self, easting_m: float, northing_m: float) -> tuple[float, float]:
        """Return a place's latitude and longitude, WGS84."""
        false_northing_m = _FALSE_NORTHING_SOUTH_M if self.south else 0.0
        plane_m = complex(northing_m - false_northing_m, easting_m - _FALSE_EASTING_M)
        plane = plane_m / (_SCALE * _RECTIFYING_RADIUS_M)
        sphere = plane
        for order, factor in enumerate(_TO_SPHERE, start=1):
            double = 2.0 * order * plane
            sphere -= factor * complex(
                math.sin(double.real) * math.cosh(double.imag),
                math.cos(double.real) * math.sinh(double.imag),
            )
        conformal_rad = math.asin(math.sin(sphere.real) / math.cosh(sphere.imag))
        latitude_rad = conformal_rad + sum(
            factor * math.sin(2.0 * order * conformal_rad)
            for order, factor in enumerate(_TO_GEODETIC, start=1)
        )
        east_rad = math.atan2(math.sinh(sphere.imag), math.cos(sphere.real))
        central_deg = 6.0 * self.number - 183.0
        longitude_deg = math.remainder(central_deg + math.degrees(east_rad), 360.0)
        return math.degrees(latitude_rad), longitude_deg
