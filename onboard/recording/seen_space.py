"""Builds the record of the seen-free set and of the way to rest that is held in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from onboard.recording.messages import Outline, SeenSpace

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray, LegFrame
    from onboard.geometry.free_grid import FreeGrid
    from onboard.motion.trajectory import Trajectory
    from onboard.perception.line_of_sight import BoolArray

# At most so often; the set changes with every frame of a sensor.
PERIOD_S: Final = 0.5
# A record is bounded: where there are more runs of free cells, the cells are drawn larger.
RUNS_MAX: Final = 1500
# Cells of a record are at least this large.
_CELL_MIN_M: Final = 0.2
_PATH_STEP_S: Final = 0.2


class SeenSpaceSource(Protocol):
    """What guidance says of flying in seen-free space.

    Attributes:
        free_grid: the seen-free set, leg frame; None before the first one.
        held_way: the way to rest that is held; None while none is.
        guide_path_leg_m: the way to try, (k, 2); None where no way leads on.
        pause_reason: why the vehicle pauses; None while it does not.
    """

    @property
    def free_grid(self) -> FreeGrid | None: ...  # noqa: D102  see above
    @property
    def held_way(self) -> Trajectory | None: ...  # noqa: D102
    @property
    def guide_path_leg_m(self) -> FloatArray | None: ...  # noqa: D102
    @property
    def pause_reason(self) -> str | None: ...  # noqa: D102


class SeenSpaceJournal:
    """Records the seen-free set where it has changed, at most every `PERIOD_S`.

    Args:
        shown: make the records; else only ask for what would be in them, as the flight is the same
            whether it is shown or not.
    """

    def __init__(self, *, shown: bool = True) -> None:
        self._shown = shown
        self._due_s = -np.inf
        self._last: tuple[object, ...] = ()

    def collect(
        self, source: SeenSpaceSource | None, leg: LegFrame, time_s: float, now_s: float
    ) -> SeenSpace | None:
        """Return the record of a tick; None where there is nothing new, or nothing at all.

        Args:
            source: guidance, where it flies in the seen-free space.
            leg: frame of the set.
            time_s: Unix time of the tick.
            now_s: the time.
        """
        if now_s < self._due_s or source is None:
            return None
        grid, way = source.free_grid, source.held_way
        news = (grid, way, leg, source.pause_reason)
        known = len(news) == len(self._last)
        if grid is None or (known and all(a is b for a, b in zip(news, self._last, strict=True))):
            return None
        self._due_s, self._last = now_s + PERIOD_S, news
        return seen_space(source, grid, leg, time_s) if self._shown else None


def seen_space(source: SeenSpaceSource, grid: FreeGrid, leg: LegFrame, time_s: float) -> SeenSpace:
    """Return the record of the set and of what is held in it."""
    factor = max(1, round(_CELL_MIN_M / grid.cell_m))
    runs = free_runs(grid, factor)
    while len(runs[0]) > RUNS_MAX:
        factor *= 2
        runs = free_runs(grid, factor)
    (corner_ned_m,) = _seen_from_above(np.array([grid.origin_leg_m]), leg)
    way, guide_m = source.held_way, source.guide_path_leg_m
    return SeenSpace(
        time_s=time_s,
        height_m=-leg.origin_ned_m[2],
        corner_ned_m=corner_ned_m,
        heading_rad=leg.heading_rad,
        cell_m=grid.cell_m * factor,
        row=runs[0],
        column_from=runs[1],
        column_to=runs[2],
        way_to_rest_ned_m=[] if way is None else _seen_from_above(_points_leg_m(way), leg),
        guide_ned_m=[] if guide_m is None else _seen_from_above(guide_m, leg),
        pause=source.pause_reason,
    )


def free_runs(grid: FreeGrid, factor: int) -> tuple[list[int], list[int], list[int]]:
    """Return row, first column and column after the last of every run of free cells.

    Args:
        grid: the set.
        factor: edge of a cell of the record, in cells of the grid; it is free if all of these are.
    """
    table = grid.unknown_sum[::factor, ::factor]
    free = table[1:, 1:] - table[:-1, 1:] - table[1:, :-1] + table[:-1, :-1] == 0
    return runs(free)


def runs(cells: BoolArray) -> tuple[list[int], list[int], list[int]]:
    """Return row, first column and column after the last of every run of cells that are set."""
    padded = np.zeros((cells.shape[0], cells.shape[1] + 2), np.bool_)
    padded[:, 1:-1] = cells
    # Each row begins and ends outside of a run: beginnings and ends take turns.
    row, column = np.nonzero(padded[:, 1:] != padded[:, :-1])
    return row[::2].tolist(), column[::2].tolist(), column[1::2].tolist()


def _points_leg_m(way: Trajectory) -> FloatArray:
    times_s = np.append(np.arange(way.start_s, way.end_s, _PATH_STEP_S), way.end_s)
    return np.array([way.sample(time_s).position_leg_m[:2] for time_s in times_s.tolist()])


def _seen_from_above(points_leg_m: FloatArray, leg: LegFrame) -> Outline:
    at_height = np.column_stack((points_leg_m, np.zeros(len(points_leg_m))))
    return [(x, y) for x, y, _ in leg.position_ned_from_leg(at_height).tolist()]
