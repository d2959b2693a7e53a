"""Legs to fly: through a forest, between the boxes of a scene, or walls that are drawn here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gcs_tools.benchmark.formats import BoxScene, Way
from gcs_tools.benchmark.obstacles import Floats, Obstacles
from gcs_tools.console.errors import CommandError
from sitl.environment.movers.config import MoverConfig

# Corridors: as wide as a row of trees, as SANDO's forest, and as the competition's area.
FOREST_HALF_WIDTH_M: Final = 9.0
PILLARS_HALF_WIDTH_M: Final = 18.0
BOXES_HALF_WIDTH_M: Final = 40.0
# A forest of random stems: a square of this side, and the radii of its stems.
_SIDE_M, _RADIUS_M = 120.0, (0.05, 0.20)
# Around both ends of a leg, so that the vehicle can hover there.
_CLEAR_START_M, _CLEAR_GOAL_M = 2.1, 1.6
_CLEAR_OF_BOXES_M: Final = 3.0
_AROUND_M: Final = 18.0
_RASTER_M: Final = 0.1
_DRAWS_MAX: Final = 20_000
WALLS: Final = "slalom, slalom-tight, s:GAP, door:WIDTH, trap"


class Moving(NamedTuple):
    """What moves in a scene.

    Attributes:
        movers: where each goes, in the frame of the leg.
        speed_max_mps, size_max_m: that the contract declares of them.
    """

    movers: tuple[MoverConfig, ...]
    speed_max_mps: float
    size_max_m: float


class Aloft(NamedTuple):
    """Heights, where obstacles are no pillars.

    Attributes:
        down_m: (n, 2), top and bottom of each obstacle, local NED.
        altitude_m: at which the leg is flown.
        start_clear_m: so far around its start nothing is, as an operator sees who takes off there.
    """

    down_m: Floats
    altitude_m: float
    start_clear_m: float

    def reaches(self, reach_m: float) -> NDArray[np.bool_]:
        """Tell of each obstacle whether it is within a distance above or below the flight."""
        top_m, bottom_m = self.down_m.T
        flown_m = -self.altitude_m
        met: NDArray[np.bool_] = (top_m <= flown_m + reach_m) & (bottom_m >= flown_m - reach_m)
        return met


@dataclass(frozen=True, eq=False)
class Scene:
    """One leg through a field.

    Attributes:
        field: of which it is a leg: file, density or drawn walls.
        name: of the leg.
        obstacles: in the frame of the leg, which begins at its origin.
        length_m: of the leg; the goal is (length, 0).
        half_width_m: of the corridor that the vehicle must not leave.
        peer_distance_m: the least distance that a peer kept there; None where it is unknown.
        moving: what moves; only the whole service flies such scenes.
        aloft: the heights of flight and obstacles; None where these are pillars.
    """

    field: str
    name: str
    obstacles: Obstacles
    length_m: float
    half_width_m: float
    peer_distance_m: float | None = None
    moving: Moving | None = None
    aloft: Aloft | None = None

    def passable(self, margin_m: float, reach_m: float = math.inf) -> bool:
        """Tell whether a way leads to the goal on the map with the boxes grown by a margin.

        A* would find one: the goal lies in the connected part of the raster that the start is in.

        Args:
            margin_m: from a face.
            reach_m: how far above and below the flight obstacles are in its way.
        """
        in_way = self.obstacles
        if self.aloft is not None:
            in_way = in_way.chosen(self.aloft.reaches(reach_m))
        xs = np.arange(-8.0, self.length_m + 8.0, _RASTER_M)
        half_m = min(self.half_width_m, 60.0) - margin_m
        ys = np.arange(-half_m, half_m, _RASTER_M)
        open_cells = np.ones((len(xs), len(ys)), bool)
        for box in in_way.reports(np.random.default_rng(0), 0.0):
            i0, i1 = np.searchsorted(xs, (box.x_min_m - margin_m, box.x_max_m + margin_m))
            j0, j1 = np.searchsorted(ys, (box.y_min_m - margin_m, box.y_max_m + margin_m))
            open_cells[i0:i1, j0:j1] = False
        parts, _ = ndimage.label(open_cells, np.ones((3, 3), int))
        middle = int(np.abs(ys).argmin())
        start = parts[int(np.abs(xs).argmin()), middle]
        goal = parts[int(np.abs(xs - self.length_m).argmin()), middle]
        return bool(start > 0 and start == goal)


def random_forest(stems_per_ha: float, seed: int) -> Obstacles:
    """Return stems placed uniformly in a square."""
    rng = np.random.default_rng((seed, 5))
    count = rng.poisson(stems_per_ha * _SIDE_M**2 / 1e4)
    return Obstacles.stems(rng.uniform(0.0, _SIDE_M, (count, 2)), rng.uniform(*_RADIUS_M, count))


def forest_legs(
    field: str, forest: Obstacles, length_m: float, legs: int, seed: int
) -> Iterator[Scene]:
    """Yield legs in random directions whose ends are clear and whose corridor is in the field.

    Raises:
        CommandError: the forest has no room for such a leg.
    """
    rng = np.random.default_rng(seed)
    low = forest.centre_m.min(axis=0, initial=math.inf) + 6.0
    high = forest.centre_m.max(axis=0, initial=-math.inf) - 6.0
    has_room = (high > low).all() and math.hypot(*(high - low)) >= length_m
    index = 0
    for _ in range(_DRAWS_MAX * legs if has_room else 0):
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
        yield Scene(field, f"leg {index}", near, length_m, FOREST_HALF_WIDTH_M)
        index += 1
        if index == legs:
            return
    raise CommandError(
        f"{field}: has room for {index} of {legs} legs of {length_m:g} m with {_CLEAR_START_M:g} m "
        f"free around the start and {_CLEAR_GOAL_M:g} m around the end"
    )


def pillar_legs(
    field: str, pillars: Obstacles, length_m: float, legs: int, half_width_m: float
) -> Iterator[Scene]:
    """Yield one leg due north from the origin several times: the errors of the faces differ.

    Raises:
        CommandError: an end of the leg is not clear.
    """
    for place_m, what in ((0.0, "start"), (length_m, "end")):
        clear_m = float(pillars.distance_m(np.array(((place_m, 0.0),)))[0])
        if clear_m < _CLEAR_GOAL_M:
            raise CommandError(
                f"{field}: the leg's {what} at {place_m:g}, 0 m is {clear_m:.2f} m from the "
                f"nearest obstacle; expected {_CLEAR_GOAL_M:g} m or more"
            )
    for index in range(legs):
        yield Scene(field, f"flight {index}", pillars, length_m, half_width_m)


def blocked_legs(
    field: str, scenes: Iterable[BoxScene], ways: list[Way], legs: int
) -> Iterator[Scene]:
    """Yield every leg of a mission that a scene's boxes block and whose ends are clear of them."""
    count = 0
    for scene in scenes:
        for number, (start, end) in enumerate(ways):
            dn, de = end[0] - start[0], end[1] - start[1]
            length_m = math.hypot(dn, de)
            here = scene.boxes.along_leg(np.array(start), math.atan2(de, dn))
            line = np.outer(np.arange(0.0, length_m, 0.1), (1.0, 0.0))
            clear = here.distance_m(line)
            if clear.min() > 0.0 or min(clear[0], clear[-1]) < _CLEAR_OF_BOXES_M:
                continue
            if count >= legs:
                return
            name = f"scene {scene.number} way {number}"
            half_m, peer_m = BOXES_HALF_WIDTH_M, scene.peer_distance_m
            yield Scene(field, name, here, length_m, half_m, peer_m)
            count += 1


