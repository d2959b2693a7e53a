"""Groups of points, and the rectangles that enclose them, many at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray, IntArray

# Directions that are tried, anchored to the north, so that a vehicle that turns changes no box.
_DIRECTIONS: Final = 24
_THICKNESS_M: Final = 0.02  # of a face, at least
# Between a long thin box and a short thick one, this decides.
_MARGIN_M: Final = 0.1
_ROUND_OFF_M: Final = 1e-9


@dataclass(frozen=True, eq=False)
class FittedBoxes:
    """Rectangles, in local NED.

    Attributes:
        center_ned_m: (k, 2).
        size_m: (k, 2) along their own axes.
        yaw_rad: (k,) from north.
        bounds_ned_m: (k, 4), least and greatest north, least and greatest east of the points.
    """

    center_ned_m: FloatArray
    size_m: FloatArray
    yaw_rad: FloatArray
    bounds_ned_m: FloatArray


def fit_boxes(
    points_ned_m: FloatArray, starts: IntArray, beyond_max_m: float = math.inf
) -> FittedBoxes:
    """Return the smallest rectangle around each group of points, of some directions.

    Args:
        points_ned_m: (n, 2), group after group.
        starts: (k,) index of the first point of each group.
        beyond_max_m: corners may reach this far beyond the points, to the north and east: where
            there is nothing, successive rectangles of one obstacle need not agree.
    """
    yaw_rad = np.arange(_DIRECTIONS) * (math.pi / 2.0 / _DIRECTIONS)
    cosine, sine = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    north_m, east_m = points_ned_m[:, 0], points_ned_m[:, 1]
    along, across = cosine * north_m + sine * east_m, cosine * east_m - sine * north_m
    low = np.stack([np.minimum.reduceat(axis, starts, axis=1) for axis in (along, across)])
    high = np.stack([np.maximum.reduceat(axis, starts, axis=1) for axis in (along, across)])
    size, middle = high - low, (low + high) / 2.0
    center = np.stack(
        (cosine * middle[0] - sine * middle[1], sine * middle[0] + cosine * middle[1])
    )
    half = np.stack((cosine * size[0] + sine * size[1], sine * size[0] + cosine * size[1])) / 2.0
    # The first direction is that of the bounds themselves.
    beyond = np.maximum(low[:, :1] - center + half, center + half - high[:, :1]).max(axis=0)
    cost = (size[0] + _MARGIN_M) * (size[1] + _MARGIN_M)
    best = np.where(beyond <= beyond_max_m + _ROUND_OFF_M, cost, math.inf).argmin(axis=0)
    group = np.arange(starts.size)
    bounds = np.stack((low[0, 0], high[0, 0], low[1, 0], high[1, 0]), axis=1)
    size_m = np.maximum(size[:, best, group].T, _THICKNESS_M)
    return FittedBoxes(center[:, best, group].T, size_m, yaw_rad[best], bounds)
