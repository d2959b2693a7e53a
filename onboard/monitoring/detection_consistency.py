"""Check whether successive sightings of one obstacle can be of one box that stands still.

Each face of a box lies within its stated error of where it was measured.  A sensor may see more of
an obstacle from one place than from another: a box that grows or shrinks says nothing, and one side
may go out of sight after another came into sight.  But if both faces of an axis moved the same way
by more than the errors of both measurements, and the box was never seen as large as both sightings
together, it cannot be the same box.  The cause is an obstacle that moves, a wrong heading or
position, or a tracker that mixes up its tracks.  Which sighting is true is unknown then, so the
vehicle keeps out of every place where the obstacle was seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from onboard.monitoring.assumptions import Assumption, Violation
from onboard.perception.detection import Corners
from onboard.perception.obstacle_map import MAX_TRACKS

# A contradiction that has not been seen for this long is over.
SETTLED_AFTER_S: Final = 2.0
# Places that are kept apart for one track; later sightings enlarge the last of them.
PLACES_MAX: Final = 8
# Sightings that are this much alike count as one; so many are remembered for each direction.
_ALIKE_M: Final = 0.01
_REMEMBERED_MAX: Final = 64
_ROUNDING_M: Final = 1e-6


class Sighting(NamedTuple):
    """Bounds of a measured box, NED, and the error of each bound, in metres."""

    north_min_m: float
    north_max_m: float
    east_min_m: float
    east_max_m: float
    error_m: float

    @classmethod
    def of(cls, corners_ned_m: Corners, face_error_m: float, displacement_m: float) -> Sighting:
        """Return what a measured box says about its bounds to the north and east.

        Args:
            corners_ned_m: its corners, in turn.
            face_error_m: error of each face along the box's own axes.
            displacement_m: how far the whole box may be off besides, any way.
        """
        north_m, east_m = zip(*corners_ned_m, strict=True)
        along_north_m, along_east_m = abs(north_m[1] - north_m[0]), abs(east_m[1] - east_m[0])
        length_m = math.hypot(along_north_m, along_east_m)
        # A face error along turned axes moves a bound by both of its components.
        turned = (along_north_m + along_east_m) / length_m if length_m > 0.0 else math.sqrt(2.0)
        error_m = face_error_m * turned + displacement_m
        return cls(min(north_m), max(north_m), min(east_m), max(east_m), error_m)

    def bounds_by_direction_m(self) -> tuple[tuple[float, float], ...]:
        """Return (rear, front) of the box on its way to the north, south, east and west."""
        north_min_m, north_max_m, east_min_m, east_max_m, _ = self
        return (
            (north_min_m, north_max_m),
            (-north_max_m, -north_min_m),
            (east_min_m, east_max_m),
            (-east_max_m, -east_min_m),
        )


class Contradiction(NamedTuple):
    """How far a box went between two sightings, and how far it may seem to go by their errors."""

    shift_m: float
    limit_m: float


class _Rearmost(NamedTuple):
    """Rear and front of a sighting with its error added: a box that went on lies beyond both."""

    rear_m: float
    front_m: float
    error_m: float


class Place:
    """One place where an obstacle was seen: sightings that do not contradict each other.

    Of all sightings only those are remembered against which a shift shows first, the ones whose
    rear and front are not both ahead of another's, and the largest along each axis.
    """

    __slots__ = ("_largest", "_rearmost")

    def __init__(self) -> None:
        self._rearmost: tuple[list[_Rearmost], ...] = ([], [], [], [])
        self._largest: tuple[list[tuple[float, float]], ...] = ([], [], [], [])

    def contradiction(self, sighting: Sighting) -> Contradiction | None:
        """Return how a sighting contradicts an earlier one; None if it agrees with all of them."""
        worst: Contradiction | None = None
        error_m = sighting.error_m
        for (rear_m, front_m), earlier, largest in zip(
            sighting.bounds_by_direction_m(), self._rearmost, self._largest, strict=True
        ):
            for before in earlier:
                beyond_m = min(rear_m - before.rear_m, front_m - before.front_m) - error_m
                if beyond_m <= _ROUNDING_M or _seen_whole(
                    largest, before.rear_m, front_m - error_m
                ):
                    continue
                limit_m = before.error_m + error_m
                if worst is None or beyond_m + limit_m > worst.shift_m:
                    worst = Contradiction(beyond_m + limit_m, limit_m)
        return worst

    def add(self, sighting: Sighting) -> None:
        """Remember a sighting."""
        error_m = sighting.error_m
        for (rear_m, front_m), earlier, largest in zip(
            sighting.bounds_by_direction_m(), self._rearmost, self._largest, strict=True
        ):
            new = _Rearmost(rear_m + error_m, front_m + error_m, error_m)
            if not any(
                old.rear_m <= new.rear_m + _ALIKE_M and old.front_m <= new.front_m + _ALIKE_M
                for old in earlier
            ):
                earlier[:] = [
                    old for old in earlier if old.rear_m < new.rear_m or old.front_m < new.front_m
                ][-_REMEMBERED_MAX + 1 :]
                earlier.append(new)
            if not _seen_whole(largest, rear_m, front_m):
                largest[:] = [
                    (rear, front) for rear, front in largest if rear < rear_m or front > front_m
                ][-_REMEMBERED_MAX + 1 :]
                largest.append((rear_m, front_m))


def _seen_whole(largest: list[tuple[float, float]], rear_m: float, front_m: float) -> bool:
    """Tell whether one sighting reached from a rear to a front, or very nearly."""
    return any(rear <= rear_m + _ALIKE_M and front >= front_m - _ALIKE_M for rear, front in largest)


@dataclass
class _Track:
    """Places where one track was seen, and which of them is believed to be its place."""

    places: list[Place] = field(default_factory=lambda: [Place()])
    believed: int = 0
    latest: int = 0
    latest_since_s: float = -math.inf
    contradicted_s: float = -math.inf


class Placement(NamedTuple):
    """Where a sighting belongs.

    Attributes:
        track_id: the track's own id, or an id of its own for a place that contradicts the first.
        apart: whether it contradicts the place that was believed, so that both are to be kept.
        violation: what contradicts what, if something does.
    """

    track_id: str
    apart: bool
    violation: Violation | None


class DetectionConsistencyMonitor:
    """Compares every sighting of a track with the earlier ones."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def take(self, track_id: str, sighting: Sighting | None, now_s: float) -> Placement:
        """Find the place that a sighting belongs to, and tell whether it contradicts another.

        Args:
            track_id: which obstacle, as the sensor sees it.
            sighting: where it is; None if it was seen in part only, which says no more than that
                there is something.
            now_s: when the sighting came.
        """
        track = self._tracks.get(track_id)
        if sighting is None:
            latest = 0 if track is None else track.latest
            return Placement(_place_id(track_id, latest), apart=False, violation=None)
        if track is None:
            track = _Track()
            if len(self._tracks) < MAX_TRACKS:
                self._tracks[track_id] = track
        found = track.places[track.believed].contradiction(sighting)
        index = track.believed if found is None else _place_of(track, sighting)
        track.places[index].add(sighting)
        if index != track.latest:
            track.latest, track.latest_since_s = index, now_s
        if found is None:
            return Placement(_place_id(track_id, index), apart=False, violation=None)
        track.contradicted_s = now_s
        if now_s - track.latest_since_s >= SETTLED_AFTER_S:
            track.believed = index
        violation = Violation(
            Assumption.DETECTION_CONSISTENCY, found.shift_m, found.limit_m, "m", track_id
        )
        return Placement(_place_id(track_id, index), apart=True, violation=violation)

    def contradicted(self, now_s: float) -> list[str]:
        """Return the tracks of which sightings contradicted each other a moment ago."""
        return [
            track_id
            for track_id, track in self._tracks.items()
            if now_s - track.contradicted_s < SETTLED_AFTER_S
        ]


def _place_id(track_id: str, index: int) -> str:
    return track_id if index == 0 else f"{track_id}~{index + 1}"


def _place_of(track: _Track, sighting: Sighting) -> int:
    """Return the place that a sighting agrees with, or a new one while there may be more."""
    for index, place in enumerate(track.places):
        if place.contradiction(sighting) is None:
            return index
    if len(track.places) < PLACES_MAX:
        track.places.append(Place())
    return len(track.places) - 1
