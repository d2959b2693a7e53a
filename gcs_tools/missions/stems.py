"""``clearway mission stems``: a stem map with other columns or coordinates as an obstacle field."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gcs_tools.console.errors import CommandError
from gcs_tools.geodesy.utm import UtmZone
from onboard.files.stem_map import DIAMETER_MAX_CM, DISTANCE_MAX_M, Row, read_columns
from onboard.files.yaml_file import FileError
from onboard.geometry.local_frame import GeographicPoint, LocalFrame

# Centimetres of diameter in one of each; a girth is measured around the stem.
DIAMETER_UNITS_CM: Final = MappingProxyType(
    {"cm": 1.0, "mm": 0.1, "m": 100.0, "in": 2.54, "girth-cm": 1.0 / math.pi}
)
DELIMITERS: Final = MappingProxyType({"comma": ",", "semicolon": ";", "tab": "\t", "space": " "})

Place = Callable[[float, float], tuple[float, float]]


@dataclass(frozen=True)
class StemTable:
    """How a file states its stems.

    Attributes:
        north, east: columns of metres north and east of the mission's origin; with a zone, of
            northing and easting; or, where ``geographic``, of latitude and longitude in degrees.
        diameter: column of the diameter.
        diameter_unit: of `DIAMETER_UNITS_CM`.
        delimiter: of `DELIMITERS`; None finds it in the header.
        zone: of UTM coordinates.
        geographic: whether the columns are latitude and longitude.
        origin: of the mission; needed by UTM, latitude and longitude.
    """

    north: str
    east: str
    diameter: str
    diameter_unit: str = "cm"
    delimiter: str | None = None
    zone: UtmZone | None = None
    geographic: bool = False
    origin: LocalFrame | None = None


def convert_stems(path: Path, table: StemTable) -> tuple[str, str]:
    """Return a stem map of our own format, and one line about it.

    Raises:
        CommandError: the options do not fit together.
        FileError: names the file, the row, the column and the value.
    """
    place = _place(table)
    meanings = {table.north: "north", table.east: "east", table.diameter: "diameter"}
    if len(meanings) < 3:
        raise CommandError(
            f"columns {table.north}, {table.east}, {table.diameter}: expected three different ones"
        )
    if table.geographic:
        meanings |= {table.north: "latitude in degrees", table.east: "longitude in degrees"}
    delimiter = None if table.delimiter is None else DELIMITERS[table.delimiter]
    stems = [_stem(row, place, table) for row in read_columns(path, meanings, delimiter)]
    lines = [f"{north_m:.3f},{east_m:.3f},{cm:.2f}" for north_m, east_m, cm in stems]
    norths_m, easts_m, _ = zip(*stems, strict=True)
    report = (
        f"{len(stems)} stems, {min(norths_m):.1f} to {max(norths_m):.1f} m north and "
        f"{min(easts_m):.1f} to {max(easts_m):.1f} m east of the origin"
    )
    return "\n".join(("x_m,y_m,dbh_cm", *lines)) + "\n", report


def _place(table: StemTable) -> Place:
    """Return the function that converts a row's two numbers to metres north and east."""
    if table.zone is not None and table.geographic:
        raise CommandError("--utm is for northings and eastings, not --latitude and --longitude")
    if table.zone is None and not table.geographic:
        if table.origin is not None:
            raise CommandError("--origin needs --utm, or --latitude and --longitude")
        return lambda north_m, east_m: (north_m, east_m)
    frame = table.origin
    if frame is None:
        raise CommandError("map coordinates need --origin LAT,LON, the mission's")
    if table.geographic:
        return lambda latitude_deg, longitude_deg: _local(frame, latitude_deg, longitude_deg)
    zone = table.zone
    assert zone is not None  # noqa: S101  for mypy: the other cases have returned

    def of_zone(northing_m: float, easting_m: float) -> tuple[float, float]:
        if (problem := zone.problem(easting_m, northing_m)) is not None:
            raise ValueError(f"{problem} in UTM zone {zone}")
        return _local(frame, *zone.latitude_longitude_deg(easting_m, northing_m))

    return of_zone


def _local(frame: LocalFrame, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    if (problem := GeographicPoint(latitude_deg, longitude_deg).problem()) is not None:
        raise ValueError(problem)
    return frame.north_east_m(latitude_deg, longitude_deg)


def _stem(row: Row, place: Place, table: StemTable) -> tuple[float, float, float]:
    """Return metres north and east, and the diameter in cm."""
    first, second, diameter = row.numbers
    try:
        north_m, east_m = place(first, second)
    except ValueError as error:
        raise FileError(f"{row.source}: {error}") from error
    away_m = max(abs(north_m), abs(east_m))
    if away_m > DISTANCE_MAX_M:
        raise FileError(
            f"{row.source}: {table.north} = {first:.10g}, {table.east} = {second:.10g} is "
            f"{away_m / 1e3:,.0f} km from the mission's origin; check --origin and --utm"
        )
    diameter_cm = diameter * DIAMETER_UNITS_CM[table.diameter_unit]
    # Written with two decimals; nothing may be rounded away.
    if not 0.01 <= diameter_cm <= DIAMETER_MAX_CM:
        raise FileError(
            f"{row.source}: {table.diameter} [{table.diameter_unit}] = {diameter:g} is "
            f"{diameter_cm:g} cm, expected 0.01 to {DIAMETER_MAX_CM:g} cm"
        )
    return north_m, east_m, math.ceil(diameter_cm * 100.0 - 1e-6) / 100.0
