"""From the terms of a contract to the worst encounter and its Region of Influence.

Proofs: THEORY.md; the formulas run on floats and on arrays alike.
"""

from __future__ import annotations

import math
from typing import Generic, NamedTuple

from onboard.contract.agility import available_limits
from onboard.contract.arithmetic import Arithmetic
from onboard.contract.region import Dimensions, Encounter, dimensions
from onboard.contract.run_on import frozen_run_m, run_on_slope_s
from onboard.contract.stop_region import run_on_ahead_m, stop_dimensions
from onboard.contract.terms import Terms
from onboard.geometry.frames import Q, heading_displacement_m


class Derived(NamedTuple, Generic[Q]):
    """Quantities derived from the terms for the largest obstacle; lengths in metres.

    Attributes:
        encounter: the worst encounter: largest obstacle, highest speed, all errors that count.
        region: its Region of Influence, of stopping and sidestepping or in the published form.
        manoeuvre_encounter, manoeuvre: the same of an avoidance by Eq. 17, which swerves.
        margin_m: rho, by which obstacle faces move out (theory B, I).
        edge_offset_m: lateral distance to the farthest point that must be seen to decide.
        roi_length_m, roi_width_m: extent of the region and of its obstacle along and across.
        manoeuvre_width_m: the width that an avoidance by Eq. 17 may take.
        required_separation_box_m: along and across the leg: apart by one of the two suffices.
        required_separation_m: the same in any direction.
    """

    encounter: Encounter[Q]
    region: Dimensions[Q]
    manoeuvre_encounter: Encounter[Q]
    manoeuvre: Dimensions[Q]
    margin_m: Q
    edge_offset_m: Q
    roi_length_m: Q
    roi_width_m: Q
    manoeuvre_width_m: Q
    required_detection_range_m: Q
    required_separation_box_m: tuple[Q, Q]
    required_separation_m: Q
    stopping_distance_m: Q


def worst_encounter(
    terms: Terms[Q], size_along_m: Q, size_across_m: Q, ops: Arithmetic[Q]
) -> Encounter[Q]:
    """Return the worst encounter of an avoidance by Eq. 17, obstacle size (already inflated) given.

    Speeds are those of the vehicle, errors included, since an avoidance is planned from there.
    """
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


def stop_encounter(
    terms: Terms[Q], size_along_m: Q, size_across_m: Q, ops: Arithmetic[Q]
) -> Encounter[Q]:
    """Return the worst encounter where the vehicle stops and sidesteps.

    Speeds are those of the reference: its tracking error is part of the inflation (theory L).
    """
    swerving = worst_encounter(terms, size_along_m, size_across_m, ops)
    return _stopping(terms, swerving, run_on_slope_s(terms, ops), ops)


def _stopping(
    terms: Terms[Q], swerving: Encounter[Q], slope_s: Q, ops: Arithmetic[Q]
) -> Encounter[Q]:
    """Return the encounter of stopping from that of swerving, with the run-on's slope κ."""
    zero = slope_s * 0.0
    return Encounter(
        brake_mps2=swerving.brake_mps2,
        forward_mps2=swerving.forward_mps2,
        left_mps2=swerving.left_mps2,
        right_mps2=swerving.right_mps2,
        speed_mps=terms.cruise_speed_mps,
        lateral_speed_mps=terms.recentring_speed_mps,
        size_along_m=swerving.size_along_m,
        size_across_m=swerving.size_across_m,
        attitude_lag_s=swerving.attitude_lag_s,
        reaction_time_s=swerving.reaction_time_s,
        run_on_m=run_on_ahead_m(terms.cruise_speed_mps, swerving.brake_mps2, slope_s, ops),
        coast_time_s=zero,
        coast_drift_m=zero,
    )


def stop_region(
    terms: Terms[Q], size_along_m: Q, size_across_m: Q, ops: Arithmetic[Q]
) -> Dimensions[Q]:
    """Return the region of stopping and sidestepping an obstacle of this (inflated) size."""
    swerving = worst_encounter(terms, size_along_m, size_across_m, ops)
    return _stop_region(terms, swerving, ops)[1]


def _stop_region(
    terms: Terms[Q], swerving: Encounter[Q], ops: Arithmetic[Q]
) -> tuple[Encounter[Q], Dimensions[Q]]:
    """Return the encounter of stopping and its region, from that of swerving."""
    slope_s = run_on_slope_s(terms, ops)
    e = _stopping(terms, swerving, slope_s, ops)
    return e, stop_dimensions(e, slope_s, passive_safety=terms.passive_safety, ops=ops)


