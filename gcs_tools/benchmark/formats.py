"""Readers of the public scenes' files, into obstacles and the ways that are to be flown.

- SANDO's static forests: upright cylinders, one a row of ``static_*.csv`` (``x_m,y_m,radius_m``),
  as they stand in the project's ``worlds/*.world``.
- UAV Testing Competition: scenes of upright boxes, one scene a row of ``two_box_scenes.csv``, and
  the missions of its case studies in ``missions.json``.

Obstacles are taken for pillars that reach past the flight height, which is harder than what is
written where they do not.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from gcs_tools.benchmark.obstacles import Obstacles
from onboard.files.stem_map import Row, read_columns, read_stems
from onboard.files.yaml_file import FileError, ModelT, read_text, validate

# Larger numbers are in another unit, or in a map's coordinates.
_FROM_ORIGIN_MAX_M: Final = 10_000.0
_SIZE_MAX_M: Final = 200.0
_PILLAR: Final = {"x_m": "metres north", "y_m": "metres east", "radius_m": "metres"}
_BOX: Final = ("north{}_m", "east{}_m", "l{}_north_m", "w{}_east_m", "r{}_deg")
_BOXES_MAX: Final = 9
_PEER: Final = "px4_avoidance_min_distance_m"

Point = tuple[float, float]
_Coordinate = Annotated[float, Field(ge=-_FROM_ORIGIN_MAX_M, le=_FROM_ORIGIN_MAX_M)]


@dataclass(frozen=True, eq=False)
class BoxScene:
    """One scene of the competition.

    Attributes:
        number: of its row, from 0.
        boxes: in local NED.
        peer_distance_m: the least distance that PX4-Avoidance kept; None where it is not stated.
    """

    number: int
    boxes: Obstacles
    peer_distance_m: float | None


class Way(NamedTuple):
    """One leg of one or several missions, from place to place in local NED [m]."""

    start_ne_m: Point
    end_ne_m: Point


class _Missions(BaseModel):
    """``missions.json``; it has notes beside the missions."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)

    missions: dict[
        str,
        Annotated[
            tuple[Annotated[tuple[str, _Coordinate, _Coordinate, float], Field(strict=False)], ...],
            Field(strict=False, min_length=2),
        ],
    ] = Field(min_length=1)


def read_forest(path: Path) -> Obstacles:
    """Read a stem map (`onboard.files.stem_map`).

    Raises:
        FileError: names the file, the row, the column and the value.
    """
    stems = read_stems(path)
    centres = np.array([(stem.north_m, stem.east_m) for stem in stems])
    return Obstacles.stems(centres, np.array([stem.diameter_m / 2.0 for stem in stems]))


def read_pillars(path: Path) -> Obstacles:
    """Read the cylinders of a static SANDO forest; columns beside the three are passed over.

    Raises:
        FileError: names the file, the row, the column and the value.
    """
    rows = read_columns(path, _PILLAR)
    for row in rows:
        _check(row, ("x_m", "y_m"), row.numbers[:2])
        _check_size(row, "radius_m", row.numbers[2])
    table = np.array([row.numbers for row in rows])
    return Obstacles.stems(table[:, :2], table[:, 2])


def read_box_scenes(path: Path) -> Iterator[BoxScene]:
    """Read the scenes of the competition, one a row, of as many boxes as the header numbers.

    Raises:
        FileError: names the file, the row, the column and the value.
    """
    header = [name.strip() for name in re.split("[,;\t]", read_text(path).partition("\n")[0])]
    names = [
        tuple(name.format(k) for name in _BOX)
        for k in range(1, _BOXES_MAX + 1)
        if k == 1 or _BOX[0].format(k) in header
    ]
    columns = {name: "one box's" for box in names for name in box}
    if _PEER in header:
        columns[_PEER] = "metres"
    for number, row in enumerate(read_columns(path, columns)):
        values = dict(zip(columns, row.numbers, strict=True))
        boxes = [_box(row, box, values) for box in names]
        table = np.array(boxes)
        yield BoxScene(
            number,
            Obstacles(
                table[:, :2], table[:, 2:4] / 2.0, np.radians(table[:, 4]), np.zeros(len(boxes))
            ),
            values.get(_PEER),
        )


def read_json(path: Path, model: type[ModelT]) -> ModelT:
    """Read a JSON file of scenes.

    Raises:
        FileError: names the file, the key and the value.
    """
    try:
        document: Any = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise FileError(f"{path}: is not JSON: {error}") from error
    if not isinstance(document, dict):
        keys = ", ".join(name for name, each in model.model_fields.items() if each.is_required())
        raise FileError(f"{path}: expected an object with {keys}")
    return validate(document, model, source=str(path))


def read_ways(path: Path) -> list[Way]:
    """Read the legs of the competition's missions, each once, sorted.

    Raises:
        FileError: names the file, the mission and the value.
    """
    missions = read_json(path, _Missions).missions
    ways = {
        Way((one[1], one[2]), (other[1], other[2]))
        for mission in missions.values()
        for one, other in pairwise(mission)
        if one[1:3] != other[1:3]
    }
    return sorted(ways)


def _box(row: Row, names: tuple[str, ...], values: Mapping[str, float]) -> list[float]:
    _check(row, names[:2], [values[name] for name in names[:2]])
    for name in names[2:4]:
        _check_size(row, name, values[name])
    return [values[name] for name in names]


def _check(row: Row, names: tuple[str, ...], values: list[float] | tuple[float, ...]) -> None:
    for name, value in zip(names, values, strict=True):
        if abs(value) > _FROM_ORIGIN_MAX_M:
            raise FileError(
                f"{row.source}: {name} [m] = {value:.10g} is more than {_FROM_ORIGIN_MAX_M:g} m "
                "from the origin"
            )


def _check_size(row: Row, name: str, value: float) -> None:
    if not 0.0 < value <= _SIZE_MAX_M:
        raise FileError(
            f"{row.source}: {name} [m] = {value:g} must be greater than 0 and at most "
            f"{_SIZE_MAX_M:g}"
        )
