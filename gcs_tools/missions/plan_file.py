"""Reads QGroundControl's ``.plan`` files: mission, geofence, rally points (JSON, version 1).

The format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html.  Surveys
and corridor scans keep the items that they expand to; other complex items do not, and cannot be
read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from onboard.files.yaml_file import FileError, read_text, validate
from onboard.geometry.local_frame import Autopilot, GeographicPoint
from onboard.mission_items.planned_flight import (
    PARAMETERS,
    FileItem,
    GeographicArea,
    PlannedFlight,
)

# MAV_AUTOPILOT.
_FIRMWARE: Final[dict[int, Autopilot]] = {12: "px4", 3: "ardupilot"}
_FIRMWARES_UNDECIDED: Final = (0,)
_MULTIROTORS: Final = frozenset({0, 2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE; 0: generic


class _Model(BaseModel):
    """Programs add keys of their own; what is read is strict."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)


# JSON has arrays only; a parameter that is not used is null.
_Numbers = Annotated[tuple[float | None, ...], Field(strict=False)]
_Corner = Annotated[tuple[float, float], Field(strict=False)]


class _Circle(_Model):
    center: _Corner
    radius: float


class _FenceCircle(_Model):
    circle: _Circle
    inclusion: bool


class _FencePolygon(_Model):
    polygon: tuple[_Corner, ...] = Field(strict=False)
    inclusion: bool


class _Fence(_Model):
    circles: tuple[_FenceCircle, ...] = Field((), strict=False)
    polygons: tuple[_FencePolygon, ...] = Field((), strict=False)
    polygon: tuple[_Corner, ...] = Field((), strict=False)  # version 1: one, to stay inside
    breachReturn: _Numbers | None = None  # noqa: N815  the file's key


class _Rally(_Model):
    points: tuple[_Numbers, ...] = Field((), strict=False)


class _Item(_Model):
    command: int
    frame: int
    params: _Numbers
    coordinate: _Numbers | None = None


class _Mission(_Model):
    items: tuple[dict[str, Any], ...] = Field(strict=False)
    plannedHomePosition: _Numbers | None = None  # noqa: N815  the file's key
    firmwareType: int = 0  # noqa: N815  the file's key
    vehicleType: int = 0  # noqa: N815  the file's key


class _Plan(_Model):
    fileType: Literal["Plan"]  # noqa: N815  the file's key
    version: Literal[1]
    mission: _Mission
    geoFence: _Fence | None = None  # noqa: N815  the file's key
    rallyPoints: _Rally | None = None  # noqa: N815  the file's key


def read_plan(path: Path) -> PlannedFlight:
    """Read a plan.

    Raises:
        FileError: names the file, the key and the value.
    """
    plan = validate(_json(path), _Plan, source=str(path))
    home = _home(plan.mission.plannedHomePosition, path)
    items: list[FileItem] = []
    for number, document in enumerate(plan.mission.items, start=1):
        items += _items(document, f"item {number}", path)
    fence = () if plan.geoFence is None else tuple(_areas(plan.geoFence, path))
    autopilot = _FIRMWARE.get(plan.mission.firmwareType)
    return PlannedFlight(home, autopilot, tuple(items), fence, tuple(_notes(plan, autopilot)))


def _json(path: Path) -> Any:
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise FileError(
            f"{path}: is neither JSON (line {error.lineno}: {error.msg}) nor a QGC WPL 110 list"
        ) from error
    except RecursionError as error:
        raise FileError(f"{path}: is nested too deeply") from error


def _home(numbers: tuple[float | None, ...] | None, path: Path) -> GeographicPoint | None:
    if numbers is None or any(each is None for each in numbers[:2]):
        return None
    if len(numbers) != 3:
        raise FileError(
            f"{path}: mission.plannedHomePosition has {len(numbers)} numbers, expected latitude, "
            "longitude, altitude"
        )
    return GeographicPoint(*(math.nan if each is None else each for each in numbers))


def _items(document: dict[str, Any], name: str, path: Path) -> Iterator[FileItem]:
    kind = document.get("type")
    if kind == "SimpleItem":
        yield _simple(validate(document, _Item, source=f"{path}: mission, {name}"), name, path)
        return
    if kind != "ComplexItem":
        raise FileError(f"{path}: {name}: type = {kind!r}, expected 'SimpleItem' or 'ComplexItem'")
    pattern = str(document.get("complexItemType", "complex item"))
    transects = document.get("TransectStyleComplexItem")
    expanded = transects.get("Items") if isinstance(transects, dict) else None
    if not isinstance(expanded, list) or not all(isinstance(each, dict) for each in expanded):
        raise FileError(
            f"{path}: {name}: a {pattern} does not keep its waypoints in the file, so it cannot be "
            "read; export the plan as waypoints"
        )
    for number, inner in enumerate(expanded, start=1):
        inner_name = f"{name} ({pattern}) {number}"
        read = validate(inner, _Item, source=f"{path}: mission, {inner_name}")
        yield _simple(read, inner_name, path)


def _simple(item: _Item, name: str, path: Path) -> FileItem:
    numbers = item.params + (item.coordinate or ())  # early files state the place apart
    if len(numbers) != PARAMETERS + 3:
        raise FileError(
            f"{path}: mission, {name}: params has {len(numbers)} numbers, expected "
            f"{PARAMETERS} and latitude, longitude, altitude"
        )
    first, second, third, fourth, *place = (math.nan if n is None else n for n in numbers)
    return FileItem(
        name, item.command, item.frame, (first, second, third, fourth), GeographicPoint(*place)
    )


def _areas(fence: _Fence, path: Path) -> Iterator[GeographicArea]:
    polygons = [(each.polygon, each.inclusion) for each in fence.polygons]
    if fence.polygon:
        polygons.append((fence.polygon, True))
    for corners, keeps_in in polygons:
        if len(corners) < 3:
            raise FileError(f"{path}: geoFence: a polygon has {len(corners)} corners, expected 3")
        yield GeographicArea(tuple(GeographicPoint(*each) for each in corners), None, keeps_in)
    for each in fence.circles:
        circle = each.circle
        if not circle.radius > 0.0:
            raise FileError(f"{path}: geoFence: radius [m] = {circle.radius:g}, expected above 0")
        yield GeographicArea((GeographicPoint(*circle.center),), circle.radius, each.inclusion)


def _notes(plan: _Plan, autopilot: Autopilot | None) -> Iterator[str]:
    mission = plan.mission
    if autopilot is None and mission.firmwareType not in _FIRMWARES_UNDECIDED:
        yield (
            f"the plan is for firmware {mission.firmwareType} (MAV_AUTOPILOT), neither PX4 nor "
            "ArduPilot"
        )
    if mission.vehicleType not in _MULTIROTORS:
        yield f"the plan is for a vehicle of type {mission.vehicleType} (MAV_TYPE), no multirotor"
    if plan.rallyPoints is not None and plan.rallyPoints.points:
        count = len(plan.rallyPoints.points)
        yield f"rally points ({count}): only the autopilot's own return uses them"
    if plan.geoFence is not None and plan.geoFence.breachReturn is not None:
        yield "the geofence's return point: only the autopilot uses it"
