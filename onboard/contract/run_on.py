"""Where the vehicle may run on to when the setpoint stream stops, for any setpoint.

The run stays in the bounding box of the setpoint's position and of points that are linear in its
position, velocity and acceleration (THEORY.md, "Stop and sidestep"): along a cubic piece each of
them is a cubic again, so that they are rows of a QP and can be certified like the path itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from onboard.contract.agility import available_limits
from onboard.contract.arithmetic import SCALAR

if TYPE_CHECKING:
    from onboard.contract.arithmetic import Arithmetic
    from onboard.contract.terms import Terms
    from onboard.geometry.frames import Q

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
        if not all(math.isfinite(gain) for pair in self.gains for gain in pair):
            return (((0.0, 0.0), *self.gains),)  # unknown: no box around it is free
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


NO_RUN_ON: Final = RunOn()


def contract_run_on(terms: Terms[float], speed_max_mps: float | None = None) -> RunOn:
    """Return how the vehicle of a contract runs on; nothing without passive safety.

    A measured run that is longer than the model is one more point.  It says nothing of a setpoint
    that brakes: there the run is that of the model or of this point, whichever is longer.  It holds
    up to the speed at which it was measured on each axis, and nowhere above: not a number then, so
    that nothing certifies.

    Args:
        terms: of the contract.
        speed_max_mps: greatest Euclidean speed of a setpoint, where it exceeds the cruise speed.
    """
    if not terms.passive_safety:
        return NO_RUN_ON
    fastest_mps = max(terms.cruise_speed_mps, speed_max_mps or 0.0)
    kappa_s, c_s2 = _model(terms, fastest_mps, SCALAR)
    frozen = terms.setpoint_loss_model == "frozen"
    timeout_s, measured_s = terms.setpoint_loss_timeout_s, _measured_slope_s(terms, SCALAR)
    first = () if frozen else ((timeout_s, 0.0), (timeout_s, timeout_s**2 / 2.0))
    if not _is_covered(terms, fastest_mps):
        measured_s = math.nan
    # Not a number, above the speed at which it was measured, stays so: nothing certifies then.
    longest_s = kappa_s if measured_s <= kappa_s else measured_s  # noqa: FURB136  max() would drop NaN
    if frozen or longest_s != kappa_s:
        first = (*first, (longest_s, 0.0))
    if longest_s != kappa_s:
        # Where the acceleration opposes the speed, a greater kappa alone makes the run shorter.
        first = (*first, (kappa_s, c_s2))
    return RunOn((*first, *_swung_back(terms, c_s2), (longest_s, c_s2)))


def _is_covered(terms: Terms[float], fastest_mps: float) -> bool:
    """Tell whether a measured run, if there is one, was measured fast enough.

    The loops act on each axis by itself, where no setpoint is faster than the diagonal says.
    """
    if terms.setpoint_loss_run_on_m is None:
        return True
    measured_at_mps = terms.setpoint_loss_run_on_speed_mps or terms.cruise_speed_mps
    return fastest_mps <= math.sqrt(2.0) * measured_at_mps


def run_on_slope_s(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return kappa, the run per speed of a setpoint without acceleration; 0 without the clause.

    Not a number above the speed at which a run was measured: there it is unknown.
    """
    zero = terms.cruise_speed_mps * 0.0
    if not terms.passive_safety:
        return zero
    kappa_s, _ = _model(terms, terms.cruise_speed_mps, ops)
    measured_s = _measured_slope_s(terms, ops)
    # What is not a number stays so.
    return ops.where(measured_s <= kappa_s, zero + kappa_s, measured_s)


def frozen_run_m(terms: Terms[Q], speed_mps: Q, forward_mps2: Q, ops: Arithmetic[Q]) -> Q:
    """Return the longest modelled run of an autopilot that keeps flying to the last setpoint [m].

    The setpoint may still accelerate: at a, it has to have a² T/2L left to its greatest speed,
    where the jerk takes the limit L back within T.

    Args:
        terms: of a contract with that model.
        speed_mps: greatest speed of a setpoint.
        forward_mps2: L.
        ops: for floats or arrays.
    """
    kappa_s, c_s2 = _model(terms, speed_mps, ops)
    lost_s2 = kappa_s * terms.attitude_lag_s
    part_s2 = c_s2 * c_s2 / (2.0 * ops.maximum(lost_s2, lost_s2 * 0.0 + 1e-9))
    gained_s2 = ops.where(c_s2 >= lost_s2, c_s2 - lost_s2 / 2.0, part_s2)
    return kappa_s * speed_mps + gained_s2 * forward_mps2


