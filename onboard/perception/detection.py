"""Detections: what a sensor saw at one instant, and where its boxes are in local NED.

Every `onboard.perception.sources` implementation produces these models, whatever it reads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from onboard.geometry.frames import LegFrame
from onboard.vehicle_state import Pose

# Bounds of what a frame may claim: beyond them a frame is garbage, not an observation.
MAX_OBSTACLES_PER_FRAME: Final = 10_000
MAX_BEARING_BINS: Final = 3600
# At 20 Hz a tick sees one frame; a burst beyond this is a fault: the oldest are dropped.
MAX_PENDING_FRAMES: Final = 32
MAX_COORDINATE_M: Final = 1e6

Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Extent = Annotated[float, Field(ge=0.0, le=1e4)]

# North and east of each [m].
Corners = Sequence[tuple[float, float]]
# Top and bottom of a box [m], positive down: top <= bottom.
DownRange = tuple[float, float]
# What is not known to end anywhere: a pillar.
ANY_HEIGHT: Final[DownRange] = (-math.inf, math.inf)
# The same as a sensor states it; None for a face that it does not know.
StatedDown = tuple[float | None, float | None]


def _top_first(down_m: StatedDown) -> StatedDown:
    top_m, bottom_m = down_m
    if top_m is not None and bottom_m is not None and top_m > bottom_m:
        raise ValueError(f"top {top_m:g} m is below bottom {bottom_m:g} m; down is positive")
    return down_m


_Down = Annotated[float, Field(strict=True, ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
_Half = Annotated[float, Field(strict=True, ge=0.0, lt=90.0)]
_Range = Annotated[float, Field(strict=True, ge=0.0, le=MAX_COORDINATE_M)]


class _Message(BaseModel):
    # A newer sensor may send more fields: unknown ones are ignored.
    model_config = ConfigDict(frozen=True, allow_inf_nan=False, extra="ignore")


class Detection(_Message):
    """One obstacle of a frame: a box, its extents along its own axes, its yaw in the frame.

    Attributes:
        id: the track, unique within the source.
        center_m, size_m, yaw_deg: the box, horizontally.
        uncertainty_m: how far each face may be off.
        down_m: top and bottom, positive down: in local NED, or relative to the levelled body for
            a frame in FRD; None if unknown, which is an obstacle of any height, and None for a face
            that is at the edge of the view or hidden.
        down_uncertainty_m: how far top and bottom may be off, levelling included; None where that
            is no more than the contract's.
        partial: whether the sensor saw a part of the obstacle only, so that it may reach farther.
    """

    id: Annotated[str, Field(min_length=1, max_length=64)]
    center_m: tuple[Coordinate, Coordinate]
    size_m: tuple[Extent, Extent]
    yaw_deg: float
    uncertainty_m: Annotated[float, Field(ge=0.0, le=100.0)]
    down_m: Annotated[tuple[_Down | None, _Down | None], AfterValidator(_top_first)] | None = None
    down_uncertainty_m: Annotated[float, Field(strict=True, ge=0.0, le=100.0)] | None = None
    partial: Annotated[bool, Field(strict=True)] = False


class DetectionFrame(_Message):
    """What a sensor saw at one instant; an empty list of obstacles means "looked, nothing there".

    Attributes:
        version: of the message.
        source: name of the sensor.
        sequence: number of the frame, ascending.
        stamp_unix_s: when the sensor saw it.
        frame: coordinates of the boxes: local NED, or forward, right, down from the body.
        range_m, field_of_view_deg: how far and how wide the sensor sees.
        obstacles: its boxes.
        free_range_m: how far it saw free space, for equal bins of bearing across the field of
            view, from left to right, before position error is taken off; 0 where unknown, None
            where nothing returned, and None as a whole if it does not say. What is unseen is not
            free, and neither is what returned nothing, unless the contract says so.
    """

    version: Literal[1]
    source: Annotated[str, Field(min_length=1, max_length=64)]
    sequence: Annotated[int, Field(ge=0)]
    stamp_unix_s: float
    frame: Literal["local_ned", "body_frd"]
    range_m: Annotated[float, Field(gt=0.0)]
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)]
    obstacles: Annotated[tuple[Detection, ...], Field(max_length=MAX_OBSTACLES_PER_FRAME)]
    free_range_m: (
        Annotated[tuple[_Range | None, ...], Field(min_length=1, max_length=MAX_BEARING_BINS)]
        | None
    ) = None
    vertical_field_of_view_deg: tuple[_Half, _Half] | None = None
    reported_height_m: tuple[_Range, _Range] | None = None

    @property
    def bin_rad(self) -> float:
        """Width of one bin of `free_range_m`; of the whole view if there is none."""
        return math.radians(self.field_of_view_deg) / len(self.free_range_m or (0.0,))

    def track_id(self, detection: Detection) -> str:
        """Return the name of one of its obstacles, unique among sources."""
        return f"{self.source}/{detection.id}"


def corners_ned(detection: Detection, pose: Pose | None) -> Corners:
    """Return the corners of a detected box, in turn.

    Args:
        detection: the box.
        pose: where the body was, for a box in FRD; None for one in local NED.  A sensor levels
            what it reports (pillars do not tilt), so that only the heading turns it.
    """
    (north_m, east_m), yaw_rad = detection.center_m, math.radians(detection.yaw_deg)
    if pose is not None:
        frame = LegFrame(pose.position_ned_m, pose.yaw_rad)
        north_m, east_m, _ = frame.position_ned((north_m, east_m, 0.0))
        yaw_rad += pose.yaw_rad
    length_m, width_m = detection.size_m
    x_m, y_m = length_m / 2.0, width_m / 2.0
    # Turned once, not corner by corner: all boxes of all frames pass here.
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    along_n_m, along_e_m, across_n_m, across_e_m = (
        cosine * x_m,
        sine * x_m,
        sine * y_m,
        cosine * y_m,
    )
    return [
        (-along_n_m + across_n_m + north_m, -along_e_m - across_e_m + east_m),
        (along_n_m + across_n_m + north_m, along_e_m - across_e_m + east_m),
        (along_n_m - across_n_m + north_m, along_e_m + across_e_m + east_m),
        (-along_n_m - across_n_m + north_m, -along_e_m + across_e_m + east_m),
    ]


def down_range_ned(detection: Detection, pose: Pose | None) -> DownRange | None:
    """Return top and bottom of a detected box in local NED; None if they are unknown.

    A part of an obstacle says nothing about where the whole one ends.

    Args:
        detection: the box.
        pose: where the body was, for a box in FRD; None for one in local NED.
    """
    if detection.down_m is None or detection.partial:
        return None
    body_m = 0.0 if pose is None else pose.position_ned_m[2]
    top_m, bottom_m = detection.down_m
    if top_m is None or bottom_m is None:
        return None
    return body_m + top_m, body_m + bottom_m


def shifted_corners(corners_ned_m: Corners, shift_ned_m: tuple[float, float]) -> Corners:
    """Return corners moved north and east."""
    return [(north + shift_ned_m[0], east + shift_ned_m[1]) for north, east in corners_ned_m]
