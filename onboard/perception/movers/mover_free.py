"""Until when no mover can be in a cell: the mover-free set, which shrinks where none is looked at.

For each cell of a raster in local NED the set holds the earliest time at which a mover may enter
it.  A frame that shows cells to be free at its stamp moves that time on: no mover was there, and
from the nearest cell that may hold one a mover needs the distance over v_o (THEORY.md, "Movers").
So what is unseen counts as occupied once a mover may have come there, and nothing is rounded twice.

What hides behind obstacles that stand still counts as unseen, too, unless the contract says that no
mover is hidden there from the start; then it is free until one that was seen may have gone there.
Frames count in the order of their stamps: one that comes later than another's is put in its place,
and what follows from it is computed again.  Sensors may be as slow as they like beside others: of
each the frames that make a row are kept, however many of others came between them.
"""

from __future__ import annotations

import bisect
import itertools
import math
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray
from onboard.perception.movers.counted_frame import Past, Step, Word
from onboard.perception.movers.glance import NEAR_M, Glance, cells_shown, nothing_near
from onboard.perception.movers.open_cells import OpenCells
from onboard.perception.movers.raster import (
    Rectangle,
    away_from,
    depth_within,
    moved,
    shifted,
)

CELL_M: Final = 0.2
# The grid follows the vehicle in steps of this, so that it moves seldom.
_STEP_CELLS: Final = 20
# Frames that may still change places: more than any two sensors are apart.
_HISTORY_MAX: Final = 10
_ROUND_OFF_S: Final = 1e-9


