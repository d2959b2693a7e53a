"""Writes an imported mission, and its geofence, as files that ``clearway preflight`` takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import parse_document, validate
from onboard.mission_items.planned_flight import GeographicArea
from onboard.mission_items.route import Point, Route, Site

_AUTOPILOTS = {"px4": "PX4", "ardupilot": "ArduPilot"}


@dataclass(frozen=True)
class Widths:
    """What an imported mission states of every leg.

    Attributes:
        target_half_width_m: how far beside the end the vehicle may arrive.
        corridor_half_width_m: how far beside the leg it may fly; None leaves that open.
    """

    target_half_width_m: float
    corridor_half_width_m: float | None = None


def mission_text(route: Route, widths: Widths, source: Path) -> str:
    """Return the mission file of a route, checked by the model that reads it.

    Raises:
        FileError: the route is not a mission.
    """
    text = "\n".join(_mission_lines(route, widths, source)) + "\n"
    validate(parse_document(text, source=str(source)), Mission, source=str(source))
    return text


def _mission_lines(route: Route, widths: Widths, source: Path) -> Iterator[str]:
    yield from _heading(source, route.site)
    yield f"start_ned_m: {_point(route.site.start_ned_m)}"
    yield f"altitude_m: {route.height_m:.2f}"
    yield "legs:"
    for leg in route.legs:
        yield f"  - end_ned_m: {_point(leg.end_ned_m)}  # {leg.item}"
        yield f"    target_half_width_m: {widths.target_half_width_m:g}"
        if widths.corridor_half_width_m is not None:
            yield f"    corridor_half_width_m: {widths.corridor_half_width_m:g}"


def _heading(source: Path, site: Site) -> Iterator[str]:
    frame = site.frame
    yield f"# Imported by clearway mission import from {source.name!r}."
    yield (
        f"# Local frame of {_AUTOPILOTS[frame.autopilot]}, its origin (GPS_GLOBAL_ORIGIN) at "
        f"{frame.origin}."
    )
    if site.home is not frame.origin:
        yield f"# Home at {site.home}."


def _point(point_ned_m: Point) -> str:
    north_m, east_m = (round(value, 3) + 0.0 for value in point_ned_m)  # no -0.0
    return f"[{north_m:.3f}, {east_m:.3f}]"


def geofence_text(areas: tuple[GeographicArea, ...], site: Site, source: Path) -> str:
    """Return the geofence file of areas, checked by the model that reads it.

    Raises:
        FileError: an area is not one.
    """
    lines = [*_heading(source, site), "areas:"]
    for area in areas:
        lines.append(f"  - keep: {'inside' if area.keeps_in else 'outside'}")
        corners = [_point(site.frame.north_east_m(*each[:2])) for each in area.corners]
        if area.radius_m is None:
            lines.append("    corners_ned_m:")
            lines += [f"      - {corner}" for corner in corners]
        else:
            lines.append(f"    center_ned_m: {corners[0]}")
            lines.append(f"    radius_m: {area.radius_m:.3f}")
    text = "\n".join(lines) + "\n"
    validate(parse_document(text, source=str(source)), Geofence, source=str(source))
    return text
