"""Detection frames -> remembered obstacles -> Regions of Influence -> the obstacle of interest.

Obstacles are static, so what has been seen is remembered: a frame that no longer mentions an
obstacle does not remove it.  A box only ever grows, to enclose every measurement of its obstacle.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from onboard.frames import FloatArray, LegFrame, rotation_about_down
from onboard.mavlink import Pose
from onboard.region import Box, RegionOfInfluence

# Bounds of what a frame may claim: beyond them a frame is garbage, not an observation.
MAX_OBSTACLES_PER_FRAME: Final = 10_000
MAX_TRACKS: Final = 100_000
MAX_COORDINATE_M: Final = 1e6

Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Extent = Annotated[float, Field(ge=0.0, le=1e4)]


class _Message(BaseModel):
    # Other fields than ours are tolerated on the wire: a newer sensor may say more.
    model_config = ConfigDict(frozen=True, allow_inf_nan=False, extra="ignore")


class Detection(_Message):
    """One obstacle of a frame: a box, its extents along its own axes, its yaw in the frame."""

    id: Annotated[str, Field(min_length=1, max_length=64)]
    center_m: tuple[Coordinate, Coordinate]
    size_m: tuple[Extent, Extent]
    yaw_deg: float
    uncertainty_m: Annotated[float, Field(ge=0.0, le=100.0)]


class DetectionFrame(_Message):
    """What a sensor saw at one instant; no obstacles means "looked, nothing there"."""

    version: Literal[1]
    source: Annotated[str, Field(min_length=1, max_length=64)]
    sequence: Annotated[int, Field(ge=0)]
    stamp_unix_s: float
    frame: Literal["local_ned", "body_frd"]
    range_m: Annotated[float, Field(gt=0.0)]
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)]
    obstacles: Annotated[tuple[Detection, ...], Field(max_length=MAX_OBSTACLES_PER_FRAME)]


class MalformedFrameError(ValueError):
    """A payload that is not a detection frame."""


def parse_frame(payload: bytes) -> DetectionFrame:
    """Read one detection frame (design: Messages).

    Raises:
        MalformedFrameError: the payload is not one.
    """
    try:
        return DetectionFrame.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"])) or "payload"
        raise MalformedFrameError(f"{place}: {first['msg']}") from error


class PoseHistory:
    """The last second of poses, to place what was seen from the body."""

    def __init__(self, span_s: float = 2.0) -> None:
        self._span_s = span_s
        self._poses: deque[Pose] = deque(maxlen=500)

    def add(self, pose: Pose) -> None:
        """Remember a pose; poses come in the order of time."""
        self._poses.append(pose)
        while self._poses[0].time_s < pose.time_s - self._span_s:
            self._poses.popleft()

    def at(self, time_s: float, tolerance_s: float = 0.1) -> Pose | None:
        """Return the pose nearest to ``time_s``, moved on to that time; None if none is near."""
        nearest = min(self._poses, key=lambda pose: abs(pose.time_s - time_s), default=None)
        if nearest is None or abs(nearest.time_s - time_s) > tolerance_s:
            return None
        later_s = time_s - nearest.time_s
        (north_m, east_m, down_m), (vn, ve, vd) = nearest.position_ned_m, nearest.velocity_ned_mps
        moved_m = (north_m + vn * later_s, east_m + ve * later_s, down_m + vd * later_s)
        return replace(nearest, time_s=time_s, position_ned_m=moved_m)


def corners_ned(detection: Detection, pose: Pose | None) -> FloatArray:
    """Corners (4, 2) of a detected box, north and east in metres.

    Args:
        detection: the box.
        pose: where the body was, for a box in FRD; None for one in local NED.  A sensor levels
            what it reports (pillars have no tilt), so that only the heading turns it.
    """
    half_m = np.array(detection.size_m) / 2.0
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    turn = rotation_about_down(np.deg2rad(detection.yaw_deg))[:2, :2]
    corners = np.array(detection.center_m) + signs * half_m @ turn.T
    if pose is None:
        return corners
    heading = rotation_about_down(pose.yaw_rad)[:2, :2]
    placed: FloatArray = corners @ heading.T + np.array(pose.position_ned_m[:2])
    return placed


@dataclass(frozen=True)
class Obstacle:
    """A remembered obstacle in the current leg frame.

    Attributes:
        id: ``source/id`` of its detections.
        measured: the box that encloses every measurement.
        position_error_m: the largest uncertainty reported for a face.
        region: its Region of Influence.
    """

    id: str
    measured: Box
    position_error_m: float
    region: RegionOfInfluence


RegionFactory = Callable[[Box, float], RegionOfInfluence]


class ObstacleMap:
    """Obstacles seen so far, ordered along the current leg.

    Args:
        leg: the leg frame.
        region_around: measured box and position error -> Region of Influence.
    """

    def __init__(self, leg: LegFrame, region_around: RegionFactory) -> None:
        # Changes whenever anything known changes.
        self.revision = 0
        self._leg = leg
        self._region_around = region_around
        self._corners_ned_m: dict[str, FloatArray] = {}
        self._obstacles: dict[str, Obstacle] = {}
        # (front of the region, id), sorted; with the longest region it bounds every search.
        self._order: list[tuple[float, str]] = []
        self._longest_region_m = 0.0

    def __len__(self) -> int:
        return len(self._obstacles)

    def __iter__(self) -> Iterator[Obstacle]:
        return iter(self._obstacles.values())

    def get(self, obstacle_id: str) -> Obstacle | None:
        """Return the obstacle of that id, as it is known now."""
        return self._obstacles.get(obstacle_id)

    def start_leg(self, leg: LegFrame) -> None:
        """Re-express everything remembered in the frame of a new leg."""
        corners, errors = self._corners_ned_m, {o.id: o.position_error_m for o in self}
        self._leg, self._obstacles, self._order = leg, {}, []
        self._corners_ned_m, self._longest_region_m = {}, 0.0
        for obstacle_id, corners_ned_m in corners.items():
            self.add(obstacle_id, corners_ned_m, errors[obstacle_id])

    def add(self, obstacle_id: str, corners_ned_m: FloatArray, position_error_m: float) -> bool:
        """Remember a measurement; tell whether it changed what is known.

        Args:
            obstacle_id: which obstacle.
            corners_ned_m: corners (4, 2) of the measured box, NED.
            position_error_m: uncertainty of its faces.
        """
        known = self._obstacles.get(obstacle_id)
        measured = self._leg_box(corners_ned_m)
        if known is not None:
            measured = known.measured.enclosing(measured)
            position_error_m = max(known.position_error_m, position_error_m)
            if measured == known.measured and position_error_m == known.position_error_m:
                return False
            # Sound for any later leg: what encloses every measurement in this one encloses them.
            corners_ned_m = self._corners_of(measured)
            self._forget_order(known)
        elif len(self._obstacles) >= MAX_TRACKS:
            raise OverflowError(f"more than {MAX_TRACKS} obstacles remembered")
        self.revision += 1
        region = self._region_around(measured, position_error_m)
        self._obstacles[obstacle_id] = Obstacle(obstacle_id, measured, position_error_m, region)
        self._corners_ned_m[obstacle_id] = corners_ned_m
        bisect.insort(self._order, (region.extent.x_min_m, obstacle_id))
        length_m = region.extent.x_max_m - region.extent.x_min_m
        self._longest_region_m = max(self._longest_region_m, length_m)
        return True

    def between(self, x_min_m: float, x_max_m: float) -> Iterator[Obstacle]:
        """Obstacles whose regions reach into [x_min_m, x_max_m], in the order of their fronts."""
        start = bisect.bisect_left(self._order, (x_min_m - self._longest_region_m, ""))
        for index in range(start, len(self._order)):
            front_m, obstacle_id = self._order[index]
            if front_m > x_max_m:
                return
            obstacle = self._obstacles[obstacle_id]
            if obstacle.region.extent.x_max_m >= x_min_m:
                yield obstacle

    def obstacle_of_interest(self, x_m: float, y_m: float, *, horizon_m: float) -> Obstacle | None:
        """Return the first obstacle met when flying on along x whose region is within reach.

        Args:
            x_m: position along the leg.
            y_m: position across the leg.
            horizon_m: way made until the next decision; a region that begins within it counts.
        """
        ahead = (
            obstacle
            for obstacle in self.between(x_m, x_m + horizon_m)
            if obstacle.region.lies_ahead(x_m, y_m)
        )
        return min(ahead, key=lambda obstacle: obstacle.region.keep_out.x_min_m, default=None)

    def conflicts(self, obstacle: Obstacle) -> Iterator[Obstacle]:
        """Other obstacles whose Regions of Influence intersect this one's."""
        extent = obstacle.region.extent
        for other in self.between(extent.x_min_m, extent.x_max_m):
            if other.id != obstacle.id and other.region.extent.intersects(extent):
                yield other

    def _leg_box(self, corners_ned_m: FloatArray) -> Box:
        flat = np.column_stack((corners_ned_m, np.zeros(len(corners_ned_m))))
        x_m, y_m = self._leg.position_leg_from_ned(flat).T[:2]
        return Box(float(x_m.min()), float(x_m.max()), float(y_m.min()), float(y_m.max()))

    def _corners_of(self, box: Box) -> FloatArray:
        x_m = [box.x_min_m, box.x_max_m, box.x_max_m, box.x_min_m]
        y_m = [box.y_min_m, box.y_min_m, box.y_max_m, box.y_max_m]
        return self._leg.position_ned_from_leg(np.column_stack((x_m, y_m, np.zeros(4))))[:, :2]

    def _forget_order(self, obstacle: Obstacle) -> None:
        key = (obstacle.region.extent.x_min_m, obstacle.id)
        del self._order[bisect.bisect_left(self._order, key)]