class MoverFree:
    """The mover-free set around one vehicle.

    Args:
        speed_max_mps: v_o, of the fastest class.
        reach_m: the grid reaches this far from the vehicle on each side, at least.
        frames_needed: K, successive frames of one sensor that have to show a cell free, as for the
            seen-free set; a mover that comes into view is reported after no more of them.
        stamp_error_s: how far the stamp of a frame may be off.
        shadows_open: whether a frame may come with its `open_view`, or the operator's word: else
            it is not asked who was seen to hide, which is half of the work.

    Attributes:
        dropped: frames that came too late to be put in their place.
        version: changes whenever the set does.
    """

    def __init__(
        self,
        speed_max_mps: float,
        reach_m: float,
        *,
        frames_needed: int = 3,
        stamp_error_s: float = 0.0,
        shadows_open: bool = True,
    ) -> None:
        self._speed_mps, self._error_s = speed_max_mps, stamp_error_s
        self._shadows_open = shadows_open
        self._needed = frames_needed
        self._half = math.ceil(reach_m / CELL_M) + _STEP_CELLS
        self._corner = (-self._half, -self._half)
        self._steps: list[Step] = []
        self._free_until_s: FloatArray
        self._word: Word | None = None
        self._rows: dict[str, int] = {}  # by sensor, how often it began again
        # By sensor, the newest first, at most as many as a row needs before its last frame.
        self._past: dict[str, list[Past]] = {}
        self.dropped = self.version = 0
        self._clear(unvisited_until_s=math.inf)

    def begin(self) -> None:
        """Begin with a flight: no frame has counted, and none hides that was not seen to hide."""
        self._clear(unvisited_until_s=math.inf)

    def take_word(self, north_m: float, east_m: float, radius_m: float, at_s: float) -> None:
        """Take the operator's word that at a time no mover is in a disc, at whatever height.

        Args:
            north_m: of its centre.
            east_m: likewise.
            radius_m: its radius.
            at_s: the time; frames that were taken before it change nothing any more.
        """
        if not self._shadows_open:
            raise ValueError("a word needs to know who was seen to hide: expected shadows_open")
        self.centre_on(north_m, east_m)
        self._word = Word(north_m, east_m, radius_m, at_s)
        self._apply_word()

    def _apply_word(self) -> None:
        """Account for the word: into the disc a mover has to come from outside."""
        if self._word is None:
            return
        north_m, east_m, radius_m, at_s = self._word
        xs_m, ys_m = self._centres()
        inside_m = radius_m - np.hypot(xs_m[:, None] - north_m, ys_m[None, :] - east_m)
        inside_m -= CELL_M / math.sqrt(2.0)
        until_s = np.where(inside_m >= 0.0, at_s + inside_m / self._speed_mps, -math.inf)
        self._free_until_s = np.maximum(self._free_until_s, until_s)
        self.version += 1

    def void(self) -> None:
        """Forget everything, also that no mover is hidden: the local frame is in doubt."""
        self._clear(unvisited_until_s=-math.inf)

    def forget_seen(self) -> None:
        """Forget where none was seen, which holds at one height, but not who was seen to hide."""
        self._free_until_s = np.full((2 * self._half, 2 * self._half), -math.inf)
        self._past.clear()
        self._steps.clear()
        self._apply_word()
        self.version += 1

    def _clear(self, unvisited_until_s: float) -> None:
        # Until when no mover that was ever seen can be in a cell.
        self._unvisited_until_s = np.full((2 * self._half, 2 * self._half), unvisited_until_s)
        self._word = None
        self.forget_seen()

    def break_row(self, source: str) -> None:
        """Begin the row of a sensor again: it may have lost what it saw before one of them."""
        self._rows[source] = self._rows.get(source, 0) + 1

    def frames_in_row(self, source: str) -> int:
        """Return how many successive frames of a sensor have counted, at most K."""
        row = self._rows.get(source, 0)
        kept = [step.row for step in self._steps if step.source == source]
        kept += [past.row for past in self._past.get(source, ())]
        return min(kept.count(row), self._needed)

    def centre_on(self, north_m: float, east_m: float) -> None:
        """Move the grid along with the vehicle; what leaves the grid is unseen."""
        wanted = [
            round(value / CELL_M / _STEP_CELLS) * _STEP_CELLS - self._half
            for value in (north_m, east_m)
        ]
        di, dj = wanted[0] - self._corner[0], wanted[1] - self._corner[1]
        if not (di or dj):
            return
        self._corner = (wanted[0], wanted[1])
        self._free_until_s = moved(self._free_until_s, di, dj, -math.inf)
        # A mover may have gone out and come back in elsewhere.
        self._unvisited_until_s = moved(self._unvisited_until_s, di, dj, -math.inf)
        for step in self._steps:
            for name, fill in (
                ("seen", False), ("shaded", False),
                ("free_until_s", -math.inf), ("unvisited_until_s", -math.inf),
            ):  # fmt: skip
                setattr(step, name, moved(getattr(step, name), di, dj, fill))
            step.open = step.open.moved(di, dj)
            step.occupied = shifted(step.occupied, di, dj, 2 * self._half)
            step.filled = shifted(step.filled, di, dj, 2 * self._half)
        for past in itertools.chain.from_iterable(self._past.values()):
            past.open = past.open.moved(di, dj)
        self.version += 1

    # ------------------------------------------------------------------ frames

    def see(self, glance: Glance, source: str) -> bool:
        """Take a frame of a sensor; tell whether it could still be put in its place."""
        index = bisect.bisect_right(self._steps, glance.stamp_s, key=lambda step: step.stamp_s)
        too_old = index == 0 and len(self._steps) >= _HISTORY_MAX
        if too_old or (self._word is not None and glance.stamp_s < self._word.at_s):
            self.dropped += 1
            return False
        self._steps.insert(index, self._step(glance, source))
        later = self._steps[index + 1 :]
        if later:
            self._free_until_s = later[0].free_until_s
            self._unvisited_until_s = later[0].unvisited_until_s
        for position in range(index, len(self._steps)):
            self._apply(position)
        while len(self._steps) > _HISTORY_MAX:
            self._keep_of(self._steps.pop(0))
        self.version += 1
        return True

    def _keep_of(self, step: Step) -> None:
        """Keep of the oldest step what later frames of its sensor need to make a row."""
        past = Past(step.stamp_s, step.source, step.row, step.open)
        kept = [past, *self._past.get(step.source, ())]
        self._past[step.source] = kept[: self._needed - 1]
        # What is older shows nothing: by now a mover may have come from outside of the raster.
        oldest_s = step.stamp_s - 2.0 * self._half * CELL_M / self._speed_mps
        for source, rows in list(self._past.items()):
            if rows and rows[0].stamp_s < oldest_s:
                del self._past[source]

    def _step(self, glance: Glance, source: str) -> Step:
        xs_m, ys_m = self._centres()
        blocking = [glance.view.boxes]
        if glance.open_view is not None and self._shadows_open:
            blocking.append(glance.open_view.boxes)
        seen, *open_past = cells_shown(glance.view, blocking, xs_m, ys_m, CELL_M)
        shaded = open_past[0] & ~seen if open_past else np.zeros_like(seen)
        if nothing_near(glance.open_view or glance.view):
            # Every mover within range of it is reported: none is there.
            north_m, east_m = glance.view.position_leg_m
            whole_m = NEAR_M - CELL_M / math.sqrt(2.0)
            i = np.flatnonzero(np.abs(xs_m - north_m) <= NEAR_M)[:, None]
            j = np.flatnonzero(np.abs(ys_m - east_m) <= NEAR_M)
            seen[i, j] |= np.hypot(xs_m[i] - north_m, ys_m[j] - east_m) <= whole_m
        occupied = filled = self._rectangles(glance.movers)
        if glance.cores is not None:
            filled = self._rectangles(glance.cores)
        for each in occupied:
            seen[each.window] = shaded[each.window] = False
        return Step(
            glance.stamp_s,
            glance.stamp_s + glance.exposure_s,
            source,
            self._rows.get(source, 0),
            seen,
            shaded,
            occupied,
            filled,
        )

    def _rectangles(self, boxes: FloatArray) -> list[Rectangle]:
        """Return the cells that each of some boxes touches, if any."""
        touched = (self._rectangle(*box) for box in boxes.tolist())
        return [each for each in touched if each.cells]

    def _apply(self, position: int) -> None:
        """Account for a step, all before it being accounted for."""
        step = self._steps[position]
        step.free_until_s, step.unvisited_until_s = self._free_until_s, self._unvisited_until_s
        at_s = step.ended_s + self._error_s
        open_cells = step.seen
        if self._shadows_open:
            open_cells = step.seen | (step.shaded & (self._unvisited_until_s > at_s))
        step.open = OpenCells(open_cells)
        shown = self._shown_in_a_row(position, open_cells)
        self._free_until_s = self._arrival_s(shown, self._free_until_s, step, edge_open=False)
        if self._shadows_open:
            self._unvisited_until_s = self._not_visited_s(shown, step)

    def _not_visited_s(self, shown: BoolArray, step: Step) -> FloatArray:
        """Return until when no mover that was ever seen can be in each cell, after a step."""
        unvisited_s = self._arrival_s(shown, self._unvisited_until_s, step, edge_open=True)
        if step.occupied:
            # Who is seen now may never have been before: what is said of others is not of them.
            since_s, away = step.stamp_s - self._error_s, away_from(step.occupied, 2 * self._half)
            came_s = since_s + away * (CELL_M / self._speed_mps)
            np.minimum(unvisited_s, came_s, out=unvisited_s)
        return unvisited_s

    def _shown_in_a_row(self, position: int, open_cells: BoolArray) -> BoolArray:
        """Return the cells that enough successive frames of the sensor have shown free.

        A mover that is there now was within v_o times its age of there in each of them.
        """
        step, left = self._steps[position], self._needed - 1
        shown, bounds = open_cells.copy(), step.open.bounds
        before: list[Step | Past] = [*reversed(self._steps[:position])]
        for earlier in (*before, *self._past.get(step.source, ())):
            if left == 0:
                break
            if (earlier.source, earlier.row) == (step.source, step.row):
                age_s = step.ended_s - earlier.stamp_s + 2.0 * self._error_s
                deep = earlier.open.are_deep(bounds, CELL_M, self._speed_mps * age_s)
                shown[bounds.window] &= deep
                left -= 1
        if left > 0:
            shown[:] = False
        return shown

    def _arrival_s(
        self, shown: BoolArray, before_s: FloatArray, step: Step, *, edge_open: bool
    ) -> FloatArray:
        """Return until when no mover can be in each cell (Theorem M3)."""
        at_s = step.ended_s + self._error_s
        held = before_s > at_s
        # Movers where none could be: an assumption has failed, or one is seen for the first time.
        surprising = any(held[each.window].any() for each in step.filled)
        none_there = shown | held
        for each in step.occupied:
            none_there[each.window] = False
        window, depth = depth_within(none_there, edge_open=edge_open)
        since_s = step.stamp_s - self._error_s
        since_there_s = since_s + depth * (CELL_M / self._speed_mps)
        since_there_s[~none_there[window]] = -math.inf
        if surprising:
            self._word = None  # whatever was not so is not said again
            arrival_s = np.full_like(before_s, -math.inf)
            arrival_s[window] = since_there_s
            return arrival_s
        arrival_s = before_s.copy()
        np.maximum(arrival_s[window], since_there_s, out=arrival_s[window])
        for each in step.occupied:
            arrival_s[each.window] = -math.inf
        return arrival_s

    # ------------------------------------------------------------------ questions

    def are_free(self, low_ned_m: FloatArray, high_ned_m: FloatArray, until_s: FloatArray) -> bool:
        """Tell whether no mover can be in any of some rectangles before its time.

        Args:
            low_ned_m: (n, 2), least north and east of each.
            high_ned_m: (n, 2), greatest.
            until_s: (n,).
        """
        return self.first_reached(low_ned_m, high_ned_m, until_s) is None

    def first_reached(
        self, low_ned_m: FloatArray, high_ned_m: FloatArray, until_s: FloatArray
    ) -> int | None:
        """Return the first of some rectangles that a mover may be in before its time."""
        cells = np.concatenate((np.floor(low_ned_m / CELL_M), np.ceil(high_ned_m / CELL_M)), axis=1)
        if not np.isfinite(cells).all():
            return 0
        cells = cells.astype(int) - np.array((*self._corner, *self._corner))
        size, times_s = 2 * self._half, self._free_until_s
        for index, ((i0, j0, i1, j1), time_s) in enumerate(
            zip(cells.tolist(), until_s.tolist(), strict=True)
        ):
            if min(i0, j0) < 0 or max(i1, j1) > size:
                return index
            part_s = times_s[i0 : max(i1, i0 + 1), j0 : max(j1, j0 + 1)]
            if not part_s.min() >= time_s - _ROUND_OFF_S:
                return index
        return None

    def free_until_s(self, places_ned_m: FloatArray) -> FloatArray:
        """Return until when no mover can be in the cell of each of some places (n, 2), (n,)."""
        cells = np.floor(places_ned_m / CELL_M).astype(int) - np.array(self._corner)
        inside = ((cells >= 0) & (cells < 2 * self._half)).all(axis=1)
        i, j = np.where(inside[:, None], cells, 0).T
        until_s: FloatArray = np.where(inside, self._free_until_s[i, j], -math.inf)
        return until_s

    def is_free_at(self, north_m: float, east_m: float, time_s: float) -> bool:
        """Tell whether no mover can be in the cell around a place at a time."""
        place = np.array(((north_m, east_m),))
        return self.are_free(place, place, np.array((time_s,)))

    def cells_free_at(self, time_s: float) -> tuple[BoolArray, tuple[float, float], float]:
        """Return which cells hold no mover until a time, where the grid begins, and their edge.

        Rows follow each other to the north, columns to the east.
        """
        north_m, east_m = (index * CELL_M for index in self._corner)
        return self._free_until_s > time_s, (north_m, east_m), CELL_M

    def free_cells(self, time_s: float) -> int:
        """Return how many cells hold no mover at a time."""
        return int(np.count_nonzero(self._free_until_s > time_s))

    def _centres(self) -> tuple[FloatArray, FloatArray]:
        middles = np.arange(2 * self._half, dtype=np.float64) + 0.5
        return (middles + self._corner[0]) * CELL_M, (middles + self._corner[1]) * CELL_M

    def _rectangle(
        self, north_min_m: float, north_max_m: float, east_min_m: float, east_max_m: float
    ) -> Rectangle:
        """Return the cells that a box touches, as far as they are on the grid; none if empty."""
        size, ends = 2 * self._half, []
        for axis, (low_m, high_m) in enumerate(
            ((north_min_m, north_max_m), (east_min_m, east_max_m))
        ):
            first = math.floor(low_m / CELL_M) - self._corner[axis]
            last = math.floor(high_m / CELL_M) - self._corner[axis] + 1
            ends += [min(max(first, 0), size), min(max(last, 0), size)]
        return Rectangle(*ends)
