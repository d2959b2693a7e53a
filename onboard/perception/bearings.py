"""Bearings of tracks seen again from the body; a wrong heading turns all of them alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from onboard.geometry.frames import heading_displacement_m, wrap_angle
from onboard.perception.detection import Corners
from onboard.perception.obstacle_map import MAX_TRACKS
from onboard.vehicle_state import Pose

Point = tuple[float, float]

# A wrong heading turns every track: this many of a frame suffice, however crowded it is.
TRACKS_PER_FRAME: Final = 16
# A track is known by the mean of this many sightings.
KNOWN_AFTER: Final = 5
# A position estimate wanders by this much between two sightings; recorded: 0.3 to 0.8 m (PX4).
WANDER_M: Final = 0.5


class BearingResidual(NamedTuple):
    """How far a known track is seen beside where it was.

    Attributes:
        angle_rad: bearing as seen now less bearing as known, positive to the right.
        error_rad: what errors of position explain of it.
    """

    angle_rad: float
    error_rad: float


class _Known(NamedTuple):
    """A track as it was seen first: mean centre, NED, greatest extent and range, and how often."""

    center_ned_m: Point
    extent_m: float
    range_m: float
    sightings: int


class BearingMemory:
    """Remembers where tracks were first seen, and compares later sightings with that."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Known] = {}

    def forget(self) -> None:
        """Start again: the estimator has moved what was placed."""
        self._tracks.clear()

    def residuals(
        self,
        pose: Pose,
        corners_ned_m: Mapping[str, Corners],
        error_m: float,
        heading_error_rad: float = 0.0,
    ) -> list[BearingResidual]:
        """Return the residuals of the tracks of one frame that are known well.

        Args:
            pose: where the body was.
            corners_ned_m: boxes by track, as placed with that pose.
            error_m: of each face.
            heading_error_rad: with which a track may have been placed; from farther away than now,
                that turns its bearing by more.
        """
        found = []
        for track_id, corners in corners_ned_m.items():
            center_ned_m = _centre(corners)
            range_m = math.dist(center_ned_m, pose.position_ned_m[:2])
            seen = _Known(center_ned_m, _extent(corners), range_m, 1)
            known = self._tracks.get(track_id)
            if known is None or known.sightings < KNOWN_AFTER:
                self._learn(track_id, known, seen)
                continue
            # Of a box that is seen in part the centre is off by half of what is missing.
            partly_m = abs(seen.extent_m - known.extent_m) / 2.0
            farther_m = max(known.range_m - range_m, 0.0)
            turned_m = heading_displacement_m(farther_m, heading_error_rad)
            off_m = 2.0 * error_m + WANDER_M + partly_m + turned_m
            residual = _residual(pose, seen.center_ned_m, known.center_ned_m, off_m)
            if residual is not None:
                found.append(residual)
        return found

    def _learn(self, track_id: str, known: _Known | None, seen: _Known) -> None:
        if known is None:
            if len(self._tracks) < MAX_TRACKS:
                self._tracks[track_id] = seen
            return
        count = known.sightings + 1
        (north_m, east_m), (seen_north_m, seen_east_m) = known.center_ned_m, seen.center_ned_m
        mean_ned_m = (
            north_m + (seen_north_m - north_m) / count,
            east_m + (seen_east_m - east_m) / count,
        )
        extent_m, range_m = max(known.extent_m, seen.extent_m), max(known.range_m, seen.range_m)
        self._tracks[track_id] = _Known(mean_ned_m, extent_m, range_m, count)


def _residual(
    pose: Pose, seen_ned_m: Point, known_ned_m: Point, off_m: float
) -> BearingResidual | None:
    """Compare two places of a track; None where one is too near for its bearing to say anything."""
    north_m, east_m, _ = pose.position_ned_m
    seen_m = (seen_ned_m[0] - north_m, seen_ned_m[1] - east_m)
    known_m = (known_ned_m[0] - north_m, known_ned_m[1] - east_m)
    range_m = min(math.hypot(*seen_m), math.hypot(*known_m))
    if range_m <= off_m:
        return None
    angle_rad = math.atan2(seen_m[1], seen_m[0]) - math.atan2(known_m[1], known_m[0])
    return BearingResidual(wrap_angle(angle_rad), math.asin(off_m / range_m))


def _centre(corners_ned_m: Corners) -> Point:
    north_m, east_m = zip(*corners_ned_m, strict=True)
    return sum(north_m) / len(north_m), sum(east_m) / len(east_m)


def _extent(corners_ned_m: Corners) -> float:
    """Length of the diagonal, which no turn changes."""
    return math.dist(corners_ned_m[0], corners_ned_m[2])
