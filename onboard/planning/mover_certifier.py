"""Certifies a way to rest against what moves: at rest before any mover can be there.

Each instant of the way needs its place, body and tracking error included, to hold no mover that
keeps to its declared speed; with passive safety, the run-on of its setpoint, too, until the
autopilot has stopped the vehicle (THEORY.md, "Movers").  Exact in continuous time as
`rest_certifier`: a short piece lies in the box of its Bernstein points, and has to be free until
its end.  A vehicle at rest may be touched: there nothing is asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from onboard.motion.trajectory import X, Y
from onboard.planning.rest_certifier import (
    GRID_TOLERANCE_M,
    RestLimits,
    halves,
    motion_points,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray, LegFrame
    from onboard.motion.trajectory import Trajectory

    IntArray = NDArray[np.intp]

# A reference slower than this is at rest.
REST_MPS: Final = 0.01
_REST_MPS2: Final = 0.05
# The gains of a setpoint's own place, beside those of its run-on.
OWN_PLACE: Final = (0.0, 0.0)
# A piece is halved until it is no longer than this: a mover gains v_o times that on its box.
_PIECE_MAX_S: Final = 0.1
_HALVINGS_MAX: Final = 6


class GrowingBox(Protocol):
    """What holds one mover, north and east, at any later time."""

    @property
    def id(self) -> str:
        """Name of the mover."""
        ...

    def predicted(self, time_s: float, stamp_error_s: float = 0.0) -> Box:
        """Return what holds the mover at a time."""
        ...


class MoverFreePlaces(Protocol):
    """Until when places hold no mover."""

    def first_reached(
        self, low_ned_m: FloatArray, high_ned_m: FloatArray, until_s: FloatArray
    ) -> int | None:
        """Return the first of some rectangles that a mover may be in before its time."""
        ...

    def free_until_s(self, places_ned_m: FloatArray) -> FloatArray:
        """Return until when no mover can be in the cell of each of some places (n, 2)."""
        ...


class _Unasked:
    """Places that tell nothing: only the boxes of movers that are seen are asked about."""

    def first_reached(
        self, low_ned_m: FloatArray, high_ned_m: FloatArray, until_s: FloatArray
    ) -> int | None:
        """Return that none is reached."""
        del low_ned_m, high_ned_m, until_s
        return None

    def free_until_s(self, places_ned_m: FloatArray) -> FloatArray:
        """Return that none is ever reached."""
        return np.full(len(places_ned_m), math.inf)


UNASKED: Final[MoverFreePlaces] = _Unasked()


@dataclass(frozen=True)
class Movers:
    """What is known of movers.

    Attributes:
        places: until when which places hold none.
        tracks: those that are seen.
        stamp_error_s: how far their stamps may be off.
        missing: what is missing before any place around the vehicle counts; None if nothing is.
    """

    places: MoverFreePlaces
    tracks: Sequence[GrowingBox]
    stamp_error_s: float
    missing: str | None = None


@dataclass(frozen=True)
class Settling:
    """How long a vehicle moves after its setpoint rests, or after the stream of them ends.

    Attributes:
        rest_settle_s: t_set, from a reference at rest to a vehicle at rest.
        loss_s: from the last setpoint to braking, without the time that braking takes; None where
            a loss of the stream is not asked about.
        brake_mps2: with which the autopilot brakes then.
        measured_s: the whole of it, where it was measured.
    """

    rest_settle_s: float
    loss_s: float | None = None
    brake_mps2: float = 1.0
    measured_s: float | None = None

    def after_s(self, speed_mps: FloatArray, acceleration_mps2: FloatArray) -> FloatArray:
        """Return how long the vehicle moves after each of some setpoints, (n,), at the longest."""
        if self.loss_s is None:
            return np.zeros_like(speed_mps)
        if self.measured_s is not None:
            return np.full_like(speed_mps, self.measured_s + self.rest_settle_s)
        fastest_mps = speed_mps + acceleration_mps2 * self.loss_s
        return self.loss_s + fastest_mps / self.brake_mps2 + self.rest_settle_s


def mover_failures(
    way: Trajectory, limits: RestLimits, settling: Settling, leg: LegFrame, movers: Movers
) -> tuple[str, ...]:
    """Return why a mover may be where the vehicle still moves; empty if none can be.

    Args:
        way: ends at rest; in the frame of the leg.
        limits: body and run-on.
        settling: how long the vehicle moves on.
        leg: the frame.
        movers: what is known of them.
    """
    points, begins_s, ends_s = _short_pieces(way)
    speed_mps, pull_mps2, moving = _moving(points)
    if not moving.size:
        return ()
    last = int(moving[-1])
    # A reference that pauses on the way leaves the vehicle moving for as long.
    moving = _unsettled(moving, begins_s, ends_s, settling.rest_settle_s)
    grown_m = limits.body_radius_m + 2.0 * GRID_TOLERANCE_M
    low, high = swept_ned(points[:, moving], (OWN_PLACE, *limits.run_on.gains), leg)
    until_s = ends_s[moving] + settling.after_s(speed_mps[moving], pull_mps2[moving])
    # Where it comes to rest, until the vehicle has.
    end_low, end_high = swept_ned(points[:1, last : last + 1, -1:], (OWN_PLACE,), leg)
    low, high = np.concatenate((low, end_low)), np.concatenate((high, end_high))
    until_s = np.append(until_s, ends_s[last] + settling.rest_settle_s)
    low, high = low - grown_m, high + grown_m
    begins_s = np.append(begins_s[moving], ends_s[last])
    reached = movers.places.first_reached(low, high, until_s)
    if reached is not None:
        return (f"a mover may be on the way from {begins_s[reached] - way.start_s:.1f} s ahead on",)
    return _met(low, high, until_s, movers)


def _moving(points: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the greatest speed and acceleration of each piece, and which pieces move."""
    speed_mps = np.hypot(points[1, :, :, 0], points[1, :, :, 1]).max(axis=1)
    pull_mps2 = np.hypot(points[2, :, :, 0], points[2, :, :, 1]).max(axis=1)
    return speed_mps, pull_mps2, np.flatnonzero((speed_mps > REST_MPS) | (pull_mps2 > _REST_MPS2))


