"""Whether the rotors may turn: the checks before arming, and when a standing vehicle disarms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl.autopilot.settings import FlightSettings

_TILT_MAX_RAD: Final = math.radians(30.0)


@dataclass(frozen=True)
class PrearmInputs:
    """Inputs of the checks before arming.

    Attributes:
        estimator_ready: whether position and attitude are known.
        sensor_failed: whether any sensor has failed.
        tilt_rad: angle between the thrust axis and the vertical.
        battery_remaining, battery_critical: share of the charge, and the least to arm with.
    """

    estimator_ready: bool
    sensor_failed: bool
    tilt_rad: float
    battery_remaining: float
    battery_critical: float


def prearm_failures(inputs: PrearmInputs) -> list[str]:
    """Return the reasons not to arm; empty if none applies."""
    checks = (
        (not inputs.estimator_ready, "estimator not ready"),
        (inputs.sensor_failed, "sensor failure"),
        (inputs.tilt_rad > _TILT_MAX_RAD, "vehicle not level"),
        (inputs.battery_remaining < inputs.battery_critical, "battery too low"),
    )
    return [reason for failed, reason in checks if failed]


class Arming:
    """Keep whether the vehicle is armed, and whether it has flown since.

    Args:
        on_ground: whether the vehicle starts standing, disarmed; else armed, in flight.

    Attributes:
        armed: whether the rotors may turn.
    """

    def __init__(self, *, on_ground: bool) -> None:
        self.armed = not on_ground
        self._has_flown = not on_ground
        self._since_s = 0.0

    def arm(self, now_s: float) -> None:
        """Begin a flight."""
        self.armed = True
        self._since_s = now_s
        self._has_flown = False

    def disarm(self) -> None:
        """End a flight."""
        self.armed = False

    def note_take_off(self) -> None:
        """Note that the vehicle has left the ground."""
        self._has_flown = True

    def reason_to_disarm(
        self, now_s: float, standing_since_s: float, settings: FlightSettings
    ) -> str | None:
        """Return why an armed vehicle on the ground disarms by itself now; None if it does not."""
        delay_s = settings.disarm_landed_s if self._has_flown else settings.disarm_grounded_s
        if 0.0 <= delay_s <= now_s - max(self._since_s, standing_since_s):
            return "landed" if self._has_flown else "no take-off"
        return None
