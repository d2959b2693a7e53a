"""What passing a slow mover in flight requires, whatever it intends (THEORY.md, "Passing movers").

The mover is a box that grows with v_o on every side until the vehicle has passed it.  Notation
(theory -> here): v_o ``mover_mps``, of the fastest class that is declared, since it may hide behind
a slower one; kappa from "within range" to the acceleration acting; V_e and V_lo the greatest and
least speed of a cruise; S' the size of the box that is met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain
from typing import Final, Generic

from onboard.contract.arithmetic import SCALAR, Arithmetic
from onboard.contract.clause import Clause
from onboard.contract.derivation import Derived, worst_encounter
from onboard.contract.movers import RASTER_M, STAMP_ERROR_S
from onboard.contract.region import Encounter, least_advance
from onboard.contract.terms import Terms
from onboard.files.contract_terms.mover_terms import MoverClass
from onboard.geometry.frames import Q

# Where the vehicle is not faster than the mover, so much faster: nothing declared is as large then.
_LEAST_MPS: Final = 1e-3


@dataclass(frozen=True)
class Passing(Generic[Q]):
    """What passing one mover in flight takes.

    Attributes:
        front_m: from the inflated face, as first measured, to where it has to be in range.
        clearing_s: t*, until the vehicle is beside the growing box from the worst place before it.
        passing_s: t_e, until its rear is passed and the cruise speed regained.
        lane_m: beyond the inflated face as first measured, on either side.
        headed_for_m: beyond that face, within which a vehicle may be run into that flies straight.
        length_m, width_m: L_x and L_y, which hold no other obstacle, still or moving.
    """

    front_m: Q
    clearing_s: Q
    passing_s: Q
    lane_m: Q
    headed_for_m: Q
    length_m: Q
    width_m: Q


def passing(e: Encounter[Q], slow_mps: Q, mover_mps: float, ops: Arithmetic[Q]) -> Passing[Q]:
    """Return what passing a mover takes (theory M, 5).

    Args:
        e: the encounter with the inflated box as it is first measured, without any run-on; its
            lateral limits are alike, as a contract's are.
        slow_mps: V_lo, the least speed of entry.
        mover_mps: v_o.
        ops: for floats or arrays.
    """
    kappa_s = e.reaction_time_s + e.attitude_lag_s
    across_m = e.size_across_m + 2.0 * mover_mps * kappa_s
    clearing_s = _clearing_s(e, across_m, mover_mps, ops)
    depth_m = least_advance(e.speed_mps, e.brake_mps2, clearing_s, ops) + mover_mps * clearing_s
    front_m = depth_m + (e.speed_mps + mover_mps) * kappa_s
    # Where the vehicle is not faster, it takes so long that nothing declared suffices.
    faster_mps = ops.maximum(slow_mps - mover_mps, slow_mps * 0.0 + _LEAST_MPS)
    passing_s = clearing_s + _passed_m(e, slow_mps, mover_mps, clearing_s, ops) / faster_mps
    slowing_m, peak_mps = _slowing_aside(e, clearing_s, ops)
    border_m = _border_m(e, mover_mps, passing_s, peak_mps, ops)
    least_mps2, w = ops.minimum(e.left_mps2, e.right_mps2), e.lateral_speed_mps
    lane_m = mover_mps * (kappa_s + passing_s + e.attitude_lag_s) + slowing_m
    # The thinnest mover has no extent: the border lies farthest behind its centre.
    behind_m = ops.maximum(border_m, e.size_along_m / 2.0)
    return Passing(
        front_m=front_m,
        clearing_s=clearing_s,
        passing_s=passing_s,
        lane_m=lane_m,
        headed_for_m=mover_mps * (kappa_s + passing_s) + w * w / (2.0 * least_mps2),
        length_m=front_m + e.size_along_m / 2.0 + behind_m + mover_mps * passing_s,
        width_m=e.size_across_m + 2.0 * lane_m + mover_mps * passing_s,
    )


def _regaining_m(e: Encounter[Q]) -> Q:
    """Return what the attitude lag costs while the cruise speed is regained."""
    return e.speed_mps * (1.0 + e.brake_mps2 / e.forward_mps2) * e.attitude_lag_s


def _passed_m(
    e: Encounter[Q], slow_mps: Q, mover_mps: float, clearing_s: Q, ops: Arithmetic[Q]
) -> Q:
    """Return the way from t* on, relative to the mover's rear, until the speed is regained."""
    kappa_s = e.reaction_time_s + e.attitude_lag_s
    slowest_mps = ops.maximum(slow_mps - e.brake_mps2 * clearing_s, slow_mps * 0.0)
    deficit_mps = e.speed_mps - slowest_mps
    return (
        e.size_along_m
        + 2.0 * mover_mps * (kappa_s + clearing_s)
        + (e.speed_mps - slow_mps) * (kappa_s + clearing_s)
        + deficit_mps * deficit_mps / (2.0 * e.forward_mps2)
        + _regaining_m(e)
    )