def drawn_walls(name: str) -> Scene:
    """Return a scene by its name.

    Raises:
        CommandError: it is none of `WALLS`.
    """
    kind, _, size = name.partition(":")
    faces: list[tuple[float, float, float, float]]
    if kind == "slalom" and not size:
        faces = [
            (8.0 + 5.0 * k, 9.0 + 5.0 * k, *((-1.4, 0.6) if k % 2 else (-0.6, 1.4)))
            for k in range(8)
        ]
        length_m = 52.0
    elif kind == "slalom-tight" and not size:
        faces = [
            (8.0 + 3.5 * k, 8.6 + 3.5 * k, *((-2.5, 0.3) if k % 2 else (-0.3, 2.5)))
            for k in range(8)
        ]
        faces += [(6.0, 38.0, -3.0, -2.5), (6.0, 38.0, 2.5, 3.0)]
        length_m = 45.0
    elif kind == "s":
        gap_m = _size_m(name, size)
        faces = [(12.0, 14.0, -9.0, 1.5), (14.0 + gap_m, 16.0 + gap_m, -1.5, 9.0)]
        length_m = 32.0
    elif kind == "door":
        half_m = _size_m(name, size) / 2.0
        faces = [(14.0, 15.0, -9.0, 1.0 - half_m), (14.0, 15.0, 1.0 + half_m, 9.0)]
        length_m = 28.0
    elif kind == "trap" and not size:
        faces = [(16.0, 16.5, -4.0, 4.0), (9.0, 16.5, -4.5, -4.0), (9.0, 16.5, 4.0, 4.5)]
        length_m = 30.0
    else:
        raise CommandError(f"walls: unknown scene {name!r}; expected {WALLS}")
    return Scene(name, name, Obstacles.boxes(np.array(faces)), length_m, 10.0)


