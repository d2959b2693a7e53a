"""What a way to rest may ask of a vehicle under a contract."""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.assessment import Assessment
from onboard.contract.run_on import NO_RUN_ON, RunOn, coasting_run_on
from onboard.planning.rest_certifier import RestLimits

# A vehicle without lag still has no use for more jerk than this allows for.
_LAG_MIN_S: Final = 0.05


def rest_limits_of(assessment: Assessment) -> RestLimits:
    """Return what a way to rest may ask of the vehicle, whatever its heading is."""
    terms, limits = assessment.terms, assessment.limits
    box_mps2 = (limits.brake_mps2, limits.forward_mps2, limits.left_mps2, limits.right_mps2)
    least_mps2 = min(box_mps2)
    return RestLimits(
        body_radius_m=terms.body_m,
        speed_max_mps=terms.cruise_speed_mps,
        acceleration_max_mps2=(least_mps2,) * 4,
        acceleration_disc_mps2=least_mps2,
        jerk_max_mps3=least_mps2 / max(terms.attitude_lag_s, _LAG_MIN_S) / math.sqrt(2.0),
        run_on=_run_on_of(assessment, least_mps2),
    )


def _run_on_of(assessment: Assessment, acceleration_mps2: float) -> RunOn:
    terms = assessment.terms
    if not terms.passive_safety:
        return NO_RUN_ON
    run_on = coasting_run_on(
        terms.setpoint_loss_timeout_s,
        lag_s=terms.attitude_lag_s,
        brake_mps2=assessment.limits.brake_mps2,
        speed_max_mps=terms.cruise_speed_mps,
        acceleration_max_mps2=acceleration_mps2,
    )
    measured_m, measured_at_mps = terms.setpoint_loss_run_on_m, terms.setpoint_loss_run_on_speed_mps
    if measured_m is None or measured_at_mps is None:
        return run_on
    *first, (kappa_s, c_s2) = run_on.gains
    return RunOn((*first, (max(kappa_s, measured_m / measured_at_mps), c_s2)))
