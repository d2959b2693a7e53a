"""Arguments of ``clearway mission``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import positive
from gcs_tools.console.errors import EXIT_NO, CommandError
from gcs_tools.geodesy.utm import UtmZone

VEHICLES = ("px4", "ardupilot")
PLACE = "LAT,LON[,ALT]"


def place(text: str) -> tuple[float, ...]:
    """Return latitude, longitude and, where it is stated, altitude above sea level.

    Raises:
        ArgumentTypeError: the text is not such a place.
    """
    try:
        numbers = tuple(float(each) for each in text.split(","))
    except ValueError:
        numbers = ()
    # NaN fails the comparison.
    if len(numbers) not in (2, 3) or not all(abs(each) <= 1e5 for each in numbers):
        raise argparse.ArgumentTypeError(
            f"{text[:60]!r} is not {PLACE} in degrees and metres, such as 47.3977,8.5456,488"
        )
    from onboard.geometry.local_frame import GeographicPoint  # noqa: PLC0415  help loads no daemon

    if (problem := GeographicPoint(*numbers).problem()) is not None:
        raise argparse.ArgumentTypeError(problem)
    return numbers


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("mission", help="take over missions of ground stations")
    inner = parser.add_subparsers(required=True, metavar="ACTION")
    _add_import(inner)
    _add_stems(inner)


def _add_import(commands: Any) -> None:
    parser = commands.add_parser(
        "import",
        help="a .plan or .waypoints file, or what a vehicle has, as a mission file; exit code 1:"
        " cannot be flown",
    )
    parser.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="QGroundControl plan or QGC WPL"
    )
    parser.add_argument(
        "--from-vehicle", metavar="URL", help="mission and geofence of this vehicle, as in MAVSDK"
    )
    parser.add_argument("--system-id", type=int, metavar="N", help="of that vehicle")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="mission file; default: standard output"
    )
    parser.add_argument(
        "--geofence", type=Path, metavar="FILE", help="write the plan's geofence to this file"
    )
    parser.add_argument(
        "--home",
        type=place,
        metavar=PLACE,
        help="where the vehicle takes off, ALT above sea level; default: the file's",
    )
    parser.add_argument(
        "--origin",
        type=place,
        metavar=PLACE,
        help="of the autopilot's local frame (GPS_GLOBAL_ORIGIN); default: home",
    )
    parser.add_argument(
        "--vehicle", choices=VEHICLES, help="whose local frame; default: the file's, else px4"
    )
    parser.add_argument(
        "--altitude", type=positive, metavar="M", help="fly all legs at M metres above the origin"
    )
    _add_legs(parser)
    parser.set_defaults(run=_run_import)


def _add_legs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--target-half-width",
        type=positive,
        default=5.0,
        metavar="M",
        help="of every leg: how far beside its end the vehicle may arrive; default: 5",
    )
    parser.add_argument(
        "--corridor-half-width",
        type=positive,
        metavar="M",
        help="of every leg: how far beside its line the vehicle may fly; default: not stated",
    )
    parser.add_argument(
        "--first-item",
        choices=("home", "waypoint"),
        default="home",
        help="what item 0 of a QGC WPL list is; default: home",
    )


def _run_import(options: argparse.Namespace) -> int:
    from gcs_tools.missions.command import ImportRequest, import_mission  # noqa: PLC0415  loads every model

    if (options.file is None) is (options.from_vehicle is None):
        raise CommandError("expected either FILE or --from-vehicle URL")
    if options.system_id is not None and options.from_vehicle is None:
        raise CommandError("--system-id is of --from-vehicle URL")
    request = ImportRequest(
        file=options.file or Path("the vehicle"),
        vehicle_url=options.from_vehicle,
        system_id=options.system_id,
        output=options.output,
        geofence=options.geofence,
        home=options.home,
        origin=options.origin,
        vehicle=options.vehicle,
        altitude_m=options.altitude,
        target_half_width_m=options.target_half_width,
        corridor_half_width_m=options.corridor_half_width,
        first_is_home=options.first_item == "home",
    )
    return 0 if import_mission(request) else EXIT_NO


def zone(text: str) -> UtmZone:
    """Return a UTM zone.

    Raises:
        ArgumentTypeError: the text is not the name of one.
    """
    try:
        return UtmZone.named(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _add_stems(commands: Any) -> None:
    parser = commands.add_parser(
        "stems", help="a stem map in other columns or map coordinates as an obstacle field"
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="CSV, one stem a row")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="field file, CSV; default: stdout"
    )
    for name, meaning in (
        ("north", "metres north of the origin; with --utm, northing"),
        ("east", "metres east of the origin; with --utm, easting"),
        ("latitude", "latitude in degrees, in place of --north"),
        ("longitude", "longitude in degrees, in place of --east"),
    ):
        parser.add_argument(f"--{name}", metavar="COLUMN", help=f"column of the {meaning}")
    parser.add_argument(
        "--diameter", metavar="COLUMN", default="dbh_cm", help="column; default: dbh_cm"
    )
    parser.add_argument(
        "--diameter-unit",
        choices=("cm", "mm", "m", "in", "girth-cm"),
        default="cm",
        help="of that column; girth: circumference; default: cm",
    )
    parser.add_argument(
        "--delimiter",
        choices=("comma", "semicolon", "tab", "space"),
        help="between cells; default: found in the header",
    )
    parser.add_argument("--utm", type=zone, metavar="ZONE", help="of UTM coordinates: 32N")
    parser.add_argument(
        "--origin", type=place, metavar=PLACE, help="of the mission; for map coordinates"
    )
    parser.add_argument(
        "--vehicle", choices=VEHICLES, default="px4", help="whose local frame; default: px4"
    )
    parser.set_defaults(run=_run_stems)


def _run_stems(options: argparse.Namespace) -> int:
    from gcs_tools.missions.command import write_stems  # noqa: PLC0415  loads every model

    write_stems(options)
    return 0
