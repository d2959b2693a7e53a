"""A geofence in the local frame (geofence.yaml), beside a mission that has to stay in it."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from onboard.files.contract_file import Positive
from onboard.files.mission_file import Point
from onboard.files.yaml_file import FileModel

_CORNERS_MIN = 3


class FenceAreaFile(FileModel):
    """One polygon or circle of a geofence."""

    keep: Literal["inside", "outside"] = Field(description="where the vehicle has to stay")
    corners_ned_m: Annotated[tuple[Point, ...], Field(strict=False)] = Field(
        (), description="of a polygon: north and east of each corner"
    )
    center_ned_m: Point | None = Field(None, description="of a circle: north and east")
    radius_m: Positive | None = Field(None, description="of a circle")

    @model_validator(mode="after")
    def _is_polygon_or_circle(self) -> Self:
        circle = self.center_ned_m is not None and self.radius_m is not None
        if circle == bool(self.corners_ned_m) or (self.center_ned_m is None) != (
            self.radius_m is None
        ):
            raise ValueError("expected corners_ned_m, or center_ned_m and radius_m")
        if self.corners_ned_m and len(self.corners_ned_m) < _CORNERS_MIN:
            raise ValueError(f"a polygon has {len(self.corners_ned_m)} corners, expected 3 or more")
        return self


class Geofence(FileModel):
    """Areas that a mission has to stay in, and out of (geofence.yaml)."""

    areas: Annotated[tuple[FenceAreaFile, ...], Field(strict=False, min_length=1)]
