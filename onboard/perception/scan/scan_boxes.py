"""Hits of a scan as boxes of bounded size, with names that stay.

Hits that are near each other belong to one obstacle.  One that is no larger than a box may be keeps
a name by where it is.  A larger one, such as a hedge, is cut along a lattice that stands still in
local NED: boxes side by side, named after their cell, each only a part.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.files.sensor_sources import SensorSource
from onboard.geometry.frames import FloatArray, IntArray
from onboard.perception.scan.box_tracks import BoxTracks
from onboard.perception.scan.fitted_boxes import FittedBoxes, fit_boxes
from onboard.perception.scan.levelled_beams import BoolArray, LevelledBeams
from onboard.vehicle_state import Pose

# Neighbouring hits this many beam widths apart still belong together.
_WIDTHS_PER_GAP: Final = 3.0
# Boxes that are to be compared reach no farther beyond what was seen.
_BEYOND_MAX_M: Final = 0.02
# Of what faces may be off, beams that are apart may take this much, if boxes are to be compared.
_BEAMS_SHARE: Final = 0.5


class NamedBox(NamedTuple):
    """One box in local NED.

    Attributes:
        name: that stays.
        center_ned_m, size_m, yaw_rad: horizontally.
        partial: whether it shows only a part of its obstacle.
    """

    name: str
    center_ned_m: tuple[float, float]
    size_m: tuple[float, float]
    yaw_rad: float
    partial: bool


class _Groups(NamedTuple):
    """Points of several obstacles in local NED, group after group.

    Attributes:
        points_ned_m: (n, 2).
        starts: (k,) index of the first point of each group.
        partial: (k,) whether a group shows only a part.
    """

    points_ned_m: FloatArray
    starts: IntArray
    partial: BoolArray


class ScanBoxes:
    """Finds the boxes of successive scans of one sensor.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorSource) -> None:
        self._config = config
        self._cell_m = config.box_max_m / math.sqrt(2.0)
        self._tracks = BoxTracks(config.cluster_gap_m / 2.0, config.box_max_m)
        self._generation = 0

    def find(self, beams: LevelledBeams, pose: Pose, generation: int) -> list[NamedBox]:
        """Return the boxes of a scan.

        Args:
            beams: in the order of their bearings.
            pose: of the body at the reference time.
            generation: of the local frame; names of another one do not come again.
        """
        if generation != self._generation:
            self._generation = generation
            self._tracks.forget()
        groups = _grouped(beams, pose, self._config)
        if groups is None:
            return []
        fitted = fit_boxes(groups.points_ned_m, groups.starts, _BEYOND_MAX_M)
        whole = fitted.size_m.max(axis=1) <= self._config.box_max_m
        bounds_ned_m = fitted.bounds_ned_m[whole]
        found = self._tracks.name(bounds_ned_m)
        partial = groups.partial
        here_ned_m = pose.position_ned_m[:2]
        partial[whole] |= ~self._tracks.comparable(
            bounds_ned_m, found, here_ned_m, self._config.uncertainty_m
        )
        numbers = iter(found)
        names = [next(numbers) if each else None for each in whole.tolist()]
        kept = [index for index, name in enumerate(names) if name is not None]
        boxes = _named(
            [f"{self._prefix}{names[index]}" for index in kept],
            fitted,
            kept,
            partial[kept].tolist(),
            beams.point_error_m,
        )
        large = [index for index, name in enumerate(names) if name is None]
        return boxes + self._cut(groups, large, beams.point_error_m)

    @property
    def _prefix(self) -> str:
        return f"{self._generation}." if self._generation else ""

    def _cut(self, groups: _Groups, large: list[int], point_error_m: float) -> list[NamedBox]:
        """Return the boxes of groups that are larger than a box may be."""
        pieces: dict[tuple[int, int, int], list[FloatArray]] = {}
        ends = np.append(groups.starts[1:], len(groups.points_ned_m))
        for group in large:
            points_ned_m = groups.points_ned_m[groups.starts[group] : ends[group]]
            for cell, piece in _by_cell(_dense(points_ned_m, self._cell_m / 2.0), self._cell_m):
                pieces.setdefault((*cell, group), []).append(piece)
        if not pieces:
            return []
        arrays = [np.concatenate(piece) for piece in pieces.values()]
        lengths = np.array([len(array) for array in arrays])
        fitted = fit_boxes(np.concatenate(arrays), np.cumsum(lengths) - lengths)
        names, taken = [], Counter[tuple[int, int]]()
        for north, east, _ in pieces:
            taken[north, east] += 1
            # Another obstacle in the same cell of the lattice has a name of its own.
            again = f"-{taken[north, east]}" if taken[north, east] > 1 else ""
            names.append(f"{self._prefix}cell{north}_{east}{again}")
        count = len(names)
        return _named(names, fitted, list(range(count)), [True] * count, point_error_m)


