"""Fields to fly: files of stems or boxes, random forests, and a few drawn scenes."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import ndimage

from tests.tools.dense_fields.obstacles import Floats, Obstacles

FOREST_HALF_WIDTH_M = 9.0
# A forest of random stems: a square of this side, and the radii of its stems.
_SIDE_M, _RADIUS_M = 120.0, (0.05, 0.20)
_LEG_M = {"forest": 60.0, "random": 50.0}
# Around both ends of a leg, so that the vehicle can hover there.
_CLEAR_START_M, _CLEAR_GOAL_M = 2.1, 1.6
_AROUND_M = 18.0
_RASTER_M = 0.1


@dataclass(frozen=True, eq=False)
class Scene:
    """One leg through a field.

    Attributes:
        name: for the table.
        obstacles: in the frame of the leg, which begins at its origin.
        length_m: of the leg; the goal is (length, 0).
        half_width_m: of the corridor that the vehicle must not leave.
    """

    name: str
    obstacles: Obstacles
    length_m: float
    half_width_m: float

    def passable(self, margin_m: float) -> bool:
        """Tell whether a way leads to the goal on the map with the boxes grown by a margin.

        A* would find one: the goal lies in the connected part of the raster that the start is in.
        """
        xs = np.arange(-8.0, self.length_m + 8.0, _RASTER_M)
        half_m = min(self.half_width_m, 60.0) - margin_m
        ys = np.arange(-half_m, half_m, _RASTER_M)
        open_cells = np.ones((len(xs), len(ys)), bool)
        for box in self.obstacles.reports(np.random.default_rng(0), 0.0):
            i0, i1 = np.searchsorted(xs, (box.x_min_m - margin_m, box.x_max_m + margin_m))
            j0, j1 = np.searchsorted(ys, (box.y_min_m - margin_m, box.y_max_m + margin_m))
            open_cells[i0:i1, j0:j1] = False
        parts, _ = ndimage.label(open_cells, np.ones((3, 3), int))
        middle = int(np.abs(ys).argmin())
        start = parts[int(np.abs(xs).argmin()), middle]
        goal = parts[int(np.abs(xs - self.length_m).argmin()), middle]
        return bool(start > 0 and start == goal)


def scenes_of(source: str, legs: int, seed: int) -> Iterator[Scene]:
    """Yield the scenes of a file, of a density [stems/ha], or of a drawn scene by its name."""
    path = Path(source)
    if path.suffix == ".csv":
        yield from _file_scenes(path, legs, seed)
    elif source.replace(".", "", 1).isdigit():
        yield from _forest_legs(random_forest(float(source), seed), _LEG_M["random"], legs, seed)
    else:  # the faces' errors differ
        for _ in range(legs):
            yield drawn(source)


def random_forest(stems_per_ha: float, seed: int) -> Obstacles:
    """Return stems placed uniformly in a square."""
    rng = np.random.default_rng((seed, 5))
    count = rng.poisson(stems_per_ha * _SIDE_M**2 / 1e4)
    return Obstacles.stems(rng.uniform(0.0, _SIDE_M, (count, 2)), rng.uniform(*_RADIUS_M, count))


def drawn(name: str) -> Scene:
    """Return a scene by its name: slalom, slalom-tight, s:GAP, door:WIDTH or trap."""
    kind, _, size = name.partition(":")
    faces: list[tuple[float, float, float, float]]
    if kind == "slalom":
        faces = [
            (8.0 + 5.0 * k, 9.0 + 5.0 * k, *((-1.4, 0.6) if k % 2 else (-0.6, 1.4)))
            for k in range(8)
        ]
        length_m = 52.0
    elif kind == "slalom-tight":
        faces = [
            (8.0 + 3.5 * k, 8.6 + 3.5 * k, *((-2.5, 0.3) if k % 2 else (-0.3, 2.5)))
            for k in range(8)
        ]
        faces += [(6.0, 38.0, -3.0, -2.5), (6.0, 38.0, 2.5, 3.0)]
        length_m = 45.0
    elif kind == "s":
        gap_m = float(size)
        faces = [(12.0, 14.0, -9.0, 1.5), (14.0 + gap_m, 16.0 + gap_m, -1.5, 9.0)]
        length_m = 32.0
    elif kind == "door":
        half_m = float(size) / 2.0
        faces = [(14.0, 15.0, -9.0, 1.0 - half_m), (14.0, 15.0, 1.0 + half_m, 9.0)]
        length_m = 28.0
    elif kind == "trap":
        faces = [(16.0, 16.5, -4.0, 4.0), (9.0, 16.5, -4.5, -4.0), (9.0, 16.5, 4.0, 4.5)]
        length_m = 30.0
    else:
        raise ValueError(f"unknown scene {name!r}; expected a file, a density or a drawn scene")
    return Scene(name, Obstacles.boxes(np.array(faces)), length_m, 10.0)


def _file_scenes(path: Path, legs: int, seed: int) -> Iterator[Scene]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    if "dbh_cm" in rows[0]:
        stems = Obstacles.stems(
            _columns(rows, "x_m", "y_m"), _columns(rows, "dbh_cm")[:, 0] / 200.0
        )
        yield from _forest_legs(stems, _LEG_M["forest"], legs, seed)
    elif "radius_m" in rows[0]:
        pillars = Obstacles.stems(_columns(rows, "x_m", "y_m"), _columns(rows, "radius_m")[:, 0])
        for _ in range(legs):  # of one leg; the faces' errors differ
            yield Scene(path.stem, pillars, 105.0, 18.0)
    else:
        yield from _two_box_legs(rows, path.with_name("missions.json"), legs)


def _columns(rows: list[dict[str, str]], *names: str) -> Floats:
    return np.array([[float(row[name]) for name in names] for row in rows])


def _forest_legs(forest: Obstacles, length_m: float, legs: int, seed: int) -> Iterator[Scene]:
    """Yield legs in random directions whose ends are clear and whose corridor is in the field."""
    rng = np.random.default_rng(seed)
    low = forest.centre_m.min(axis=0) + 6.0
    high = forest.centre_m.max(axis=0) - 6.0
    index = 0
    while index < legs:
        start = rng.uniform(low - 6.0, high + 6.0)
        heading_rad = rng.uniform(0.0, 2.0 * math.pi)
        end = start + length_m * np.array((math.cos(heading_rad), math.sin(heading_rad)))
        ends = np.stack((start, end))
        if (ends < low).any() or (ends > high).any():
            continue
        clear = forest.distance_m(ends)
        if clear[0] < _CLEAR_START_M or clear[1] < _CLEAR_GOAL_M:
            continue
        near = _near(forest.along_leg(start, heading_rad), length_m)
        yield Scene(f"leg {index}", near, length_m, FOREST_HALF_WIDTH_M)
        index += 1


def _near(obstacles: Obstacles, length_m: float) -> Obstacles:
    x, y = obstacles.centre_m.T
    return obstacles.chosen((x > -8.0) & (x < length_m + 8.0) & (np.abs(y) < _AROUND_M))


def _two_box_legs(rows: list[dict[str, str]], missions: Path, legs: int) -> Iterator[Scene]:
    """Yield every leg of a mission that a scene of two boxes blocks."""
    document = json.loads(missions.read_text(encoding="utf-8"))
    ways = {
        tuple((float(p[1]), float(p[2])) for p in pair)
        for mission in document["missions"].values()
        for pair in pairwise(mission)
    }
    count = 0
    for number, row in enumerate(rows):
        one = {key: float(value) for key, value in row.items() if key != "run"}
        boxes = Obstacles(
            np.array([(one[f"north{k}_m"], one[f"east{k}_m"]) for k in (1, 2)]),
            np.array([(one[f"l{k}_north_m"], one[f"w{k}_east_m"]) for k in (1, 2)]) / 2.0,
            np.radians([one["r1_deg"], one["r2_deg"]]),
            np.zeros(2),
        )
        for start, end in sorted(ways):
            dn, de = end[0] - start[0], end[1] - start[1]
            length_m = math.hypot(dn, de)
            here = boxes.along_leg(np.array(start), math.atan2(de, dn))
            line = np.outer(np.arange(0.0, length_m, 0.1), (1.0, 0.0))
            clear = here.distance_m(line)
            if clear.min() > 0.0 or clear[0] < 3.0 or clear[-1] < 3.0:
                continue
            if count >= legs:
                return
            yield Scene(f"scene {number}", here, length_m, 40.0)
            count += 1
