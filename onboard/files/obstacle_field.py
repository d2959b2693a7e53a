"""Obstacle field: a YAML list of boxes, or a CSV of tree stems, read into immutable arrays.

An obstacle is upright, and its plan view a rectangle in local NED.  It reaches to any height unless
its top and bottom are stated.  A stem becomes the square box that encloses its trunk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, RootModel, model_validator

from onboard.files.stem_map import DISTANCE_MAX_M, Stem, read_stems
from onboard.files.yaml_file import FileModel, read_document, validate

FloatArray = NDArray[np.float64]

# Flights stay within this distance of the origin: larger numbers are map coordinates.
Coordinate = Annotated[float, Field(ge=-DISTANCE_MAX_M, le=DISTANCE_MAX_M)]
PositiveLength = Annotated[float, Field(gt=0.0, le=DISTANCE_MAX_M)]


class Obstacle(FileModel):
    """One box.

    Attributes:
        id: unique name.
        center_ned_m: centre (north, east).
        size_m: full extents (along, across) before rotation, towards north and east.
        yaw_deg: rotation from north towards east.
        down_m: top and bottom in local NED, positive down; null for one that is unbounded.
    """

    id: Annotated[str, Field(min_length=1)]
    center_ned_m: Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]
    size_m: Annotated[tuple[PositiveLength, PositiveLength], Field(strict=False)]
    yaw_deg: float = 0.0
    down_m: Annotated[tuple[Coordinate | None, Coordinate | None], Field(strict=False)] | None = (
        None
    )

    @model_validator(mode="after")
    def _top_is_above(self) -> Self:
        top_m, bottom_m = self.heights_m
        if top_m >= bottom_m:
            raise ValueError(
                f"down_m = [{top_m:g}, {bottom_m:g}] m: the top is not above the bottom "
                "(expected [top, bottom], positive down)"
            )
        return self

    @property
    def heights_m(self) -> tuple[float, float]:
        """Top and bottom in local NED; infinite where unbounded."""
        top_m, bottom_m = self.down_m or (None, None)
        return -math.inf if top_m is None else top_m, math.inf if bottom_m is None else bottom_m

    @model_validator(mode="before")
    @classmethod
    def _accept_numbers_as_ids(cls, data: Any) -> Any:
        if isinstance(data, dict) and type(data.get("id")) is int:
            return {**data, "id": str(data["id"])}
        return data


class ObstacleList(RootModel[list[Obstacle]]):
    """The YAML form of a field; ``ObstacleList.model_json_schema()`` describes it to editors."""

    @model_validator(mode="after")
    def _require_unique_ids(self) -> ObstacleList:
        if not self.root:
            raise ValueError("a field needs at least one obstacle")
        seen: set[str] = set()
        for obstacle in self.root:
            if obstacle.id in seen:
                raise ValueError(f"two obstacles have the id {obstacle.id!r}")
            seen.add(obstacle.id)
        return self


@dataclass(frozen=True, eq=False)
class ObstacleField:
    """N boxes as arrays, so that a hundred thousand of them can be searched at once.

    Attributes:
        ids: N names.
        center_ned_m: (N, 2), north and east.
        half_size_m: (N, 2), half extents along the box's own axes.
        yaw_rad: (N,), from north towards east.
        down_m: (N, 2), top and bottom in local NED, infinite where unbounded; None for pillars.
    """

    ids: tuple[str, ...]
    center_ned_m: FloatArray
    half_size_m: FloatArray
    yaw_rad: FloatArray
    down_m: FloatArray | None = None

    @classmethod
    def of(cls, obstacles: Sequence[Obstacle]) -> ObstacleField:
        """Return the field of these obstacles; none is allowed (open space)."""
        return cls(
            ids=tuple(obstacle.id for obstacle in obstacles),
            center_ned_m=np.array([o.center_ned_m for o in obstacles]).reshape(-1, 2),
            half_size_m=np.array([o.size_m for o in obstacles]).reshape(-1, 2) / 2.0,
            yaw_rad=np.radians([o.yaw_deg for o in obstacles]),
            down_m=(
                np.array([o.heights_m for o in obstacles])
                if any(o.down_m is not None for o in obstacles)
                else None
            ),
        )

    def reaching_into(self, top_m: float, bottom_m: float) -> ObstacleField:
        """Return the obstacles that reach into some heights, local NED; to touch them is enough."""
        if self.down_m is None:
            return self
        kept = np.flatnonzero((self.down_m[:, 0] <= bottom_m) & (self.down_m[:, 1] >= top_m))
        return ObstacleField(
            tuple(self.ids[index] for index in kept.tolist()),
            self.center_ned_m[kept],
            self.half_size_m[kept],
            self.yaw_rad[kept],
            self.down_m[kept],
        )

    def __len__(self) -> int:
        return len(self.ids)


def load_field(path: Path) -> ObstacleField:
    """Read a field: CSV of stems if the name ends in ``.csv``, else YAML.

    Raises:
        FileError: names the file, the row or key, the value and its unit.
    """
    if path.suffix.lower() == ".csv":
        return ObstacleField.of([_tree(stem) for stem in read_stems(path)])
    return ObstacleField.of(validate(read_document(path), ObstacleList, source=str(path)).root)


def _tree(stem: Stem) -> Obstacle:
    """Return the square box around a stem."""
    center_ned_m, size_m = (stem.north_m, stem.east_m), (stem.diameter_m, stem.diameter_m)
    return Obstacle(id=stem.name, center_ned_m=center_ned_m, size_m=size_m)
