"""Files as ground stations write them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

HOME = (47.397742, 8.545594, 488.0)
# One second of arc north, by PX4's sphere.
NORTH_DEG = 1e-3
WAYPOINT, TAKE_OFF, RETURN, LAND = 16, 22, 20, 21


def simple(
    command: int,
    *place: float | None,
    frame: int = 3,
    parameters: tuple[float | None, ...] = (0, 0, 0, None),
) -> dict[str, Any]:
    """Return an item of a plan; without a place it states zeros."""
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "frame": frame,
        "params": [*parameters, *(place or (0, 0, 0))],
    }


def north(steps: float, altitude_m: float | None = 10.0, east: float = 0.0) -> tuple[Any, ...]:
    """Return a place some steps of `NORTH_DEG` north and east of home."""
    return (HOME[0] + steps * NORTH_DEG, HOME[1] + east * NORTH_DEG, altitude_m)


def plan(*items: dict[str, Any], **mission: Any) -> dict[str, Any]:
    """Return a plan of these items; keywords replace keys of its mission."""
    own = {"firmwareType": 12, "vehicleType": 2, "plannedHomePosition": list(HOME), "version": 2}
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {**own, "items": list(items), **mission},
    }


def written(path: Path, document: dict[str, Any]) -> Path:
    """Write a plan."""
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def waypoints(*rows: str, header: str = "QGC WPL 110") -> str:
    """Return a waypoint list; cells of a row are separated by spaces here, by tabs there."""
    return "\n".join((header, *("\t".join(row.split()) for row in rows))) + "\n"
