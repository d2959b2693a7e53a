"""What ways to rest may ask of the vehicle under a contract."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from onboard.contract.run_on import RunOn, contract_run_on
from onboard.perception.seen_free import CELL_M
from onboard.planning.corridor.look import TURN_FAST_RADPS
from onboard.planning.rest_certifier import RestLimits

if TYPE_CHECKING:
    from onboard.contract.assessment import Assessment

# At the edge of a view, cells are not seen as a whole: so much of it counts as edge at least.
_EDGE_RAD: Final = math.radians(12.0)
# Of lengths near the vehicle.
_ROUND_OFF_M: Final = 1e-3
# A look shows at least this share of what the view holds.
_SHOWN_SHARE: Final = 1.0 / 3.0
# A vehicle without lag still has no use for more jerk than this allows for.
_LAG_MIN_S: Final = 0.05
# Of the jerk that the attitude can follow, turning the nose in flight takes no more than this.
_TURN_SHARE: Final = 0.5


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
    lag_s = max(terms.attitude_lag_s, _LAG_MIN_S)
    jerk_mps3 = least_mps2 / lag_s
    if any_heading:
        # The vehicle tilts in its body's frame.  There an acceleration a whose nose turns at omega
        # changes by a * omega besides, and the jerk of two axes may add up.
        turning_mps3 = least_mps2 * turn_max_radps(assessment)
        jerk_mps3 = (jerk_mps3 - turning_mps3) / math.sqrt(2.0)
    return RestLimits(
        body_radius_m=terms.body_m,
        speed_max_mps=terms.cruise_speed_mps,
        acceleration_max_mps2=(least_mps2,) * 4 if any_heading else box_mps2,
        acceleration_disc_mps2=least_mps2 if any_heading else math.inf,
        jerk_max_mps3=jerk_mps3,
        run_on=run_on_of(assessment),
    )


def turn_max_radps(assessment: Assessment) -> float:
    """Return how fast the nose may turn in flight, where it may point anywhere."""
    lag_s = max(assessment.terms.attitude_lag_s, _LAG_MIN_S)
    return min(TURN_FAST_RADPS, _TURN_SHARE / lag_s)


def run_on_of(assessment: Assessment, speed_max_mps: float | None = None) -> RunOn:
    """Return how the vehicle runs on after a loss of the stream; nothing without the clause.

    Args:
        assessment: the contract in force.
        speed_max_mps: greatest Euclidean speed of a setpoint, where it may exceed the contract's
            speed along the leg.
    """
    return contract_run_on(assessment.terms, speed_max_mps)


def shown_half_view_rad(assessment: Assessment) -> float:
    """Return how far off the nose a look at rest shows cells near the vehicle, errors included.

    Of cells at twice the body's radius; nearer ones belong to where it rests, mostly.  The sensor
    may be off by as much as boxes, and a cell grows by what an error of the heading displaces
    (`onboard.perception.line_of_sight`): the nearer it is, the more of the view that takes.
    """
    terms, error_rad = assessment.terms, assessment.terms.heading_error_rad
    distance_m, astray_m = 2.0 * terms.body_m, math.sqrt(2.0) * terms.map_error_m
    cell_m = CELL_M / 2.0 * (1.0 + math.sqrt(2.0) * error_rad)
    radius_m = math.sqrt(2.0) * (cell_m + error_rad * distance_m) + _ROUND_OFF_M
    clear_m = distance_m - radius_m
    edge_rad = math.pi
    if clear_m > astray_m:
        width_rad = radius_m / math.sqrt(clear_m * (distance_m + radius_m))
        shy_rad = astray_m / math.sqrt((clear_m - astray_m) * clear_m)
        edge_rad = max(width_rad + shy_rad, _EDGE_RAD)
    half_rad = terms.sure_view_rad / 2.0
    return max(half_rad - edge_rad, _SHOWN_SHARE * half_rad)
