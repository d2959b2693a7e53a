"""Messages about the quality of the estimate, each built from a snapshot."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.snapshot import Snapshot

# These flags mean the same in both messages.
_EKF_GOOD = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)


_EKF_HORIZONTAL = mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS


_EKF_PREDICTED = mavlink.EKF_PRED_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_ABS


def ekf_status_report(s: Snapshot) -> Any:
    """EKF_STATUS_REPORT: how ArduPilot reports the quality of the estimate.

    Its variances rise at the failover; they are not measured, but the failsafe needs 0.8.
    """
    flags, variance = _estimator_flags(s), 0.02
    if not flags:
        flags = mavlink.EKF_UNINITIALIZED
    elif not s.estimator.position_valid:
        variance = 1.0
    return mavlink.MAVLink_ekf_status_report_message(flags, variance, variance, 0.02, 0.05, 0.0)


def estimator_status(s: Snapshot) -> Any:
    """ESTIMATOR_STATUS: how PX4 reports the quality of the estimate.

    Without GPS the ratios of innovations carry no information: only the accuracies grow, until
    the horizontal flags are cleared and the ratios become NaN.
    """
    estimator = s.estimator
    lost_for_s, error = estimator.lost_for_s, estimator.error
    ratios = (0.03 + 0.2 * abs(error.velocity_north_mps), 0.02 + 0.05 * abs(error.north_m))
    accuracy_m = 0.29
    if lost_for_s > 0.0:
        ratios = (0.01, 0.05)
        accuracy_m += 0.06 * lost_for_s + 0.045 * lost_for_s**2
    if not estimator.position_valid:
        accuracy_m += 4.0
    if lost_for_s >= estimator.profile.aiding_stops_s:
        ratios = (math.nan, math.nan)
    flags = _estimator_flags(s)
    if not flags:
        flags = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_CONST_POS_MODE
    return mavlink.MAVLink_estimator_status_message(
        round(s.truth.time_s * 1e6),
        flags,
        *ratios,
        0.02,
        0.08,
        math.nan,  # no range finder
        math.nan,  # no air speed
        accuracy_m,
        0.3,
    )


def _estimator_flags(s: Snapshot) -> int:
    """Return which estimates are valid; both messages share the flags.  0: none yet."""
    profile, lost_for_s = s.estimator.profile, s.estimator.lost_for_s
    if not s.reports_position and lost_for_s <= 0.0:
        return 0
    flags: int = _EKF_GOOD
    if s.realism.rest_is_constant_position and s.commander.on_ground and not s.commander.armed:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE
    if not s.estimator.position_valid:
        if not s.realism.reports_lost_position_s:
            return 0
        flags &= ~_EKF_HORIZONTAL
    if lost_for_s >= profile.aiding_stops_s:
        flags &= ~_EKF_PREDICTED
    return flags