def _named(
    names: list[str],
    fitted: FittedBoxes,
    index: list[int],
    partial: list[bool],
    point_error_m: float,
) -> list[NamedBox]:
    columns: list[list[Any]] = [
        fitted.center_ned_m[index].tolist(),
        (fitted.size_m[index] + 2.0 * point_error_m).tolist(),
        fitted.yaw_rad[index].tolist(),
    ]
    return [
        NamedBox(name, (center[0], center[1]), (size[0], size[1]), yaw, part)
        for name, center, size, yaw, part in zip(names, *columns, partial, strict=True)
    ]


def _grouped(beams: LevelledBeams, pose: Pose, config: SensorSource) -> _Groups | None:
    """Group hits; None if there is no obstacle among them."""
    hits = np.flatnonzero(beams.hit)
    if hits.size == 0:
        return None
    points_m = beams.point_m[:, hits].T
    away_m = np.hypot(*(points_m - beams.sensor_m).T)
    hits, points_m, away_m, parted = _cut_where_far(hits, points_m, away_m, beams, config)
    last = np.flatnonzero(parted)
    first = np.concatenate(([0], last[:-1] + 1))
    enough = last - first + 1 >= config.points_min
    if not enough.any():
        return None
    first, last = first[enough], last[enough]
    partial = _end_is_unsure(beams, hits, away_m, first, -1, config)
    partial |= _end_is_unsure(beams, hits, away_m, last, 1, config)
    beside_rad = _beside_rad(beams, hits, away_m, config)
    points_ned_m = _in_ned(_with_ends(points_m, away_m, beams, hits, first, last, beside_rad), pose)
    lengths = last - first + 3
    return _Groups(points_ned_m, np.cumsum(lengths) - lengths, partial)


def _cut_where_far(
    hits: IntArray,
    points_m: FloatArray,
    away_m: FloatArray,
    beams: LevelledBeams,
    config: SensorSource,
) -> tuple[IntArray, FloatArray, FloatArray, BoolArray]:
    """Return hits such that no group goes on from the last to the first, and where groups end."""
    following = np.roll(np.arange(hits.size), -1)
    gap_m = np.hypot(*(points_m[following] - points_m).T)
    near_m = np.minimum(away_m, away_m[following])
    parted = gap_m > np.maximum(
        config.cluster_gap_m, _WIDTHS_PER_GAP * beams.width_rad[hits] * near_m
    )
    if not parted.any():
        parted[-1] = True
    if parted[-1]:
        return hits, points_m, away_m, parted
    shift = int(np.flatnonzero(parted)[-1]) + 1
    order = np.roll(np.arange(hits.size), -shift)
    return hits[order], points_m[order], away_m[order], parted[order]


def _end_is_unsure(
    beams: LevelledBeams,
    hits: IntArray,
    away_m: FloatArray,
    ends: IntArray,
    side: int,
    config: SensorSource,
) -> BoolArray:
    """Tell of each end of a group whether the obstacle may go on beyond it.

    It ends where the next beam sees past it.  It may go on beyond the range or the view, behind
    something nearer, where nothing is known, and where beams are too far apart for what faces may
    be off.
    """
    count = beams.bearing_rad.size
    end, beside = hits[ends], (hits[ends] + side) % count
    apart_rad = side * (beams.bearing_rad[beside] - beams.bearing_rad[end]) % (2.0 * math.pi)
    width_rad = beams.width_rad[end]
    unsure: BoolArray = (apart_rad > 1.5 * width_rad) | beams.blocked[beside]
    unsure |= beams.hit[beside] & (beams.free_m[beside] < away_m[ends])
    unsure |= away_m[ends] > config.range_m - config.cluster_gap_m
    unsure |= away_m[ends] * width_rad / 2.0 > _BEAMS_SHARE * config.uncertainty_m
    return unsure


