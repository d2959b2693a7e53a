"""What one frame of one sensor shows to be free of obstacles.

With the sensor at p, its face error e, and pose error e_p and heading error eps of the frame
besides, a point q is seen free if every q' within e_p + eps |q - p| of it (box norm) is within
range, within the view, and the segment [p, q'] meets no reported box grown by e (two-tier theory,
C1 as corrected).  The first obstacle point on such a segment would be in range and in view with an
open line of sight, so it would lie in a grown box: there is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray

BoolArray = NDArray[np.bool_]
_Floats = NDArray[np.floating[Any]]

# In a crowd of more boxes within range, lines of sight are not computed: the frame shows nothing.
BOXES_MAX: Final = 256
# Of single precision at the distances of a sensor.
_ROUND_OFF_M: Final = 1e-4
_BIN_RAD: Final = math.radians(0.5)
_BINS: Final = math.ceil(2.0 * math.pi / _BIN_RAD)
_EDGES_RAD: Final = np.linspace(-math.pi, math.pi, _BINS + 1)
# Of a number of bins, the power of two that it holds.
_LEVEL_OF_WIDTH: Final = np.array([max(width, 1).bit_length() - 1 for width in range(_BINS + 1)])


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
        placing_error_m: how much of the faces' error an error of that position may be, at most: it
            moves the edges of the view, but not boxes against lines of sight, since both move.
        heading_error_rad: eps, of the heading at the stamp, likewise.
        free_range_m: for equal bearing bins from left to right, how far the sensor saw nothing;
            0 where it does not know; empty if the sensor gives none.
        scan_half_view_rad: half of the view that these bins divide.
        blind_m: nearer than this the frame shows nothing (`onboard.perception.heights`).
    """

    position_leg_m: tuple[float, float]
    heading_leg_rad: float
    half_view_rad: float
    range_m: float
    boxes: Sequence[Box]
    face_error_m: float
    pose_error_m: float = 0.0
    placing_error_m: float = 0.0
    heading_error_rad: float = 0.0
    free_range_m: tuple[float, ...] = ()
    scan_half_view_rad: float = math.pi
    blind_m: float = 0.0


def seen_free(view: View, x_m: FloatArray, y_m: FloatArray, cell_m: float) -> BoolArray:
    """Tell for each cell centre whether the frame shows the whole cell, errors included.

    Args:
        view: the frame.
        x_m: of the centres, leg frame.
        y_m: likewise.
        cell_m: edge of a cell.
    """
    return seen_past(view, (view.boxes,), x_m, y_m, cell_m)[0]


def seen_past(
    view: View,
    blocking: Sequence[Sequence[Box]],
    x_m: FloatArray,
    y_m: FloatArray,
    cell_m: float,
) -> list[BoolArray]:
    """Tell the same for each of several sets of boxes, as if a frame had reported only those.

    Args:
        view: the frame; its own boxes do not count.
        blocking: the sets.
        x_m: of the centres, leg frame.
        y_m: likewise.
        cell_m: edge of a cell.
    """
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
    # Where the sensor is, less where it is said to be.
    astray_m = view.pose_error_m + view.placing_error_m
    seen: BoolArray = beyond_m <= view.range_m - max(view.face_error_m, view.placing_error_m)
    seen &= distance_m - radius_m > astray_m + view.blind_m + _ROUND_OFF_M
    picked = np.flatnonzero(seen)
    if not picked.size:
        return [seen for _ in blocking]
    inside, from_rad, to_rad = _bearings(
        view, dx_m[picked], dy_m[picked], distance_m[picked], radius_m[picked]
    )
    beyond_m, found = beyond_m[picked], []
    for boxes in blocking:
        shown = inside
        if (profile := _depth_profile(replace(view, boxes=boxes))) is not None:
            shown = inside & (beyond_m <= profile.least(from_rad, to_rad))
        found.append(np.zeros_like(seen))
        found[-1][picked] = shown
    return found


