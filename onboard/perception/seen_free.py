"""The space that has been seen free: the one set that every certified way to rest lies in.

A bounded grid of cells around the vehicle, in the leg frame and at one altitude.  A cell counts as
free only after several successive frames of one sensor each showed that no obstacle can be in it
(`onboard.perception.line_of_sight`); it never expires, since obstacles stand still.  What no frame
has shown is not free.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.free_grid import FreeGrid
from onboard.perception.cells import FrameRow, IndexArray, eroded, indices, shifted
from onboard.perception.line_of_sight import BoolArray, View, seen_free
from onboard.perception.view_sector import in_sector, of_whole_cells

if TYPE_CHECKING:
    from onboard.geometry.fence import Fence
    from onboard.geometry.frames import FloatArray, LegFrame

IntArray = NDArray[np.int32]

CELL_M: Final = 0.1
# The grid reaches this far from the vehicle on each side, at least.
REACH_M: Final = 16.0
# The grid follows the vehicle in steps of this, so that it moves seldom.
_STEP_CELLS: Final = 40
_ROUND_OFF_M: Final = 1e-6
# Around a place where the vehicle rests, no more than this matters.
_REST_MAX_M: Final = 3.0


class SeenFree:
    """The seen-free set around one vehicle.

    Args:
        frames_needed: K, successive frames of one sensor that have to show a cell free; more than
            a tracker in the sensor needs to confirm an obstacle, and at most 255.
        reach_m: the grid reaches this far from the vehicle on each side, at least.
        cell_m: edge of a cell.

    Attributes:
        version: changes whenever the set does.
        level_m: how far above or below the leg it still holds.
    """

    def __init__(
        self, *, frames_needed: int = 3, reach_m: float = REACH_M, cell_m: float = CELL_M
    ) -> None:
        self._needed, self._cell_m = frames_needed, cell_m
        self._half = math.ceil(reach_m / cell_m) + _STEP_CELLS
        self._corner = (-self._half, -self._half)
        self._free = np.zeros((2 * self._half, 2 * self._half), np.bool_)
        self._rows: dict[str, FrameRow] = {}  # by sensor
        self._half_width_m = math.inf
        self._fence: tuple[Fence, LegFrame] | None = None
        # By where the grid is: the cells within the fence; None if all are.
        self._fenced: tuple[tuple[int, int], BoolArray | None] | None = None
        # Where the vehicle rested when the frame was turned: (x, y, radius) of what is free there.
        self._rest_disc: tuple[float, float, float] | None = None
        self._snapshot: FreeGrid | None = None
        # The newest snapshot, and the cells freed since; none after any other change.
        self._base: FreeGrid | None = None
        self._fresh: list[tuple[IndexArray, IndexArray]] = []
        self._size: int | None = 0
        self.version = 0
        self.level_m = math.inf

    @property
    def centre_leg_m(self) -> tuple[float, float]:
        """Middle of the grid, which is near the vehicle."""
        i, j = self._corner
        return (i + self._half) * self._cell_m, (j + self._half) * self._cell_m

    @property
    def reach_m(self) -> float:
        """How far the grid reaches from its middle."""
        return self._half * self._cell_m

    @property
    def size(self) -> int:
        """Number of free cells."""
        if self._size is None:
            self._size = int(np.count_nonzero(self._free))
        return self._size

    def limit(self, half_width_m: float) -> None:
        """Call nothing free that is farther than this from the leg line: the mission's corridor."""
        if half_width_m != self._half_width_m:
            self._half_width_m = half_width_m
            self._has_changed()

    def keep_in(self, fence: Fence | None, leg: LegFrame) -> None:
        """Call nothing free that a geofence forbids.

        Args:
            fence: in local NED; None to end that.
            leg: the frame of this set.
        """
        self._fence, self._fenced = None if fence is None else (fence, leg), None
        self._has_changed()

    def void(self) -> None:
        """Forget everything: after an estimator reset, a change of altitude, a contradiction."""
        self._rows.clear()
        self._free[:] = False
        self._rest_disc = None
        self._has_changed()

    def break_row(self, source: str) -> None:
        """Start to count the frames of a sensor again: one of them was missed or did not count."""
        self._rows.pop(source, None)

    def centre_on(self, x_m: float, y_m: float) -> None:
        """Move the grid along with the vehicle; what leaves the grid is forgotten."""
        wanted = [
            round(value / self._cell_m / _STEP_CELLS) * _STEP_CELLS - self._half
            for value in (x_m, y_m)
        ]
        di, dj = wanted[0] - self._corner[0], wanted[1] - self._corner[1]
        if di or dj:
            self._free = shifted(self._free, di, dj)
            for row in self._rows.values():
                row.shift(di, dj)
            self._corner = (wanted[0], wanted[1])
            self._has_changed()

    def confirm(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Mark the cells in a disc as free: where the vehicle rests, as the operator says (A0)."""
        xs_m, ys_m = self._centres(slice(None), slice(None))
        whole_m = radius_m - self._cell_m / math.sqrt(2.0)
        self._free |= np.hypot(xs_m[:, None] - x_m, ys_m[None, :] - y_m) <= whole_m
        self._has_changed()

    def shift(self, x_m: float, y_m: float) -> None:
        """Shift the set with the map after a declared reset: by whole cells, then eroded by one."""
        cells = (round(x_m / self._cell_m), round(y_m / self._cell_m))
        self._free = eroded(shifted(self._free, -cells[0], -cells[1]))
        if self._rest_disc is not None:
            disc_x_m, disc_y_m, radius_m = self._rest_disc
            self._rest_disc = (disc_x_m + x_m, disc_y_m + y_m, radius_m)
        self._rows.clear()
        self._has_changed()

    def see(self, view: View, source: str = "") -> None:
        """Count a frame of a sensor for each cell that it shows to be free."""
        whole = of_whole_cells(view, self._cell_m)
        window = None if whole is None else self._window(whole)
        if whole is None or window is None:
            self.break_row(source)
            return
        rows, columns = window
        xs_m, ys_m = self._centres(rows, columns)
        i, j = indices(in_sector(whole, xs_m, ys_m) > self._free[rows, columns])
        seen = seen_free(view, xs_m[i], ys_m[j], self._cell_m)
        i, j = i[seen] + rows.start, j[seen] + columns.start
        if source not in self._rows:
            self._rows[source] = FrameRow(self._free.shape)
        new = self._rows[source].count(i, j) >= self._needed
        if new.any():
            i, j = i[new], j[new]
            base, fresh, size = self._base, self._fresh, self.size
            self._has_changed()
            self._base, self._fresh, self._size = base, [*fresh, (i, j)], size + i.size
            self._free[i, j] = True

    def holds(self, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """Tell of each point whether the cell around it has been seen free."""
        i = np.floor(x_m / self._cell_m) - self._corner[0]
        j = np.floor(y_m / self._cell_m) - self._corner[1]
        size = 2 * self._half
        inside = (i >= 0) & (j >= 0) & (i < size) & (j < size)
        at = [np.where(inside, index, 0.0).astype(int) for index in (i, j)]
        held: BoolArray = inside & self._free[at[0], at[1]]
        return held

    def are_free(
        self, x_min_m: FloatArray, x_max_m: FloatArray, y_min_m: FloatArray, y_max_m: FloatArray
    ) -> bool:
        """Tell whether some closed rectangles, few and small, hold no unknown cell."""
        cell_m, (corner_i, corner_j), size = self._cell_m, self._corner, 2 * self._half
        for x0_m, x1_m, y0_m, y1_m in zip(x_min_m, x_max_m, y_min_m, y_max_m, strict=True):
            i0, j0 = math.floor(x0_m / cell_m) - corner_i, math.floor(y0_m / cell_m) - corner_j
            i1, j1 = math.ceil(x1_m / cell_m) - corner_i, math.ceil(y1_m / cell_m) - corner_j
            if min(i0, j0) < 0 or max(i1, j1) > size or not self._free[i0:i1, j0:j1].all():
                return False
        return True

    def grid(self) -> FreeGrid:
        """Return a snapshot for the certifier and the planner; the same until the set changes."""
        if self._snapshot is None:
            base = self._base
            more = None if base is None else self._grid_with_fresh(base)
            self._snapshot = self._base = more or self._grid(self._half_width_m)
            self._fresh = []
        return self._snapshot

    def turned(self, origin_leg_m: tuple[float, float], turn_rad: float) -> SeenFree:
        """Return the set in the frame of another leg, around its origin, without a corridor.

        Args:
            origin_leg_m: origin of the new leg, in this frame.
            turn_rad: heading of the new leg less that of this one.

        A cell is free there only if every cell here that its circumscribed square meets is.  What
        that takes from the place where the leg begins, and the vehicle rests, stays free as a disc.
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
        i, j = np.nonzero(self.holds(x_m, y_m))
        x_m, y_m = x_m[i, j], y_m[i, j]
        half_m = self._cell_m / 2.0 * (abs(cosine) + abs(sine)) + _ROUND_OFF_M
        free = self._grid(math.inf).are_free(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)
        new._free[i[free], j[free]] = True
        new._has_changed()
        radius_m = self.free_radius_m(*origin_leg_m)
        if radius_m > 0.0:
            new._rest_disc = (0.0, 0.0, radius_m)
            new.confirm(0.0, 0.0, radius_m)
        new.version, new.level_m = self.version + 1, self.level_m
        return new

    def free_radius_m(self, x_m: float, y_m: float) -> float:
        """Return the radius of the largest disc about a place that is free, up to a few metres."""
        xs_m, ys_m = self._centres(slice(None), slice(None))
        i = np.flatnonzero(np.abs(xs_m - x_m) <= _REST_MAX_M)
        j = np.flatnonzero(np.abs(ys_m - y_m) <= _REST_MAX_M)
        half_m, radius_m = self._cell_m / 2.0, 0.0
        if i.size and j.size:
            inside_m = (
                x_m - xs_m[i[0]],
                xs_m[i[-1]] - x_m,
                y_m - ys_m[j[0]],
                ys_m[j[-1]] - y_m,
            )  # beyond the grid nothing is known
            away_x_m = np.maximum(np.abs(xs_m[i] - x_m) - half_m, 0.0)[:, None]
            away_y_m = np.maximum(np.abs(ys_m[j] - y_m) - half_m, 0.0)[None, :]
            unknown = ~self._free[i[0] : i[-1] + 1, j[0] : j[-1] + 1]
            nearest_m = np.where(unknown, np.hypot(away_x_m, away_y_m), math.inf).min()
            radius_m = max(0.0, min(float(nearest_m), min(inside_m) + half_m))
        if self._rest_disc is not None:
            disc_x_m, disc_y_m, disc_m = self._rest_disc
            radius_m = max(radius_m, disc_m - math.hypot(x_m - disc_x_m, y_m - disc_y_m))
        return radius_m

    def _grid(self, half_width_m: float) -> FreeGrid:
        unknown = ~self._free
        if math.isfinite(half_width_m):
            _, ys_m = self._centres(slice(None), slice(None))
            unknown |= np.abs(ys_m)[None, :] + self._cell_m / 2.0 > half_width_m
        if (within := self._within_fence()) is not None:
            unknown |= ~within
        table: IntArray = np.zeros((unknown.shape[0] + 1, unknown.shape[1] + 1), np.int32)
        np.cumsum(unknown, axis=0, dtype=np.int32, out=table[1:, 1:])
        np.cumsum(table[1:, 1:], axis=1, out=table[1:, 1:])
        corner_m = (self._corner[0] * self._cell_m, self._corner[1] * self._cell_m)
        disc = self._rest_disc
        if disc is not None:
            # Nothing is free beyond the corridor.
            inside_m = min(disc[2], half_width_m - abs(disc[1]), self._fence_clearance_m(*disc[:2]))
            disc = (disc[0], disc[1], inside_m) if inside_m > 0.0 else None
        return FreeGrid(corner_m, self._cell_m, table, disc, self.level_m)

    def _grid_with_fresh(self, base: FreeGrid) -> FreeGrid:
        """Return a snapshot by what has been freed since another; a fifth of the work."""
        i, j = (np.concatenate(each) for each in zip(*self._fresh, strict=True))
        if math.isfinite(self._half_width_m):
            _, ys_m = self._centres(slice(None), slice(None))
            inside = np.abs(ys_m[j]) + self._cell_m / 2.0 <= self._half_width_m
            i, j = i[inside], j[inside]
        if (within := self._within_fence()) is not None:
            i, j = i[within[i, j]], j[within[i, j]]
        if not i.size:
            return base
        i0, i1, j0, j1 = int(i.min()), int(i.max()) + 1, int(j.min()), int(j.max()) + 1
        freed: IntArray = np.zeros((i1 - i0, j1 - j0), np.int32)
        freed[i - i0, j - j0] = 1
        np.cumsum(freed, axis=0, out=freed)
        np.cumsum(freed, axis=1, out=freed)
        table = base.unknown_sum.copy()
        table[i0 + 1 : i1 + 1, j0 + 1 : j1 + 1] -= freed
        table[i0 + 1 : i1 + 1, j1 + 1 :] -= freed[:, -1:]
        table[i1 + 1 :, j0 + 1 : j1 + 1] -= freed[-1:]
        table[i1 + 1 :, j1 + 1 :] -= freed[-1, -1]
        return replace(base, unknown_sum=table)

    def _within_fence(self) -> BoolArray | None:
        """Return the cells that lie wholly within the fence; None if all do."""
        if self._fence is None:
            return None
        if self._fenced is None or self._fenced[0] != self._corner:
            xs_m, ys_m = self._centres(slice(None), slice(None))
            north_m, east_m = self._north_east_m(xs_m[:, None], ys_m[None, :])
            within = self._fence[0].allowed_cells(north_m, east_m, self._cell_m)
            self._fenced = self._corner, within
        return self._fenced[1]

    def _fence_clearance_m(self, x_m: float, y_m: float) -> float:
        if self._fence is None:
            return math.inf
        return float(self._fence[0].clearance_m(*self._north_east_m(np.array(x_m), np.array(y_m))))

    def _north_east_m(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self._fence is not None  # noqa: S101  the callers checked
        leg = self._fence[1]
        (north_m, east_m, _), heading_rad = leg.origin_ned_m, leg.heading_rad
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        return north_m + cosine * x_m - sine * y_m, east_m + sine * x_m + cosine * y_m

    def _has_changed(self) -> None:
        self._snapshot = self._base = self._size = None
        self._fresh = []
        self.version += 1

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
        # The chord between two of these rays lies inside the arc by less than 2 %.
        far = 1.02 * reach if view.half_view_rad < math.pi / 2.0 else 1.1 * reach
        for eighth in range(9):
            aside_rad = eighth / 8.0 * (2.0 * view.half_view_rad) - view.half_view_rad
            turn_rad = view.heading_leg_rad + aside_rad
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
