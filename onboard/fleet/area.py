"""Areas of a site: north-aligned boxes, (N, 4) of north from, north to, east from, east to [m].

The order of the boxes is that in which they are flown.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.frames import FloatArray

Place = tuple[float, float]

# By how much more than body and errors reach about a place: a vehicle that rests wanders a little.
REST_SLACK_M: Final = 0.3
_ROUND_OFF_M: Final = 1e-6
# Distances by an autopilot's sphere may be too long by this share of those on WGS84.
_SPHERE_SHARE: Final = 0.007


def around(place_m: Place, reach_m: float) -> FloatArray:
    """Return the box around a place, (1, 4)."""
    north_m, east_m = place_m
    return np.array([[north_m - reach_m, north_m + reach_m, east_m - reach_m, east_m + reach_m]])


def along(start_m: Place, end_m: Place, reach_m: float, count: int) -> FloatArray:
    """Return boxes around the equal pieces of a straight way, (count, 4)."""
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    places = np.asarray(start_m) + share * (np.asarray(end_m) - np.asarray(start_m))
    low = np.minimum(places[:-1], places[1:]) - reach_m
    high = np.maximum(places[:-1], places[1:]) + reach_m
    boxes: FloatArray = np.column_stack((low[:, 0], high[:, 0], low[:, 1], high[:, 1]))
    return boxes


def meet(one_m: FloatArray, other_m: FloatArray) -> bool:
    """Tell whether two areas share a point; (N, 4) and (M, 4)."""
    return bool(meeting(one_m, other_m).any())


def meeting(one_m: FloatArray, other_m: FloatArray) -> NDArray[np.bool_]:
    """Tell of each box of an area whether it shares a point with another area, (N,) of bool."""
    one, other = one_m[:, None, :], other_m[None, :, :]
    shared = (
        (one[..., 0] <= other[..., 1])
        & (other[..., 0] <= one[..., 1])
        & (one[..., 2] <= other[..., 3])
        & (other[..., 2] <= one[..., 3])
    )
    return np.asarray(shared.any(axis=1))


def is_proper(area_m: FloatArray) -> bool:
    """Tell whether all boxes are finite and none ends before it begins; others meet nothing."""
    ends_fit = (area_m[:, 0] <= area_m[:, 1]) & (area_m[:, 2] <= area_m[:, 3])
    return bool(np.isfinite(area_m).all() and ends_fit.all())


def holds(area_m: FloatArray, box_m: FloatArray) -> bool:
    """Tell whether one box of an area holds another box, (1, 4), but for round-off."""
    low, high = area_m[:, 0::2] - _ROUND_OFF_M, area_m[:, 1::2] + _ROUND_OFF_M
    inside = (low <= box_m[:, 0::2]) & (box_m[:, 1::2] <= high)
    return bool(inside.all(axis=1).any())


def within(area_m: FloatArray, box_m: FloatArray) -> FloatArray:
    """Return the part of an area that lies in a box, (1, 4); the box itself if one holds it."""
    if holds(area_m, box_m):
        return box_m
    met_m = area_m[meeting(area_m, box_m)]
    cut_m = np.empty_like(met_m)
    cut_m[:, 0::2] = np.maximum(met_m[:, 0::2], box_m[:, 0::2])
    cut_m[:, 1::2] = np.minimum(met_m[:, 1::2], box_m[:, 1::2])
    return cut_m


def grown(area_m: FloatArray, more_m: float) -> FloatArray:
    """Return an area with each box larger on all sides; smaller, without what vanishes, if < 0."""
    boxes_m = area_m + np.array((-more_m, more_m, -more_m, more_m))
    whole = (boxes_m[:, 0] <= boxes_m[:, 1]) & (boxes_m[:, 2] <= boxes_m[:, 3])
    left_m: FloatArray = boxes_m[whole]
    return left_m


def distance_m(area_m: FloatArray, place_m: Place) -> float:
    """Return how far a place is from an area; 0 inside, infinite of an empty area."""
    north_m, east_m = place_m
    beside_n = np.maximum(np.maximum(area_m[:, 0] - north_m, north_m - area_m[:, 1]), 0.0)
    beside_e = np.maximum(np.maximum(area_m[:, 2] - east_m, east_m - area_m[:, 3]), 0.0)
    return float(np.hypot(beside_n, beside_e).min(initial=math.inf))


def nearer_m(area_m: FloatArray, place_m: Place, more_m: float = 0.0) -> float:
    """Return how far a place is at least on the Earth from an area, and that much more."""
    return (distance_m(area_m, place_m) + more_m) * (1.0 - _SPHERE_SHARE)
