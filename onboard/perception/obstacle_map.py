"""Placed boxes -> remembered obstacles -> Regions of Influence -> the obstacle of interest.

Obstacles are static, so the map remembers them: a frame that no longer mentions an obstacle does
not remove it.  A box only ever grows, to enclose every measurement of its obstacle, except that
one in full view from nearby replaces those from afar, which a wrong heading displaces by more than
the contract allows for.  Measurements that contradict each other are kept apart.

The map also carries how high obstacles reach, as the union of what was measured.  Nothing uses it
yet: planner and certifier treat every obstacle as a pillar of any height, which is the safe side.
"""

from __future__ import annotations

import bisect
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from onboard.perception.detection import Corners, DownRange, shifted_corners

# A map that holds more is fed with garbage.
MAX_TRACKS: Final = 100_000


@dataclass(frozen=True)
class Obstacle:
    """An obstacle to avoid as one, in the current leg frame.

    Attributes:
        id: ``source/id`` of its detections; those of a merged one are joined by ``+``.
        members: ids of the tracks in it, more than one if their regions intersect.
        measured: the box that encloses every measurement of every member.
        position_error_m: the largest uncertainty reported for a face.
        region: its Region of Influence.
        down_m: top and bottom in local NED over all measurements; None for any height.
    """

    id: str
    members: tuple[str, ...]
    measured: Box
    position_error_m: float
    region: RegionOfInfluence
    down_m: DownRange | None = None

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

    Tracks of one ``apart_from`` are places of an obstacle that contradict each other; ``down_m`` is
    None once a measurement did not say how high the obstacle reaches.
    """

    corners_ned_m: Corners
    measured: Box
    position_error_m: float
    apart_from: str | None
    down_m: DownRange | None

    def explains(self, measured: Box, position_error_m: float) -> bool:
        """Tell whether a worse measurement says nothing beyond the errors of both."""
        bound = self.measured.inflated(self.position_error_m + position_error_m)
        return position_error_m > self.position_error_m and bound.enclosing(measured) == bound


RegionFactory = Callable[[Box, float], RegionOfInfluence]


class ObstacleMap:
    """Obstacles seen so far, ordered along the current leg.

    Obstacles whose regions intersect are merged into one as long as it is no larger than a single
    obstacle may be, until no two regions intersect or nothing more fits; the monitors report what
    still conflicts then.

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
        # Tracks that a sensor once took for a whole obstacle.
        self._whole: set[str] = set()
        # (where an avoidance may begin, id), sorted; the longest region bounds every search.
        self._order: list[tuple[float, str]] = []
        self._longest_region_m = 0.0
        # The same for each strip of a metre across the leg, of the obstacles that conflict with it.
        self._strips: defaultdict[int, list[tuple[float, str]]] = defaultdict(list)

    def __len__(self) -> int:
        return len(self._obstacles)

    def __iter__(self) -> Iterator[Obstacle]:
        return iter(self._obstacles.values())

    def of_track(self, track_id: str) -> Obstacle | None:
        """Return the obstacle that a detection belongs to, as it is known now."""
        obstacle_id = self._obstacle_of_track.get(track_id)
        return None if obstacle_id is None else self._obstacles[obstacle_id]

    def each_new(self, known: Container[str]) -> Iterator[Obstacle]:
        """Yield each detected obstacle by itself, the newest first, up to one that is known."""
        for track_id in reversed(self._tracks):
            if track_id in known:
                return
            yield self._obstacle((track_id,))

    def is_several(self, obstacle: Obstacle) -> bool:
        """Tell whether an obstacle is known to consist of several, not of parts of one.

        A scan of one obstacle may yield boxes that are apart, such as of a face that is seen at a
        flat angle: parts whose union is no larger than an obstacle may be are one.
        """
        return len(self._whole.intersection(obstacle.members)) > 1

    def rebuild(
        self, leg: LegFrame, region_around: RegionFactory, merged_size_max_m: float
    ) -> None:
        """Express everything remembered on another leg, or under other terms."""
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
                down_m=track.down_m,
                partial=track_id not in self._whole,
            )

    def shift(self, north_m: float, east_m: float, down_m: float) -> None:
        """Move everything remembered into the present local frame, which a reset has moved."""
        for track_id, track in self._tracks.items():
            corners_ned_m = shifted_corners(track.corners_ned_m, (north_m, east_m))
            heights_m = track.down_m
            if heights_m is not None:
                heights_m = (heights_m[0] + down_m, heights_m[1] + down_m)
            self._tracks[track_id] = replace(track, corners_ned_m=corners_ned_m, down_m=heights_m)
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
        """Allow places that contradict each other to merge into one obstacle again."""
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
        down_m: DownRange | None = None,
        partial: bool = False,
    ) -> bool:
        """Remember a measurement; tell whether it changed what is known.

        Args:
            track_id: which obstacle.
            corners_ned_m: corners of the measured box.
            position_error_m: uncertainty of its faces.
            apart_from: track that it contradicts; neither it nor others that do are merged with it.
            error_max_m: of a face by the contract; worse counts until it is seen in full within.
            in_full: whether the sensor saw the whole obstacle.
            down_m: top and bottom in local NED; None for any height.
            partial: whether the sensor says that this is a part of something.

        Raises:
            OverflowError: more obstacles than any sensor could have seen.
        """
        measured = self._leg_box(corners_ned_m)
        track = _Track(corners_ned_m, measured, position_error_m, apart_from, down_m)
        known = self._tracks.get(track_id)
        if known is None and len(self._tracks) >= MAX_TRACKS:
            raise OverflowError(f"{len(self._tracks)} obstacles remembered, limit {MAX_TRACKS}")
        if not partial:
            self._whole.add(track_id)
        if known is not None:
            track = self._updated(known, track, error_max_m=error_max_m, in_full=in_full)
            if track == known:
                return False
        self._tracks[track_id] = track
        self.revision += 1
        merged = self._obstacle_of_track.get(track_id)
        members = (track_id,) if merged is None else self._forget(self._obstacles[merged])
        for member in members:
            self._place(self._obstacle((member,)))
        return True

    def _updated(self, known: _Track, new: _Track, *, error_max_m: float, in_full: bool) -> _Track:
        """Return what is known of a track after one more measurement of it."""
        down_m = _down_union((known.down_m, new.down_m))
        if down_m != known.down_m:
            known = replace(known, down_m=down_m)
        measured, error_m = new.measured, new.position_error_m
        if error_m > error_max_m and known.explains(measured, error_m):
            return known
        if not (in_full and error_m <= error_max_m < known.position_error_m):
            measured = known.measured.enclosing(measured)
            error_m = max(known.position_error_m, error_m)
        if measured == known.measured and error_m == known.position_error_m:
            return known
        return _Track(
            # Sound for any later leg: what encloses every measurement in this one encloses them.
            self._corners_of(measured),
            measured,
            error_m,
            known.apart_from or new.apart_from,
            down_m,
        )

    def between(self, x_min_m: float, x_max_m: float) -> Iterator[Obstacle]:
        """Obstacles whose regions or manoeuvres reach into an interval, as the leg meets them."""
        return self._reaching(self._order, x_min_m, x_max_m)

    def boxes_between(self, x_min_m: float, x_max_m: float) -> Iterator[Box]:
        """Boxes around all measurements of each track, unmerged, of the obstacles of `between`."""
        for obstacle in self.between(x_min_m, x_max_m):
            yield from (self._tracks[member].measured for member in obstacle.members)

    def _reaching(
        self, order: list[tuple[float, str]], x_min_m: float, x_max_m: float
    ) -> Iterator[Obstacle]:
        start = bisect.bisect_left(order, (x_min_m - self._longest_region_m, ""))
        for index in range(start, len(order)):
            approach_x_m, obstacle_id = order[index]
            if approach_x_m > x_max_m:
                return
            obstacle = self._obstacles[obstacle_id]
            if obstacle.region.departure_x_m >= x_min_m:
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
        """Other obstacles whose Regions of Influence conflict with this one's."""
        region = obstacle.region
        for other in self.between(region.approach_x_m, region.departure_x_m):
            if other.id != obstacle.id and other.region.conflicts_with(region):
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
        region = obstacle.region
        for order in self._orders_of(obstacle):
            bisect.insort(order, (region.approach_x_m, obstacle.id))
        length_m = region.departure_x_m - region.approach_x_m
        self._longest_region_m = max(self._longest_region_m, length_m)

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
        down_m = _down_union(track.down_m for track in tracks)
        return Obstacle("+".join(members), members, measured, error_m, region, down_m)

    def _forget(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Take an obstacle out of the map; return its members."""
        del self._obstacles[obstacle.id]
        for member in obstacle.members:
            del self._obstacle_of_track[member]
        key = (obstacle.region.approach_x_m, obstacle.id)
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


def _down_union(ranges_m: Iterable[DownRange | None]) -> DownRange | None:
    """Return the least range around some; None, any height, if one of them is unknown."""
    known_m = []
    for range_m in ranges_m:
        if range_m is None:
            return None
        known_m.append(range_m)
    return min(top_m for top_m, _ in known_m), max(bottom_m for _, bottom_m in known_m)