def _slowing_aside(e: Encounter[Q], clearing_s: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return the way aside beyond the face that slowing down takes, and the peak speed.

    The speed is brought down to that of the face, and to rest at the end.
    """
    w, lag_s = e.lateral_speed_mps, e.attitude_lag_s
    most_mps2 = ops.maximum(e.left_mps2, e.right_mps2)
    least_mps2 = ops.minimum(e.left_mps2, e.right_mps2)
    crossing_mps = w + most_mps2 * clearing_s
    crossing_mps = ops.sqrt(crossing_mps * crossing_mps + 2.0 * most_mps2 * w * lag_s)
    peak_mps = crossing_mps + most_mps2 * lag_s
    lagging_m = crossing_mps * lag_s + most_mps2 * lag_s * lag_s / 2.0
    return lagging_m + peak_mps * peak_mps / (2.0 * least_mps2), peak_mps


def _border_m(
    e: Encounter[Q], mover_mps: float, passing_s: Q, peak_mps: Q, ops: Arithmetic[Q]
) -> Q:
    """Return how far behind the face the last of three things ends: rear, swerve, speed."""
    kappa_s, lag_s = e.reaction_time_s + e.attitude_lag_s, e.attitude_lag_s
    least_mps2 = ops.minimum(e.left_mps2, e.right_mps2)
    rear_m = e.size_along_m + mover_mps * (kappa_s + passing_s)
    rear_m = rear_m + e.speed_mps * (mover_mps / least_mps2 + lag_s)
    swerve_m = e.speed_mps * (peak_mps / least_mps2 + lag_s)
    speed_m = e.speed_mps * e.speed_mps / (2.0 * e.forward_mps2) + _regaining_m(e)
    return ops.maximum(rear_m, ops.maximum(swerve_m, speed_m))


def _clearing_s(e: Encounter[Q], across_m: Q, mover_mps: float, ops: Arithmetic[Q]) -> Q:
    """Return t*_o, when the sides' requirements at the worst place add up to nothing (theory M, 5).

    With limits alike on both sides no drift is faster than what they make in that time, so that
    none has to be outrun.
    """
    drift_mps = mover_mps + e.lateral_speed_mps
    both_mps2 = e.left_mps2 + e.right_mps2
    root_mps = ops.sqrt(4.0 * drift_mps * drift_mps + 2.0 * both_mps2 * across_m)
    return (2.0 * drift_mps + root_mps) / both_mps2


def class_passing(
    terms: Terms[Q], derived: Derived[Q], mover: MoverClass, ops: Arithmetic[Q]
) -> Passing[Q]:
    """Return what passing a mover of a class takes, among the classes that are declared."""
    size_m = mover.size_max_m + 2.0 * derived.margin_m
    encounter = worst_encounter(terms, size_m, size_m, ops)
    slow_mps = terms.cruise_speed_mps - terms.velocity_error_x_mps
    return passing(encounter, slow_mps, fastest_mps(terms), ops)


def fastest_mps(terms: Terms[Q]) -> float:
    """Return v_o of the fastest declared class: what is unseen may be one of it."""
    return max(mover.speed_max_mps for mover in terms.movers)


def avoidance_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    """Return the clauses of passing each class; none where that is not required."""
    if terms.movers_level != "avoid":
        return ()
    found = [passing_clauses(terms, derived, ops, mover) for mover in terms.movers]
    return tuple(chain(*found))


def passing_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q], mover: MoverClass
) -> tuple[Clause[Q], ...]:
    """Return the clauses of passing one class; breaking one costs time: it is waited for."""
    mover_mps, speed = fastest_mps(terms), derived.manoeuvre_encounter.speed_mps
    size = class_passing(terms, derived, mover, ops)
    slow_mps = terms.cruise_speed_mps - terms.velocity_error_x_mps
    fixed_m = derived.margin_m + terms.tracking_error_m + (speed + mover_mps) * STAMP_ERROR_S
    apart_m = ops.sqrt(size.length_m * size.length_m + size.width_m * size.width_m)
    rows = (
        (
            "faster",
            slow_mps * 0.0 + mover_mps,
            slow_mps,
            "m/s",
            "only a vehicle that is faster than a mover passes it",
        ),
        (
            "moving_range",
            fixed_m + size.front_m + RASTER_M,
            terms.detection_range_m,
            "m",
            "a mover must be seen before the last point where passing it is possible",
        ),
        (
            "moving_separation",
            apart_m,
            terms.obstacle_separation_min_m,
            "m",
            "no other obstacle, still or moving, may come near while a mover is passed",
        ),
    )
    return tuple(
        Clause(f"{name}.{mover.kind}", required, declared, unit, reason, concerns="progress")
        for name, required, declared, unit, reason in rows
    )


def passing_levels(terms: Terms[float], derived: Derived[float]) -> tuple[str, ...]:
    """Say of each declared class whether it is passed in flight, as an operator reads it."""
    if terms.radius_z_m is not None:  # none is met in flight
        return ()
    return tuple(_level(terms, derived, mover) for mover in terms.movers)


def _level(terms: Terms[float], derived: Derived[float], mover: MoverClass) -> str:
    name = f"{mover.kind} {mover.speed_max_mps:g} m/s"
    faster, ahead, apart = passing_clauses(terms, derived, SCALAR, mover)
    if not faster.holds:
        return (
            f"{name}: waited for, not passed: at {faster.declared:.2f} m/s the vehicle is not "
            f"faster than {faster.required:g} m/s"
        )
    takes = (
        f"{math.ceil(10.0 * ahead.required) / 10.0:.1f} m ahead and no other obstacle, still or "
        f"moving, within {math.ceil(apart.required):d} m"
    )
    if not (ahead.holds and apart.holds):
        return f"{name}: waited for, not passed: passing it needs {takes}"
    if terms.movers_level != "avoid":
        return f"{name}: waited for; requirements.movers = avoid would have it passed: {takes}"
    return (
        f"{name}: passed in flight where each stop on the way certifies, else waited for: {takes}"
    )