def face_error_m(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return e' [m], the map error of a face, with what a heading error displaces (theory B, I).

    A sensor knows the faces of its own box that well; along the leg, where the box may stand at any
    angle, a corner is off by up to the square root of two times that.
    No corner of an obstacle that is at all within the detection range is farther away than that
    range and the diagonal of the largest obstacle.
    """
    farthest_m = terms.detection_range_m + math.sqrt(2.0) * terms.obstacle_size_max_m
    displaced_m = heading_displacement_m(farthest_m, terms.heading_error_rad, ops.sin)
    return math.sqrt(2.0) * terms.map_error_m + displaced_m


def _run_on(terms: Terms[Q], speed_mps: Q, brake_mps2: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return forward run [m] and coasting time [s] after the setpoint stream stops (theory H).

    Any run but that of the coasting model is read as coasting for the time that, followed by
    braking, gives that run.  A measured one is scaled below its speed, and unknown (NaN) above it.
    """
    zero = speed_mps * 0.0
    if not terms.passive_safety:
        return zero, zero
    if terms.setpoint_loss_run_on_m is not None:
        return _measured_run_on(terms, terms.setpoint_loss_run_on_m, speed_mps, brake_mps2, ops)
    if terms.setpoint_loss_model == "frozen":
        frozen_m = frozen_run_m(terms, speed_mps, brake_mps2, ops)
        return frozen_m, _coasting_for(frozen_m, speed_mps, brake_mps2, ops)
    timeout_s = terms.setpoint_loss_timeout_s
    return speed_mps * timeout_s + speed_mps * speed_mps / (2.0 * brake_mps2), timeout_s


def _measured_run_on(
    terms: Terms[Q], run_on_m: Q, speed_mps: Q, brake_mps2: Q, ops: Arithmetic[Q]
) -> tuple[Q, Q]:
    zero = speed_mps * 0.0
    measured_at_mps = terms.setpoint_loss_run_on_speed_mps
    if measured_at_mps is None:
        measured_at_mps = terms.cruise_speed_mps
    fastest_mps = measured_at_mps + terms.velocity_error_x_mps
    # From rest the autopilot may hold the last acceleration, at most the limit, for its timeout.
    timeout_s = terms.setpoint_loss_timeout_s
    gained_mps = brake_mps2 * timeout_s
    from_rest_m = gained_mps * (timeout_s / 2.0 + terms.attitude_lag_s + timeout_s / 2.0)
    shorter_m = ops.maximum(zero, run_on_m - from_rest_m) * (1.0 - speed_mps / fastest_mps)
    covered = terms.cruise_speed_mps <= measured_at_mps
    unknown_m = zero + math.nan
    coast_time_s = _coasting_for(run_on_m, fastest_mps, brake_mps2, ops)
    return ops.where(covered, run_on_m - shorter_m, unknown_m), coast_time_s


def _coasting_for(run_on_m: Q, speed_mps: Q, brake_mps2: Q, ops: Arithmetic[Q]) -> Q:
    """Return for how long coasting at a speed, then braking, makes a run; at least 0."""
    coast_time_s = run_on_m / speed_mps - speed_mps / (2.0 * brake_mps2)
    return ops.maximum(speed_mps * 0.0, coast_time_s)


def derive(terms: Terms[Q], ops: Arithmetic[Q]) -> Derived[Q]:
    """Return every quantity that the clauses compare, for the largest obstacle."""
    margin_m = terms.body_m + 2.0 * face_error_m(terms, ops)
    size_m = terms.obstacle_size_max_m + 2.0 * margin_m
    swerving = worst_encounter(terms, size_m, size_m, ops)
    manoeuvre = dimensions(swerving, ops)
    beside_m = _beside(manoeuvre)
    if terms.stops:
        e, region = _stop_region(terms, swerving, ops)
        length_m, width_m = region.front_m + size_m, size_m + _beside(region)
        apart_m = (length_m, size_m + ops.maximum(region.overhang_left_m, region.overhang_right_m))
        # The nearest edge of an obstacle that the vehicle would only just meet.
        edge_m = margin_m + ops.maximum(region.drift_left_m, region.drift_right_m)
    else:
        e, region = swerving, manoeuvre
        length_m, width_m = (
            _published_length(terms, swerving, region, size_m, ops),
            size_m + beside_m,
        )
        apart_m = (length_m, width_m)
        edge_m = size_m - margin_m + ops.maximum(region.drift_left_m, region.drift_right_m)
    stop_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2)
    late_m = e.speed_mps * (e.reaction_time_s + e.attitude_lag_s)
    return Derived(
        encounter=e,
        region=region,
        manoeuvre_encounter=swerving,
        manoeuvre=manoeuvre,
        margin_m=margin_m,
        edge_offset_m=edge_m,
        roi_length_m=length_m,
        roi_width_m=width_m,
        manoeuvre_width_m=size_m + beside_m,
        required_detection_range_m=margin_m + region.front_m + terms.tracking_error_m,
        required_separation_box_m=apart_m,
        required_separation_m=ops.sqrt(apart_m[0] * apart_m[0] + apart_m[1] * apart_m[1]),
        stopping_distance_m=stop_m + late_m,
    )


def separation_m(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Q:
    """Return the separation required, in metres; of a pair, its diagonal with the pair's shares."""
    if terms.separation_shares is None:
        return derived.required_separation_m
    along, across = terms.separation_shares
    along_m, across_m = derived.required_separation_box_m
    return ops.maximum(along_m / along, across_m / across)


def _beside(region: Dimensions[Q]) -> Q:
    """Return what a region has beside its obstacle, on both sides together."""
    left_m = region.overhang_left_m + region.coast_left_m
    return left_m + region.overhang_right_m + region.coast_right_m


def _published_length(
    terms: Terms[Q], e: Encounter[Q], region: Dimensions[Q], size_m: Q, ops: Arithmetic[Q]
) -> Q:
    """Return L_x of THEORY.md, "Many obstacles".

    The border lies farthest behind the centre of the thinnest obstacle (erratum 11), the more so if
    its front face is measured too far away: only the body is certain to stand before it.
    """
    thin_m = terms.obstacle_size_min_m + 2.0 * terms.body_m
    behind_m = region.recovery_m - e.run_on_m - thin_m / 2.0
    return region.front_m + size_m / 2.0 + ops.maximum(behind_m, size_m / 2.0)
