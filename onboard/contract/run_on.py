"""Where the vehicle may run on to when the setpoint stream stops, for any setpoint.

The run stays in the bounding box of the setpoint's position and of points that are linear in its
position, velocity and acceleration (two-tier theory, section 6): along a cubic piece each of them
is a cubic again, so that they are rows of a QP and can be certified like the path itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

# A run is covered by so many boxes.
_STRIPS: Final = 8


@dataclass(frozen=True)
class RunOn:
    """The points that bound a run, beside the setpoint's own position.

    Attributes:
        gains: (kappa [s], c [s²]) for each point ``position + kappa velocity + c acceleration``.
    """

    gains: tuple[tuple[float, float], ...] = ()

    @cached_property
    def strips(self) -> tuple[tuple[tuple[float, float], ...], ...]:
        """Points (kappa, c) of strips that cover the run together, the setpoint's own included.

        The run stays in the hull of the points, a polygon in the plane of kappa and c: between two
        values of kappa in the hull of that part of it.  The boxes around the parts hold far less of
        what lies beside a run that leads aside than the one box around all of it.
        """
        corners = _hull([(0.0, 0.0), *self.gains])
        kappas_s = [kappa_s for kappa_s, _ in corners]
        low_s, high_s = min(kappas_s), max(kappas_s)
        if high_s - low_s <= 0.0:
            return (tuple(corners),)
        edges_s = [low_s + (high_s - low_s) * i / _STRIPS for i in range(_STRIPS + 1)]
        return tuple(
            tuple(
                [corner for corner in corners if begin_s < corner[0] < end_s]
                + _at(corners, begin_s)
                + _at(corners, end_s)
            )
            for begin_s, end_s in pairwise(edges_s)
        )

    def reach_m(self, speed_mps: float) -> float:
        """Return how far a setpoint without acceleration may run on at a speed."""
        return max((kappa_s * speed_mps for kappa_s, _ in self.gains), default=0.0)


def _hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull of points in the plane, in order (monotone chain)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered
    halves = []
    for side in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in side:
            while len(chain) > 1:
                (x0, y0), (x1, y1) = chain[-2:]
                if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0:
                    break
                chain.pop()
            chain.append((x, y))
        halves.append(chain[:-1])
    return halves[0] + halves[1]


def _at(corners: list[tuple[float, float]], kappa_s: float) -> list[tuple[float, float]]:
    """Return the lowest and the highest point of a polygon at one kappa."""
    found = []
    for (k0_s, c0_s2), (k1_s, c1_s2) in zip(corners, corners[1:] + corners[:1], strict=True):
        if min(k0_s, k1_s) <= kappa_s <= max(k0_s, k1_s):
            share = (kappa_s - k0_s) / (k1_s - k0_s) if k1_s != k0_s else 0.0
            found += [c0_s2 + share * (c1_s2 - c0_s2)] + ([c1_s2] if k0_s == k1_s else [])
    return [(kappa_s, min(found)), (kappa_s, max(found))]


NO_RUN_ON = RunOn()


def frozen_run_on(kappa_s: float, *, gain_per_s: float, velocity_gain_per_s: float) -> RunOn:
    """Return the run of an autopilot that keeps flying to the last setpoint (PX4).

    The commanded velocity is ``v + Kp (p_setpoint - p)``, so it stops at ``p + v / Kp``, and the
    acceleration acts as a bias of ``a / Kv``: the run stays in the triangle of p, p + kappa v and
    p + kappa v + a / (Kp Kv).

    Args:
        kappa_s: overshoot over Kp, or what a measured run gives if that is longer.
        gain_per_s: Kp, of the position controller.
        velocity_gain_per_s: Kv, of the velocity controller.
    """
    return RunOn(((kappa_s, 0.0), (kappa_s, 1.0 / (gain_per_s * velocity_gain_per_s))))


def coasting_run_on(
    timeout_s: float,
    *,
    lag_s: float,
    brake_mps2: float,
    speed_max_mps: float,
    acceleration_max_mps2: float,
) -> RunOn:
    """Return the run of an autopilot that integrates the setpoint, then brakes (ArduPilot).

    The coast ``p + v t + a t²/2`` is a quadratic Bézier curve in the hull of p, p + v t_l and
    p + v t_l + a t_l²/2; the braking way is part of the segment from there to p + kappa v + c a
    (correction of C3).

    Args:
        timeout_s: t_l, until the autopilot stops by itself.
        lag_s: from a command until the acceleration acts.
        brake_mps2: with which it stops.
        speed_max_mps: greatest Euclidean speed of a setpoint.
        acceleration_max_mps2: greatest Euclidean acceleration of a setpoint.
    """
    fastest_mps = speed_max_mps + acceleration_max_mps2 * timeout_s
    stopping_s = lag_s + fastest_mps / (2.0 * brake_mps2)
    half_s2 = timeout_s**2 / 2.0
    return RunOn(
        (
            (timeout_s, 0.0),
            (timeout_s, half_s2),
            (timeout_s + stopping_s, half_s2 + timeout_s * stopping_s),
        )
    )


def overshoot(gain_per_s: float, lag_s: float) -> float:
    """Return how far the loop ``v' = (Kp (target - p) + v_ff - v) / lag`` overshoots its target.

    Starting with the velocity that the feed-forward asks for; 1 where the loop does not overshoot.
    """
    damping = 0.5 / math.sqrt(gain_per_s * lag_s)
    if damping >= 1.0:
        return 1.0
    root = math.sqrt(1.0 - damping**2)
    return 1.0 + math.exp(-damping * math.pi / root)
