"""Solve the contract again in flight, for an environment or a vehicle worse than it assumes.

If the contract still complies with what was measured, the flight goes on at the same speed; else at
the highest speed at which it complies; else it ends in a hover.  The terms only worsen and the
speed only falls, in steps of a least size, so the response cannot chatter: after finitely many
steps it is final (tests/onboard/monitoring/test_adaptation.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from onboard.contract.assessment import Assessment, Terms, assess_terms
from onboard.monitoring.assumptions import Assumption, Violation

# An error that was exceeded once is assumed to reach this multiple of what was measured.
HEADROOM: Final = 1.25
# Errors beyond this multiple of the declared one indicate a fault, and are not adapted to.
ERROR_FACTOR_MAX: Final = 2.0
# Below this speed the vehicle hovers instead, and the operator decides.
SPEED_MIN_MPS: Final = 0.3
SPEED_STEP_MPS: Final = 0.05

# Where the vehicle always holds a certified way to rest in the space seen free, these cost time
# only: it slows down or stops, and goes on by itself once they hold again.
PROGRESS_ASSUMPTIONS: Final = frozenset(
    {
        Assumption.DETECTION_AGE,
        Assumption.REACTION_TIME,
        Assumption.DETECTION_RANGE,
        Assumption.FIELD_OF_VIEW,
        Assumption.OBSTACLE_SIZE,
        Assumption.ROI_INTERSECTION,
        Assumption.LATE_FIRST_SIGHT,
        Assumption.PLAN_EXISTS,
        Assumption.TICK_OVERRUN,
    }
)


def costs_progress_only(assumption: Assumption, terms: Terms[float]) -> bool:
    """Tell whether breaking an assumption costs time only, in the space seen free.

    The speed of the vehicle itself matters to how it runs on after a loss of the stream, and to
    nothing else there: what is flown is certified for the reference.
    """
    if assumption is Assumption.VELOCITY_ERROR:
        return not terms.passive_safety
    return assumption in PROGRESS_ASSUMPTIONS


@dataclass(frozen=True)
class Adaptation:
    """The contract solved again.

    Attributes:
        assessment: for what was measured, at a speed at which it complies.
        slower: whether that speed is below the one before.
    """

    assessment: Assessment
    slower: bool


def _with_speed_error(terms: Terms[float], seen_mps: float) -> Terms[float]:
    """Return the terms with a larger speed error.

    A measured run-on covers the speed at which it was measured, errors included: a larger error
    leaves less of that speed for the cruise.
    """
    error_mps = max(terms.velocity_error_x_mps, seen_mps)
    measured_at_mps = terms.setpoint_loss_run_on_speed_mps
    if measured_at_mps is not None:
        measured_at_mps += terms.velocity_error_x_mps - error_mps
    return replace(
        terms, velocity_error_x_mps=error_mps, setpoint_loss_run_on_speed_mps=measured_at_mps
    )


Worsening = Callable[[Terms[float], float], Terms[float]]

# How a measured violation of each assumption changes the terms; the key is the assumption and, for
# the velocity error, its axis.  The measured value has the unit of the contract's key: degrees.
WORSENINGS: Final[dict[tuple[Assumption, str], Worsening]] = {
    (Assumption.DETECTION_RANGE, ""): lambda terms, seen: replace(
        terms, detection_range_m=min(terms.detection_range_m, seen)
    ),
    (Assumption.FIELD_OF_VIEW, ""): lambda terms, seen: replace(
        terms, field_of_view_rad=min(terms.field_of_view_rad, math.radians(seen))
    ),
    (Assumption.DETECTION_UNCERTAINTY, ""): lambda terms, seen: replace(
        terms, position_error_m=max(terms.position_error_m, seen)
    ),
    (Assumption.REACTION_TIME, ""): lambda terms, seen: replace(
        terms, reaction_time_s=max(terms.reaction_time_s, seen * HEADROOM)
    ),
    (Assumption.OBSTACLE_SIZE, ""): lambda terms, seen: replace(
        terms, obstacle_size_max_m=max(terms.obstacle_size_max_m, seen)
    ),
    (Assumption.ROI_INTERSECTION, ""): lambda terms, seen: replace(
        terms, obstacle_separation_min_m=min(terms.obstacle_separation_min_m, seen)
    ),
    (Assumption.TRACKING_ERROR, ""): lambda terms, seen: replace(
        terms, tracking_error_m=max(terms.tracking_error_m, seen * HEADROOM)
    ),
    (Assumption.TRACKING_ERROR_Z, ""): lambda terms, seen: replace(
        terms, tracking_error_z_m=max(terms.tracking_error_z_m, seen * HEADROOM)
    ),
    (Assumption.WIND, ""): lambda terms, seen: replace(
        terms, wind_max_mps=max(terms.wind_max_mps or 0.0, seen * HEADROOM)
    ),
    (Assumption.VELOCITY_ERROR, "x"): lambda terms, seen: _with_speed_error(terms, seen * HEADROOM),
    (Assumption.VELOCITY_ERROR, "y"): lambda terms, seen: replace(
        terms, velocity_error_y_mps=max(terms.velocity_error_y_mps, seen * HEADROOM)
    ),
}


def adapt(assessment: Assessment, violation: Violation) -> Adaptation | None:
    """Solve the contract again for a violated assumption.

    Args:
        assessment: the contract in force.
        violation: what was measured.

    Returns:
        None if no speed complies, if the measured error indicates a fault, or if the contract has
        no number for what failed: it has none for a blind sensor or an unknown position, and a nose
        off its command, a rejected magnetometer or turned sightings show that the heading is wrong
        but not by how much.
    """
    axis = violation.subject if violation.assumption is Assumption.VELOCITY_ERROR else ""
    worsening = WORSENINGS.get((violation.assumption, axis))
    if worsening is None:
        return None
    before = assessment.terms
    terms = worsening(before, violation.measured)
    if _indicates_fault(terms, Terms.of(assessment.contract)):
        return None
    return at_compliant_speed(replace(assessment, terms=terms), before.cruise_speed_mps)


def _indicates_fault(terms: Terms[float], declared: Terms[float]) -> bool:
    """Tell whether an error is too large for the vehicle that the contract describes."""
    errors = (
        (terms.tracking_error_z_m, declared.tracking_error_z_m),
        (terms.wind_max_mps or 0.0, declared.wind_max_mps or 0.0),
        (terms.tracking_error_m, declared.tracking_error_m),
        (terms.velocity_error_x_mps, declared.velocity_error_x_mps),
        (terms.velocity_error_y_mps, declared.velocity_error_y_mps),
    )
    return any(seen > ERROR_FACTOR_MAX * stated for seen, stated in errors)


def at_compliant_speed(assessment: Assessment, speed_max_mps: float) -> Adaptation | None:
    """Return the assessment at the highest speed that complies, in steps from ``speed_max_mps``.

    Bisection: every requirement except that on the field of view, and those of passing movers,
    grows with speed.  Where one of these decides, the search may miss a speed, but never returns
    one that does not comply.

    Returns:
        None if no speed down to `SPEED_MIN_MPS` complies.
    """
    if _at(assessment, speed_max_mps).compliant:
        return Adaptation(_at(assessment, speed_max_mps), slower=False)
    # Steps taken off the speed: too few at `low`, enough at `high` unless none are.
    low, high = 0, math.floor((speed_max_mps - SPEED_MIN_MPS) / SPEED_STEP_MPS)
    while high - low > 1:
        middle = (low + high) // 2
        if _at(assessment, speed_max_mps - middle * SPEED_STEP_MPS).compliant:
            high = middle
        else:
            low = middle
    solved = _at(assessment, speed_max_mps - high * SPEED_STEP_MPS)
    return Adaptation(solved, slower=True) if high > 0 and solved.compliant else None


def _at(assessment: Assessment, speed_mps: float) -> Assessment:
    terms = replace(assessment.terms, cruise_speed_mps=speed_mps)
    return assess_terms(assessment.contract, terms)


def slowing_distance(before: Assessment, speed_mps: float, adapted: Assessment) -> float:
    """Bound the distance flown while slowing down to the adapted speed, in metres.

    Braking builds up and ends within the lag T, as if it began T/2 later and ended T/2 earlier;
    before that, it takes up to T/2 to end the half acceleration with which cruises speed up.

    Args:
        before: the contract until now.
        speed_mps: greatest speed while slowing down.
        adapted: the contract from now on.
    """
    final_mps = adapted.terms.cruise_speed_mps
    # The adaptation, to wind for instance, may leave less to brake with.
    brake_mps2 = min(before.limits.brake_mps2, adapted.limits.brake_mps2)
    change_m = max(0.0, speed_mps**2 - final_mps**2) / (2.0 * brake_mps2)
    return change_m + 1.5 * speed_mps * before.terms.attitude_lag_s


def slows_in_time(before: Assessment, speed_mps: float, adapted: Assessment) -> bool:
    """Tell whether the adapted speed is reached before an unseen obstacle could matter.

    Obstacles within the range declared before are known, except for the age of the newest frame;
    the region of an obstacle just beyond must not begin before the vehicle has slowed down.  The
    arguments are those of `slowing_distance`.
    """
    terms = before.terms
    known_m = (
        terms.detection_range_m
        - before.inflated.manoeuvre_encounter.speed_mps * terms.frame_age_max_s
    )
    needed_m = adapted.inflated.required_detection_range_m
    return slowing_distance(before, speed_mps, adapted) + needed_m < known_m
