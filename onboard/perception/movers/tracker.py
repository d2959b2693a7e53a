"""Tracks of what moves: boxes that grow with the greatest speed of their class until seen again.

A track says where a mover that was seen may be, whatever it intends.  It is not what proves a place
free (`mover_free` is), so that a wrong identity costs nothing but a track.  Coordinates are north
and east; every box holds the whole mover, errors included.

No more than `TRACKS_MAX` are followed.  A frame with which there would be more is refused as a
whole: none of its movers is left out while the others count, and the caller has to take it that any
place may hold one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import BOXES_MAX
from onboard.perception.movers.box_rows import BoxRows

# Complete frames of its sensor without it: then it is unseen, and its place counts as such.
MISSED_MAX: Final = 3
# A track that no frame of its sensor has updated for so long is unseen, too.
MEMORY_S: Final = 5.0
# Of all sensors together: two that see as many boxes each as a frame may have and still show a
# place free.  To compare each with all others takes about a tick.  Ghosts may double them once.
TRACKS_MAX: Final = 2 * BOXES_MAX
# A mover that was faster than declared may become faster still.
_RAISED: Final = 1.25
_ROUND_OFF_M: Final = 1e-6


class Sighting(NamedTuple):
    """One mover of one frame.

    Attributes:
        track_id: unique among sensors.
        kind: class as the contract names it.
        measured: the box as reported, along north and east.
        error_m: how far each of its faces may be off.
        whole: whether it holds the whole mover.
        velocity_ned_mps: (north, east), where the sensor estimates it.
    """

    track_id: str
    kind: str
    measured: Box
    error_m: float
    whole: bool = True
    velocity_ned_mps: tuple[float, float] | None = None


@dataclass(frozen=True)
class Bound:
    """What a class of movers keeps to.

    Attributes:
        speed_max_mps: v_o.
        size_max_m: largest extent.
    """

    speed_max_mps: float
    size_max_m: float


@dataclass(frozen=True)
class MoverTrack:
    """Where one mover may be.

    Attributes:
        id: of the track.
        kind: class.
        box: holds the whole mover at `seen_s`.
        seen_s: stamp of the newest frame that showed it.
        speed_max_mps: v_o, of its class, or more once it was faster.
        witness: holds the mover if its name has been right all the time: by it a mover is found to
            be too fast, and nothing else.
        velocity_ned_mps: as its sensor estimates it; for people.
        missed: complete frames of its sensor since that did not show it.
    """

    id: str
    kind: str
    box: Box
    seen_s: float
    speed_max_mps: float
    witness: Box
    velocity_ned_mps: tuple[float, float] | None = None
    missed: int = 0

    def predicted(self, time_s: float, stamp_error_s: float = 0.0) -> Box:
        """Return what holds the mover at a time, if it keeps to its speed."""
        age_s = max(time_s - self.seen_s, 0.0) + stamp_error_s
        return self.box.inflated(self.speed_max_mps * age_s)

    def expected(self, time_s: float, stamp_error_s: float = 0.0) -> Box:
        """Return what holds the mover at a time, if its name has been right all the time."""
        age_s = max(time_s - self.seen_s, 0.0) + stamp_error_s
        return self.witness.inflated(self.speed_max_mps * age_s)


class TooFast(NamedTuple):
    """A mover was farther from where it was than its class allows.

    Attributes:
        track_id: which.
        speed_mps: how fast it has been at least.
        limit_mps: v_o.
    """

    track_id: str
    speed_mps: float
    limit_mps: float


class MoverTracker:
    """Keeps the tracks of all movers that are seen.

    Args:
        bounds: of each class; of ``unknown``, too, for what has none.
        stamp_error_s: how far the stamp of a frame may be off.

    Attributes:
        renamed: tracks of the last frame whose name is at a place where they cannot be at all: it
            has been given to another mover.
    """

    def __init__(
        self, bounds: Mapping[str, Bound], unknown: Bound, *, stamp_error_s: float = 0.0
    ) -> None:
        self._bounds, self._unknown = dict(bounds), unknown
        self._error_s = stamp_error_s
        self._tracks: dict[str, MoverTrack] = {}
        self._ghosts = 0
        self.renamed: set[str] = set()

    def __len__(self) -> int:
        return len(self._tracks)

    def __iter__(self) -> Iterator[MoverTrack]:
        return iter(self._tracks.values())

    def bound(self, kind: str) -> Bound:
        """Return what a class keeps to; one that is not declared may be any."""
        return self._bounds.get(kind, self._unknown)

    def clear(self) -> None:
        """Forget every track: the local frame has moved."""
        self._tracks.clear()

    def take(
        self, source: str, sightings: Iterable[Sighting], stamp_s: float, *, complete: bool
    ) -> list[TooFast] | None:
        """Take what a frame shows.

        Args:
            source: the sensor, with whose name its tracks begin.
            sightings: its movers.
            stamp_s: when it was taken; an older one than before changes nothing.
            complete: whether it names everything within range and view.

        Returns:
            Movers that have been faster than their class allows; None if there are more movers
            than are followed: then the frame changes nothing.
        """
        before, sightings = dict(self._tracks), tuple(sightings)
        self.renamed = set()
        found, shown = [], {sighting.track_id for sighting in sightings}
        if self._overflows(shown, before.values(), stamp_s):
            return None
        # Another sensor's track of the same mover says nothing of its name.
        own = [track for track in before.values() if track.id.startswith(f"{source}/")]
        places = {track.id: index for index, track in enumerate(own)}
        predicted = BoxRows(track.predicted(stamp_s, self._error_s) for track in own)
        for sighting in sightings:
            known = before.get(sighting.track_id)
            if known is not None and stamp_s <= known.seen_s:
                continue
            # Another one may be there as well: the identities may have been exchanged.
            shared = False
            if known is not None:
                met = predicted.meet(sighting.measured, sighting.error_m)
                if known.id in places:
                    met[places[known.id]] = False
                shared = bool(met.any())
            track, too_fast = self._updated(known, sighting, stamp_s, shared=shared)
            self._tracks[sighting.track_id] = track
            if too_fast is not None:
                found.append(too_fast)
        self._forget(f"{source}/", shown, stamp_s, complete=complete)
        return found

    def _overflows(
        self, shown: Collection[str], before: Iterable[MoverTrack], stamp_s: float
    ) -> bool:
        """Tell whether there are more movers than are followed, with those that are shown now."""
        kept = {track.id for track in before if stamp_s - track.seen_s <= MEMORY_S}
        return len(kept.union(shown)) > TRACKS_MAX

    def replace_returns(self, source: str, sightings: Iterable[Sighting], stamp_s: float) -> bool:
        """Take the returns of a frame, which have no identity: none is one of an earlier frame.

        What an earlier frame showed and this one does not is unseen, and its place counts as such.

        Args:
            source: the sensor, with whose name its tracks begin.
            sightings: all its returns.
            stamp_s: when it was taken; an older one than before changes nothing.

        Returns:
            Whether all of them are followed; else they are too many: the frame changes nothing.
        """
        sightings = tuple(sightings)
        own = [track for track in self._tracks.values() if track.id.startswith(f"{source}/")]
        if any(track.seen_s >= stamp_s for track in own):
            return True
        gone = {track.id for track in own}
        others = [track for track in self._tracks.values() if track.id not in gone]
        if self._overflows({sighting.track_id for sighting in sightings}, others, stamp_s):
            return False
        for track in own:
            del self._tracks[track.id]
        for sighting in sightings:
            self._tracks[sighting.track_id] = self._track_of(sighting, stamp_s)
        self.renamed = set()
        self._forget(f"{source}/", set(), stamp_s, complete=False)
        return True

    def _updated(
        self, known: MoverTrack | None, sighting: Sighting, stamp_s: float, *, shared: bool
    ) -> tuple[MoverTrack, TooFast | None]:
        """Return a track after a sighting, and whether the mover was too fast."""
        error_m, new = sighting.error_m, self._track_of(sighting, stamp_s)
        if known is None:
            return new, None
        new = replace(new, speed_max_mps=max(new.speed_max_mps, known.speed_max_mps))
        at = known.expected(stamp_s, self._error_s)
        beyond_m = _beyond_m(sighting.measured, at, error_m)
        if beyond_m > _ROUND_OFF_M:
            self._add_ghost(known)
            apart = not at.inflated(error_m).intersects(sighting.measured)
            if apart and not shared:
                self.renamed.add(known.id)
            if apart or shared:
                return new, None
            speed_mps = known.speed_max_mps + beyond_m / max(stamp_s - known.seen_s, 1e-3)
            raised_mps = max(new.speed_max_mps, _RAISED * speed_mps)
            too_fast = TooFast(known.id, speed_mps, known.speed_max_mps)
            return replace(new, speed_max_mps=raised_mps), too_fast
        if shared:
            return new, None
        if not sighting.whole:
            # What is not seen of it cannot have gone farther than all of it.
            new = replace(new, box=_common(new.box, known.predicted(stamp_s, self._error_s)))
        return replace(new, witness=_common(new.witness, at)), None

    def _track_of(self, sighting: Sighting, stamp_s: float) -> MoverTrack:
        """Return a track that knows nothing but one sighting."""
        bound = self.bound(sighting.kind)
        told = sighting.measured.inflated(sighting.error_m)
        if not sighting.whole:
            told = with_hidden_part(sighting.measured, sighting.error_m, bound.size_max_m)
        speed_mps, velocity_ned_mps = bound.speed_max_mps, sighting.velocity_ned_mps
        return MoverTrack(
            sighting.track_id, sighting.kind, told, stamp_s, speed_mps, told, velocity_ned_mps
        )

    def _add_ghost(self, track: MoverTrack) -> None:
        """Let the old box go on growing: it may be another mover that is there."""
        self._ghosts += 1
        ghost_id = f"{track.id}~{self._ghosts}"
        self._tracks[ghost_id] = replace(track, id=ghost_id)

    def _forget(self, prefix: str, shown: set[str], stamp_s: float, *, complete: bool) -> None:
        for track_id, track in list(self._tracks.items()):
            if stamp_s - track.seen_s > MEMORY_S:
                del self._tracks[track_id]
            elif complete and track_id.startswith(prefix) and track_id not in shown:
                if track.missed + 1 >= MISSED_MAX:
                    del self._tracks[track_id]
                elif stamp_s > track.seen_s:
                    self._tracks[track_id] = replace(track, missed=track.missed + 1)


def with_hidden_part(measured: Box, error_m: float, size_max_m: float) -> Box:
    """Return what holds a mover of which only a part was seen, turned by any angle.

    A face that was seen may be off either way: on its own side it may lie farther out, and what is
    hidden on the other side is counted from where it lies farthest in.

    Args:
        measured: the part that was seen.
        error_m: how far each of its faces may be off.
        size_max_m: of the whole mover.
    """
    told, most_m = measured.inflated(error_m), size_max_m * math.sqrt(2.0) + error_m
    return Box(
        min(told.x_min_m, measured.x_max_m - most_m),
        max(told.x_max_m, measured.x_min_m + most_m),
        min(told.y_min_m, measured.y_max_m - most_m),
        max(told.y_max_m, measured.y_min_m + most_m),
    )


def _beyond_m(measured: Box, predicted: Box, error_m: float) -> float:
    """Return how far a face is at least beyond where it could be; negative if within."""
    return max(
        predicted.x_min_m - (measured.x_min_m + error_m),
        predicted.y_min_m - (measured.y_min_m + error_m),
        measured.x_max_m - error_m - predicted.x_max_m,
        measured.y_max_m - error_m - predicted.y_max_m,
    )


def _common(one: Box, other: Box) -> Box:
    """Return what two boxes share; the first where they share nothing."""
    if not one.intersects(other):
        return one
    return Box(
        max(one.x_min_m, other.x_min_m),
        min(one.x_max_m, other.x_max_m),
        max(one.y_min_m, other.y_min_m),
        min(one.y_max_m, other.y_max_m),
    )
