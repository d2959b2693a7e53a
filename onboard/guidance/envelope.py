"""The limits of plans, and the speeds derived from them, under the contract in force."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.contract.assessment import Assessment
from onboard.motion.axis_profile import coasting_speed
from onboard.motion.trajectory import State, X
from onboard.planning.problem import Envelope

# A vehicle is at rest if it can stop within the tracking error, but not below the first speed and
# not above the second.  The estimate of a real hover reads up to 0.9 m/s (PX4), and its position
# wanders with it.
AT_REST_MPS: Final = 0.3
AT_REST_MAX_MPS: Final = 1.0

# A leg starts once the nose points along it, at rest, and the sensor has looked there since.
HEADING_TOLERANCE_RAD: Final = math.radians(5.0)


def envelope_of(assessment: Assessment) -> Envelope:
    """Return what plans may ask for: W, the thrust limit, and jerk that the attitude can follow.

    Full acceleration builds up within the attitude lag that the contract allows for (theory D).
    """
    terms, limits = assessment.terms, assessment.limits
    jerk_x_mps3 = jerk_y_mps3 = math.inf
    if terms.attitude_lag_s > 0.0:
        jerk_x_mps3 = max(limits.brake_mps2, limits.forward_mps2) / terms.attitude_lag_s
        jerk_y_mps3 = max(limits.left_mps2, limits.right_mps2) / terms.attitude_lag_s
    return Envelope(
        limits=limits,
        thrust_max_mps2=terms.thrust_to_weight * GRAVITY_MPS2,
        jerk_max_mps3=(jerk_x_mps3, jerk_y_mps3, jerk_y_mps3),
        speed_max_mps=terms.cruise_speed_mps,
        trim_mps2=assessment.reserved_trim_mps2,
    )


def envelope_from(state: State, envelope: Envelope) -> Envelope:
    """Return an envelope that also admits the speed from which a state has yet to slow down."""
    speed_max_mps = max(envelope.speed_max_mps, peak_speed_mps(state, envelope))
    return replace(envelope, speed_max_mps=speed_max_mps)


def any_heading(envelope: Envelope) -> Envelope:
    """Return limits that hold wherever the nose points: a square in the disc of the least one."""
    limits = envelope.limits
    least_mps2 = min(limits.brake_mps2, limits.forward_mps2, limits.left_mps2, limits.right_mps2)
    least_mps2 /= math.sqrt(2.0)
    jerk_x_mps3, jerk_y_mps3, jerk_z_mps3 = envelope.jerk_max_mps3
    jerk_mps3 = min(jerk_x_mps3, jerk_y_mps3) / math.sqrt(2.0)
    return replace(
        envelope,
        limits=AccelerationLimits(least_mps2, least_mps2, least_mps2, least_mps2),
        jerk_max_mps3=(jerk_mps3, jerk_mps3, jerk_z_mps3),
    )


def peak_speed_mps(state: State, envelope: Envelope) -> float:
    """Return the speed along the leg that is reached while the jerk limit ends an acceleration."""
    x = state.axis(X)
    return max(x.velocity_mps, coasting_speed(x, envelope.jerk_max_mps3[X]))


def at_rest_speed_mps(assessment: Assessment) -> float:
    """Return the speed below which the vehicle counts as at rest.

    From it the vehicle stops, attitude lag included, within its tracking error.
    """
    terms, brake_mps2 = assessment.terms, assessment.limits.brake_mps2
    lag_s = terms.attitude_lag_s
    stops_mps = brake_mps2 * (
        math.sqrt(lag_s**2 + 2.0 * terms.tracking_error_m / brake_mps2) - lag_s
    )
    return min(max(AT_REST_MPS, stops_mps), AT_REST_MAX_MPS)


def has_best_effort(assessment: Assessment) -> bool:
    """Tell whether to fly where passing obstacles is not guaranteed, in seen-free space only."""
    requirements = assessment.contract.requirements
    return requirements.progress == "best_effort" and requirements.stop


def is_shielded(assessment: Assessment) -> bool:
    """Tell whether the induction flies, but only what carries a certified way to rest with it."""
    requirements = assessment.contract.requirements
    return requirements.progress == "guaranteed" and requirements.stop


def broken_clauses(assessment: Assessment) -> list[str]:
    """Return which clauses keep the service in STANDBY; with best effort, those of safety."""
    best_effort = has_best_effort(assessment)
    return [
        clause.name
        for clause in assessment.clauses
        if not clause.holds and not (best_effort and clause.concerns == "progress")
    ]