def _beside_rad(
    beams: LevelledBeams, hits: IntArray, away_m: FloatArray, config: SensorSource
) -> FloatArray:
    """Return how far beside the middle of its last beam an obstacle is taken to end.

    It fills the sector of a beam that sees all of it.  Between thin beams it ends anywhere up to
    the next one: half way is off by half of that, and where this is more than faces may be off,
    the end is taken so far that the obstacle does not reach beyond by more.
    """
    width_rad = beams.width_rad[hits]
    if beams.gap_rad == 0.0:
        return width_rad / 2.0
    off_rad = config.uncertainty_m / np.maximum(away_m, 1e-3)
    return np.maximum(width_rad / 2.0, width_rad - off_rad)


def _with_ends(
    points_m: FloatArray,
    away_m: FloatArray,
    beams: LevelledBeams,
    hits: IntArray,
    first: IntArray,
    last: IntArray,
    beside_rad: FloatArray,
) -> FloatArray:
    """Return the points of each group, and one beside each end."""
    parts = []
    aside = []
    for end, side in ((first, -1.0), (last, 1.0)):
        bearing_rad = beams.bearing_rad[hits[end]]
        edge_rad = bearing_rad + side * beside_rad[end]
        turned = np.stack(
            (np.cos(edge_rad) - np.cos(bearing_rad), np.sin(edge_rad) - np.sin(bearing_rad)), axis=1
        )
        aside.append(points_m[end] + away_m[end, None] * turned)
    for group, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        parts += [
            aside[0][group : group + 1],
            points_m[begin : end + 1],
            aside[1][group : group + 1],
        ]
    return np.concatenate(parts)


def _in_ned(points_m: FloatArray, pose: Pose) -> FloatArray:
    cosine, sine = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    turned = np.stack(
        (
            cosine * points_m[:, 0] - sine * points_m[:, 1],
            sine * points_m[:, 0] + cosine * points_m[:, 1],
        ),
        axis=1,
    )
    moved: FloatArray = turned + np.array(pose.position_ned_m[:2])
    return moved


def _dense(points_m: FloatArray, step_m: float) -> FloatArray:
    """Fill in points of a row that are farther apart than a step."""
    gaps_m = np.hypot(*np.diff(points_m, axis=0).T)
    pieces = np.maximum(np.ceil(gaps_m / step_m).astype(int), 1)
    gap = np.repeat(np.arange(pieces.size), pieces)
    done = np.arange(gap.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = (done / pieces[gap])[:, None]
    filled = points_m[gap] + share * (points_m[gap + 1] - points_m[gap])
    return np.concatenate((filled, points_m[-1:]))


def _by_cell(points_ned_m: FloatArray, cell_m: float) -> list[tuple[tuple[int, int], FloatArray]]:
    """Cut a row of points where it crosses a lattice; both sides get the middle between them.

    So boxes side by side touch: a cut leaves no gap.
    """
    cells = np.floor(points_ned_m / cell_m).astype(int)
    crossed = np.flatnonzero((np.diff(cells, axis=0) != 0).any(axis=1))
    middles = (points_ned_m[crossed] + points_ned_m[crossed + 1]) / 2.0
    found = []
    bounds = np.concatenate(([0], crossed + 1, [len(points_ned_m)]))
    for run in range(len(bounds) - 1):
        begin, end = int(bounds[run]), int(bounds[run + 1])
        piece = [points_ned_m[begin:end]]
        if run > 0:
            piece.append(middles[run - 1 : run])
        if run < len(middles):
            piece.append(middles[run : run + 1])
        north, east = cells[begin].tolist()
        found.append(((north, east), np.concatenate(piece)))
    return found
