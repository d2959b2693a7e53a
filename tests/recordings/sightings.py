"""What the sensor saw in a recording, as far as its log still tells.

The flight log holds the map, not the frames: at 5 Hz the smallest box that encloses every
measurement of an obstacle so far, its hull.  A hull grows where the newest measurement lies beyond
it, so each growth tells where that measurement was: its size is that of the first hull, one of its
faces is the hull's.  In between the measurement is taken to move evenly.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from gcs_tools.logs.flight_log import read_log

# A hull has grown if a face has moved by more than rounding.
_GROWN_M = 1e-3


@dataclass(frozen=True)
class Sighting:
    """Where one obstacle was measured: centre and extents, NED."""

    track_id: str
    center_ned_m: tuple[float, float]
    size_m: tuple[float, float]


@dataclass(frozen=True)
class HullRow:
    """One obstacle's hull as the map had it at a time (north and east, least and largest)."""

    time_unix_s: float
    track_id: str
    box_ned_m: tuple[float, float, float, float]


def hulls_of_log(path: Path) -> list[HullRow]:
    """Return the hulls of a flight log (MCAP), in the order of time."""
    rows = []
    for said in read_log(path).obstacles:
        for obstacle in said.obstacles:
            norths, easts = zip(*obstacle.measured_ned_m, strict=True)
            box_m = (min(norths), min(easts), max(norths), max(easts))
            rows.append(HullRow(said.time_s, obstacle.id.split("/", 1)[1], box_m))
    return rows


def write_hulls(path: Path, rows: list[HullRow]) -> None:
    lines = (
        json.dumps([round(r.time_unix_s, 3), r.track_id, [round(v, 4) for v in r.box_ned_m]])
        for r in rows
    )
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def read_hulls(path: Path) -> list[HullRow]:
    rows = json.loads(path.read_text(encoding="utf-8"))
    return [HullRow(time_s, track_id, tuple(box)) for time_s, track_id, box in rows]


class Sightings:
    """The measurements behind a recording's hulls.

    Args:
        rows: the hulls, in the order of time.
    """

    def __init__(self, rows: list[HullRow]) -> None:
        by_track: defaultdict[str, list[HullRow]] = defaultdict(list)
        for row in rows:
            by_track[row.track_id].append(row)
        self._tracks = {track: _Track(hulls) for track, hulls in by_track.items()}

    def at(self, time_unix_s: float) -> list[Sighting]:
        """Return where each obstacle is measured at a time, once it has been seen."""
        return [
            Sighting(track, path.center_at(time_unix_s), path.size_m)
            for track, path in self._tracks.items()
            if time_unix_s >= path.first_s
        ]


class _Track:
    def __init__(self, hulls: list[HullRow]) -> None:
        north_0, east_0, north_1, east_1 = hulls[0].box_ned_m
        self.first_s = hulls[0].time_unix_s
        self.size_m = (north_1 - north_0, east_1 - east_0)
        self._axes = [_centres(hulls, axis, self.size_m[axis]) for axis in range(2)]

    def center_at(self, time_unix_s: float) -> tuple[float, float]:
        north_m, east_m = (_interpolated(points, time_unix_s) for points in self._axes)
        return north_m, east_m


def _centres(hulls: list[HullRow], axis: int, size_m: float) -> list[tuple[float, float]]:
    """Return where the measurement's centre was, along one axis, whenever the hull shows it."""
    low_m, high_m = hulls[0].box_ned_m[axis], hulls[0].box_ned_m[axis + 2]
    points = [(hulls[0].time_unix_s, (low_m + high_m) / 2.0)]
    for hull in hulls[1:]:
        new_low_m, new_high_m = hull.box_ned_m[axis], hull.box_ned_m[axis + 2]
        if new_low_m < low_m - _GROWN_M:
            points.append((hull.time_unix_s, new_low_m + size_m / 2.0))
        elif new_high_m > high_m + _GROWN_M:
            points.append((hull.time_unix_s, new_high_m - size_m / 2.0))
        low_m, high_m = new_low_m, new_high_m
    return points


def _interpolated(points: list[tuple[float, float]], time_s: float) -> float:
    after = bisect_right(points, time_s, key=lambda point: point[0])
    if after == 0:
        return points[0][1]
    if after == len(points):
        return points[-1][1]
    (begin_s, begin_m), (end_s, end_m) = points[after - 1], points[after]
    return begin_m + (end_m - begin_m) * (time_s - begin_s) / (end_s - begin_s)
