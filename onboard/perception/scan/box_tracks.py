"""Which box of a scan is which of an earlier one: names that stay."""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray, wrap_angle
from onboard.perception.scan.levelled_beams import BoolArray

# Remembered at most; those that have not been seen for longest are forgotten, never their names.
TRACKS_MAX: Final = 2000
# What is farther apart than so many times `near_m` is not taken for one box.
_ALONE: Final = 4.0
_SAME_SIDE_RAD: Final = math.radians(30.0)


class BoxTracks:
    """Names boxes by where they are: obstacles stand still.

    What is remembered of a track is the union of its boxes.  It stays within the size of one box,
    so that a name never wanders along a hedge.

    Args:
        near_m: a box this far from a track may be of it.
        size_max_m: of a union.
    """

    def __init__(self, near_m: float, size_max_m: float) -> None:
        self._near_m, self._size_max_m = near_m, size_max_m
        self._numbers = itertools.count(1)
        self._bounds_ned_m = np.empty((0, 4))
        self._names: list[int] = []
        self._seen: list[int] = []
        # From where each was compared first, or seen as a whole.
        self._aspect_rad: dict[int, float] = {}
        self._scans = 0

    def forget(self) -> None:
        """Forget every track: the local frame has moved."""
        self._bounds_ned_m = np.empty((0, 4))
        self._names.clear()
        self._aspect_rad.clear()
        self._seen.clear()

    def comparable(
        self,
        bounds_ned_m: FloatArray,
        names: list[int | None],
        from_ned_m: tuple[float, float],
        error_m: float,
    ) -> BoolArray:
        """Tell which of the boxes that have just been named show again what earlier ones showed.

        What stands close together may be one box from here and two from there.  From another side
        other faces of an obstacle are seen, unless all is seen that ever was.

        Args:
            bounds_ned_m: of the boxes.
            names: theirs.
            from_ned_m: where they are seen from, north and east.
            error_m: of a face.
        """
        middle_m = (bounds_ned_m[:, 0::2] + bounds_ned_m[:, 1::2]) / 2.0 - np.array(from_ned_m)
        aspect_rad = np.arctan2(middle_m[:, 1], middle_m[:, 0])
        near = _apart_m(bounds_ned_m, self._bounds_ned_m) <= _ALONE * self._near_m
        alone = np.count_nonzero(near, axis=1) <= 1
        tracks = np.searchsorted(self._names, [name or 0 for name in names])
        found = np.zeros(len(names), np.bool_)
        rows = zip(names, tracks.tolist(), alone.tolist(), aspect_rad.tolist(), strict=True)
        for index, (name, track, is_alone, aspect) in enumerate(rows):
            if name is None or not is_alone:
                continue
            known = self._aspect_rad.get(name)
            turned = known is not None and abs(wrap_angle(aspect - known)) > _SAME_SIDE_RAD
            same = not turned
            if turned:
                off_m = np.abs(bounds_ned_m[index] - self._bounds_ned_m[track]).max()
                same = bool(off_m <= error_m)
            found[index] = same
            if same and (known is None or turned):
                self._aspect_rad[name] = aspect
        return found

    def name(self, bounds_ned_m: FloatArray) -> list[int | None]:
        """Name the boxes of one scan; None for a part of something larger than one box.

        Args:
            bounds_ned_m: (k, 4), least and greatest north, least and greatest east.
        """
        self._scans += 1
        known = len(self._names)
        claimed: set[int] = set()
        apart_m = _apart_m(bounds_ned_m, self._bounds_ned_m[:known])
        unions = _unions(bounds_ned_m, self._bounds_ned_m[:known])
        fits = (
            np.maximum(unions[..., 1] - unions[..., 0], unions[..., 3] - unions[..., 2])
            <= self._size_max_m
        )
        names: list[int | None] = []
        added = []
        near: list[list[int]] = [[] for _ in bounds_ned_m]
        for index, track in np.argwhere(apart_m <= self._near_m).tolist():
            near[index].append(track)
        for index, bounds in enumerate(bounds_ned_m):
            unclaimed = [track for track in near[index] if track not in claimed]
            usable = [track for track in unclaimed if fits[index, track]]
            if usable:
                track = usable[0]
                if len(usable) > 1:
                    apart = _middles_apart(bounds, self._bounds_ned_m[usable])
                    track = usable[int(apart.argmin())]
                self._bounds_ned_m[track] = unions[index, track]
                self._seen[track] = self._scans
                claimed.add(track)
                names.append(self._names[track])
            elif unclaimed:
                names.append(None)
            else:
                names.append(next(self._numbers))
                added.append((bounds, names[-1]))
        self._remember(added)
        return names

    def _remember(self, added: list[tuple[FloatArray, int | None]]) -> None:
        for bounds, name in added:
            assert name is not None  # noqa: S101  it has just been given
            self._bounds_ned_m = np.vstack((self._bounds_ned_m, bounds))
            self._names.append(name)
            self._seen.append(self._scans)
        if len(self._names) > TRACKS_MAX:
            kept = np.sort(np.argsort(self._seen, kind="stable")[-TRACKS_MAX // 2 :])
            self._bounds_ned_m = self._bounds_ned_m[kept]
            self._names = [self._names[index] for index in kept]
            self._seen = [self._seen[index] for index in kept]
            self._aspect_rad = {
                name: self._aspect_rad[name] for name in self._names if name in self._aspect_rad
            }


def _apart_m(boxes: FloatArray, tracks: FloatArray) -> FloatArray:
    """Return how far each box is from each track, along the axis in which it is farther."""
    one, other = boxes[:, None], tracks[None]
    north_m = np.maximum(one[..., 0] - other[..., 1], other[..., 0] - one[..., 1])
    east_m = np.maximum(one[..., 2] - other[..., 3], other[..., 2] - one[..., 3])
    apart_m: FloatArray = np.maximum(north_m, east_m)
    return apart_m


def _unions(boxes: FloatArray, tracks: FloatArray) -> FloatArray:
    one, other = boxes[:, None], tracks[None]
    low, high = np.minimum(one, other), np.maximum(one, other)
    return np.stack((low[..., 0], high[..., 1], low[..., 2], high[..., 3]), axis=-1)


def _middles_apart(box: FloatArray, tracks: FloatArray) -> FloatArray:
    north_m = (box[0] + box[1] - tracks[:, 0] - tracks[:, 1]) / 2.0
    east_m = (box[2] + box[3] - tracks[:, 2] - tracks[:, 3]) / 2.0
    apart_m: FloatArray = np.hypot(north_m, east_m)
    return apart_m
