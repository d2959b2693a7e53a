"""Placed boxes -> remembered obstacles -> Regions of Influence -> the obstacle of interest.

Obstacles are static, so the map remembers them: a frame that no longer mentions an obstacle does
not remove it.  A box only ever grows, to enclose every measurement of its obstacle, except that
one in full view from nearby replaces those from afar, which a wrong heading displaces by more than
the contract allows for.  Measurements that contradict each other are kept apart.

The map also carries how high obstacles reach, as the union of what was measured.  One that does not
reach into the heights flown at is passed over or under: it is remembered, but in no way (theory K).
Every other one counts as a pillar of any height.
"""

from __future__ import annotations

import bisect
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Container, Iterator
from dataclasses import replace
from typing import Final

from onboard.contract.heights import HeightBand
from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from onboard.perception.detection import ANY_HEIGHT, Corners, DownRange, shifted_corners
from onboard.perception.obstacle_track import Obstacle, Track, down_union

__all__ = ["MAX_TRACKS", "Obstacle", "ObstacleMap", "RegionFactory"]

# A map that holds more is fed with garbage.
MAX_TRACKS: Final = 100_000


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
        half_band_m: what is farther above or below the leg is not in the way; infinite: nothing.
    """

    def __init__(
        self,
        leg: LegFrame,
        region_around: RegionFactory,
        merged_size_max_m: float,
        half_band_m: float = math.inf,
    ) -> None:
        # Changes whenever anything known changes.
        self.revision = 0
        # By how much the estimator has moved everything since the first measurement, NED.
        self._shifted_ned_m = (0.0, 0.0)
        self._leg = leg
        self._region_around = region_around
        self._merged_size_max_m = merged_size_max_m
        self._band = HeightBand.around(leg.origin_ned_m[2], half_band_m)
        self._tracks: dict[str, Track] = {}
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
            if self._is_in_way(self._tracks[track_id]):
                yield self._obstacle((track_id,))

    def is_several(self, obstacle: Obstacle) -> bool:
        """Tell whether an obstacle is known to consist of several, not of parts of one.

        A scan of one obstacle may yield boxes that are apart, such as of a face that is seen at a
        flat angle: parts whose union is no larger than an obstacle may be are one.
        """
        return len(self._whole.intersection(obstacle.members)) > 1

    def rebuild(
        self,
        leg: LegFrame,
        region_around: RegionFactory,
        merged_size_max_m: float,
        half_band_m: float | None = None,
    ) -> None:
        """Express everything remembered on another leg, or under other terms.

        The arguments are those of the map; without ``half_band_m`` the present one stays.
        """
        tracks = self._tracks
        if half_band_m is None:
            half_band_m = (self._band.bottom_m - self._band.top_m) / 2.0
        self._band = HeightBand.around(leg.origin_ned_m[2], half_band_m)
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
                filled_m=track.filled_m,
                partial=track_id not in self._whole,
            )

    def shift(self, north_m: float, east_m: float, down_m: float) -> None:
        """Move everything remembered into the present local frame, which a reset has moved."""
        for track_id, track in self._tracks.items():
            corners_ned_m = shifted_corners(track.corners_ned_m, (north_m, east_m))
            heights_m, (top_m, bottom_m) = track.down_m, track.filled_m
            if heights_m is not None:
                heights_m = (heights_m[0] + down_m, heights_m[1] + down_m)
            self._tracks[track_id] = replace(
                track,
                corners_ned_m=corners_ned_m,
                down_m=heights_m,
                filled_m=(top_m + down_m, bottom_m + down_m),
            )
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
        filled_m: DownRange = ANY_HEIGHT,
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
            filled_m: heights that the obstacle may fill, errors included.
            partial: whether the sensor says that this is a part of something.

        Raises:
            OverflowError: more obstacles than any sensor could have seen.
        """
        measured = self._leg_box(corners_ned_m)
        track = Track(corners_ned_m, measured, position_error_m, apart_from, down_m, filled_m)
        if track_id not in self._tracks and len(self._tracks) >= MAX_TRACKS:
            raise OverflowError(f"{len(self._tracks)} obstacles remembered, limit {MAX_TRACKS}")
        if not partial:
            self._whole.add(track_id)
        known = self._tracks.get(track_id)
        if known is not None:
            track = known.updated(track, self._corners_of, error_max_m=error_max_m, in_full=in_full)
        if track == known:
            return False
        self._remember(track_id, track)
        return True

    def _remember(self, track_id: str, track: Track) -> None:
        before = self._tracks.get(track_id)
        if before is not None and not self._is_in_way(before):
            del self._tracks[track_id]  # new once it comes to be in the way, for `each_new`
        self._tracks[track_id] = track
        self.revision += 1
        if not self._is_in_way(track):
            return  # it was not before either: heights only grow
        merged = self._obstacle_of_track.get(track_id)
        members = (track_id,) if merged is None else self._forget(self._obstacles[merged])
        for member in members:
            self._place(self._obstacle((member,)))

    def is_passed_over(
        self, track_id: str, corners_ned_m: Corners, error_m: float, filled_m: DownRange
    ) -> bool:
        """Tell whether a measurement shows what is passed over or under only.

        All that was measured of its obstacle has to agree; where this measurement does not say how
        high it reaches, the obstacle has to be known at this place.

        Args:
            track_id: which obstacle.
            corners_ned_m: of the measured box.
            error_m: uncertainty of its faces.
            filled_m: heights that it may fill, errors included.
        """
        known = self._tracks.get(track_id)
        if known is None:
            return not self._band.meets(filled_m)
        new = Track(corners_ned_m, self._leg_box(corners_ned_m), error_m, None, None, filled_m)
        return not self._band.meets(known.filled_with(new))

    def remembers(self, track_id: str) -> bool:
        """Tell whether an obstacle has been seen, whether or not it is in the way."""
        return track_id in self._tracks

    def out_of_way(self, x_min_m: float, x_max_m: float) -> Iterator[Obstacle]:
        """Obstacles that are passed over or under, of which the region reaches into an interval."""
        for track_id, _ in self.passed_over():
            obstacle = self._obstacle((track_id,))
            region = obstacle.region
            if region.approach_x_m <= x_max_m and region.departure_x_m >= x_min_m:
                yield obstacle

    def passed_over(self) -> Iterator[tuple[str, Track]]:
        """Tracks that are passed over or under, by their ids."""
        for track_id, track in self._tracks.items():
            if not self._is_in_way(track):
                yield track_id, track

    def _is_in_way(self, track: Track) -> bool:
        return self._band.meets(track.filled_m)

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
        down_m = down_union(track.down_m for track in tracks)
        tops_m, bottoms_m = zip(*(track.filled_m for track in tracks), strict=True)
        filled_m = (min(tops_m), max(bottoms_m))
        name = "+".join(members)
        return Obstacle(name, members, measured, error_m, region, down_m, filled_m)

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
