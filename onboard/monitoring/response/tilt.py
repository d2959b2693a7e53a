"""Check that the attitude delivers the acceleration that is asked for."""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import Terms
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.response.trim import TrimEstimator, tilt_acceleration
from onboard.vehicle_state import Pose

# Acceleration below which tilt says nothing, alone and as a share of the agility: an agile vehicle
# does more than that against gusts.  And the share of it that must be there in time.
ASKED_MIN_MPS2: Final = 0.5
ASKED_MIN_SHARE: Final = 0.25
DELIVERED_SHARE: Final = 0.4
# The autopilot itself takes this much back of what is asked for, to correct what a gust has done.
FEEDBACK_MPS2: Final = 0.8
PATIENCE_S: Final = 0.3


class TiltResponseMonitor:
    """Compares the tilt, less its trim, with the acceleration asked for.

    Args:
        trim: learns while little is asked for; nothing is checked before it is ready.
    """

    def __init__(self, trim: TrimEstimator) -> None:
        self._trim = trim
        self._lacking_since_s: float | None = None

    def check(
        self, pose: Pose, asked_ned_mps2: tuple[float, float], terms: Terms[float]
    ) -> Violation | None:
        """Check the attitude against the horizontal acceleration asked for, and learn the trim.

        Args:
            pose: attitude, and when.
            asked_ned_mps2: north and east, of the setpoint one attitude lag ago.
            terms: the contract.
        """
        asked_mps2 = math.hypot(*asked_ned_mps2)
        # A stuck attitude must not be learnt as trim while it is being checked.
        checked = self._trim.ready and asked_mps2 >= ASKED_MIN_MPS2
        if checked:
            self._trim.skip()
        else:
            self._trim.learn(pose)
        agility_mps2 = GRAVITY_MPS2 * math.tan(min(terms.roll_max_rad, terms.pitch_max_rad))
        if not checked or asked_mps2 < ASKED_MIN_SHARE * agility_mps2:
            self._lacking_since_s = None
            return None
        tilt_mps2, trim_mps2 = tilt_acceleration(pose), self._trim.trim_mps2
        delivered_mps2 = (
            (tilt_mps2[0] - trim_mps2[0]) * asked_ned_mps2[0]
            + (tilt_mps2[1] - trim_mps2[1]) * asked_ned_mps2[1]
        ) / asked_mps2
        limit_mps2 = min(DELIVERED_SHARE * asked_mps2, asked_mps2 - FEEDBACK_MPS2)
        if delivered_mps2 >= limit_mps2:
            self._lacking_since_s = None
            return None
        if self._lacking_since_s is None:
            self._lacking_since_s = pose.time_s
        if pose.time_s - self._lacking_since_s < PATIENCE_S + terms.attitude_lag_s:
            return None
        return Violation(Assumption.TILT_RESPONSE, delivered_mps2, limit_mps2, "m/s²")
