"""Which way to try: a field of distances to the goal over known boxes, and the path down it.

Unseen space counts as free here, since a guide promises nothing: where it leads into something, the
vehicle stops before it, looks, and the field changes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from scipy.ndimage import maximum_filter

from onboard.planning.corridor.memory import Memory
from onboard.planning.corridor.raster import (
    CELL_M,
    Axes,
    BoolArray,
    IntArray,
    Raster,
    Room,
    Ways,
    covered,
)

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Sequence

    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray

# The field covers this much around the vehicle.
AHEAD_M: Final = 14.0
BEHIND_M: Final = 10.0
ASIDE_M: Final = 10.0
# Beyond it the straight way counts; to leave it aside costs more, since a way that is known is
# better than one that may be, and to leave it behind is the last that is tried.
_BEYOND_SIDE_M: Final = 10.0
_BACKWARDS_M: Final = 100.0
# No way leads farther than this behind the start of the leg, or beyond its end.
_BEYOND_ENDS_M: Final = 10.0
# A way that has turned out to be longer than the straight one by more than this leads nowhere.
_DETOUR_MAX_M: Final = 500.0
# Beside a box: (distance beyond the margin, factor on the length of the way).  What it takes to see
# free costs up to 0.15 m of a gap, so that the nearest open shell is the last resort.
_SHELLS: Final = ((0.5, 1.5), (0.25, 3.0), (0.12, 10.0))
# Nearer than the wish for clearance; the field begins a little outside, for plans cut corners.
_WISH_FACTOR: Final = 6.0
_WISH_EDGE_M, _WISH_EDGE_FACTOR = 0.3, 1.5
# Where a plan stood and nothing certified: another gap is to be tried.
_PENALTY: Final = 8.0
_PENALTY_HALF_M: Final = 0.9
# The distance from where no way is known.
FAR_M: Final = 1e3
# Of the set that is seen free: a cell that a box takes a part of is not free, nor one that is so
# near to its face that the line of sight to the cell's corners may be shut.
_SEEN_CELL_M, _SIGHT_M = 0.1, 0.03
_ROUND_OFF_M: Final = 1e-6


class Passing(Protocol):
    """What is somewhere for a while."""

    def are_met(self, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """Tell of the places (n, m) at some x (n,) and y (m,) whether it may be there."""
        ...


class Guide:
    """Distances to a goal in a window, in the leg frame.

    Args:
        goal_leg_m: (x, y).
        margin_m: that boxes are grown by: radius, tracking error and face error.
        half_width_m: of the mission's corridor about the leg line; infinite for none.
        face_error_m: the part of the margin that the seen-free set keeps from a box.
        wish_m: distance that is preferred beyond the margin; no gap is closed by it.
    """

    def __init__(
        self,
        goal_leg_m: tuple[float, float],
        margin_m: float,
        half_width_m: float = math.inf,
        *,
        face_error_m: float = 0.0,
        wish_m: float = 0.0,
    ) -> None:
        self.goal_leg_m, self._margin_m, self._half_width_m = goal_leg_m, margin_m, half_width_m
        self._face_error_m, self._wish_m = face_error_m, wish_m
        self._shape = (round((AHEAD_M + BEHIND_M) / CELL_M), round(2.0 * ASIDE_M / CELL_M))
        self._raster = Raster(self._shape)
        self._corner_m = (0.0, 0.0)
        nowhere = np.full(self._shape, -1, np.int32)
        self._ways = Ways(np.full(self._shape, math.inf), nowhere)
        self._memory = Memory(self._shape)
        self._low_x_m, self._boxes = math.inf, 0
        self.penalized_leg_m: list[tuple[float, float]] = []

    def update(self, position_leg_m: tuple[float, float], boxes: Iterable[Box]) -> None:
        """Compute the field around a position."""
        for _ in self.updating(position_leg_m, boxes):
            pass

    def updating(
        self,
        position_leg_m: tuple[float, float],
        boxes: Iterable[Box],
        passing: Passing | None = None,
    ) -> Generator[None]:
        """Compute the field; yield between its slices, while the old field still serves.

        Args:
            position_leg_m: around which.
            boxes: what is known.
            passing: tells where something may be that will not be there for ever: it costs, but
                closes no way.
        """
        corner_m = self._corner(position_leg_m)
        if math.isinf(self._low_x_m):
            self._low_x_m = min(position_leg_m[0], 0.0, self.goal_leg_m[0]) - _BEYOND_ENDS_M
        known = list(boxes)
        if len(known) < self._boxes:
            self._memory.clear()  # what is gone must not close a way for ever
        self._boxes = len(known)
        room = self._room(self._axes(corner_m), known, passing)
        yield
        graph = self._raster.graph(room, self._exits(corner_m, room.cost))
        yield
        ways = self._raster.ways(graph)
        self._memory.add(self._index(corner_m), ways.left_m)
        self._corner_m, self._ways = corner_m, ways

    def distance_m(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return the way to the goal from each point; from a blocked cell, by the next open one."""
        i, j, inside = self._cells(x_m, y_m)
        values = np.where(inside, self._ways.left_m[i, j], FAR_M)
        for k in np.flatnonzero(~np.isfinite(values)).tolist():
            near = self._nearest_open((float(x_m[k]), float(y_m[k])))
            # Where the path from there begins: staying must not look cheaper than setting off.
            values[k] = FAR_M if near is None else min(self._ways.left_m[near] + 1.0, FAR_M)
        return values

    def path_leg_m(self, position_leg_m: tuple[float, float], length_m: float) -> FloatArray | None:
        """Descend from a position: points (k, 2), k of 2 or more; None where no way leads on."""
        start = self._nearest_open(position_leg_m)
        if start is None:
            return None
        points = [position_leg_m]
        count, rows = self._shape[1], self._ways.leads_to
        (i, j), walked_m = start, 0.0
        while True:
            points.append(self._point(i, j))
            walked_m += math.dist(points[-2], points[-1])
            onward = int(rows[i, j])
            if not 0 <= onward < rows.size or walked_m >= length_m:
                break
            i, j = divmod(onward, count)
        if math.dist(points[-1], self.goal_leg_m) <= 2.0 * CELL_M or i == self._row_ahead(
            self._corner_m
        ):
            points.append(self.goal_leg_m)
        path = np.array(points)
        steps_m = np.hypot(*np.diff(path, axis=0).T)
        path = path[np.concatenate(([True], steps_m > 1e-9))]
        return path if len(path) >= 2 else None

    def _corner(self, position_leg_m: tuple[float, float]) -> tuple[float, float]:
        """Return the corner of the window: most of it lies towards the goal, in the corridor."""
        x_m, y_m = position_leg_m
        back_m = BEHIND_M if self.goal_leg_m[0] >= x_m else AHEAD_M
        aside_m = max(self._half_width_m - ASIDE_M, 0.0)
        low_x, low_y = x_m - back_m, max(-aside_m, min(aside_m, y_m)) - ASIDE_M
        # On the goal's own raster, so that the goal is a cell's centre.
        return (
            self.goal_leg_m[0] + math.floor((low_x - self.goal_leg_m[0]) / CELL_M) * CELL_M,
            self.goal_leg_m[1] + math.floor((low_y - self.goal_leg_m[1]) / CELL_M) * CELL_M,
        )

    def _room(self, axes: Axes, boxes: Iterable[Box], passing: Passing | None) -> Room:
        """Return where the body may be: exactly, in the limit of all seen, and what that costs."""
        faces = [(box.x_min_m, box.x_max_m, box.y_min_m, box.y_max_m) for box in boxes]
        faces_m = np.array(faces).reshape(-1, 4)
        outward = np.array((-1.0, 1.0, -1.0, 1.0))
        cost = np.ones(axes.shape)
        for beyond_m, factor in self._shells():
            near = covered(axes, faces_m + outward * (self._margin_m + beyond_m))
            cost[near] = factor
        cost[:, np.abs(axes.y_m) > self._half_width_m - self._margin_m] = _SHELLS[-1][1]
        if passing is not None:
            met = passing.are_met(*axes)
            cost[maximum_filter(met, 2 * math.ceil(self._margin_m / CELL_M) + 1)] += _PENALTY
        for x_m, y_m in self.penalized_leg_m:
            i0, i1 = np.searchsorted(axes.x_m, (x_m - _PENALTY_HALF_M, x_m + _PENALTY_HALF_M))
            j0, j1 = np.searchsorted(axes.y_m, (y_m - _PENALTY_HALF_M, y_m + _PENALTY_HALF_M))
            cost[i0:i1, j0:j1] += _PENALTY
        # A cell of the seen-free set that a box grown by its faces' error takes a part of is lost.
        shut_m = (faces_m * outward + self._face_error_m + _SIGHT_M) / _SEEN_CELL_M
        body_m = self._margin_m - self._face_error_m
        quarters = axes.quartered()
        shut_m = outward * (np.ceil(shut_m) * _SEEN_CELL_M + body_m)
        # Faces and centres may be on the same lines: of the two faces of a gap one is open then.
        shut = covered(quarters, shut_m - _ROUND_OFF_M)
        shut[:, np.abs(quarters.y_m) > self._half_width_m - body_m] = True
        high_x_m = max(self.goal_leg_m[0], 0.0) + _BEYOND_ENDS_M
        shut[(quarters.x_m < self._low_x_m) | (quarters.x_m > high_x_m)] = True
        return Room.of(cost, ~shut)

    def _shells(self) -> list[tuple[float, float]]:
        """Return (distance beyond the margin, factor on the length), the outermost first."""
        wished = []
        if self._wish_m > 0.0:
            wished = [
                (self._wish_m + _WISH_EDGE_M, _WISH_EDGE_FACTOR),
                (self._wish_m, _WISH_FACTOR),
            ]
        innermost = wished[-1][1] if wished else 1.0
        near = [(beyond_m, max(factor, innermost)) for beyond_m, factor in _SHELLS]
        return sorted((*wished, *near), reverse=True)

    def _exits(self, corner_m: tuple[float, float], cost: FloatArray) -> FloatArray:
        """Return what is left beyond a cell: nothing at the goal, the way on from the rim.

        What is known of the way from a cell on the rim from before counts, so that a way that was
        seen to lead nowhere is not tried again as soon as its end is out of the window.
        """
        exits = np.full(self._shape, math.inf)
        xs, ys = self._axes(corner_m)
        gx, gy = self.goal_leg_m
        i, j = np.nonzero(_rim(self._shape) & np.isfinite(cost))
        left_m = np.hypot(xs[i] - gx, ys[j] - gy)
        low_i, low_j = self._index(corner_m)
        before_m = self._memory.left_m(i + low_i, j + low_j)
        aside = (j == 0) | (j == self._shape[1] - 1)
        astray_m = np.where(aside, _BEYOND_SIDE_M, _BACKWARDS_M)
        astray_m[i == self._row_ahead(corner_m)] = 0.0
        guess_m = left_m + astray_m
        before_m[before_m > left_m + _DETOUR_MAX_M] = math.inf
        exits[i, j] = np.maximum(guess_m, before_m)
        i, j = round((gx - xs[0]) / CELL_M), round((gy - ys[0]) / CELL_M)
        if 0 <= i < self._shape[0] and 0 <= j < self._shape[1]:
            exits[i, j] = 0.0
        return exits

    def _row_ahead(self, corner_m: tuple[float, float]) -> int:
        """Return the index along x of the rim towards the goal; -1 where the goal is not beyond."""
        low_m, high_m = corner_m[0], corner_m[0] + CELL_M * (self._shape[0] - 1)
        if self.goal_leg_m[0] > high_m:
            return self._shape[0] - 1
        return 0 if self.goal_leg_m[0] < low_m else -1

    def _axes(self, corner_m: tuple[float, float]) -> Axes:
        steps = (CELL_M * np.arange(count, dtype=np.float64) for count in self._shape)
        return Axes(*(low_m + step for low_m, step in zip(corner_m, steps, strict=True)))

    def _index(self, corner_m: tuple[float, float]) -> tuple[int, int]:
        """Return the indices of the cell at a corner, on the raster of the goal."""
        (x_m, y_m), (gx, gy) = corner_m, self.goal_leg_m
        return round((x_m - gx) / CELL_M), round((y_m - gy) / CELL_M)

    def _point(self, i: int, j: int) -> tuple[float, float]:
        return self._corner_m[0] + CELL_M * i, self._corner_m[1] + CELL_M * j

    def _cells(self, x_m: FloatArray, y_m: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
        i = np.rint((np.asarray(x_m) - self._corner_m[0]) / CELL_M).astype(int)
        j = np.rint((np.asarray(y_m) - self._corner_m[1]) / CELL_M).astype(int)
        inside = (i >= 0) & (i < self._shape[0]) & (j >= 0) & (j < self._shape[1])
        # `np.clip` looks up the limits of integers first, which takes longer.
        i = np.minimum(np.maximum(i, 0), self._shape[0] - 1)
        j = np.minimum(np.maximum(j, 0), self._shape[1] - 1)
        return i, j, inside

    def _nearest_open(self, position_leg_m: tuple[float, float]) -> tuple[int, int] | None:
        (i,), (j,), _ = self._cells(np.array([position_leg_m[0]]), np.array([position_leg_m[1]]))
        if math.isfinite(self._ways.left_m[i, j]):
            return int(i), int(j)
        for reach in range(1, 8):
            low_i, low_j = max(0, i - reach), max(0, j - reach)
            around = self._ways.left_m[low_i : i + reach + 1, low_j : j + reach + 1]
            if np.isfinite(around).any():
                a, b = divmod(int(around.argmin()), around.shape[1])
                return int(low_i + a), int(low_j + b)
        return None


def _rim(shape: tuple[int, int]) -> BoolArray:
    rim = np.ones(shape, bool)
    rim[1:-1, 1:-1] = False
    return rim


def along(path_leg_m: FloatArray, ways_m: FloatArray | Sequence[float]) -> FloatArray:
    """Return the points at given lengths along a path, (k, 2); before and after it, its ends."""
    lengths_m = _lengths(path_leg_m)
    return np.stack([np.interp(ways_m, lengths_m, path_leg_m[:, axis]) for axis in (0, 1)], axis=1)


def _lengths(path_leg_m: FloatArray) -> FloatArray:
    """Length of the way up to each point of a path."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path_leg_m, axis=0).T))))
