"""Readers of public scenes in which something moves, or has a height of its own.

- SANDO's moving boxes: ``dynamic_*.json``, for each seed boxes that stand still or go along trefoil
  knots, as the project's ``scripts/run_sim.py`` draws them.  Beside movers at the height of
  the flight the contract takes every obstacle for a pillar, so that boxes are pillars over all
  heights here, and so are beams.
- DodgeDrone's spheres: ``easy_0.csv`` and such without a header, one sphere a row: name, x ahead, y
  to the left, z up, quaternion w x y z, scale along three axes, which is the diameter.  Where none
  is, all of x, y and z are 1000.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from gcs_tools.benchmark.formats import read_json
from gcs_tools.benchmark.obstacles import Floats, Obstacles
from gcs_tools.benchmark.scenes import PILLARS_HALF_WIDTH_M, Aloft, Moving, Scene
from gcs_tools.console.errors import CommandError
from onboard.files.yaml_file import FileError, read_text
from sitl.environment.movers.config import Knot, MoverConfig
from sitl.environment.movers.paths import knot_ned_m

KIND: Final = "box"
_FROM_ORIGIN_MAX_M, _SIZE_MAX_M = 10_000.0, 200.0
# Speeds are declared in steps of this, which leaves more than sampling a curve misses.
_STEP_MPS: Final = 0.05
_SAMPLES: Final = 2000
_SPARE: Final = 1.002

# DodgeDrone: what a sphere is called and how many cells its row has, and where none stands.
_SPHERE, _CELLS, _NOWHERE_M = "rpg_box01", 11, 1000.0
_SPHERES_LEG_M: Final = 17.0
# The rule's 15 m beside the line, less what the vehicle may be off.
_SPHERES_HALF_WIDTH_M: Final = 14.0
# The middle of what the generator keeps clear of spheres at the start: from 0 to 5 m.
_SPHERES_ALTITUDE_M: Final = 2.5
_SPHERES_START_CLEAR_M: Final = 1.5
# What is farther above or below is in the way of none of the vehicles here.
_SPHERES_REACH_M: Final = 1.8

_Coordinate = Annotated[float, Field(ge=-_FROM_ORIGIN_MAX_M, le=_FROM_ORIGIN_MAX_M)]
_Place = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], Field(strict=False)]
_Scale = Annotated[float, Field(ge=0.0, le=_SIZE_MAX_M)]
_Size = Annotated[float, Field(gt=0.0, le=_SIZE_MAX_M)]


class _Box(BaseModel):
    """One box: where its knot is, how large both are, and how slowly it goes."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)

    name: str
    x0: _Coordinate
    y0: _Coordinate
    scale_x: _Scale
    scale_y: _Scale
    offset: float
    slower: Annotated[float, Field(ge=0.0)]
    size_x: _Size
    size_y: _Size

    @property
    def moves(self) -> bool:
        return self.scale_x > 0.0 or self.scale_y > 0.0


