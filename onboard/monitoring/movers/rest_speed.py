"""Checks that a vehicle whose setpoint rests has come to rest, as passive safety counts on."""

from __future__ import annotations

import math

from onboard.contract.terms import Terms
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.vehicle_state import Pose

# A setpoint that is slower than this rests.
_RESTING_MPS = 0.01


class RestSpeedMonitor:
    """Measures for how long the setpoint has rested."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def check(
        self,
        pose: Pose,
        reference: State | None,
        now_s: float,
        terms: Terms[float],
        rest_speed_mps: float,
    ) -> Violation | None:
        """Tell whether the vehicle moves although its setpoint has rested for long enough.

        Args:
            pose: the newest.
            reference: the setpoint now; None in STANDBY.
            now_s: the time.
            terms: of the contract.
            rest_speed_mps: of a vehicle at rest, at most.
        """
        resting = (
            terms.movers_meet
            and reference is not None
            and math.hypot(*reference.velocity_leg_mps) < _RESTING_MPS
        )
        if not resting:
            self._since_s = None
            return None
        if self._since_s is None:
            self._since_s = now_s
        speed_mps = math.hypot(*pose.velocity_ned_mps)
        if now_s - self._since_s < terms.rest_settle_s or speed_mps <= rest_speed_mps:
            return None
        return Violation(Assumption.REST_SPEED, speed_mps, rest_speed_mps, "m/s")
