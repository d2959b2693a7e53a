"""Motion along one axis in segments of constant jerk, and the quickest change of its speed.

The building blocks of the closed-form manoeuvres.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from onboard.motion import polynomial

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

_ITERATIONS_MAX = 60
_RESIDUAL = 1e-7


class Segment(NamedTuple):
    """Constant jerk for ``duration_s``, starting at ``acceleration_mps2``."""

    duration_s: float
    acceleration_mps2: float
    jerk_mps3: float = 0.0


class AxisState(NamedTuple):
    """Position, velocity and acceleration on one axis."""

    position_m: float
    velocity_mps: float
    acceleration_mps2: float

    def advanced(self, duration_s: float, jerk_mps3: float = 0.0) -> AxisState:
        """Return the state after ``duration_s`` of constant jerk."""
        p, v, a, j, t = *self, jerk_mps3, duration_s
        return AxisState(
            p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j
        )

    def after(self, segments: Iterable[Segment]) -> AxisState:
        """Return the state at the end of ``segments``, still with the last one's acceleration."""
        p, v, a = self
        for t, acceleration_mps2, j in segments:
            a = acceleration_mps2
            p += t * (v + t * (a / 2.0 + t * j / 6.0))
            v += t * (a + t * j / 2.0)
            a += t * j
        return AxisState(p, v, a)


def cut(segments: tuple[Segment, ...], duration_s: float) -> tuple[Segment, ...]:
    """Return the first ``duration_s`` of segments, followed by a coast if they are shorter."""
    kept: list[Segment] = []
    for segment in segments:
        if segment.duration_s >= duration_s:
            kept.append(segment._replace(duration_s=duration_s))
            duration_s = 0.0
            break
        kept.append(segment)
        duration_s -= segment.duration_s
    if duration_s > 0.0:
        kept.append(Segment(duration_s, 0.0))
    return tuple(kept)


@dataclass(frozen=True)
class Profile:
    """Motion on one axis from a position and velocity; afterwards it coasts at its last velocity.

    Position and velocity are continuous by construction; acceleration may jump between segments
    (an infinite jerk limit).
    """

    position_m: float
    velocity_mps: float
    segments: tuple[Segment, ...] = ()

    @cached_property
    def knots(self) -> tuple[tuple[float, AxisState, float], ...]:
        """Start time from 0 [s], state and jerk [m/s³] of every segment and the final coast."""
        knots: list[tuple[float, AxisState, float]] = []
        time_s, state = 0.0, AxisState(self.position_m, self.velocity_mps, 0.0)
        for duration_s, acceleration_mps2, jerk_mps3 in self.segments:
            state = state._replace(acceleration_mps2=acceleration_mps2)
            knots.append((time_s, state, jerk_mps3))
            time_s, state = time_s + duration_s, state.advanced(duration_s, jerk_mps3)
        knots.append((time_s, state._replace(acceleration_mps2=0.0), 0.0))
        return tuple(knots)

    @property
    def duration_s(self) -> float:
        """Time until the final coast."""
        return self.knots[-1][0]

    @property
    def final(self) -> AxisState:
        """State at the start of the final coast."""
        return self.knots[-1][1]

    def at(self, time_s: float) -> AxisState:
        """State ``time_s`` after the start."""
        start_s, state, jerk_mps3 = self.knots[0]
        for knot in self.knots:
            if knot[0] > time_s:
                break
            start_s, state, jerk_mps3 = knot
        return state.advanced(time_s - start_s, jerk_mps3)

    def last_time_at_s(self, position_m: float) -> float | None:
        """Last time before the final coast at which the profile crosses a position."""
        for (start_s, state, jerk_mps3), (end_s, *_) in reversed(
            list(itertools.pairwise(self.knots))
        ):
            p, v, a = state
            cubic_m = (p - position_m, v, a / 2.0, jerk_mps3 / 6.0)
            crossings_s = polynomial.roots(cubic_m, end_s - start_s)
            if crossings_s:
                return start_s + crossings_s[-1]
            if p == position_m:
                return start_s
        return None

    def then(self, *segments: Segment) -> Profile:
        """Return this profile followed by ``segments`` in place of its coast."""
        return Profile(self.position_m, self.velocity_mps, self.segments + segments)


class AxisLimits(NamedTuple):
    """Limits on one axis; a jerk limit of ``math.inf`` lets acceleration jump."""

    acceleration_min_mps2: float
    acceleration_max_mps2: float
    jerk_max_mps3: float

    @property
    def largest_mps2(self) -> float:
        """The larger of the two magnitudes."""
        return max(self.acceleration_max_mps2, -self.acceleration_min_mps2)

    def scaled(self, factor: float) -> AxisLimits:
        """Return the limits with less (or more) acceleration and the same jerk."""
        return AxisLimits(
            self.acceleration_min_mps2 * factor,
            self.acceleration_max_mps2 * factor,
            self.jerk_max_mps3,
        )

    def mirrored(self) -> AxisLimits:
        """Return the limits for the axis with its sign reversed."""
        return AxisLimits(
            -self.acceleration_max_mps2, -self.acceleration_min_mps2, self.jerk_max_mps3
        )


