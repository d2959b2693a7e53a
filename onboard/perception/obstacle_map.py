"""Detection frames -> remembered obstacles -> Regions of Influence -> the obstacle of interest.

Obstacles are static, so what has been seen is remembered: a frame that no longer mentions an
obstacle does not remove it.  A box only ever grows, to enclose every measurement of its obstacle,
but for those from afar, which a wrong heading displaces by more than the contract allows for: one
in full view from nearer replaces them.  Measurements that contradict each other are kept apart.
"""

from __future__ import annotations

import bisect
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from onboard.contract.region import RegionOfInfluence
from onboard.files.json_payload import parse
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from onboard.vehicle_state import Pose

# Bounds of what a frame may claim: beyond them a frame is garbage, not an observation.
MAX_OBSTACLES_PER_FRAME: Final = 10_000
MAX_TRACKS: Final = 100_000
MAX_COORDINATE_M: Final = 1e6

Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Extent = Annotated[float, Field(ge=0.0, le=1e4)]

# North and east of each [m].
Corners = Sequence[tuple[float, float]]


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


def parse_frame(payload: bytes) -> DetectionFrame:
    """Read one detection frame (design: Messages).

    Raises:
        MalformedPayloadError: the payload is not one.
    """
    return parse(payload, DetectionFrame)


def corners_ned(detection: Detection, pose: Pose | None) -> Corners:
    """Corners of a detected box.

    Args:
        detection: the box.
        pose: where the body was, for a box in FRD; None for one in local NED.  A sensor levels
            what it reports (pillars have no tilt), so that only the heading turns it.
    """
    center_m, yaw_rad = (*detection.center_m, 0.0), math.radians(detection.yaw_deg)
    if pose is not None:
        center_m = LegFrame(pose.position_ned_m, pose.yaw_rad).position_ned(center_m)
        yaw_rad += pose.yaw_rad
    box, (x_m, y_m) = LegFrame(center_m, yaw_rad), (side_m / 2.0 for side_m in detection.size_m)
    corners = ((-x_m, -y_m, 0.0), (x_m, -y_m, 0.0), (x_m, y_m, 0.0), (-x_m, y_m, 0.0))
    return [box.position_ned(corner)[:2] for corner in corners]


def shifted_corners(corners_ned_m: Corners, shift_ned_m: tuple[float, float]) -> Corners:
    """Corners moved north and east."""
    return [(north + shift_ned_m[0], east + shift_ned_m[1]) for north, east in corners_ned_m]


@dataclass(frozen=True)
class Obstacle:
    """An obstacle to avoid as one, in the current leg frame.

    Attributes:
        id: ``source/id`` of its detections; those of a merged one are joined by ``+``.
        members: ids of the tracks in it, more than one if their regions intersect.
        measured: the box that encloses every measurement of every member.
        position_error_m: the largest uncertainty reported for a face.
        region: its Region of Influence.
    """

    id: str
    members: tuple[str, ...]
    measured: Box
    position_error_m: float
    region: RegionOfInfluence

    def shifted_by(self, x_m: float, y_m: float) -> Obstacle:
        """Return the same obstacle elsewhere in the leg frame."""
        return replace(
            self,
            measured=self.measured.shifted_by(x_m, y_m),
            region=self.region.shifted_by(x_m, y_m),
        )

    def confirms(self, earlier: Obstacle, position_error_m: float) -> bool:
        """Tell whether all that was measured since agrees with an earlier state of the obstacle.

        Every face lies within the error of every measurement of it, so that one which comes to lie
        farther out by no more than both errors does not say that the earlier bound was wrong.

        Args:
            earlier: the obstacle as it was known before.
            position_error_m: of a face, where a sensor reports less.
        """
        errors_m = [max(o.position_error_m, position_error_m) for o in (self, earlier)]
        bound = earlier.measured.inflated(sum(errors_m))
        return self.members == earlier.members and bound.enclosing(self.measured) == bound


@dataclass(frozen=True)
class _Track:
    """One detected obstacle: what encloses its measurements, in NED for other legs too.

    Tracks of one ``apart_from`` are places of an obstacle that contradict each other.
    """

    corners_ned_m: Corners
    measured: Box
    position_error_m: float
    apart_from: str | None = None

    def explains(self, measured: Box, position_error_m: float) -> bool:
        """Tell whether a worse measurement says nothing beyond the errors of both."""
        bound = self.measured.inflated(self.position_error_m + position_error_m)
        return position_error_m > self.position_error_m and bound.enclosing(measured) == bound


RegionFactory = Callable[[Box, float], RegionOfInfluence]


