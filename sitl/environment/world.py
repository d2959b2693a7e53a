"""Ground truth: distance of the vehicle from the obstacles, and collisions."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.files.obstacle_field import FloatArray, ObstacleField

IndexArray = NDArray[np.intp]


def distance_to_box_m(
    point_ned_m: tuple[float, float],
    center_ned_m: FloatArray,
    half_size_m: FloatArray,
    yaw_rad: FloatArray,
) -> FloatArray:
    """Signed distance of one point to N boxes, negative inside; (N, 2), (N, 2), (N,) -> (N,)."""
    offset = np.asarray(point_ned_m) - center_ned_m
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    along = np.abs(cosine * offset[:, 0] + sine * offset[:, 1]) - half_size_m[:, 0]
    across = np.abs(cosine * offset[:, 1] - sine * offset[:, 0]) - half_size_m[:, 1]
    outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    distance: FloatArray = outside + np.minimum(np.maximum(along, across), 0.0)
    return distance


_SLOPE_STEP_M = 0.01


class Neighbourhood:
    """Find the obstacles near a slowly moving point without searching the field each time.

    A full search is made once; its result, taken a margin wider than asked, stays valid until the
    point has moved by that margin.
    """

    def __init__(self, field: ObstacleField, margin_m: float = 5.0) -> None:
        self._field = field
        self._margin_m = margin_m
        self._anchor_ned_m = (math.inf, math.inf)
        self._reach_m = 0.0
        self._near = np.empty(0, dtype=np.intp)
        self._nearest_m = math.inf

    def within(self, point_ned_m: tuple[float, float], reach_m: float) -> IndexArray:
        """Indices of a superset of the obstacles within ``reach_m`` of the point, ascending."""
        moved_m = math.dist(point_ned_m, self._anchor_ned_m)
        if moved_m > self._margin_m or reach_m > self._reach_m:
            self._search(point_ned_m, reach_m)
        return self._near

    def nearest(self, point_ned_m: tuple[float, float]) -> IndexArray:
        """Indices among which the nearest obstacle is; empty only in an empty field."""
        moved_m = math.dist(point_ned_m, self._anchor_ned_m)
        if moved_m > self._margin_m or self._nearest_m + self._margin_m > self._reach_m:
            self._search(point_ned_m, None)
        return self._near

    def _search(self, point_ned_m: tuple[float, float], reach_m: float | None) -> None:
        field = self._field
        distance_m = distance_to_box_m(
            point_ned_m, field.center_ned_m, field.half_size_m, field.yaw_rad
        )
        self._nearest_m = float(distance_m.min(initial=math.inf))
        # The nearest box from any point at most one margin away lies within this reach of it.
        self._reach_m = self._nearest_m + self._margin_m if reach_m is None else reach_m
        self._near = np.flatnonzero(distance_m <= self._reach_m + self._margin_m)
        self._anchor_ned_m = point_ned_m


class World:
    """A disc of the vehicle's radius among pillars: clearance and collisions.

    Attributes:
        clearance_min_m: smallest clearance so far.
        collisions: how often contact with the obstacles began.
    """

    def __init__(self, field: ObstacleField, radius_m: float) -> None:
        self.field = field
        self.radius_m = radius_m
        self.clearance_min_m = math.inf
        self.collisions = 0
        self._here = self._evaluated_at = (math.inf, math.inf)
        self._evaluated_m = math.inf
        self._neighbourhood = Neighbourhood(field)
        self._near: IndexArray | None = None
        self._boxes: list[_Box] = []

    @property
    def clearance_m(self) -> float:
        """Centre to nearest obstacle face, less the radius; ``inf`` in open space."""
        return (
            self._evaluated_m
            if self._here == self._evaluated_at
            else self.clearance_at_m(self._here)
        )

    def observe(self, position_ned_m: tuple[float, float, float]) -> None:
        """Evaluate the clearance here, and half-way from the previous position."""
        before, self._here = self._here, (position_ned_m[0], position_ned_m[1])
        # Clearance changes by no more than the distance flown, so most calls need no evaluation.
        at_least_m = self._evaluated_m - math.dist(self._here, self._evaluated_at)
        if at_least_m > max(self.clearance_min_m, 0.0):
            return
        if math.isfinite(before[0]):
            (north_m, east_m), (before_north_m, before_east_m) = self._here, before
            self._evaluate((0.5 * (before_north_m + north_m), 0.5 * (before_east_m + east_m)))
        self._evaluate(self._here)

    def _evaluate(self, point_ned_m: tuple[float, float]) -> None:
        was_in_collision = self._evaluated_m < 0.0
        self._evaluated_m, self._evaluated_at = self.clearance_at_m(point_ned_m), point_ned_m
        self.clearance_min_m = min(self.clearance_min_m, self._evaluated_m)
        if self._evaluated_m < 0.0 and not was_in_collision:
            self.collisions += 1

    def toward_nearest(self, position_ned_m: tuple[float, float, float]) -> tuple[float, float]:
        """Unit vector (north, east) towards the nearest face; zero in open space."""
        north_m, east_m, _ = position_ned_m
        slope_north, slope_east = (
            self.clearance_at_m((north_m - step_north_m, east_m - step_east_m))
            - self.clearance_at_m((north_m + step_north_m, east_m + step_east_m))
            for step_north_m, step_east_m in ((_SLOPE_STEP_M, 0.0), (0.0, _SLOPE_STEP_M))
        )
        length = math.hypot(slope_north, slope_east)
        if not 0.0 < length < math.inf:
            return 0.0, 0.0
        return slope_north / length, slope_east / length

    def clearance_at_m(self, point_ned_m: tuple[float, float]) -> float:
        """Clearance of a vehicle centred on the point (north, east)."""
        near = self._neighbourhood.nearest(point_ned_m)
        if near is not self._near:
            self._near, self._boxes = near, _boxes(self.field, near)
        return _nearest_m(point_ned_m, self._boxes) - self.radius_m


class _Box(NamedTuple):
    """One box of the field as plain floats, which are faster than arrays for a few of them."""

    north_m: float
    east_m: float
    half_along_m: float
    half_across_m: float
    cosine: float
    sine: float
    reach_m: float


def _boxes(field: ObstacleField, indices: IndexArray) -> list[_Box]:
    columns = np.column_stack(
        (
            field.center_ned_m[indices],
            field.half_size_m[indices],
            np.cos(field.yaw_rad[indices]),
            np.sin(field.yaw_rad[indices]),
            np.hypot(*field.half_size_m[indices].T),
        )
    )
    return [_Box(*row) for row in columns.tolist()]


def _nearest_m(point_ned_m: tuple[float, float], boxes: list[_Box]) -> float:
    """Signed distance to the nearest box, as :func:`distance_to_box_m`; ``inf``."""
    nearest_m = math.inf
    for box in boxes:
        north_m, east_m = point_ned_m[0] - box.north_m, point_ned_m[1] - box.east_m
        if math.hypot(north_m, east_m) - box.reach_m > nearest_m:
            continue  # not even a corner is that near
        along_m = abs(box.cosine * north_m + box.sine * east_m) - box.half_along_m
        across_m = abs(box.cosine * east_m - box.sine * north_m) - box.half_across_m
        outside_m = math.hypot(max(along_m, 0.0), max(across_m, 0.0))
        nearest_m = min(nearest_m, outside_m + min(max(along_m, across_m), 0.0))
    return nearest_m
