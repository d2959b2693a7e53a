"""Writes the obstacles of a map as an obstacle field, which `clearway preflight` and `fly` read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import write_text
from onboard.files.yaml_file import dump_document
from onboard.recording.messages import KnownObstacle, Obstacles

_SIZE_MIN_M: Final = 0.01


def write_field(obstacles: Obstacles | None, path: Path) -> None:
    """Write the measured boxes: as YAML, or, as stems that enclose them, as CSV.

    Raises:
        CommandError: there is no obstacle, or the file cannot be written.
    """
    boxes = [] if obstacles is None else [_box(each) for each in obstacles.obstacles]
    if not boxes:
        raise CommandError(f"{path}: the map has no obstacle, and a field needs at least one")
    if path.suffix == ".csv":
        rows = ["x_m,y_m,dbh_cm", *(_stem(box) for box in boxes)]
        write_text("\n".join(rows) + "\n", path)
    else:
        write_text(dump_document(boxes), path)


def _box(obstacle: KnownObstacle) -> dict[str, Any]:
    """Return the keys of a box; the first of its sides is along its own axis."""
    corners: Sequence[tuple[float, float]] = obstacle.measured_ned_m
    (north_m, east_m), (next_north_m, next_east_m) = corners[0], corners[1]
    along_m = math.hypot(next_north_m - north_m, next_east_m - east_m)
    across_m = math.hypot(corners[2][0] - next_north_m, corners[2][1] - next_east_m)
    yaw_deg = math.degrees(math.atan2(next_east_m - east_m, next_north_m - north_m))
    center_m = [round(sum(corner[axis] for corner in corners) / 4.0, 3) for axis in (0, 1)]
    return {
        "id": obstacle.id,
        "center_ned_m": center_m,
        "size_m": [round(max(each, _SIZE_MIN_M), 3) for each in (along_m, across_m)],
        "yaw_deg": round(yaw_deg, 2),
    }


def _stem(box: dict[str, Any]) -> str:
    """Return the row of the stem around a box."""
    (north_m, east_m), size_m = box["center_ned_m"], box["size_m"]
    return f"{north_m},{east_m},{100.0 * math.hypot(*size_m):.1f}"
