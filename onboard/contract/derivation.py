"""From the terms of a contract to the worst encounter and its Region of Influence.

Proofs: THEORY.md; the formulas run on floats and on arrays alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic

from onboard.contract.agility import available_limits
from onboard.contract.arithmetic import Arithmetic
from onboard.contract.region import Dimensions, Encounter, dimensions
from onboard.contract.terms import Terms
from onboard.geometry.frames import Q, heading_displacement_m


@dataclass(frozen=True)
class Derived(Generic[Q]):
    """Quantities derived from the terms for the largest obstacle; lengths in metres.

    Attributes:
        encounter: the worst encounter: largest obstacle, highest speed, all errors.
        region: its Region of Influence.
        margin_m: rho, by which obstacle faces move out (theory B, I).
        edge_offset_m: lateral distance to the farthest point that must be seen to decide.
        roi_length_m, roi_width_m: L_x, L_y of THEORY.md, "Many obstacles".
    """

    encounter: Encounter[Q]
    region: Dimensions[Q]
    margin_m: Q
    edge_offset_m: Q
    roi_length_m: Q
    roi_width_m: Q
    required_detection_range_m: Q
    required_separation_m: Q
    stopping_distance_m: Q


def worst_encounter(
    terms: Terms[Q], size_along_m: Q, size_across_m: Q, ops: Arithmetic[Q]
) -> Encounter[Q]:
    """Return the worst encounter with an obstacle of this (already inflated) size."""
    x_mps2, y_mps2 = available_limits(terms, ops)
    speed_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
    run_on_m, coast_time_s = _run_on(terms, speed_mps, x_mps2, ops)
    return Encounter(
        brake_mps2=x_mps2,
        forward_mps2=x_mps2,
        left_mps2=y_mps2,
        right_mps2=y_mps2,
        speed_mps=speed_mps,
        lateral_speed_mps=terms.velocity_error_y_mps + terms.recentring_speed_mps,
        size_along_m=size_along_m,
        size_across_m=size_across_m,
        attitude_lag_s=terms.attitude_lag_s,
        reaction_time_s=terms.reaction_time_s,
        run_on_m=run_on_m,
        coast_time_s=coast_time_s,
        coast_drift_m=terms.recentring_speed_mps * coast_time_s,
    )


def face_error_m(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return e' [m], the map error of a face, with what a heading error displaces (theory I).

    No corner of an obstacle that is at all within the detection range is farther away than that
    range and the diagonal of the largest obstacle.
    """
    farthest_m = terms.detection_range_m + math.sqrt(2.0) * terms.obstacle_size_max_m
    displaced_m = heading_displacement_m(farthest_m, terms.heading_error_rad, ops.sin)
    return terms.map_error_m + displaced_m


def _run_on(terms: Terms[Q], speed_mps: Q, brake_mps2: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return forward run [m] and coasting time [s] after the setpoint stream stops (theory H).

    A measured run is read as coasting for the time that, followed by braking, gives that run.  It
    is scaled below the speed at which it was measured, and unknown (NaN) above it.
    """
    zero = speed_mps * 0.0
    if not terms.passive_safety:
        return zero, zero
    timeout_s = terms.setpoint_loss_timeout_s
    if terms.setpoint_loss_run_on_m is None:
        return speed_mps * timeout_s + speed_mps * speed_mps / (2.0 * brake_mps2), timeout_s
    run_on_m, measured_at_mps = terms.setpoint_loss_run_on_m, terms.setpoint_loss_run_on_speed_mps
    if measured_at_mps is None:
        measured_at_mps = terms.cruise_speed_mps
    fastest_mps = measured_at_mps + terms.velocity_error_x_mps
    coast_time_s = run_on_m / fastest_mps - fastest_mps / (2.0 * brake_mps2)
    # From rest the autopilot may hold the last acceleration, at most the limit, for its timeout.
    gained_mps = brake_mps2 * timeout_s
    from_rest_m = gained_mps * (timeout_s / 2.0 + terms.attitude_lag_s + timeout_s / 2.0)
    shorter_m = ops.maximum(zero, run_on_m - from_rest_m) * (1.0 - speed_mps / fastest_mps)
    covered = terms.cruise_speed_mps <= measured_at_mps
    unknown_m = zero + math.nan
    return ops.where(covered, run_on_m - shorter_m, unknown_m), ops.maximum(zero, coast_time_s)


def derive(terms: Terms[Q], ops: Arithmetic[Q]) -> Derived[Q]:
    """Return every quantity that the clauses compare, for the largest obstacle."""
    body_m = terms.body_m
    margin_m = body_m + 2.0 * face_error_m(terms, ops)
    size_m = terms.obstacle_size_max_m + 2.0 * margin_m
    e = worst_encounter(terms, size_m, size_m, ops)
    region = dimensions(e, ops)
    # The border lies farthest behind the centre of the thinnest obstacle (erratum 11), the more so
    # if its front face is measured too far away: only body_m is certain to stand before it.
    thin_m = terms.obstacle_size_min_m + 2.0 * body_m
    behind_m = region.recovery_m - e.run_on_m - thin_m / 2.0
    length_m = region.front_m + size_m / 2.0 + ops.maximum(behind_m, size_m / 2.0)
    width_m = (
        size_m
        + (region.overhang_left_m + region.coast_left_m)
        + (region.overhang_right_m + region.coast_right_m)
    )
    stop_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2)
    late_m = e.speed_mps * (e.reaction_time_s + e.attitude_lag_s)
    return Derived(
        encounter=e,
        region=region,
        margin_m=margin_m,
        edge_offset_m=_edge_offset(e, region, margin_m, ops),
        roi_length_m=length_m,
        roi_width_m=width_m,
        required_detection_range_m=margin_m + region.front_m + terms.tracking_error_m,
        required_separation_m=ops.sqrt(length_m * length_m + width_m * width_m),
        stopping_distance_m=stop_m + late_m,
    )


def _edge_offset(e: Encounter[Q], region: Dimensions[Q], margin_m: Q, ops: Arithmetic[Q]) -> Q:
    """Return the lateral distance to the farthest point that must be seen in time (erratum 13).

    Where there is room to stop, that is the nearest edge of an obstacle that the vehicle would
    only just meet; where there is not, it is the edge round which it has to pass.
    """
    t_m = region.avoidance_time_s
    grazing_m = margin_m + ops.maximum(region.drift_left_m, region.drift_right_m)
    passing_m = e.lateral_speed_mps * (t_m + e.attitude_lag_s) + (
        ops.maximum(e.right_mps2, e.left_mps2) * t_m * t_m / 2.0
    )
    return ops.where(region.flat, grazing_m, passing_m)