def _model(terms: Terms[Q], speed_max_mps: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return kappa [s] and c [s²] of the farthest point of the model."""
    gain_per_s, velocity_gain_per_s = terms.setpoint_gain_per_s, terms.setpoint_velocity_gain_per_s
    if gain_per_s is not None and velocity_gain_per_s is not None:
        moving, resting = _overshoots(gain_per_s, terms.attitude_lag_s, ops)
        return moving / gain_per_s, resting / (gain_per_s * velocity_gain_per_s)
    timeout_s, lag_s = terms.setpoint_loss_timeout_s, terms.attitude_lag_s
    # A reference still has to take its acceleration back, within T at its jerk limit, before it
    # exceeds its own greatest speed: that much less does a coast add to the speed.
    taken_back_s = ops.maximum(lag_s, lag_s * 0.0 + 1e-9)
    shorter_s = ops.minimum(taken_back_s, timeout_s)
    gained_s = timeout_s - shorter_s + shorter_s * shorter_s / (2.0 * taken_back_s)
    x_mps2, y_mps2 = available_limits(terms, ops)
    fastest_mps = speed_max_mps + ops.sqrt(x_mps2 * x_mps2 + y_mps2 * y_mps2) * gained_s
    # It may fly in any direction when it has to brake.
    return _braking_gains(timeout_s, lag_s, ops.minimum(x_mps2, y_mps2), fastest_mps)


def _measured_slope_s(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return a measured run per speed; 0 without one, not a number above the speed of it."""
    zero = terms.cruise_speed_mps * 0.0
    run_on_m, measured_at_mps = terms.setpoint_loss_run_on_m, terms.setpoint_loss_run_on_speed_mps
    if run_on_m is None:
        return zero
    if measured_at_mps is None:
        measured_at_mps = terms.cruise_speed_mps
    covered = terms.cruise_speed_mps <= measured_at_mps
    return ops.where(covered, zero + run_on_m / measured_at_mps, zero + math.nan)


def _swung_back(terms: Terms[float], c_s2: float) -> tuple[tuple[float, float], ...]:
    """Return the point that bounds the run of a loop that overshoots, where a setpoint brakes.

    With the step response S of the loop, the speed moves the vehicle by ``(S + T S') / Kp`` and the
    acceleration by ``S / (Kp Kv)``.  After the peak S' is negative: then the speed carries it less
    far than the acceleration takes it back.  Their ratio stays above Kv times ``1 - r``, where r is
    the largest T |S'| over the first trough of S.
    """
    gain_per_s, velocity_gain_per_s = terms.setpoint_gain_per_s, terms.setpoint_velocity_gain_per_s
    if gain_per_s is None or velocity_gain_per_s is None:
        return ()
    product = gain_per_s * terms.attitude_lag_s
    if product <= 0.25:
        return ()
    root = math.sqrt(4.0 * product - 1.0)
    steepest = math.sqrt(product) * math.exp(-(math.pi + math.atan(root)) / root)
    trough = -math.expm1(-2.0 * math.pi / root)
    return (((1.0 - steepest / trough) * velocity_gain_per_s * c_s2, c_s2),)


def _braking_gains(timeout_s: Q, lag_s: Q, brake_mps2: Q, fastest_mps: Q) -> tuple[Q, Q]:
    """Return kappa [s] and c [s²] of the point that bounds braking after a coast.

    Args:
        timeout_s: of the coast.
        lag_s: until braking acts.
        brake_mps2: with which the autopilot stops.
        fastest_mps: greatest Euclidean speed at the end of the coast.
    """
    stopping_s = lag_s + fastest_mps / (2.0 * brake_mps2)
    return timeout_s + stopping_s, timeout_s * timeout_s / 2.0 + timeout_s * stopping_s


def overshoot(gain_per_s: float, lag_s: float) -> float:
    """Return how far the loop ``v' = (Kp (target - p) + v_ff - v) / lag`` overshoots its target.

    Starting with the velocity that the feed-forward asks for; 1 where the loop does not overshoot.
    """
    return _overshoots(gain_per_s, lag_s, SCALAR)[0]


def _overshoots(gain_per_s: Q, lag_s: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return the overshoot of what starts with its velocity, and of what starts at rest."""
    product = gain_per_s * lag_s
    excess = 4.0 * product - 1.0
    root = ops.sqrt(ops.maximum(excess, excess * 0.0 + 1e-12))
    none = 1.0 + 0.0 * excess
    turned_rad = math.pi - ops.atan2(root, none)
    moving = none + ops.sqrt(product) * ops.exp(-turned_rad / root)
    resting = none + ops.exp(-math.pi / root)
    return ops.where(excess > 0.0, moving, none), ops.where(excess > 0.0, resting, none)
