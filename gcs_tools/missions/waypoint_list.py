"""Reads waypoint lists (``QGC WPL 110``): the text format of Mission Planner, MAVProxy and others.

Fields of an item are separated by tabs or spaces: index, current, frame, command, four parameters,
latitude, longitude, altitude, autocontinue (https://mavlink.io/en/file_formats/).  Item 0 is home,
as ArduPilot's ground stations write it: a waypoint whose altitude counts from sea level.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from onboard.files.yaml_file import FileError, read_text
from onboard.geometry.local_frame import GeographicPoint
from onboard.mission_items.planned_flight import SEA_LEVEL_FRAMES, FileItem, PlannedFlight

_HEADER: Final = ("QGC", "WPL", "110")
_FIELDS: Final = 12
_WAYPOINT: Final = 16
_WHOLE: Final = ("index", "current", "frame", "command")
_NUMBERS: Final = (
    *("param1", "param2", "param3", "param4"),
    *("latitude", "longitude", "altitude", "autocontinue"),
)
_ITEMS_MAX: Final = 100_000


def is_waypoint_list(text: str) -> bool:
    """Tell whether a text is meant as a waypoint list, of whatever version."""
    return text.lstrip().split(None, 2)[:2] == ["QGC", "WPL"]


def read_waypoint_list(path: Path, *, first_is_home: bool = True) -> PlannedFlight:
    """Read a waypoint list.

    Args:
        path: the file.
        first_is_home: whether item 0 is home; otherwise it is flown as every other.

    Raises:
        FileError: names the file, the line, the field and the value.
    """
    lines = [(number, line.split()) for number, line in enumerate(read_text(path).splitlines(), 1)]
    filled = [(number, words) for number, words in lines if words and not words[0].startswith("#")]
    if not filled or tuple(filled[0][1]) != _HEADER:
        found = " ".join(filled[0][1])[:40] if filled else ""
        raise FileError(f"{path}: line 1: begins with {found!r}, expected 'QGC WPL 110'")
    if len(filled) > _ITEMS_MAX:
        raise FileError(f"{path}: has {len(filled) - 1} items, at most {_ITEMS_MAX} are read")
    items = [_item(words, f"{path}: line {number}") for number, words in filled[1:]]
    if not items:
        raise FileError(f"{path}: has no items after its first line")
    home = None
    if first_is_home:
        home = _home(items.pop(0), path)
    return PlannedFlight(home, None, tuple(items))


def _home(item: FileItem, path: Path) -> GeographicPoint | None:
    if item.command != _WAYPOINT or item.frame not in SEA_LEVEL_FRAMES:
        raise FileError(
            f"{path}: {item.name} (command {item.command}, frame {item.frame}) is not home, a "
            "waypoint above sea level (command 16, frame 0); if it is to be flown, say "
            "--first-item waypoint and --home LAT,LON,ALT"
        )
    # Ground stations without a vehicle write zeros.
    return item.place if item.states_place else None


def _item(words: list[str], source: str) -> FileItem:
    if len(words) != _FIELDS:
        raise FileError(f"{source}: has {len(words)} fields, expected {_FIELDS}")
    index, _, frame, command = (
        _whole(word, name, source) for word, name in zip(words[:4], _WHOLE, strict=True)
    )
    numbers = [_number(word, name, source) for word, name in zip(words[4:], _NUMBERS, strict=True)]
    first, second, third, fourth, latitude_deg, longitude_deg, altitude_m, _ = numbers
    return FileItem(
        f"item {index}",
        command,
        frame,
        (first, second, third, fourth),
        GeographicPoint(latitude_deg, longitude_deg, altitude_m),
    )


def _whole(word: str, name: str, source: str) -> int:
    # Some programs write whole numbers as 16.000000.
    value = _number(word, name, source)
    if not value.is_integer() or value < 0.0:
        raise FileError(f"{source}: {name} = {word!r} is not a whole number")
    return int(value)


def _number(word: str, name: str, source: str) -> float:
    if word.lower() == "nan" and name.startswith("param"):
        return math.nan  # "unchanged", as for a yaw
    try:
        value = float(word) if word.isascii() and "_" not in word else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileError(f"{source}: {name} = {word[:40]!r} is not a finite number")
    return value
