"""How far beams show free space, by bearing from the vehicle's centre.

A sensor beside the centre sees from elsewhere than the centre.  What is declared free around the
centre has to lie in what the beams crossed: each bin of bearing is followed outward in rings, as
long as every beam that may meet the ring's part of the bin reaches beyond it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.frames import FloatArray, IntArray
from onboard.perception.scan.levelled_beams import BoolArray, LevelledBeams

BIN_RAD: Final = math.radians(0.5)
_BINS: Final = round(2.0 * math.pi / BIN_RAD)
_RINGS: Final = 10
# A sensor that is nearer to the centre than this is in it.
_CENTRED_M: Final = 1e-3
_ROUND_OFF_M: Final = 1e-3
# Beams that touch are not to leave a gap by rounding.
_ROUND_OFF_BINS: Final = 1e-6


class FreeView(NamedTuple):
    """What a scan shows around the vehicle's centre.

    Attributes:
        half_view_rad: the beams cover all bearings up to this on both sides of the nose.
        free_m: by equal bins across that view, from left to right; 0 where nothing is known.
        range_m: how far obstacles would have been seen in all of it.
    """

    half_view_rad: float
    free_m: FloatArray
    range_m: float


def free_view(
    beams: LevelledBeams, *, range_m: float, view_max_rad: float, own_radius_m: float
) -> FreeView | None:
    """Return what beams show to be free; None if they do not cover the nose.

    Args:
        beams: around the sensor.
        range_m: of the sensor.
        view_max_rad: full opening angle to count on, at most.
        own_radius_m: nearer to the centre than this is only the vehicle itself.
    """
    reach_m = _least(*_spans(beams.bearing_rad, beams.width_rad), beams.reach_m)
    spans = _spans(beams.bearing_rad, beams.width_rad + 2.0 * beams.gap_rad)
    open_m = _least(*spans, np.minimum(beams.free_m, range_m))
    met = np.isfinite(open_m)
    # A bin at the edge of the view is covered in part only.
    covered = met & np.roll(met, 1) & np.roll(met, -1)
    count = min(_bins_each_side(covered), math.floor(view_max_rad / 2.0 / BIN_RAD + 1e-9))
    if count == 0:
        return None
    nose = _BINS // 2
    view = slice(nose - count, nose + count)
    open_m = np.where(covered, open_m, 0.0)
    if math.hypot(*beams.sensor_m) > _CENTRED_M or beams.moved_m > _CENTRED_M:
        free_m = _from_centre(open_m, view, beams, range_m, own_radius_m)
    else:
        free_m = open_m[view]
    seen_m = min(float(reach_m[view].min()), range_m)
    return FreeView(count * BIN_RAD, free_m, seen_m)


def _spans(bearing_rad: FloatArray, width_rad: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first and the last bin that each beam meets, counted from behind."""
    begin = (bearing_rad - width_rad / 2.0 + math.pi) / BIN_RAD
    end = (bearing_rad + width_rad / 2.0 + math.pi) / BIN_RAD
    first = np.floor(begin + _ROUND_OFF_BINS).astype(int)
    return first, np.maximum(np.ceil(end - _ROUND_OFF_BINS).astype(int) - 1, first)


def _least(first: IntArray, last: IntArray, value: FloatArray) -> FloatArray:
    """Return the least value of the beams that meet each bin; infinite where there is none."""
    least = np.full(_BINS, math.inf)
    for step in range(min(int((last - first).max(initial=0)) + 1, _BINS)):
        np.minimum.at(least, np.minimum(first + step, last) % _BINS, value)
    return least


def _bins_each_side(covered: BoolArray) -> int:
    """Return how many bins on each side of the nose are covered without a gap."""
    if covered.all():
        return _BINS // 2
    nose = _BINS // 2
    right, left = covered[nose:], covered[:nose][::-1]
    both = right & left
    return int(both.argmin()) if not both.all() else nose


def _from_centre(
    open_m: FloatArray,
    view: slice,
    beams: LevelledBeams,
    range_m: float,
    own_radius_m: float,
) -> FloatArray:
    """Return the open distance from the centre for the bins of a view.

    A point at distance d from the sensor at its reference place is at most d + moved from where it
    was when it looked there, in a direction that differs by at most asin(moved / d).
    """
    edges = np.arange(view.start, view.stop + 1) * BIN_RAD - math.pi
    # The vehicle reaches at least as far as its sensor.
    begin_m = max(own_radius_m, 1.05 * math.hypot(*beams.sensor_m), 0.05)
    if begin_m >= range_m:
        return np.zeros(view.stop - view.start)
    radii_m = begin_m * (range_m / begin_m) ** (np.arange(_RINGS + 1) / _RINGS)
    # Of each edge's points, seen from the sensor: along the edge, to its right, and how far turned.
    (x_m, y_m), cosine, sine = beams.sensor_m, np.cos(edges), np.sin(edges)
    along_m = radii_m - (x_m * cosine + y_m * sine)[:, None]
    aside_m = (x_m * sine - y_m * cosine)[:, None]
    away_m = np.hypot(along_m, aside_m)
    angle_rad = edges[:, None] + np.arctan2(aside_m, along_m)
    wider_rad = np.arcsin(np.minimum(beams.moved_m / away_m, 1.0)) if beams.moved_m else 0.0
    # Over a ring's part of a bin, bearing and distance are extreme in its corners.
    from_rad = _over_cells(np.minimum, angle_rad - wider_rad)
    to_rad = _over_cells(np.maximum, angle_rad + wider_rad)
    beyond_m = _over_cells(np.maximum, away_m - radii_m) + beams.moved_m + _ROUND_OFF_M
    reached_m = _least_between(open_m, from_rad, to_rad) - beyond_m
    passed = reached_m >= radii_m[1:]
    ring = np.where(passed.all(axis=1), _RINGS - 1, passed.argmin(axis=1))
    depth_m = np.minimum(reached_m[np.arange(ring.size), ring], radii_m[ring + 1])
    # A ring that is not open from its begin is not open at all, but those before it are.
    before_m = np.where(ring > 0, radii_m[ring], 0.0)
    return np.where(depth_m >= radii_m[ring], depth_m, before_m)


def _over_cells(extreme: np.ufunc, values: FloatArray) -> FloatArray:
    """Return the extreme of the four corners of each cell between edges and radii."""
    by_edge = extreme(values[:-1], values[1:])
    found: FloatArray = extreme(by_edge[:, :-1], by_edge[:, 1:])
    return found


def _least_between(open_m: FloatArray, from_rad: FloatArray, to_rad: FloatArray) -> FloatArray:
    """Return the least value over intervals of bearing; by minima over powers of two of bins."""
    first = ((from_rad + math.pi) / BIN_RAD + _BINS).astype(int)
    count = ((to_rad + math.pi) / BIN_RAD + _BINS).astype(int) - first + 1
    # An interval of all bearings begins anywhere.
    first, count = np.where(count > _BINS, _BINS, first), np.minimum(count, _BINS)
    levels = [np.concatenate((open_m, open_m, open_m))]
    while 2 ** len(levels) <= count.max(initial=1):
        last, width = levels[-1], 2 ** (len(levels) - 1)
        level = last.copy()
        level[:-width] = np.minimum(last[:-width], last[width:])
        levels.append(level)
    table = np.concatenate(levels)
    level_of = np.frexp(count.astype(np.float32))[1] - 1
    row = level_of * (3 * _BINS) + first
    least: FloatArray = np.minimum(table[row], table[row + count - (1 << level_of)])
    return least