class ObstacleMap:
    """Obstacles seen so far, ordered along the current leg.

    Obstacles whose regions intersect are merged into one as long as it is no larger than a single
    obstacle may be, until no two regions intersect or nothing more fits; what then still conflicts
    is for the monitors.

    Args:
        leg: the leg frame.
        region_around: measured box and position error -> Region of Influence.
        merged_size_max_m: largest extent that merging may give; 0 keeps all apart.
    """

    def __init__(
        self, leg: LegFrame, region_around: RegionFactory, merged_size_max_m: float
    ) -> None:
        # Changes whenever anything known changes.
        self.revision = 0
        # By how much the estimator has moved everything since the first measurement, NED.
        self._shifted_ned_m = (0.0, 0.0)
        self._leg = leg
        self._region_around = region_around
        self._merged_size_max_m = merged_size_max_m
        self._tracks: dict[str, _Track] = {}
        self._obstacles: dict[str, Obstacle] = {}
        self._obstacle_of_track: dict[str, str] = {}
        # (front of the region, id), sorted; with the longest region it bounds every search.
        self._order: list[tuple[float, str]] = []
        self._longest_region_m = 0.0
        # The same for each strip of a metre across the leg: who stands in the way there.
        self._strips: defaultdict[int, list[tuple[float, str]]] = defaultdict(list)

    def __len__(self) -> int:
        return len(self._obstacles)

    def __iter__(self) -> Iterator[Obstacle]:
        return iter(self._obstacles.values())

    def of_track(self, track_id: str) -> Obstacle | None:
        """Return the obstacle that a detection belongs to, as it is known now."""
        obstacle_id = self._obstacle_of_track.get(track_id)
        return None if obstacle_id is None else self._obstacles[obstacle_id]

    def rebuild(
        self, leg: LegFrame, region_around: RegionFactory, merged_size_max_m: float
    ) -> None:
        """Express everything remembered anew: on another leg, or under other terms."""
        tracks = self._tracks
        self._leg, self._region_around = leg, region_around
        self._merged_size_max_m = merged_size_max_m
        self._tracks, self._obstacles, self._obstacle_of_track = {}, {}, {}
        self._order, self._longest_region_m = [], 0.0
        self._strips.clear()
        for track_id, track in tracks.items():
            self.add(
                track_id,
                track.corners_ned_m,
                track.position_error_m,
                apart_from=track.apart_from,
            )

    def shift(self, north_m: float, east_m: float) -> None:
        """State everything remembered in the local frame of now, which a reset has moved."""
        for track_id, track in self._tracks.items():
            corners_ned_m = shifted_corners(track.corners_ned_m, (north_m, east_m))
            self._tracks[track_id] = replace(track, corners_ned_m=corners_ned_m)
        self._shifted_ned_m = (self._shifted_ned_m[0] + north_m, self._shifted_ned_m[1] + east_m)
        self.rebuild(self._leg, self._region_around, self._merged_size_max_m)

    def unshifted(self, corners_ned_m: Corners) -> Corners:
        """Return where corners would be, had the estimator not moved since the first measurement.

        Measurements before and after a jump can be compared there.
        """
        north_m, east_m = self._shifted_ned_m
        if north_m == east_m == 0.0:
            return corners_ned_m
        return shifted_corners(corners_ned_m, (-north_m, -east_m))

    def rejoin(self) -> None:
        """Let places that contradict each other be one obstacle again: they may be merged."""
        if any(track.apart_from is not None for track in self._tracks.values()):
            self._tracks = {
                track_id: replace(track, apart_from=None)
                for track_id, track in self._tracks.items()
            }
            self.rebuild(self._leg, self._region_around, self._merged_size_max_m)

    def add(
        self,
        track_id: str,
        corners_ned_m: Corners,
        position_error_m: float,
        *,
        apart_from: str | None = None,
        error_max_m: float = math.inf,
        in_full: bool = False,
    ) -> bool:
        """Remember a measurement; tell whether it changed what is known.

        Args:
            track_id: which obstacle.
            corners_ned_m: corners of the measured box.
            position_error_m: uncertainty of its faces.
            apart_from: track that the measurement contradicts; the two are never merged, nor with
                other places that contradict the same one.
            error_max_m: of a face by the contract; worse counts until it is seen in full within.
            in_full: whether the whole obstacle was seen.

        Raises:
            OverflowError: more obstacles than any sensor could have seen.
        """
        known = self._tracks.get(track_id)
        measured = self._leg_box(corners_ned_m)
        if known is not None:
            if position_error_m > error_max_m and known.explains(measured, position_error_m):
                return False
            if not (in_full and position_error_m <= error_max_m < known.position_error_m):
                measured = known.measured.enclosing(measured)
                position_error_m = max(known.position_error_m, position_error_m)
            if measured == known.measured and position_error_m == known.position_error_m:
                return False
            # Sound for any later leg: what encloses every measurement in this one encloses them.
            corners_ned_m = self._corners_of(measured)
            apart_from = known.apart_from or apart_from
        elif len(self._tracks) >= MAX_TRACKS:
            raise OverflowError(f"more than {MAX_TRACKS} obstacles remembered")
        self._tracks[track_id] = _Track(corners_ned_m, measured, position_error_m, apart_from)
        self.revision += 1
        obstacle_id = self._obstacle_of_track.get(track_id)
        alone = (track_id,)
        members = alone if obstacle_id is None else self._forget(self._obstacles[obstacle_id])
        for member in members:
            self._place(self._obstacle((member,)))
        return True

    def between(self, x_min_m: float, x_max_m: float) -> Iterator[Obstacle]:
        """Obstacles whose regions reach into [x_min_m, x_max_m], in the order of their fronts."""
        return self._reaching(self._order, x_min_m, x_max_m)

    def _reaching(
        self, order: list[tuple[float, str]], x_min_m: float, x_max_m: float
    ) -> Iterator[Obstacle]:
        start = bisect.bisect_left(order, (x_min_m - self._longest_region_m, ""))
        for index in range(start, len(order)):
            front_m, obstacle_id = order[index]
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
        in_the_way = self._strips.get(math.floor(y_m), [])
        ahead = (
            obstacle
            for obstacle in self._reaching(in_the_way, x_m, x_m + horizon_m)
            if obstacle.region.on_collision_course(x_m, y_m)
        )
        return min(ahead, key=lambda obstacle: obstacle.region.keep_out.x_min_m, default=None)

    def conflicts(self, obstacle: Obstacle) -> Iterator[Obstacle]:
        """Other obstacles whose Regions of Influence intersect this one's."""
        extent = obstacle.region.extent
        for other in self.between(extent.x_min_m, extent.x_max_m):
            if other.id != obstacle.id and other.region.extent.intersects(extent):
                yield other

    def _place(self, obstacle: Obstacle) -> None:
        """Put an obstacle into the map, merged with what it conflicts with (to the fixpoint)."""
        while True:
            conflicts = self.conflicts(obstacle)
            partner = next((o for o in conflicts if self._may_merge(obstacle, o)), None)
            if partner is None:
                break
            self._forget(partner)
            obstacle = self._obstacle(tuple(sorted((*obstacle.members, *partner.members))))
        self._obstacles[obstacle.id] = obstacle
        for member in obstacle.members:
            self._obstacle_of_track[member] = obstacle.id
        extent = obstacle.region.extent
        for order in self._orders_of(obstacle):
            bisect.insort(order, (extent.x_min_m, obstacle.id))
        self._longest_region_m = max(self._longest_region_m, extent.x_max_m - extent.x_min_m)

    def _may_merge(self, one: Obstacle, other: Obstacle) -> bool:
        if self._contradict(one, other):
            return False
        merged = one.measured.enclosing(other.measured)
        return max(merged.size_m) <= self._merged_size_max_m

    def _contradict(self, one: Obstacle, other: Obstacle) -> bool:
        """Tell whether two obstacles hold places of one track that contradict each other."""
        for a, b in ((one, other), (other, one)):
            origins = {self._tracks[member].apart_from for member in a.members} - {None}
            if origins and any(
                member in origins or self._tracks[member].apart_from in origins
                for member in b.members
            ):
                return True
        return False

    def _obstacle(self, members: tuple[str, ...]) -> Obstacle:
        tracks = [self._tracks[member] for member in members]
        measured = functools.reduce(Box.enclosing, (track.measured for track in tracks))
        error_m = max(track.position_error_m for track in tracks)
        region = self._region_around(measured, error_m)
        return Obstacle("+".join(members), members, measured, error_m, region)

    def _forget(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Take an obstacle out of the map; return its members."""
        del self._obstacles[obstacle.id]
        for member in obstacle.members:
            del self._obstacle_of_track[member]
        key = (obstacle.region.extent.x_min_m, obstacle.id)
        for order in self._orders_of(obstacle):
            del order[bisect.bisect_left(order, key)]
        return obstacle.members

    def _orders_of(self, obstacle: Obstacle) -> Iterator[list[tuple[float, str]]]:
        """Every sorted list that an obstacle stands in."""
        yield self._order
        left_m, right_m = obstacle.region.conflict_band_y_m
        for strip in range(math.floor(left_m), math.floor(right_m) + 1):
            yield self._strips[strip]

    def _leg_box(self, corners_ned_m: Corners) -> Box:
        points = [self._leg.position_leg((*corner, 0.0)) for corner in corners_ned_m]
        x_m, y_m, _ = zip(*points, strict=True)
        return Box(min(x_m), max(x_m), min(y_m), max(y_m))

    def _corners_of(self, box: Box) -> Corners:
        x_m = (box.x_min_m, box.x_max_m, box.x_max_m, box.x_min_m)
        y_m = (box.y_min_m, box.y_min_m, box.y_max_m, box.y_max_m)
        return [self._leg.position_ned((x, y, 0.0))[:2] for x, y in zip(x_m, y_m, strict=True)]
