"""Check how well the vehicle follows its reference against the contract's tracking errors."""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.assessment import Terms
from onboard.geometry.frames import Vector
from onboard.monitoring.assumptions import Assumption, Violation

# Consecutive poses beyond a bound before it counts: one may be an estimator's glitch.
CONFIRMATIONS: Final = 3


class TrackingMonitor:
    """Compares poses with the reference.

    Attributes:
        position_error_m: horizontal distance to the reference at the last pose.
        vertical_error_m: height above or below it, without sign.
        velocity_error_mps: along and across the leg, without sign.
    """

    def __init__(self) -> None:
        self._streaks: dict[tuple[Assumption, str], int] = {}
        self.position_error_m = self.vertical_error_m = 0.0
        self.velocity_error_mps = (0.0, 0.0)

    def check(
        self,
        position_error_leg_m: Vector,
        velocity_leg_mps: tuple[float, float],
        reference_velocity_leg_mps: tuple[float, float],
        terms: Terms[float],
        *,
        cruising: bool,
    ) -> list[Violation]:
        """Check one new pose against the tracking errors that the contract states.

        Args:
            position_error_leg_m: measured less reference.
            velocity_leg_mps: measured, horizontal.
            reference_velocity_leg_mps: of the reference at that time, horizontal.
            terms: the contract.
            cruising: outside every Region of Influence, where the velocity bound applies (paper,
                "Velocity Tracking Error").
        """
        self.position_error_m = math.hypot(*position_error_leg_m[:2])
        self.vertical_error_m = abs(position_error_leg_m[2])
        self.velocity_error_mps = (
            abs(velocity_leg_mps[0] - reference_velocity_leg_mps[0]),
            abs(velocity_leg_mps[1] - reference_velocity_leg_mps[1]),
        )
        assumed = Assumption
        bounds = [
            (assumed.TRACKING_ERROR, "", self.position_error_m, terms.tracking_error_m, "m"),
            (assumed.TRACKING_ERROR_Z, "", self.vertical_error_m, terms.tracking_error_z_m, "m"),
        ]
        if cruising:
            # Dangerous is flying faster than the contract's speed, or drifting faster than it
            # allows for; a velocity that only lags behind its reference does neither.
            fastest_mps = max(terms.cruise_speed_mps, reference_velocity_leg_mps[0])
            excess_mps = velocity_leg_mps[0] - fastest_mps
            sideways_mps = abs(velocity_leg_mps[1]) - terms.recentring_speed_mps
            bounds += [
                (assumed.VELOCITY_ERROR, "x", excess_mps, terms.velocity_error_x_mps, "m/s"),
                (assumed.VELOCITY_ERROR, "y", sideways_mps, terms.velocity_error_y_mps, "m/s"),
            ]
        return [
            Violation(assumption, measured, limit, unit, axis)
            for assumption, axis, measured, limit, unit in bounds
            if self._confirmed((assumption, axis), exceeded=measured > limit)
        ]

    def _confirmed(self, bound: tuple[Assumption, str], *, exceeded: bool) -> bool:
        self._streaks[bound] = self._streaks.get(bound, 0) + 1 if exceeded else 0
        return self._streaks[bound] >= CONFIRMATIONS