class _Scenes(BaseModel):
    """``dynamic_*.json``; it has notes beside the scenes."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)

    start: _Place
    goal: _Place
    seeds: dict[str, Annotated[tuple[_Box, ...], Field(strict=False, min_length=1)]] = Field(
        min_length=1
    )


def moving_legs(path: Path, legs: int) -> Iterator[Scene]:
    """Yield one leg for each seed of a file of moving boxes, in the order of the file.

    Raises:
        FileError: names the file, the key and the value.
    """
    scenes = read_json(path, _Scenes)
    length_m = math.dist(scenes.start[:2], scenes.goal[:2])
    if scenes.start[:2] != (0.0, 0.0) or scenes.goal[1] != 0.0 or not length_m > 0.0:
        raise FileError(
            f"{path}: start = {list(scenes.start)} and goal = {list(scenes.goal)} [m] must be the "
            "origin and a place ahead of it along x"
        )
    for seed, boxes in list(scenes.seeds.items())[:legs]:
        yield _scene(path, seed, boxes, length_m)


def _scene(path: Path, seed: str, boxes: tuple[_Box, ...], length_m: float) -> Scene:
    still = [box for box in boxes if not box.moves]
    moving = [box for box in boxes if box.moves]
    for box in moving:
        if box.size_x != box.size_y:
            raise FileError(
                f"{path}: seeds.{seed}: {box.name!r} is {box.size_x:g} m by {box.size_y:g} m; "
                "expected what moves to be square"
            )
        if box.slower == 0.0:
            raise FileError(
                f"{path}: seeds.{seed}: {box.name!r} moves with slower = 0 [s/rad]; expected more"
            )
    speed_mps = _STEP_MPS * math.ceil(
        _SPARE * max((greatest_speed_mps(_knot(box)) for box in moving), default=0.0) / _STEP_MPS
    )
    halves = [(box.size_x / 2.0, box.size_y / 2.0) for box in still]
    places = [(box.x0, box.y0) for box in still]
    count = len(still)
    return Scene(
        field=path.stem,
        name=f"seed {seed}",
        obstacles=Obstacles(
            np.array(places).reshape(count, 2),
            np.array(halves).reshape(count, 2),
            np.zeros(count),
            np.zeros(count),
        ),
        length_m=length_m,
        half_width_m=PILLARS_HALF_WIDTH_M,
        moving=Moving(
            tuple(
                MoverConfig(
                    id=box.name, kind=KIND, size_m=box.size_x, speed_mps=speed_mps, path=_knot(box)
                )
                for box in moving
            ),
            speed_mps,
            max((box.size_x for box in moving), default=0.0),
        ),
    )


def _knot(box: _Box) -> Knot:
    """Return where a box goes; x is taken for north and y for east."""
    return Knot(
        kind="knot",
        center_ned_m=(box.x0, box.y0),
        scale_m=(box.scale_x, box.scale_y),
        period_s=2.0 * math.pi * box.slower,
        phase_deg=math.degrees(box.offset),
    )


def greatest_speed_mps(knot: Knot) -> float:
    """Return how fast something goes along a knot at most, horizontally; sampled."""
    angles_rad = np.linspace(0.0, 2.0 * math.pi, _SAMPLES + 1).tolist()
    points_m = np.array([knot_ned_m(knot.scale_m, angle_rad) for angle_rad in angles_rad])
    step_s = knot.period_s / _SAMPLES
    return float(np.hypot(*np.diff(points_m, axis=0).T).max() / step_s)


def sphere_legs(path: Path, legs: int) -> Iterator[Scene]:
    """Yield the leg of a file of spheres several times: the errors of the faces differ.

    Each sphere is taken for the box around it.

    Raises:
        FileError: names the file, the row, the column and the value.
        CommandError: a sphere is where the leg begins.
    """
    spheres = read_spheres(path)
    centre_m, radius_m = spheres[:, :3], spheres[:, 3]
    boxes = Obstacles(
        centre_m[:, :2],
        np.repeat(radius_m[:, None], 2, axis=1),
        np.zeros(len(spheres)),
        np.zeros(len(spheres)),
    )
    down_m = np.stack((centre_m[:, 2] - radius_m, centre_m[:, 2] + radius_m), axis=1)
    aloft = Aloft(down_m, _SPHERES_ALTITUDE_M, _SPHERES_START_CLEAR_M)
    at_height = boxes.chosen(aloft.reaches(_SPHERES_REACH_M))
    clear_m = float(at_height.distance_m(np.zeros((1, 2)))[0])
    if clear_m < aloft.start_clear_m:
        raise CommandError(
            f"{path}: the start at 0, 0 m is {clear_m:.2f} m from the nearest sphere of its "
            f"height; expected {aloft.start_clear_m:g} m or more"
        )
    for index in range(legs):
        yield Scene(
            field=path.stem.partition("_")[0],
            name=f"{path.stem} flight {index}",
            obstacles=boxes,
            length_m=_SPHERES_LEG_M,
            half_width_m=_SPHERES_HALF_WIDTH_M,
            aloft=aloft,
        )


def read_spheres(path: Path) -> Floats:
    """Return the spheres of a file, (n, 4): north, east, down, radius, in metres.

    Raises:
        FileError: names the file, the row, the column and the value.
    """
    rows = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        found = [
            _sphere(row, f"{path}: row {rows.line_num}")
            for row in rows
            if any(cell.strip() for cell in row)
        ]
    except csv.Error as error:
        raise FileError(f"{path}: row {rows.line_num}: is not CSV: {error}") from error
    spheres = np.array([sphere for sphere in found if sphere is not None]).reshape(-1, 4)
    if not len(spheres):
        raise FileError(f"{path}: has no sphere")
    return spheres


def _sphere(row: list[str], source: str) -> tuple[float, float, float, float] | None:
    """Return north, east, down and radius; None for a row that says that none is there."""
    name = row[0].strip()
    if len(row) != _CELLS or name != _SPHERE:
        raise FileError(
            f"{source}: is {name[:40]!r} with {len(row)} cells; expected {_SPHERE!r}, and x, y, z "
            f"[m], a quaternion and three scales: {_CELLS} cells"
        )
    try:
        numbers = [float(cell) for cell in row[1:]]
    except ValueError as error:
        raise FileError(f"{source}: {error}") from error
    (x_m, y_m, z_m), scales_m = numbers[:3], numbers[7:]
    for column, value in zip(("x", "y", "z"), (x_m, y_m, z_m), strict=True):
        if not abs(value) <= _FROM_ORIGIN_MAX_M:
            raise FileError(
                f"{source}: {column} [m] = {value:.10g} is more than {_FROM_ORIGIN_MAX_M:g} m from "
                "the origin"
            )
    if not all(0.0 < scale_m <= _SIZE_MAX_M for scale_m in scales_m):
        raise FileError(
            f"{source}: scale [m] = {', '.join(f'{each:g}' for each in scales_m)} must be greater "
            f"than 0 and at most {_SIZE_MAX_M:g}"
        )
    if x_m == y_m == z_m == _NOWHERE_M:
        return None
    return x_m, -y_m, -z_m, max(scales_m) / 2.0
