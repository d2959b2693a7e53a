"""Builds the record of what moves, and of what it may reach until the vehicle rests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.guidance.movers.yield_cause import tracks_in_way
from onboard.guidance.phases import FlightState
from onboard.planning.mover_certifier import REST_MPS
from onboard.planning.rest_certifier import velocity_points_mps
from onboard.recording.mover_record import KnownMover, MoversRecord, corners
from onboard.recording.seen_space import runs
from onboard.recording.state import unix_time_s

if TYPE_CHECKING:
    from onboard.autonomy import Autonomy
    from onboard.geometry.box import Box
    from onboard.motion.trajectory import Trajectory
    from onboard.perception.line_of_sight import BoolArray
    from onboard.perception.movers.mover_free import MoverFree
    from onboard.perception.movers.tracker import MoverTrack

# At most so often: boxes change with every frame of a sensor.
PERIOD_S: Final = 0.25
# A record is bounded: so many movers, the nearest, and so many runs, else cells are drawn larger.
MOVERS_MAX: Final = 150
# Whether the vehicle yields for a mover is asked of the nearest ones only: it takes time.
ASKED_MAX: Final = 20
RUNS_MAX: Final = 600
_CELLS: Final = 2


class MoverJournal:
    """Records the movers where something has changed, at most every `PERIOD_S`.

    Args:
        shown: make records at all; only people and viewers need them.
    """

    def __init__(self, *, shown: bool = True) -> None:
        self._due_s = -math.inf if shown else math.inf
        self._last: tuple[object, ...] = ()

    def collect(self, autonomy: Autonomy, time_s: float, now_s: float) -> MoversRecord | None:
        """Return the record of a tick; None where nothing is new, or movers are not required.

        Args:
            autonomy: the service.
            time_s: Unix time of the tick.
            now_s: the time.
        """
        if now_s < self._due_s:
            return None
        space = autonomy.supervisor.detections.movers
        known, free = space.movers, space.free
        if known is None or free is None:
            return None
        news = (free.version, _held_until_s(autonomy), _yielding(autonomy), known.missing)
        tracks = tuple(space.tracks)
        before = self._last[: len(news)], self._last[len(news) :]
        if before[0] == news and _same(before[1], tracks):
            return None
        self._due_s, self._last = now_s + PERIOD_S, (*news, *tracks)
        return _record(autonomy, free, tracks, known.missing, time_s, now_s)


def _same(before: tuple[object, ...], after: tuple[MoverTrack, ...]) -> bool:
    # Tracks are replaced, never changed.
    return len(before) == len(after) and all(a is b for a, b in zip(before, after, strict=True))


def _record(
    autonomy: Autonomy,
    free: MoverFree,
    tracks: tuple[MoverTrack, ...],
    missing: str | None,
    time_s: float,
    now_s: float,
) -> MoversRecord:
    held_until_s = _held_until_s(autonomy)
    until_s = now_s if held_until_s is None else max(held_until_s, now_s)
    shown = sorted(tracks, key=lambda track: _distance_m(autonomy, track.predicted(now_s)))
    shown = shown[:MOVERS_MAX]
    yielding = _yielding(autonomy)
    known = autonomy.supervisor.detections.movers.movers
    assert known is not None  # noqa: S101  the caller has asked
    blocking = _blocking(autonomy, shown) if yielding is not None else frozenset[str]()
    cells, corner_ned_m, cell_m = _coarse(*free.cells_free_at(until_s))
    row, column_from, column_to = runs(cells)
    return MoversRecord(
        time_s=time_s,
        height_m=-autonomy.navigator.leg.origin_ned_m[2],
        until_s=unix_time_s(autonomy, until_s),
        stamp_error_s=known.stamp_error_s,
        movers=[
            _mover(
                track,
                unix_time_s(autonomy, track.seen_s),
                track.predicted(until_s, known.stamp_error_s),
                yields_for=track.id in blocking,
            )
            for track in shown
        ],
        left_out=len(tracks) - len(shown),
        yielding=yielding,
        missing=missing,
        corner_ned_m=corner_ned_m,
        cell_m=cell_m,
        row=row,
        column_from=column_from,
        column_to=column_to,
    )


def _blocking(autonomy: Autonomy, nearest: list[MoverTrack]) -> frozenset[str]:
    """Return for which movers the vehicle yields."""
    navigator, known = autonomy.navigator, autonomy.supervisor.detections.movers.movers
    if navigator.thread is None or navigator.thread.guard.refused is None or known is None:
        return frozenset()
    return tracks_in_way(
        navigator.thread.guard.refused,
        autonomy.assessment,
        navigator.leg,
        nearest[:ASKED_MAX],
        known.stamp_error_s,
    )


def _mover(track: MoverTrack, seen_s: float, reach: Box, *, yields_for: bool) -> KnownMover:
    return KnownMover(
        id=track.id,
        kind=track.kind,
        seen_s=seen_s,
        speed_max_mps=track.speed_max_mps,
        velocity_ned_mps=track.velocity_ned_mps,
        box_ned_m=_corners(track.box),
        reach_ned_m=_corners(reach),
        yields_for=yields_for,
    )


def _held_until_s(autonomy: Autonomy) -> float | None:
    """Return when the vehicle has come to rest on the way that it holds; None without one."""
    shield = autonomy.navigator.shield
    way = None if shield is None else shield.held_way
    end_s = None if way is None else rests_s(way)
    return None if end_s is None else end_s + autonomy.assessment.terms.rest_settle_s


def rests_s(way: Trajectory) -> float | None:
    """Return from when on a way to rest rests, however long it lasts; None if it never moves."""
    points_mps = velocity_points_mps(way)[:, :, :2]
    moving = np.flatnonzero(np.hypot(points_mps[..., 0], points_mps[..., 1]).max(axis=1) > REST_MPS)
    return float(way.knots_s[moving[-1] + 1]) if moving.size else None


def _yielding(autonomy: Autonomy) -> str | None:
    navigator = autonomy.navigator
    if navigator.state is not FlightState.YIELDING or navigator.thread is None:
        return None
    return navigator.thread.guard.reason


def _distance_m(autonomy: Autonomy, box: Box) -> float:
    pose = autonomy.link.pose
    north_m, east_m = (0.0, 0.0) if pose is None else pose.position_ned_m[:2]
    return math.hypot(
        max(box.x_min_m - north_m, 0.0, north_m - box.x_max_m),
        max(box.y_min_m - east_m, 0.0, east_m - box.y_max_m),
    )


def _corners(box: Box) -> list[tuple[float, float]]:
    """Return the corners, to the millimetre that lies farther out."""
    return corners(
        math.floor(box.x_min_m * 1e3) / 1e3,
        math.ceil(box.x_max_m * 1e3) / 1e3,
        math.floor(box.y_min_m * 1e3) / 1e3,
        math.ceil(box.y_max_m * 1e3) / 1e3,
    )


def _coarse(
    cells: BoolArray, corner_ned_m: tuple[float, float], cell_m: float
) -> tuple[BoolArray, tuple[float, float], float]:
    """Return larger cells, each free if all of these are, so that their runs are few enough."""
    factor = _CELLS
    while True:
        rows, columns = (size // factor for size in cells.shape)
        blocks = cells[: rows * factor, : columns * factor]
        coarse = np.logical_and.reduce(blocks.reshape(rows, factor, columns, factor), axis=(1, 3))
        if len(runs(coarse)[0]) <= RUNS_MAX:
            return coarse, corner_ned_m, cell_m * factor
        factor *= 2
