"""The space that has been seen free: the one set that every certified way to rest lies in.

A bounded grid of cells around the vehicle, in the leg frame and at one altitude.  A cell counts as
free only after several frames each showed that no obstacle can be in it; it never expires, since
obstacles stand still.  What no frame has shown is not free.

Of one frame (two-tier theory, C1 as corrected): with the sensor at p, its face error e, and pose
error e_p and heading error eps of the frame besides, a point q is seen free if every q' within
e_p + eps |q - p| of it (box norm) is within range, within the view, and the segment [p, q'] meets
no reported box grown by e.  The first obstacle point on such a segment would be in range and in
view with an open line of sight, so it would lie in a grown box: there is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.geometry.free_grid import FreeGrid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray

    BoolArray = NDArray[np.bool_]
    Counts = NDArray[np.uint8]

CELL_M: Final = 0.1
# The grid reaches this far from the vehicle on each side, at least.
REACH_M: Final = 16.0
# The grid follows the vehicle in steps of this, so that it moves seldom.
_STEP_CELLS: Final = 40
# Of single precision at the distances of a sensor.
_ROUND_OFF_M: Final = 1e-4
_BIN_RAD: Final = math.radians(0.5)


@dataclass(frozen=True)
class View:
    """One frame of one sensor, as far as it says what is free.

    Attributes:
        position_leg_m: of the sensor (x, y) at the stamp of the frame.
        heading_leg_rad: of the sensor's axis, from the leg towards its right.
        half_view_rad: half of the field of view, up to pi.
        range_m: within which the frame shows every obstacle.
        boxes: of all that the frame reports, in the leg frame.
        face_error_m: e, the error of a reported face.
        pose_error_m: e_p, of the position at the stamp, in addition to the faces' error.
        heading_error_rad: eps, of the heading at the stamp, likewise.
        free_range_m: for equal bearing bins from left to right, how far the sensor saw nothing;
            0 where it does not know; empty if the sensor gives none.
    """

    position_leg_m: tuple[float, float]
    heading_leg_rad: float
    half_view_rad: float
    range_m: float
    boxes: Sequence[Box]
    face_error_m: float
    pose_error_m: float = 0.0
    heading_error_rad: float = 0.0
    free_range_m: tuple[float, ...] = ()


class SeenFree:
    """The seen-free set around one vehicle.

    Args:
        frames_needed: K, frames that have to show a cell free; more than a tracker of the sensor
            needs to confirm an obstacle.
        reach_m: the grid reaches this far from the vehicle on each side, at least.
        cell_m: edge of a cell.
    """

    def __init__(
        self, *, frames_needed: int = 3, reach_m: float = REACH_M, cell_m: float = CELL_M
    ) -> None:
        self._needed, self._cell_m = frames_needed, cell_m
        self._half = math.ceil(reach_m / cell_m) + _STEP_CELLS
        self._corner = (-self._half, -self._half)
        self._counts = np.zeros((2 * self._half, 2 * self._half), np.uint8)
        self._half_width_m = math.inf
        self.version = 0

    def limit(self, half_width_m: float) -> None:
        """Never call free what is farther than this from the leg line: the mission's corridor."""
        self._half_width_m = half_width_m

    def void(self) -> None:
        """Forget everything: after an estimator reset, a change of altitude, a contradiction."""
        self._counts[:] = 0
        self.version += 1

    def centre_on(self, x_m: float, y_m: float) -> None:
        """Move the grid along with the vehicle; what leaves the grid is forgotten."""
        wanted = [
            round(value / self._cell_m / _STEP_CELLS) * _STEP_CELLS - self._half
            for value in (x_m, y_m)
        ]
        di, dj = wanted[0] - self._corner[0], wanted[1] - self._corner[1]
        if di or dj:
            self._counts = _shifted(self._counts, di, dj)
            self._corner = (wanted[0], wanted[1])
            self.version += 1

    def confirm(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Mark a disc as free: where the operator or a turn on the spot has shown it (A0)."""
        xs_m, ys_m = self._centres(slice(None), slice(None))
        inside = np.hypot(xs_m[:, None] - x_m, ys_m[None, :] - y_m) <= radius_m
        self._counts[inside] = self._needed
        self.version += 1

    def shift(self, x_m: float, y_m: float) -> None:
        """Shift the set with the map after a declared reset: by whole cells, then eroded by one."""
        cells = (round(x_m / self._cell_m), round(y_m / self._cell_m))
        self._counts = _shifted(self._counts, -cells[0], -cells[1])
        self._counts = _eroded(self._counts)
        self.version += 1

    def see(self, view: View) -> None:
        """Count a frame for each cell that it shows to be free."""
        window = self._window(view)
        if window is None:
            return
        rows, columns = window
        counts = self._counts[rows, columns]
        i, j = np.nonzero(counts < self._needed)
        if not i.size:
            return
        xs_m, ys_m = self._centres(rows, columns)
        seen = _seen(view, xs_m[i], ys_m[j], self._cell_m)
        counts[i[seen], j[seen]] += 1
        self.version += 1

    def contradicts(self, box: Box, face_error_m: float) -> bool:
        """Tell whether an obstacle is reported where all had been seen free.

        A face lies within the strip ``face +- e``, its ends within ``+- e`` of theirs: a strip that
        is wholly free cannot hold it.
        """
        grid, e = self.grid(), face_error_m
        x = (box.x_min_m - e, box.x_max_m + e)
        y = (box.y_min_m - e, box.y_max_m + e)
        return any(
            grid.is_free(*strip)
            for strip in (
                (box.x_min_m - e, box.x_min_m + e, *y),
                (box.x_max_m - e, box.x_max_m + e, *y),
                (*x, box.y_min_m - e, box.y_min_m + e),
                (*x, box.y_max_m - e, box.y_max_m + e),
            )
        )

    def grid(self) -> FreeGrid:
        """Return a snapshot for the certifier and the planner."""
        unknown = self._counts < self._needed
        if math.isfinite(self._half_width_m):
            _, ys_m = self._centres(slice(None), slice(None))
            unknown |= np.abs(ys_m)[None, :] + self._cell_m / 2.0 > self._half_width_m
        table = np.zeros((unknown.shape[0] + 1, unknown.shape[1] + 1), np.int32)
        np.cumsum(unknown, axis=0, dtype=np.int32, out=table[1:, 1:])
        np.cumsum(table[1:, 1:], axis=1, out=table[1:, 1:])
        corner_m = (self._corner[0] * self._cell_m, self._corner[1] * self._cell_m)
        return FreeGrid(corner_m, self._cell_m, table)

    def turned(self, origin_leg_m: tuple[float, float], turn_rad: float) -> SeenFree:
        """Return the set in the frame of another leg.

        Args:
            origin_leg_m: origin of the new leg, in this frame.
            turn_rad: heading of the new leg less that of this one.

        A cell is free there only if every cell here that its circumscribed square meets is.
        """
        new = SeenFree(
            frames_needed=self._needed,
            reach_m=(self._half - _STEP_CELLS) * self._cell_m,
            cell_m=self._cell_m,
        )
        cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
        xs_m, ys_m = new._centres(slice(None), slice(None))
        x_m = origin_leg_m[0] + cosine * xs_m[:, None] - sine * ys_m[None, :]
        y_m = origin_leg_m[1] + sine * xs_m[:, None] + cosine * ys_m[None, :]
        grid, half_m = self.grid(), self._cell_m / math.sqrt(2.0)
        new._counts[grid.are_free(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)] = (
            self._needed
        )
        return new

    def _centres(self, rows: slice, columns: slice) -> tuple[FloatArray, FloatArray]:
        size = 2 * self._half
        middles = np.arange(size, dtype=np.float64) + 0.5
        xs = (middles[rows] + self._corner[0]) * self._cell_m
        ys = (middles[columns] + self._corner[1]) * self._cell_m
        return xs, ys

    def _window(self, view: View) -> tuple[slice, slice] | None:
        """Return the part of the grid that a frame may show; None if there is none."""
        x_m, y_m = view.position_leg_m
        reach = view.range_m
        corners = [(x_m, y_m)]
        turns = np.linspace(-view.half_view_rad, view.half_view_rad, 9)
        for turn_rad in (view.heading_leg_rad + turns).tolist():
            # The chord between two of these rays lies inside the arc by less than 2 %.
            far = 1.02 * reach if view.half_view_rad < math.pi / 2.0 else 1.1 * reach
            corners.append((x_m + far * math.cos(turn_rad), y_m + far * math.sin(turn_rad)))
        slices = []
        for axis in (0, 1):
            values = [corner[axis] for corner in corners]
            first = math.floor(min(values) / self._cell_m) - self._corner[axis]
            last = math.ceil(max(values) / self._cell_m) - self._corner[axis]
            first, last = max(first, 0), min(last, 2 * self._half)
            if first >= last:
                return None
            slices.append(slice(first, last))
        return slices[0], slices[1]


def _seen(view: View, x_m: FloatArray, y_m: FloatArray, cell_m: float) -> BoolArray:
    """Tell for each cell centre whether the frame shows the whole cell, errors included."""
    # Single precision is off by micrometres here, which `_ROUND_OFF_M` covers, and twice as fast.
    dx_m = (x_m - view.position_leg_m[0]).astype(np.float32)
    dy_m = (y_m - view.position_leg_m[1]).astype(np.float32)
    distance_m = np.sqrt(dx_m * dx_m + dy_m * dy_m)
    half_cell_m = cell_m / 2.0
    # Half the diagonal of the cell grown by e_p + eps times its greatest distance, linear in it.
    grown_m = (
        half_cell_m + view.pose_error_m + view.heading_error_rad * math.sqrt(2.0) * half_cell_m
    )
    radius_m = math.sqrt(2.0) * (grown_m + view.heading_error_rad * distance_m) + _ROUND_OFF_M
    beyond_m = distance_m + radius_m
    seen: BoolArray = beyond_m <= view.range_m - view.face_error_m
    seen &= distance_m - radius_m > view.pose_error_m + _ROUND_OFF_M
    picked = np.flatnonzero(seen)
    if not picked.size:
        return seen
    dx_m, dy_m, distance_m = dx_m[picked], dy_m[picked], distance_m[picked]
    radius_m, beyond_m = radius_m[picked], beyond_m[picked]
    cosine, sine = math.cos(view.heading_leg_rad), math.sin(view.heading_leg_rad)
    angle_rad = np.arctan2(cosine * dy_m - sine * dx_m, cosine * dx_m + sine * dy_m)
    # The half width that a cell takes of the view is asin(u) <= u / sqrt(1 - u^2), u = radius / d.
    width_rad = radius_m / np.sqrt((distance_m - radius_m) * (distance_m + radius_m)) + 1e-5
    if view.half_view_rad < math.pi:
        shy_rad = view.pose_error_m / np.sqrt(
            (distance_m - radius_m - view.pose_error_m) * (distance_m - radius_m)
        )
        limit_rad = view.half_view_rad - view.heading_error_rad - shy_rad
        inside = np.abs(angle_rad) + width_rad <= limit_rad
    else:
        inside = np.ones(picked.size, bool)
    profile = _depth_profile(view)
    inside &= beyond_m <= profile.least(angle_rad - width_rad, angle_rad + width_rad)
    seen[picked] = inside
    return seen


class _Profile:
    """Least open distance over intervals of bearing; bins over the full circle, wrapped."""

    def __init__(self, depth_m: FloatArray) -> None:
        self._count = depth_m.size
        levels = [np.concatenate((depth_m, depth_m, depth_m))]
        width = 1
        while 2 * width <= self._count:
            last = levels[-1]
            level = last.copy()
            level[:-width] = np.minimum(last[:-width], last[width:])
            levels.append(level)
            width *= 2
        self._levels = np.stack(levels)

    def least(self, from_rad: FloatArray, to_rad: FloatArray) -> FloatArray:
        """Return the least depth between bearings, both within [-2 pi, 2 pi]."""
        scale = self._count / (2.0 * math.pi)
        first = np.floor((from_rad + math.pi) * scale).astype(int) + self._count
        last = np.floor((to_rad + math.pi) * scale).astype(int) + self._count
        level = np.log2(np.maximum(last - first + 1, 1)).astype(int)
        level = np.minimum(level, len(self._levels) - 1)
        one, other = self._levels[level, first], self._levels[level, last - (1 << level) + 1]
        least: FloatArray = np.minimum(one, other)
        return least


def _depth_profile(view: View) -> _Profile:
    """How far the line of sight is open at least, per bin of bearing from the sensor's axis."""
    count = math.ceil(2.0 * math.pi / _BIN_RAD)
    edges_rad = np.linspace(-math.pi, math.pi, count + 1)
    depth_m = np.full(count, math.inf)
    if view.boxes:
        _shade(depth_m, edges_rad, view)
    if view.free_range_m:
        _limit_to_scan(depth_m, edges_rad, view)
    return _Profile(depth_m)


def _shade(depth_m: FloatArray, edges_rad: FloatArray, view: View) -> None:
    """Lower the depth to every box grown by the face error, at every bearing that it covers."""
    (x_m, y_m), e = view.position_leg_m, view.face_error_m
    faces = np.array([(b.x_min_m, b.y_min_m, b.x_max_m, b.y_max_m) for b in view.boxes])
    low = faces[:, :2] - (x_m + e, y_m + e)
    high = faces[:, 2:] - (x_m - e, y_m - e)
    nearest = np.clip(0.0, low, high)
    nearest_m = np.hypot(nearest[:, 0], nearest[:, 1])
    near = nearest_m <= view.range_m
    if not near.any():
        return
    if nearest_m.min() <= 0.0:  # the sensor is inside a grown box: the frame shows nothing
        depth_m[:] = 0.0
        return
    low, high, nearest = low[near], high[near], nearest[near]
    used = np.flatnonzero(np.abs(edges_rad) <= view.half_view_rad + 2.0 * _BIN_RAD)
    ray_m = _ray_distance(edges_rad[used] + view.heading_leg_rad, low, high).min(axis=0)
    # Along one face the distance is least at an end of the interval or at the face's foot point:
    # the corners and the nearest point are given to the bins around them.  A corner behind the
    # faces lowers its bin too, which is on the safe side.
    np.minimum(depth_m[used[:-1]], np.minimum(ray_m[:-1], ray_m[1:]), out=ray_m[:-1])
    depth_m[used[:-1]] = ray_m[:-1]
    corners = [
        np.stack((x, y), axis=1) for x in (low[:, 0], high[:, 0]) for y in (low[:, 1], high[:, 1])
    ]
    points = np.concatenate((*corners, nearest))
    angle_rad = np.arctan2(points[:, 1], points[:, 0]) - view.heading_leg_rad
    at = np.floor((angle_rad + math.pi) / (2.0 * math.pi) * depth_m.size).astype(int)
    points_m = np.hypot(points[:, 0], points[:, 1])
    for offset in (-1, 0, 1):
        np.minimum.at(depth_m, (at + offset) % depth_m.size, points_m)


def _ray_distance(rays_rad: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Distance along rays from the origin to boxes, (boxes, rays); infinite for a miss."""
    # A ray along an axis is turned by far less than a cell, so that no division is by zero.
    directions = [np.where(np.abs(d) < 1e-9, 1e-9, d) for d in (np.cos(rays_rad), np.sin(rays_rad))]
    near, far = [], []
    for axis, direction in enumerate(directions):
        one, other = low[:, axis, None] / direction, high[:, axis, None] / direction
        near.append(np.minimum(one, other))
        far.append(np.maximum(one, other))
    enter, leave = np.maximum(*near), np.minimum(*far)
    distance_m: FloatArray = np.where(
        (enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), math.inf
    )
    return distance_m


def _limit_to_scan(depth_m: FloatArray, edges_rad: FloatArray, view: View) -> None:
    """Take a bin for open only as far as the scan says so, at every bearing in it."""
    free_m = np.maximum(np.asarray(view.free_range_m) - view.face_error_m, 0.0)
    count, half_rad = free_m.size, view.half_view_rad
    scale = count / (2.0 * half_rad)
    first = np.floor((edges_rad[:-1] + half_rad) * scale + 1e-9).astype(int)
    last = np.ceil((edges_rad[1:] + half_rad) * scale - 1e-9).astype(int) - 1
    padded = np.concatenate(([0.0], free_m, [0.0]))  # outside the view nothing is known
    for index in range(int((last - first).max()) + 1):
        within = np.minimum(first + index, last)
        np.minimum(depth_m, padded[np.clip(within, -1, count) + 1], out=depth_m)


def _shifted(counts: Counts, di: int, dj: int) -> Counts:
    """Return the window moved by whole cells; new cells are unknown."""
    moved = np.zeros_like(counts)
    size = counts.shape[0]
    if abs(di) >= size or abs(dj) >= size:
        return moved
    source = counts[max(di, 0) : size + min(di, 0), max(dj, 0) : size + min(dj, 0)]
    moved[max(-di, 0) : size + min(-di, 0), max(-dj, 0) : size + min(-dj, 0)] = source
    return moved


def _eroded(counts: Counts) -> Counts:
    """Return each cell's least count among itself and its eight neighbours."""
    padded = np.pad(counts, 1)
    rows = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    least: Counts = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return least