def _size_m(name: str, text: str) -> float:
    try:
        size_m = float(text)
    except ValueError:
        size_m = math.nan
    if not 0.5 <= size_m <= 8.0:
        raise CommandError(f"walls: {name!r}: expected a width from 0.5 to 8 m after the colon")
    return size_m


def _near(obstacles: Obstacles, length_m: float) -> Obstacles:
    x, y = obstacles.centre_m.T
    return obstacles.chosen((x > -8.0) & (x < length_m + 8.0) & (np.abs(y) < _AROUND_M))


# ------------------------------------------------------------------ which of them


class Selection(NamedTuple):
    """What to fly of a benchmark.

    Attributes:
        scenes: names of scenes; none means all that there are.
        data: file or folder; None of benchmarks that need none.
        legs: how many of each scene at most.
        seed: of what is drawn.
    """

    scenes: tuple[str, ...]
    data: Path | None
    legs: int
    seed: int


def data_of(selection: Selection, name: str) -> Path:
    """Return where a benchmark's scenes are.

    Raises:
        CommandError: the command does not say.
    """
    if selection.data is None:
        raise CommandError(f"{name} needs --data PATH: its scenes are not part of Clearway")
    return selection.data


def expect_no_data(name: str, selection: Selection) -> None:
    """Refuse data of a benchmark that draws its scenes.

    Raises:
        CommandError: there are some.
    """
    if selection.data is not None:
        raise CommandError(f"--data {selection.data}: {name} has no data files")


def expect_no_scenes(name: str, selection: Selection) -> None:
    """Refuse names of scenes of a benchmark that has none.

    Raises:
        CommandError: there are some.
    """
    if selection.scenes:
        raise CommandError(f"{name}: has no scenes to name, got {selection.scenes[0]!r}")


def file_of(data: Path, name: str, folder: str) -> Path:
    """Return the file itself, or the one of that name in a folder.

    Raises:
        CommandError: the folder has none.
    """
    if not data.is_dir():
        return data
    found = found_in(data, name, folder)
    if found is None:
        raise CommandError(f"{data}: has no {name}, nor {folder}/{name}")
    return found


def found_in(data: Path, name: str, folder: str) -> Path | None:
    """Return the file of that name in a folder of data; None if it has none."""
    places: Sequence[Path] = (data, data / folder, data / "benchmarks" / folder)
    return next((place / name for place in places if (place / name).is_file()), None)
