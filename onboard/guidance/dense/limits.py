"""What ways to rest may ask of the vehicle under a contract."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from onboard.contract.run_on import LAG_MIN_S, RunOn, contract_run_on
from onboard.planning.rest_certifier import RestLimits

if TYPE_CHECKING:
    from onboard.contract.assessment import Assessment


def rest_limits_of(assessment: Assessment, *, any_heading: bool) -> RestLimits:
    """Return the limits of ways to rest.

    Args:
        assessment: the contract in force.
        any_heading: whether the nose may point anywhere: the accelerations of W hold along and
            across the nose only, the least of them in every direction, and so does the jerk.
    """
    terms, limits = assessment.terms, assessment.limits
    box_mps2 = (limits.brake_mps2, limits.forward_mps2, limits.left_mps2, limits.right_mps2)
    least_mps2 = min(box_mps2)
    lag_s = max(terms.attitude_lag_s, LAG_MIN_S)
    return RestLimits(
        body_radius_m=terms.body_m,
        speed_max_mps=terms.cruise_speed_mps,
        acceleration_max_mps2=(least_mps2,) * 4 if any_heading else box_mps2,
        acceleration_disc_mps2=least_mps2 if any_heading else math.inf,
        jerk_max_mps3=least_mps2 / lag_s / (math.sqrt(2.0) if any_heading else 1.0),
        run_on=run_on_of(assessment),
    )


def run_on_of(assessment: Assessment) -> RunOn:
    """Return how the vehicle runs on after a loss of the stream; nothing without the clause."""
    return contract_run_on(assessment.terms)