def coasting_speed(state: AxisState, jerk_max_mps3: float) -> float:
    """Return the velocity [m/s] after the acceleration was ended as fast as the jerk allows."""
    acceleration_mps2 = state.acceleration_mps2
    return state.velocity_mps + acceleration_mps2 * abs(acceleration_mps2) / (2.0 * jerk_max_mps3)


def largest(excess: Callable[[float], float], low: float, high: float) -> float | None:
    """Largest argument in [low, high] at which a rising function is not above zero (Illinois).

    Returns:
        An argument at which ``excess`` was seen not to be above zero, close to the largest; None
        if it is above zero at ``low`` already.
    """
    excess_low = excess(low)
    if excess_low > 0.0:
        return None
    excess_high = excess(high)
    if excess_high <= 0.0:
        return high
    weight_low, weight_high = excess_low, excess_high
    for _ in range(_ITERATIONS_MAX):
        if excess_low > -_RESIDUAL or high - low <= 1e-12 * abs(high):
            break
        middle = (low * weight_high - high * weight_low) / (weight_high - weight_low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        value = excess(middle)
        # An end that stays twice in succession counts half; else the other would converge slowly.
        if value <= 0.0:
            low, excess_low, weight_low, weight_high = middle, value, value, weight_high / 2.0
        else:
            high, weight_high, weight_low = middle, value, weight_low / 2.0
    return low


def displacement(
    state: AxisState, target_m: float, speed_mps: float, limits: AxisLimits
) -> tuple[Segment, ...]:
    """Move to rest at ``target_m``, at most at ``speed_mps``, and quickly.

    Returns:
        At most seven segments, which turn back if the axis cannot stop before the target.
    """
    direct = speed_change(state, 0.0, limits)
    stop_m = state.after(direct).position_m
    if target_m == stop_m:
        return direct
    way = 1.0 if target_m > stop_m else -1.0

    def through(peak_mps: float) -> tuple[Segment, ...]:
        rising = speed_change(state, way * peak_mps, limits)
        return rising + speed_change(AxisState(0.0, way * peak_mps, 0.0), 0.0, limits)

    def beyond_m(peak_mps: float) -> float:
        return way * (state.after(through(peak_mps)).position_m - target_m)

    # A peak of zero stops directly, which is short of the target.
    peak_mps = largest(beyond_m, 0.0, speed_mps) or 0.0
    if peak_mps == 0.0:
        return direct
    hold = Segment(-beyond_m(peak_mps) / peak_mps, 0.0)
    rising = speed_change(state, way * peak_mps, limits)
    return (*rising, hold, *through(peak_mps)[len(rising) :])


def speed_change(state: AxisState, target_mps: float, limits: AxisLimits) -> tuple[Segment, ...]:
    """Quickest change from ``state`` to ``target_mps`` at zero acceleration, within the limits.

    Returns:
        At most three segments: ramp, hold, ramp; just the hold where jerk is unlimited.  An
        acceleration beyond its limit at the start is brought back as fast as the jerk allows.
    """
    jerk = limits.jerk_max_mps3
    change_mps = target_mps - state.velocity_mps
    if math.isinf(jerk):
        limit = limits.acceleration_max_mps2 if change_mps > 0.0 else limits.acceleration_min_mps2
        return (Segment(change_mps / limit, limit),) if change_mps else ()
    # Mirrored so that the acceleration to build points up: the formulas are written once.
    up = 1.0 if target_mps >= coasting_speed(state, jerk) else -1.0
    limit = limits.acceleration_max_mps2 if up > 0.0 else -limits.acceleration_min_mps2
    start = up * state.acceleration_mps2
    peak = math.sqrt(max(0.0, up * change_mps * jerk + start * start / 2.0))
    hold_s = 0.0
    if peak > limit:
        ramps_mps = ((limit + start) * abs(limit - start) + limit * limit) / (2.0 * jerk)
        hold_s = max(0.0, (up * change_mps - ramps_mps) / limit)
        peak = limit
    segments = (
        Segment(
            abs(peak - start) / jerk,
            state.acceleration_mps2,
            math.copysign(jerk, up * (peak - start)),
        ),
        Segment(hold_s, up * peak),
        Segment(peak / jerk, up * peak, -up * jerk),
    )
    return tuple(segment for segment in segments if segment.duration_s > 0.0)