def _unsettled(
    moving: IntArray, begins_s: FloatArray, ends_s: FloatArray, rest_settle_s: float
) -> IntArray:
    """Return which pieces up to the last one that moves find the vehicle moving, or settling."""
    moved_s = np.full(int(moving[-1]) + 1, -math.inf)
    moved_s[moving] = ends_s[moving]
    latest_s = np.maximum.accumulate(moved_s)
    return np.flatnonzero(begins_s[: moved_s.size] < latest_s + rest_settle_s)


def _short_pieces(way: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Bernstein points (3, n, 4, 2) of short pieces, when they begin, and when they end."""
    points, durations_s = motion_points(way), way.durations_s
    begins_s = np.array(way.knots_s[:-1])
    for _ in range(_HALVINGS_MAX):
        long = durations_s > _PIECE_MAX_S
        if not long.any():
            break
        half_s = durations_s[long] / 2.0
        points = np.concatenate((points[:, ~long], halves(points[:, long])), axis=1)
        first_s = np.repeat(begins_s[long], 2)
        first_s[1::2] += half_s
        begins_s = np.concatenate((begins_s[~long], first_s))
        durations_s = np.concatenate((durations_s[~long], np.repeat(half_s, 2)))
    order = np.argsort(begins_s)
    return points[:, order], begins_s[order], begins_s[order] + durations_s[order]


def swept_ned(
    points: FloatArray, gains: Sequence[tuple[float, float]], leg: LegFrame
) -> tuple[FloatArray, FloatArray]:
    """Return the boxes, along north and east, of a part of the run-on of each piece.

    Args:
        points: Bernstein points (3, n, k, 2) of pieces, leg frame.
        gains: (kappa [s], c [s²]) of each point of the run-on, the setpoint's own included.
        leg: the frame.
    """
    north_east = np.stack((leg.rotation_ned_from_leg[:2, X], leg.rotation_ned_from_leg[:2, Y]))
    turned = points @ north_east
    ahead = [
        turned[0] + kappa_s * turned[1] + c_s2 * turned[2] if kappa_s or c_s2 else turned[0]
        for kappa_s, c_s2 in gains
    ]
    swept = np.concatenate(ahead, axis=1)
    origin = np.array(leg.origin_ned_m[:2])
    return swept.min(axis=1) + origin, swept.max(axis=1) + origin


def moving_until_s(way: Trajectory, settling: Settling) -> float | None:
    """Return until when the vehicle moves on a way, at the latest; None if it never does."""
    points, _, ends_s = _short_pieces(way)
    speed_mps, pull_mps2, moving = _moving(points)
    if not moving.size:
        return None
    lost_s = ends_s[moving] + settling.after_s(speed_mps[moving], pull_mps2[moving])
    return max(float(lost_s.max()), float(ends_s[moving[-1]]) + settling.rest_settle_s)


def _met(low: FloatArray, high: FloatArray, until_s: FloatArray, movers: Movers) -> tuple[str, ...]:
    """Return which track may be in one of the boxes before its time."""
    latest_s = float(until_s.max())
    # What is not a number meets nothing.
    x_min_m, y_min_m = np.fmin.reduce(low, axis=0).tolist()
    x_max_m, y_max_m = np.fmax.reduce(high, axis=0).tolist()
    for track in movers.tracks:
        # Its box only grows: what it does not meet at last, it never meets.
        grown = track.predicted(latest_s, movers.stamp_error_s)
        along_north = x_min_m <= grown.x_max_m and grown.x_min_m <= x_max_m
        if not (along_north and y_min_m <= grown.y_max_m and grown.y_min_m <= y_max_m):
            continue
        boxes = [track.predicted(time_s, movers.stamp_error_s) for time_s in until_s.tolist()]
        least = np.array([(box.x_min_m, box.y_min_m) for box in boxes])
        most = np.array([(box.x_max_m, box.y_max_m) for box in boxes])
        if ((low <= most) & (least <= high)).all(axis=1).any():
            return (f"mover {track.id} may be on the way",)
    return ()
