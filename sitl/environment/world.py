"""Ground truth: distance of the vehicle from the obstacles, and collisions."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

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


# Farther from what has a top or a bottom nothing is looked for.
_REACH_M: Final = 30.0


class World:
    """An upright cylinder, the vehicle as it tilts, among obstacles: clearance and collisions.

    Args:
        field: the obstacles.
        radius_m: of the vehicle around its centre, rotors included.
        half_height_m: above and below its centre, level.

    Attributes:
        clearance_min_m: smallest clearance so far.
        collisions: how often contact with the obstacles began.
    """

    def __init__(self, field: ObstacleField, radius_m: float, half_height_m: float = 0.0) -> None:
        self.field = field
        self.radius_m = radius_m
        self._half_height_m = half_height_m
        self.clearance_min_m = math.inf
        self.collisions = 0
        self._here = self._evaluated_at = Place(math.inf, math.inf)
        self._evaluated_m = math.inf
        self._neighbourhood = Neighbourhood(field)
        self._near: IndexArray | None = None
        self._boxes: list[_Box] = []

    @property
    def clearance_m(self) -> float:
        """From the vehicle's surface to the nearest obstacle; ``inf`` in open space."""
        return (
            self._evaluated_m if self._here == self._evaluated_at else self._clearance_m(self._here)
        )

    def rise_m(self, tilt_rad: float) -> float:
        """Return how far a tilted vehicle reaches above and below its centre."""
        return self._half_height_m + self.radius_m * abs(math.sin(tilt_rad))

    def observe(self, position_ned_m: tuple[float, float, float], tilt_rad: float = 0.0) -> None:
        """Evaluate the clearance here, and half-way from the previous position."""
        rise_m = self.rise_m(tilt_rad)
        if self.field.down_m is None:  # among pillars only the plan matters
            position_ned_m, rise_m = (position_ned_m[0], position_ned_m[1], 0.0), 0.0
        before, self._here = self._here, Place(*position_ned_m, rise_m)
        # Clearance changes by no more than the distance flown, so most calls need no evaluation.
        at_least_m = self._evaluated_m - self._here.distance_m(self._evaluated_at)
        if at_least_m > max(self.clearance_min_m, 0.0):
            return
        if math.isfinite(before.north_m):
            self._evaluate(self._here.half_way_from(before))
        self._evaluate(self._here)

    def _evaluate(self, place: Place) -> None:
        was_in_collision = self._evaluated_m < 0.0
        self._evaluated_m, self._evaluated_at = self._clearance_m(place), place
        self.clearance_min_m = min(self.clearance_min_m, self._evaluated_m)
        if self._evaluated_m < 0.0 and not was_in_collision:
            self.collisions += 1

    def toward_nearest(self, position_ned_m: tuple[float, float, float]) -> tuple[float, float]:
        """Unit vector (north, east) towards the nearest face; zero in open space."""
        north_m, east_m, down_m = position_ned_m
        slope_north, slope_east = (
            self.clearance_at_m((north_m - step_north_m, east_m - step_east_m), down_m)
            - self.clearance_at_m((north_m + step_north_m, east_m + step_east_m), down_m)
            for step_north_m, step_east_m in ((_SLOPE_STEP_M, 0.0), (0.0, _SLOPE_STEP_M))
        )
        length = math.hypot(slope_north, slope_east)
        if not 0.0 < length < math.inf:
            return 0.0, 0.0
        return slope_north / length, slope_east / length

    def clearance_at_m(self, point_ned_m: tuple[float, float], down_m: float = 0.0) -> float:
        """Clearance of a level vehicle centred on a point (north, east) at a height."""
        return self._clearance_m(Place(*point_ned_m, down_m, self._half_height_m))

    def _clearance_m(self, place: Place) -> float:
        point_ned_m = (place.north_m, place.east_m)
        heights = self.field.down_m is not None
        # The nearest from above may be far below: a wider search, which ends somewhere.
        near = (
            self._neighbourhood.within(point_ned_m, _REACH_M)
            if heights
            else self._neighbourhood.nearest(point_ned_m)
        )
        if near is not self._near:
            self._near, self._boxes = near, _boxes(self.field, near)
        if heights:
            nearest_m = _nearest_apart_m(place, self._boxes, self.radius_m)
            return min(nearest_m, _REACH_M - self.radius_m)
        return _nearest_m(point_ned_m, self._boxes) - self.radius_m


class Place(NamedTuple):
    """Where the vehicle is: its centre in local NED, and how far it reaches above and below it."""

    north_m: float
    east_m: float
    down_m: float = 0.0
    rise_m: float = 0.0

    def distance_m(self, other: Place) -> float:
        """Return how far a point of the vehicle has moved at most."""
        moved_m = math.dist(self[:3], other[:3])
        return moved_m + abs(self.rise_m - other.rise_m)

    def half_way_from(self, other: Place) -> Place:
        """Return the place half-way from another."""
        return Place(*(0.5 * (one + two) for one, two in zip(other, self, strict=True)))


class _Box(NamedTuple):
    """One box of the field as plain floats, which are faster than arrays for a few of them."""

    north_m: float
    east_m: float
    half_along_m: float
    half_across_m: float
    cosine: float
    sine: float
    reach_m: float
    top_m: float
    bottom_m: float

    def plan_distance_m(self, north_m: float, east_m: float) -> float:
        """Signed distance of a point, seen from above."""
        north_m, east_m = north_m - self.north_m, east_m - self.east_m
        along_m = abs(self.cosine * north_m + self.sine * east_m) - self.half_along_m
        across_m = abs(self.cosine * east_m - self.sine * north_m) - self.half_across_m
        outside_m = math.hypot(max(along_m, 0.0), max(across_m, 0.0))
        return outside_m + min(max(along_m, across_m), 0.0)


def _boxes(field: ObstacleField, indices: IndexArray) -> list[_Box]:
    every = np.tile((-math.inf, math.inf), (len(field), 1))
    columns = np.column_stack(
        (
            field.center_ned_m[indices],
            field.half_size_m[indices],
            np.cos(field.yaw_rad[indices]),
            np.sin(field.yaw_rad[indices]),
            np.hypot(*field.half_size_m[indices].T),
            (every if field.down_m is None else field.down_m)[indices],
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
        nearest_m = min(nearest_m, box.plan_distance_m(*point_ned_m))
    return nearest_m


def _nearest_apart_m(place: Place, boxes: list[_Box], radius_m: float) -> float:
    """Signed distance of an upright cylinder from the nearest box; ``inf`` without any."""
    nearest_m, centre = math.inf, (place.north_m, place.east_m)
    highest_m, lowest_m = place.down_m - place.rise_m, place.down_m + place.rise_m
    for box in boxes:
        beside_m = box.plan_distance_m(*centre) - radius_m
        above_m = max(box.top_m - lowest_m, highest_m - box.bottom_m)
        apart_m = math.hypot(max(beside_m, 0.0), max(above_m, 0.0))
        nearest_m = min(nearest_m, apart_m + min(max(beside_m, above_m), 0.0))
    return nearest_m