def _bearings(
    view: View, dx_m: _Floats, dy_m: _Floats, distance_m: _Floats, radius_m: _Floats
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which discs a view holds, and between which bearings from its axis each lies."""
    astray_m = view.pose_error_m + view.placing_error_m
    cosine, sine = math.cos(view.heading_leg_rad), math.sin(view.heading_leg_rad)
    angle_rad = np.arctan2(cosine * dy_m - sine * dx_m, cosine * dx_m + sine * dy_m)
    # The half width that a cell takes of the view is asin(u) <= u / sqrt(1 - u^2), u = radius / d.
    width_rad = radius_m / np.sqrt((distance_m - radius_m) * (distance_m + radius_m)) + 1e-5
    # Nearer cells, which would take up more of the view, belong to the vehicle itself.
    inside = width_rad < math.pi / 2.0
    width_rad = np.minimum(width_rad, math.pi / 2.0)
    if view.half_view_rad < math.pi:
        shy_rad = astray_m / np.sqrt((distance_m - radius_m - astray_m) * (distance_m - radius_m))
        limit_rad = view.half_view_rad - view.heading_error_rad - shy_rad
        inside &= np.abs(angle_rad) + width_rad <= limit_rad
    return inside, angle_rad - width_rad, angle_rad + width_rad


class _Profile:
    """Least open distance over intervals of bearing; bins over the full circle, wrapped."""

    def __init__(self, depth_m: FloatArray) -> None:
        self._depth_m = depth_m

    def _levels(self, count: int) -> FloatArray:
        """Return the least of 1, 2, 4 ... bins from each bin on, of the circle three times over."""
        bins = self._depth_m.size
        levels = np.empty((count, 3 * bins))
        levels[0].reshape(3, bins)[:] = self._depth_m
        for number in range(1, count):
            width, last, level = 1 << number - 1, levels[number - 1], levels[number]
            np.minimum(last[:-width], last[width:], out=level[:-width])
            level[-width:] = last[-width:]
        return levels

    def least(self, from_rad: FloatArray, to_rad: FloatArray) -> FloatArray:
        """Return the least depth between bearings, both within [-2 pi, 2 pi]."""
        bins = self._depth_m.size
        scale = bins / (2.0 * math.pi)
        first = np.floor((from_rad + math.pi) * scale).astype(int) + bins
        last = np.floor((to_rad + math.pi) * scale).astype(int) + bins
        width = np.minimum(np.maximum(last - first + 1, 1), bins)
        level = _LEVEL_OF_WIDTH[width]
        # Intervals are narrow mostly, and need few levels.
        table, row = self._levels(int(level.max()) + 1).ravel(), level * (3 * bins)
        one, other = table[row + first], table[row + (last - (1 << level) + 1)]
        least: FloatArray = np.minimum(one, other)
        return least


def _depth_profile(view: View) -> _Profile | None:
    """How far the line of sight is open at least, per bin of bearing from the sensor's axis.

    None if nothing is said to be in its way.
    """
    if not view.boxes and not view.free_range_m:
        return None
    depth_m = np.full(_BINS, math.inf)
    if view.boxes:
        _shade(depth_m, _EDGES_RAD, view)
    if view.free_range_m:
        _limit_to_scan(depth_m, _EDGES_RAD, view)
    return _Profile(depth_m)


def _shade(depth_m: FloatArray, edges_rad: FloatArray, view: View) -> None:
    """Lower the depth to every box grown by the face error, at every bearing that it covers."""
    (x_m, y_m), e = view.position_leg_m, view.face_error_m
    faces = np.array([(b.x_min_m, b.y_min_m, b.x_max_m, b.y_max_m) for b in view.boxes])
    low = faces[:, :2] - (x_m + e, y_m + e)
    high = faces[:, 2:] - (x_m - e, y_m - e)
    nearest = np.minimum(np.maximum(0.0, low), high)
    nearest_m = np.hypot(nearest[:, 0], nearest[:, 1])
    near = nearest_m <= view.range_m
    if not near.any():
        return
    # A sensor inside a grown box, or one in a crowd, shows nothing.
    if nearest_m.min() <= 0.0 or np.count_nonzero(near) > BOXES_MAX:
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
    xs_m = np.concatenate((low[:, 0], low[:, 0], high[:, 0], high[:, 0], nearest[:, 0]))
    ys_m = np.concatenate((low[:, 1], high[:, 1], low[:, 1], high[:, 1], nearest[:, 1]))
    angle_rad = np.arctan2(ys_m, xs_m) - view.heading_leg_rad
    at = np.floor((angle_rad + math.pi) / (2.0 * math.pi) * depth_m.size).astype(int)
    points_m = np.hypot(xs_m, ys_m)
    around = np.concatenate((at - 1, at, at + 1)) % depth_m.size
    np.minimum.at(depth_m, around, np.concatenate((points_m, points_m, points_m)))


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
    count, half_rad = free_m.size, view.scan_half_view_rad
    scale = count / (2.0 * half_rad)
    first = np.floor((edges_rad[:-1] + half_rad) * scale + 1e-9).astype(int)
    last = np.ceil((edges_rad[1:] + half_rad) * scale - 1e-9).astype(int) - 1
    padded = np.concatenate(([0.0], free_m, [0.0]))  # outside the view nothing is known
    for index in range(int((last - first).max()) + 1):
        within = np.minimum(first + index, last)
        np.minimum(depth_m, padded[np.clip(within, -1, count) + 1], out=depth_m)
