"""Trajectories: pieces of constant jerk, on three axes with common knots.

Everything is in the leg frame (x along the leg, y right, z down).  A trajectory does not depend on
obstacles or limits.  Its ranges and times are exact: found by roots, never by sampling.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from onboard.motion import polynomial
from onboard.motion.axis_profile import AxisState, Profile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.frames import FloatArray

Vector = tuple[float, float, float]
X, Y, Z = 0, 1, 2


class State(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s²] in the leg frame."""

    position_leg_m: Vector
    velocity_leg_mps: Vector
    acceleration_leg_mps2: Vector = (0.0, 0.0, 0.0)

    def axis(self, axis: int) -> AxisState:
        """Return the state on one axis."""
        return AxisState(
            self.position_leg_m[axis], self.velocity_leg_mps[axis], self.acceleration_leg_mps2[axis]
        )


class CannotCoastError(ValueError):
    """A trajectory does not end in a coast that reaches the position asked for."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Pieces of constant jerk; before the first it stays at its start, after the last it coasts.

    Attributes:
        start_s: absolute time of the first knot.
        durations_s: (n,), above zero.
        position_leg_m, velocity_leg_mps, acceleration_leg_mps2: (n, 3), at the start of each piece.
        jerk_leg_mps3: (n, 3), constant over each piece.

    The arrays are taken as given: whether the pieces join is for the certifier to check.

    Raises:
        ValueError: no pieces, arrays of different lengths, a duration that is not above zero, or a
            value that is not finite.
    """

    start_s: float
    durations_s: FloatArray
    position_leg_m: FloatArray
    velocity_leg_mps: FloatArray
    acceleration_leg_mps2: FloatArray
    jerk_leg_mps3: FloatArray

    def __post_init__(self) -> None:
        count = len(self.durations_s)
        if count == 0 or not (self.durations_s > 0.0).all():
            raise ValueError(
                f"durations_s = {self.durations_s}: expected at least one, all above zero"
            )
        for array in self.motion:
            if array.shape != (count, 3):
                raise ValueError(f"array of shape {array.shape}: expected ({count}, 3)")
        motion_is_finite = np.isfinite(np.concatenate(self.motion)).all()
        if not (motion_is_finite and np.isfinite(self.durations_s).all()):
            raise ValueError("durations and motion of a trajectory must be finite")

    @property
    def motion(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Position, velocity, acceleration and jerk: four arrays (n, 3)."""
        return (
            self.position_leg_m,
            self.velocity_leg_mps,
            self.acceleration_leg_mps2,
            self.jerk_leg_mps3,
        )

    @classmethod
    def from_profiles(cls, start_s: float, x: Profile, y: Profile, z: Profile) -> Trajectory:
        """Merge three single-axis profiles that start together; the shorter ones coast.

        Raises:
            ValueError: all profiles are empty, so that the trajectory has no duration.
        """
        profiles = (x, y, z)
        knots_s = np.array(sorted({knot[0] for profile in profiles for knot in profile.knots}))
        durations_s = np.diff(knots_s)
        axes = [_resample(profile, knots_s) for profile in profiles]
        position, velocity, acceleration, jerk = (
            np.array([[axis[i][k] for axis in axes] for i in range(len(durations_s))])
            for k in range(4)
        )
        return cls(start_s, durations_s, position, velocity, acceleration, jerk)

    @classmethod
    def from_accelerations(
        cls,
        start_s: float,
        start: State,
        durations_s: FloatArray,
        acceleration_leg_mps2: FloatArray,
        coast_to_x_m: float | None = None,
    ) -> Trajectory:
        """Integrate accelerations (n + 1, 3) that are given at the knots and linear in between.

        Args:
            start_s: absolute time of the first knot.
            start: position and velocity at it.
            durations_s: of the pieces, (n,).
            acceleration_leg_mps2: at the knots.
            coast_to_x_m: if given, one more piece without acceleration, up to this x.

        Raises:
            CannotCoastError: that x lies behind, or the vehicle does not fly towards it.
            ValueError: the arrays do not form a trajectory.
        """
        t = durations_s[:, None]
        begin, end = acceleration_leg_mps2[:-1], acceleration_leg_mps2[1:]
        velocity = np.vstack((start.velocity_leg_mps, t * (begin + end) / 2.0)).cumsum(axis=0)
        advance = t * (velocity[:-1] + t * (2.0 * begin + end) / 6.0)
        position = np.vstack((start.position_leg_m, advance)).cumsum(axis=0)
        jerk = (end - begin) / t
        if coast_to_x_m is None:
            return cls(start_s, durations_s, position[:-1], velocity[:-1], begin, jerk)
        left_m, speed_mps = coast_to_x_m - position[-1, X], velocity[-1, X]
        if not (left_m > 0.0 and speed_mps > 0.0):
            raise CannotCoastError(
                f"cannot coast over the last {left_m:.3g} m at {speed_mps:.3g} m/s: "
                "both must be above zero"
            )
        still = np.zeros((1, 3))
        return cls(
            start_s,
            np.append(durations_s, left_m / speed_mps),
            position,
            velocity,
            np.concatenate((begin, still)),
            np.concatenate((jerk, still)),
        )

    def coasting_for(self, duration_s: float) -> Trajectory:
        """Return this trajectory with its final coast made explicit for a duration above zero."""
        return Trajectory(self.start_s, np.append(self.durations_s, duration_s), *self._with_coast)

    @cached_property
    def knots_s(self) -> tuple[float, ...]:
        """Absolute times of the n + 1 knots."""
        elapsed_s = accumulate(self.durations_s.tolist(), initial=0.0)
        return tuple([self.start_s + each_s for each_s in elapsed_s])

    @property
    def end_s(self) -> float:
        """Absolute time of the last knot."""
        return self.knots_s[-1]

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at the end of each piece: three arrays (n, 3)."""
        p, v, a, j = self.motion
        t = self.durations_s[:, None]
        return p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j

    @cached_property
    def final(self) -> State:
        """State at the end of the last piece."""
        position, velocity, acceleration = (tuple(array[-1].tolist()) for array in self.ends)
        return State(position, velocity, acceleration)

    def sample(self, time_s: float) -> State:
        """State at an absolute time; at rest in acceleration outside [start_s, end_s)."""
        # Most ask for the time of the tick, as others have done in it.
        before_s, state = self._sampled
        if time_s == before_s and state is not None:
            return state
        piece = bisect_right(self.knots_s, time_s) - 1
        after_s = 0.0 if piece < 0 else time_s - self.knots_s[piece]
        state = _advanced(self._pieces[max(piece, 0)], after_s)
        self.__dict__["_sampled"] = time_s, state
        return state

    def positions_leg_m(self, times_s: FloatArray) -> FloatArray:
        """Positions (k, 3) at absolute times (k,), to the last bit those of `sample`."""
        pieces = np.searchsorted(self.knots_s, times_s, side="right") - 1
        after_s = np.where(pieces < 0, 0.0, times_s - np.array(self.knots_s)[pieces])[:, None]
        p, v, a, j = (array[np.maximum(pieces, 0)] for array in self._with_coast)
        positions_m: FloatArray = p + after_s * (v + after_s * (a / 2.0 + after_s * j / 6.0))
        return positions_m

    @cached_property
    def control_points_m(self) -> FloatArray:
        """Bernstein control points (n, 4, 3): each piece lies within the hull of its four."""
        p, v, a, _ = self.motion
        t = self.durations_s[:, None]
        second = p + v * t / 3.0
        return np.stack((p, second, second + (v + a * t / 2.0) * t / 3.0, self.ends[0]), axis=1)

    def position_range_m(self, axis: int) -> tuple[float, float]:
        """Least and greatest position on an axis between start and end, exact."""
        points_m = self.control_points_m[:, :, axis]
        nodes_m = points_m[:, (0, 3)]
        low_m, high_m = float(nodes_m.min()), float(nodes_m.max())
        may_exceed = (points_m.min(axis=1) < low_m) | (points_m.max(axis=1) > high_m)
        for piece in np.flatnonzero(may_exceed).tolist():
            coefficients = self.position_coefficients(piece, axis)
            low, high = polynomial.value_range(coefficients, float(self.durations_s[piece]))
            low_m, high_m = min(low_m, low), max(high_m, high)
        return low_m, high_m

    def velocity_range_mps(self, axis: int) -> tuple[float, float]:
        """Least and greatest velocity on an axis between start and end, exact."""
        v, a, j = (array[:, axis] for array in self.motion[1:])
        candidates = [v, self.ends[1][:, axis]]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            peak_s = -a / j
        inside = (peak_s > 0.0) & (peak_s < self.durations_s)  # NaN and infinity are not inside
        t = peak_s[inside]
        candidates.append(v[inside] + t * (a[inside] + t * j[inside] / 2.0))
        values = np.concatenate(candidates)
        return float(values.min()), float(values.max())

    def first_time_s(self, axis: int, position_m: float) -> float | None:
        """First absolute time at which an axis reaches a position, the final coast included."""
        started_m = self.position_leg_m[0, axis]
        if started_m == position_m:
            return self.start_s
        for piece, duration_s in enumerate(self.durations_s.tolist()):
            c0, *rest = self.position_coefficients(piece, axis)
            crossings = polynomial.roots((c0 - position_m, *rest), duration_s)
            if crossings:
                return self.knots_s[piece] + crossings[0]
            if (self.ends[0][piece, axis] - position_m) * (started_m - position_m) <= 0.0:
                return self.knots_s[piece + 1]
        return self._coast_time_s(axis, position_m)

    def position_coefficients(self, piece: int, axis: int) -> tuple[float, float, float, float]:
        """Cubic of one piece and axis in the time since the piece's start, constant first."""
        p, v, a, j = (float(array[piece, axis]) for array in self.motion)
        return p, v, a / 2.0, j / 6.0

    def from_time(self, time_s: float) -> Trajectory:
        """Return what remains after an absolute time before the end; all of it before the start.

        Raises:
            ValueError: nothing remains.
        """
        # A piece may be so short that its knots coincide: nothing remains of it.
        time_s = max(time_s, self.start_s)
        piece = bisect_right(self.knots_s, time_s) - 1
        if piece >= len(self.durations_s):
            raise ValueError(f"time {time_s} s: the trajectory ends at {self.end_s} s")
        state = self.sample(time_s)
        durations_s = self.durations_s[piece:].copy()
        durations_s[0] = self.knots_s[piece + 1] - time_s
        position, velocity, acceleration = (array[piece:].copy() for array in self.motion[:3])
        position[0], velocity[0] = state.position_leg_m, state.velocity_leg_mps
        acceleration[0] = state.acceleration_leg_mps2
        return Trajectory(
            time_s,
            durations_s,
            position,
            velocity,
            acceleration,
            self.jerk_leg_mps3[piece:],
        )

    def until(self, time_s: float) -> Trajectory:
        """Return the part before an absolute time after the start, the final coast included."""
        if time_s > self.end_s:
            return self.coasting_for(time_s - self.end_s)
        # A piece that would begin at that time is not begun.
        count = max(bisect_left(self.knots_s, time_s), 1)
        durations_s = self.durations_s[:count].copy()
        durations_s[-1] = time_s - self.knots_s[count - 1]
        return Trajectory(self.start_s, durations_s, *(array[:count] for array in self.motion))

    def followed_by(self, other: Trajectory) -> Trajectory:
        """Return this trajectory followed by ``other``, whose own start time does not matter."""
        joined = (np.concatenate(pair) for pair in zip(self._arrays, other._arrays, strict=True))
        return Trajectory(self.start_s, *joined)

    def shifted_by(self, shift_leg_m: Vector) -> Trajectory:
        """Return the same motion with every position moved by one vector, leg frame."""
        durations_s, position_leg_m, *rest = self._arrays
        moved_leg_m = position_leg_m + np.array(shift_leg_m)
        return Trajectory(self.start_s, durations_s, moved_leg_m, *rest)

    @property
    def _arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        return (self.durations_s, *self.motion)

    @property
    def _with_coast(self) -> tuple[FloatArray, ...]:
        """The motion of each piece, and of the coast after the last."""
        final, still = self.final, (0.0, 0.0, 0.0)
        coast = (final.position_leg_m, final.velocity_leg_mps, still, still)
        return tuple(np.vstack(pair) for pair in zip(self.motion, coast, strict=True))

    @cached_property
    def _sampled(self) -> tuple[float, State | None]:
        """The time that was asked for last, and the state then; None before the first."""
        return 0.0, None

    @cached_property
    def _pieces(self) -> list[tuple[Vector, Vector, Vector, Vector]]:
        """The motion of each piece, and of the coast after the last, as plain floats.

        A single sample reads them ten times faster than the arrays.
        """
        rows = [map(tuple, array.tolist()) for array in self.motion]
        still, final = (0.0, 0.0, 0.0), self.final
        coast = (final.position_leg_m, final.velocity_leg_mps, still, still)
        return [*zip(*rows, strict=True), coast]

    def _coast_time_s(self, axis: int, position_m: float) -> float | None:
        final = self.final.axis(axis)
        distance_m = position_m - final.position_m
        if distance_m * final.velocity_mps <= 0.0:
            return None
        return self.end_s + distance_m / final.velocity_mps


def _advanced(piece: tuple[Vector, Vector, Vector, Vector], t: float) -> State:
    """State after a time in a piece.  Written out: this runs several times in every tick."""
    (px, py, pz), (vx, vy, vz), (ax, ay, az), (jx, jy, jz) = piece
    return State(
        (
            px + t * (vx + t * (ax / 2.0 + t * jx / 6.0)),
            py + t * (vy + t * (ay / 2.0 + t * jy / 6.0)),
            pz + t * (vz + t * (az / 2.0 + t * jz / 6.0)),
        ),
        (vx + t * (ax + t * jx / 2.0), vy + t * (ay + t * jy / 2.0), vz + t * (az + t * jz / 2.0)),
        (ax + t * jx, ay + t * jy, az + t * jz),
    )


def _resample(profile: Profile, knots_s: FloatArray) -> list[tuple[float, float, float, float]]:
    """Position, velocity, acceleration and jerk of a profile on each interval between knots."""
    rows: list[tuple[float, float, float, float]] = []
    segments: Sequence[tuple[float, AxisState, float]] = profile.knots
    index = 0
    for knot_s in knots_s[:-1].tolist():
        while index + 1 < len(segments) and segments[index + 1][0] <= knot_s:
            index += 1
        begin_s, state, jerk_mps3 = segments[index]
        rows.append((*state.advanced(knot_s - begin_s, jerk_mps3), jerk_mps3))
    return rows
