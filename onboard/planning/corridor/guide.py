"""Which way to try: a field of distances to the goal over known boxes, and the path down it.

Unseen space counts as free here, since a guide promises nothing: where it leads into something, the
vehicle stops before it, looks, and the field changes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Sequence

    from numpy.typing import NDArray

    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray

    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.int_]

CELL_M: Final = 0.2
# The field covers this much around the vehicle; beyond it the straight way counts.
AHEAD_M: Final = 14.0
BEHIND_M: Final = 10.0
ASIDE_M: Final = 10.0
# Beside a box: (distance beyond the margin, factor on the length of the way).  The cells of the
# seen-free set take up to 0.15 m from a gap, so that the nearest open shell is the last resort.
_SHELLS: Final = ((0.5, 1.5), (0.25, 3.0), (0.12, 10.0), (0.03, math.inf))
# Where a plan stood and nothing certified: another gap is to be tried.
_PENALTY: Final = 8.0
_PENALTY_HALF_M: Final = 0.9
_FAR_M: Final = 1e3


class Guide:
    """Distances to a goal in a window, in the leg frame.

    Args:
        goal_leg_m: (x, y).
        margin_m: that boxes are grown by: radius, tracking error and face error.
        half_width_m: of the mission's corridor about the leg line; infinite for none.
    """

    def __init__(
        self, goal_leg_m: tuple[float, float], margin_m: float, half_width_m: float = math.inf
    ) -> None:
        self.goal_leg_m, self._margin_m, self._half_width_m = goal_leg_m, margin_m, half_width_m
        self._shape = (round((AHEAD_M + BEHIND_M) / CELL_M), round(2.0 * ASIDE_M / CELL_M))
        self._graph = _Raster(self._shape)
        self._corner_m = (0.0, 0.0)
        self._distance_m: FloatArray = np.full(self._shape, math.inf)
        self.penalized_leg_m: list[tuple[float, float]] = []

    def update(self, position_leg_m: tuple[float, float], boxes: Iterable[Box]) -> None:
        """Compute the field around a position."""
        for _ in self.updating(position_leg_m, boxes):
            pass

    def updating(
        self, position_leg_m: tuple[float, float], boxes: Iterable[Box]
    ) -> Generator[None]:
        """Compute the field; yield between its slices, while the old field still serves."""
        corner_m = self._corner(position_leg_m)
        cost = self._costs(corner_m, boxes)
        exits = self._exits(corner_m, cost)
        yield
        distance_m = self._graph.distances(cost, exits)
        self._corner_m, self._distance_m = corner_m, distance_m

    def distance_m(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return the way to the goal from each point; from a blocked cell, by the next open one."""
        i, j, inside = self._cells(x_m, y_m)
        values = np.where(inside, self._distance_m[i, j], _FAR_M)
        for k in np.flatnonzero(~np.isfinite(values)).tolist():
            around = self._distance_m[max(0, i[k] - 3) : i[k] + 4, max(0, j[k] - 3) : j[k] + 4]
            values[k] = min(float(around.min()) + 1.0, _FAR_M)
        return values

    def path_leg_m(self, position_leg_m: tuple[float, float], length_m: float) -> FloatArray | None:
        """Descend from a position: points (k, 2), k of 2 or more; None where no way leads on."""
        start = self._nearest_open(position_leg_m)
        if start is None:
            return None
        i, j = start
        points = [position_leg_m, self._point(i, j)]
        walked_m, field = 0.0, self._distance_m
        while walked_m < length_m and field[i, j] > CELL_M / 2.0:
            a, b = self._next(i, j)
            if not field[a, b] < field[i, j]:
                break
            walked_m += CELL_M * math.hypot(a - i, b - j)
            i, j = a, b
            points.append(self._point(i, j))
        if math.dist(points[-1], self.goal_leg_m) <= 2.0 * CELL_M or walked_m < length_m:
            points.append(self.goal_leg_m)
        path = np.array(points)
        steps_m = np.hypot(*np.diff(path, axis=0).T)
        path = path[np.concatenate(([True], steps_m > 1e-9))]
        return path if len(path) >= 2 else None

    def _next(self, i: int, j: int) -> tuple[int, int]:
        """Return the cell, among a cell and its neighbours, that is nearest to the goal."""
        low_i, low_j = max(0, i - 1), max(0, j - 1)
        around = self._distance_m[low_i : i + 2, low_j : j + 2]
        if not np.isfinite(around).all():  # no way past the corner of a blocked cell
            open_cells = np.isfinite(around)
            around = around.copy()
            rows, columns = open_cells[i - low_i], open_cells[:, j - low_j]
            beside = rows[None, :] & columns[:, None]
            beside[i - low_i], beside[:, j - low_j] = True, True
            around[~beside] = math.inf
        a, b = divmod(int(around.argmin()), around.shape[1])
        return low_i + a, low_j + b

    def _corner(self, position_leg_m: tuple[float, float]) -> tuple[float, float]:
        """Return the corner of the window, most of which lies towards the goal."""
        x_m, y_m = position_leg_m
        back = BEHIND_M if self.goal_leg_m[0] >= x_m else AHEAD_M
        low_x = x_m - back
        low_y = y_m - ASIDE_M
        # On the goal's own raster, so that the goal is a cell's centre.
        return (
            self.goal_leg_m[0] + math.floor((low_x - self.goal_leg_m[0]) / CELL_M) * CELL_M,
            self.goal_leg_m[1] + math.floor((low_y - self.goal_leg_m[1]) / CELL_M) * CELL_M,
        )

    def _costs(self, corner_m: tuple[float, float], boxes: Iterable[Box]) -> FloatArray:
        cost = np.ones(self._shape)
        xs, ys = self._axes(corner_m)
        known = list(boxes)
        for extra_m, factor in _SHELLS:
            grown_m = self._margin_m + extra_m
            for box in known:
                i0, i1 = np.searchsorted(xs, (box.x_min_m - grown_m, box.x_max_m + grown_m))
                j0, j1 = np.searchsorted(ys, (box.y_min_m - grown_m, box.y_max_m + grown_m))
                np.maximum(cost[i0:i1, j0:j1], factor, out=cost[i0:i1, j0:j1])
        for x_m, y_m in self.penalized_leg_m:
            i0, i1 = np.searchsorted(xs, (x_m - _PENALTY_HALF_M, x_m + _PENALTY_HALF_M))
            j0, j1 = np.searchsorted(ys, (y_m - _PENALTY_HALF_M, y_m + _PENALTY_HALF_M))
            cost[i0:i1, j0:j1] += _PENALTY
        cost[:, np.abs(ys) > self._half_width_m - self._margin_m] = math.inf
        return cost

    def _exits(self, corner_m: tuple[float, float], cost: FloatArray) -> FloatArray:
        """Return what is left beyond a cell: nothing at the goal, the straight way on the rim.

        The rim is that towards the goal, and both sides where no corridor ends before them.
        """
        exits = np.full(self._shape, math.inf)
        xs, ys = self._axes(corner_m)
        gx, gy = self.goal_leg_m
        i, j = round((gx - xs[0]) / CELL_M), round((gy - ys[0]) / CELL_M)
        if 0 <= i < self._shape[0] and 0 <= j < self._shape[1]:
            exits[i, j] = 0.0
            return exits
        left_m = np.hypot(xs[:, None] - gx, ys[None, :] - gy)
        # Not behind: what lies ahead is unknown from there, and it would come back again.
        ahead_m = max(gx - xs[-1], xs[0] - gx)
        rim = np.zeros(self._shape, bool)
        if ahead_m > 0.0:
            rim[-1 if gx > xs[-1] else 0, :] = True
        if math.isinf(self._half_width_m) or ahead_m <= 0.0:
            rim[:, [0, -1]] = True
        rim &= np.isfinite(cost)
        exits[rim] = left_m[rim]
        return exits

    def _axes(self, corner_m: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        xs = corner_m[0] + CELL_M * np.arange(self._shape[0], dtype=np.float64)
        ys = corner_m[1] + CELL_M * np.arange(self._shape[1], dtype=np.float64)
        return xs, ys

    def _point(self, i: int, j: int) -> tuple[float, float]:
        return self._corner_m[0] + CELL_M * i, self._corner_m[1] + CELL_M * j

    def _cells(self, x_m: FloatArray, y_m: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
        i = np.rint((np.asarray(x_m) - self._corner_m[0]) / CELL_M).astype(int)
        j = np.rint((np.asarray(y_m) - self._corner_m[1]) / CELL_M).astype(int)
        inside = (i >= 0) & (i < self._shape[0]) & (j >= 0) & (j < self._shape[1])
        i, j = np.clip(i, 0, self._shape[0] - 1), np.clip(j, 0, self._shape[1] - 1)
        return i, j, inside

    def _nearest_open(self, position_leg_m: tuple[float, float]) -> tuple[int, int] | None:
        (i,), (j,), _ = self._cells(np.array([position_leg_m[0]]), np.array([position_leg_m[1]]))
        if math.isfinite(self._distance_m[i, j]):
            return int(i), int(j)
        for reach in range(1, 8):
            low_i, low_j = max(0, i - reach), max(0, j - reach)
            around = self._distance_m[low_i : i + reach + 1, low_j : j + reach + 1]
            if np.isfinite(around).any():
                a, b = divmod(int(around.argmin()), around.shape[1])
                return int(low_i + a), int(low_j + b)
        return None


class _Raster:
    """Eight neighbours of each cell of a raster, and one source beside them."""

    def __init__(self, shape: tuple[int, int]) -> None:
        index = np.arange(shape[0] * shape[1]).reshape(shape)
        cells, source = index.ravel(), index.size
        froms, tos = [np.full(cells.size, source)], [cells]
        for step in _STEPS:
            one, other = _shifts(index, step)
            froms += [one.ravel(), other.ravel()]
            tos += [other.ravel(), one.ravel()]
        rows, columns = np.concatenate(froms), np.concatenate(tos)
        self._order = np.lexsort((columns, rows))
        self._columns = columns[self._order]
        self._starts = np.searchsorted(rows[self._order], np.arange(source + 2))
        self._source, self._shape = source, shape

    def distances(self, cost: FloatArray, exits: FloatArray) -> FloatArray:
        """Return the cheapest way from each cell to an exit, what is left beyond it included."""
        # A weight of nothing would be no edge to SciPy.
        parts = [exits.ravel() + 1e-9]
        for step in _STEPS:
            one, other = _shifts(cost, step)
            costliest = np.maximum(one, other)
            if all(step):  # both cells beside a diagonal step have to be open, too
                rows, columns = cost.shape
                low, high = slice(None, columns - 1), slice(1, None)
                near, far = (high, low) if step[1] > 0 else (low, high)
                blocked = np.isinf(cost[: rows - 1, near]) | np.isinf(cost[1:, far])
                costliest[blocked] = math.inf
            weights = (costliest * (math.hypot(*step) * CELL_M)).ravel()
            parts += [weights, weights]
        matrix = sparse.csr_matrix(
            (np.concatenate(parts)[self._order], self._columns, self._starts),
            shape=(self._source + 1, self._source + 1),
        )
        ways = dijkstra(matrix, indices=self._source)
        distance: FloatArray = ways[: self._source].reshape(self._shape)
        return distance


_STEPS: Final = ((1, 0), (0, 1), (1, 1), (1, -1))
_T = TypeVar("_T", bound=np.generic)


def _shifts(cells: NDArray[_T], step: tuple[int, int]) -> tuple[NDArray[_T], NDArray[_T]]:
    """Return the cells that have a neighbour at a step, and these neighbours."""
    (rows, columns), (di, dj) = cells.shape, step
    return (
        cells[: rows - di, max(0, -dj) : columns - max(0, dj)],
        cells[di:, max(0, dj) : columns + min(0, dj)],
    )


def along(path_leg_m: FloatArray, ways_m: FloatArray | Sequence[float]) -> FloatArray:
    """Return the points at given lengths along a path, (k, 2); before and after it, its ends."""
    lengths_m = _lengths(path_leg_m)
    return np.stack([np.interp(ways_m, lengths_m, path_leg_m[:, axis]) for axis in (0, 1)], axis=1)


def _lengths(path_leg_m: FloatArray) -> FloatArray:
    """Length of the way up to each point of a path."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path_leg_m, axis=0).T))))
