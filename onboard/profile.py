"""Motion along one axis in segments of constant jerk, and the quickest change of its speed.

The building bricks of the closed-form manoeuvres: every function here is a formula, none searches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple


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

    def until(self, time_s: float) -> Profile:
        """Return the part before ``time_s``, coasting until then if the profile ends earlier."""
        kept: list[Segment] = []
        remaining_s = time_s
        for segment in self.segments:
            if segment.duration_s >= remaining_s:
                kept.append(segment._replace(duration_s=remaining_s))
                remaining_s = 0.0
                break
            kept.append(segment)
            remaining_s -= segment.duration_s
        if remaining_s > 0.0:
            kept.append(Segment(remaining_s, 0.0))
        return Profile(self.position_m, self.velocity_mps, tuple(kept))

    def then(self, *segments: Segment) -> Profile:
        """Return this profile followed by ``segments`` in place of its coast."""
        return Profile(self.position_m, self.velocity_mps, self.segments + segments)


class AxisLimits(NamedTuple):
    """What one axis may be asked for; a jerk limit of ``math.inf`` lets acceleration jump."""

    acceleration_min_mps2: float
    acceleration_max_mps2: float
    jerk_max_mps3: float

    def scaled(self, factor: float) -> AxisLimits:
        """Return the limits with less (or more) acceleration and the same jerk."""
        return AxisLimits(
            self.acceleration_min_mps2 * factor,
            self.acceleration_max_mps2 * factor,
            self.jerk_max_mps3,
        )


def coasting_speed(state: AxisState, jerk_max_mps3: float) -> float:
    """Velocity [m/s] reached when the acceleration is taken off as fast as the jerk allows."""
    acceleration_mps2 = state.acceleration_mps2
    return state.velocity_mps + acceleration_mps2 * abs(acceleration_mps2) / (2.0 * jerk_max_mps3)


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
