"""Decide from motion and thrust, as a flight controller does, whether the vehicle stands."""

from __future__ import annotations

import math

from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import VehicleTruth

_TOUCHDOWN_S = 0.5  # signs of standing must last this long
_LIFTED_M = 0.15
_GROUND_SPEED_MAX_MPS, _VERTICAL_SPEED_MAX_MPS = 0.3, 0.15
_THRUST_SHARE = 0.7  # of the weight: the ground carries the rest


class LandDetector:
    """Decide whether the vehicle stands or flies; the commander distinguishes the phases between.

    Attributes:
        on_ground: whether the vehicle stands.
        since_s: when it last landed or took off.
    """

    def __init__(self, *, on_ground: bool, down_m: float) -> None:
        self.on_ground = on_ground
        self.since_s = 0.0
        self._ground_down_m = down_m
        self._still_since_s = math.inf

    def update(
        self,
        truth: VehicleTruth,
        setpoint: Setpoint | None,
        thrust_share: float,
        *,
        position_valid: bool = True,
    ) -> None:
        """Evaluate one tick.

        Args:
            truth: the vehicle's state.
            setpoint: what the controller flies; None while it does not.
            thrust_share: rotor thrust over weight.
            position_valid: whether the horizontal velocity is known; if not, it counts as zero.
        """
        if self.on_ground:
            if self._ground_down_m - truth.position_ned_m[2] > _LIFTED_M:
                self._enter(on_ground=False, now_s=truth.time_s)
            return
        slow = not position_valid or truth.ground_speed_mps < _GROUND_SPEED_MAX_MPS
        if not (slow and self._sits(truth, setpoint, thrust_share)):
            self._still_since_s = math.inf
            return
        self._still_since_s = min(self._still_since_s, truth.time_s)
        if truth.time_s - self._still_since_s >= _TOUCHDOWN_S:
            self._ground_down_m = truth.position_ned_m[2]
            self._enter(on_ground=True, now_s=truth.time_s)

    def _sits(self, truth: VehicleTruth, setpoint: Setpoint | None, thrust_share: float) -> bool:
        """Whether the ground carries the vehicle, although its setpoint is below."""
        level = abs(truth.velocity_ned_mps[2]) < _VERTICAL_SPEED_MAX_MPS
        wants_down = setpoint is None or _sinks(setpoint, truth)
        return level and thrust_share < _THRUST_SHARE and wants_down

    def _enter(self, *, on_ground: bool, now_s: float) -> None:
        self.on_ground = on_ground
        self.since_s = now_s
        self._still_since_s = math.inf


def _sinks(setpoint: Setpoint, truth: VehicleTruth) -> bool:
    if math.isnan(setpoint.down_m) and math.isnan(setpoint.velocity_down_mps):
        return setpoint.acceleration_down_mps2 > 0.1
    return setpoint.velocity_down_mps > 0.1 or setpoint.down_m > truth.position_ned_m[2] + 0.1


def climbs(setpoint: Setpoint, truth: VehicleTruth) -> bool:
    """Whether a setpoint asks a standing vehicle to leave the ground."""
    return (
        setpoint.down_m < truth.position_ned_m[2] - 0.1
        or (math.isnan(setpoint.down_m) and setpoint.velocity_down_mps < -0.05)
        or (
            math.isnan(setpoint.down_m)
            and math.isnan(setpoint.velocity_down_mps)
            and setpoint.acceleration_down_mps2 < -0.1
        )
    )
