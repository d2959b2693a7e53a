"""``clearway mission``: files of ground stations and surveyors as files of ours."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from gcs_tools.console.errors import CommandError
from gcs_tools.missions.document import Widths, geofence_text, mission_text
from gcs_tools.missions.plan_file import read_plan
from gcs_tools.missions.stems import StemTable, convert_stems
from gcs_tools.missions.waypoint_list import is_waypoint_list, read_waypoint_list
from onboard.files.yaml_file import FileError, read_text
from onboard.geometry.local_frame import Autopilot, GeographicPoint, LocalFrame
from onboard.mission_items.commands import command_name
from onboard.mission_items.fence_items import FenceError
from onboard.mission_items.planned_flight import GeographicArea, PlannedFlight
from onboard.mission_items.route import SAME_PLACE_M, Route, Site, route_of

_OTHER_FRAME = "the local frames of PX4 and ArduPilot differ by 1 m in 900"


@dataclass(frozen=True)
class ImportRequest:
    """What to import, and how.

    Attributes:
        file: a plan or a waypoint list; its content says which.
        output: mission file; None for standard output.
        geofence: file for the geofence; None leaves it out.
        home: latitude, longitude and perhaps altitude; None takes the file's.
        origin: of the local frame; None takes home.
        vehicle: whose local frame; None takes the file's, else PX4's.
        altitude_m: height of all legs above the origin; None takes the items'.
        target_half_width_m, corridor_half_width_m: of every leg.
        first_is_home: whether item 0 of a waypoint list is home.
        vehicle_url: where the vehicle is whose mission to import, in place of a file.
        system_id: of that vehicle; None if there is only one.
    """

    file: Path
    output: Path | None = None
    geofence: Path | None = None
    home: tuple[float, ...] | None = None
    origin: tuple[float, ...] | None = None
    vehicle: Autopilot | None = None
    altitude_m: float | None = None
    target_half_width_m: float = 5.0
    corridor_half_width_m: float | None = None
    first_is_home: bool = True
    vehicle_url: str | None = None
    system_id: int | None = None


def import_mission(request: ImportRequest) -> bool:
    """Write the mission file; return whether the mission can be flown.

    Where an item cannot be flown, nothing is written.  The report on every item goes to standard
    output, or to standard error where the mission file goes to standard output.

    Raises:
        FileError: the file cannot be used.
        CommandError: home is not known, or a file cannot be written.
    """
    _refuse_own_file(request)
    planned = _read(request)
    site = _site(request, planned)
    route = route_of(planned.items, site, request.altitude_m)
    crossed = _crossed_areas(route, planned.fence)
    report = sys.stderr if request.output is None else sys.stdout
    for line in (*_remark_lines(route), *_notes(request, planned, site), *crossed):
        report.write(f"{line}\n")
    if route.refusals or crossed or not route.legs:
        report.write(f"{_refusal(route, crossed)}; nothing was written\n")
        return False
    widths = Widths(request.target_half_width_m, request.corridor_half_width_m)
    _write(mission_text(route, widths, request.file), request.output)
    if request.geofence is not None:
        _write(geofence_text(planned.fence, site, request.file), request.geofence)
    report.write(f"{_summary(route)}\n")
    return True


def write_stems(options: argparse.Namespace) -> None:
    """Write a stem map as an obstacle field, from the arguments of ``clearway mission stems``.

    Raises:
        FileError: the file cannot be used.
        CommandError: the options do not fit together, or the output cannot be written.
    """
    if options.output is not None and options.output.resolve() == options.file.resolve():
        raise CommandError(f"{options.output}: would overwrite the file that is read")
    geographic = options.latitude is not None or options.longitude is not None
    origin = options.origin
    table = StemTable(
        *_columns(options, geographic=geographic),
        options.diameter,
        diameter_unit=options.diameter_unit,
        delimiter=options.delimiter,
        zone=options.utm,
        geographic=geographic,
        origin=origin and LocalFrame(GeographicPoint(*origin), options.vehicle),
    )
    text, report = convert_stems(options.file, table)
    _write(text, options.output)
    (sys.stderr if options.output is None else sys.stdout).write(f"{report}\n")


def _columns(options: argparse.Namespace, *, geographic: bool) -> tuple[str, str]:
    """Return the names of the two columns that state places."""
    first, second = options.north, options.east
    if geographic:
        mixed = first or second
        first, second = (None, None) if mixed else (options.latitude, options.longitude)
    elif options.utm is None:
        first, second = first or "x_m", second or "y_m"
    if first is None or second is None:
        raise CommandError("expected --north and --east, or --latitude and --longitude")
    return first, second


def _refuse_own_file(request: ImportRequest) -> None:
    written = [each for each in (request.output, request.geofence) if each is not None]
    for one, other in pairwise((request.file, *written)):
        if one.resolve() == other.resolve():
            raise CommandError(f"{other}: would overwrite a file of the same command")
    if len(written) > 1 and request.file.resolve() == written[1].resolve():
        raise CommandError(f"{written[1]}: would overwrite the file that is imported")


def _read(request: ImportRequest) -> PlannedFlight:
    path = request.file
    if request.vehicle_url is not None:
        from gcs_tools.missions.from_vehicle import read_vehicle  # noqa: PLC0415  loads MAVSDK

        planned = read_vehicle(request.vehicle_url, request.system_id)
    elif is_waypoint_list(read_text(path)):
        planned = read_waypoint_list(path, first_is_home=request.first_is_home)
    else:
        planned = read_plan(path)
    if request.geofence is not None and not planned.fence:
        raise CommandError(f"{path}: has no geofence that --geofence could write")
    for corner in (corner for area in planned.fence for corner in area.corners):
        if (problem := corner.problem()) is not None:
            raise FileError(f"{path}: geofence: {problem}")
    return planned


def _site(request: ImportRequest, planned: PlannedFlight) -> Site:
    home = planned.home if request.home is None else GeographicPoint(*request.home)
    if home is None:
        raise CommandError(f"{request.file}: states no home; give --home LAT,LON,ALT")
    if (problem := home.problem()) is not None:
        raise FileError(f"{request.file}: home: {problem}")
    stated = planned.origin or home
    origin = stated if request.origin is None else GeographicPoint(*request.origin)
    return Site(LocalFrame(origin, request.vehicle or planned.autopilot or "px4"), home)


def _remark_lines(route: Route) -> Iterator[str]:
    rows = [(each.item, command_name(each.command), each.kind, each.text) for each in route.remarks]
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    for row in rows:
        padded = (cell.ljust(width) for cell, width in zip(row, widths, strict=False))
        yield "  ".join((*padded, row[3]))


def _notes(request: ImportRequest, planned: PlannedFlight, site: Site) -> Iterator[str]:
    yield from (f"note: {each}" for each in planned.notes)
    if request.vehicle is None and planned.autopilot is None:
        yield f"note: taken for PX4, as --vehicle does not say; {_OTHER_FRAME}"
    if request.home is not None and planned.home is not None:
        away_m = math.dist(site.frame.north_east_m(*planned.home[:2]), site.start_ned_m)
        if away_m > SAME_PLACE_M:
            yield f"note: home of the file is {away_m:,.0f} m from --home, which counts"
    if request.origin is None and planned.origin is None:
        yield (
            "note: the local origin is taken to be at home; where GPS_GLOBAL_ORIGIN says "
            "otherwise, give it by --origin"
        )
    if planned.fence and request.geofence is None:
        yield (
            f"note: the geofence (areas: {len(planned.fence)}) is left out; --geofence FILE writes "
            "it, for preflight --geofence"
        )


def _crossed_areas(route: Route, fence: tuple[GeographicArea, ...]) -> list[str]:
    """Return a line for each area of the fence that the legs themselves break."""
    if not fence or not route.legs:
        return []
    from shapely import LineString  # noqa: PLC0415  only where there is a geofence

    from gcs_tools.vehicle.geofence import FenceArea  # noqa: PLC0415  loads Shapely

    frame = route.site.frame
    path = LineString([route.site.start_ned_m, *(leg.end_ned_m for leg in route.legs)])
    lines = []
    for number, area in enumerate(fence, start=1):
        corners_m = tuple(frame.north_east_m(*corner[:2]) for corner in area.corners)
        known = FenceArea(corners_m, area.radius_m, area.keeps_in)
        try:
            if known.margin_m(path) < 0.0:
                lines.append(f"REFUSED: the legs cross area {number} of the geofence, {known}")
        except FenceError as error:
            lines.append(f"REFUSED: area {number} of the geofence: {error}")
    return lines


def _refusal(route: Route, crossed: list[str]) -> str:
    if route.refusals:
        items = {each.item for each in route.refusals}
        return f"{len(items)} of {len({each.item for each in route.remarks})} items cannot be flown"
    return "the legs break the geofence" if crossed else "no item is a leg"


def _summary(route: Route) -> str:
    points = [route.site.start_ned_m, *(leg.end_ned_m for leg in route.legs)]
    length_m = sum(math.dist(*leg) for leg in pairwise(points))
    legs = "1 leg" if len(route.legs) == 1 else f"{len(route.legs)} legs"
    return f"{legs}, {length_m:,.1f} m, at {route.height_m:.1f} m above the local origin"


def _write(text: str, path: Path | None) -> None:
    if path is None:
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
