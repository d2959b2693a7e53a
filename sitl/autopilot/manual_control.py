"""The pilot's sticks: MANUAL_CONTROL, and the velocity that they command.

Simulation shortcut: every mode flown by stick is flown as position control (sticks command
velocity), so that a pilot can take over; none of them gives attitude or thrust by hand.
"""

from __future__ import annotations

import math
from typing import Any

from sitl.plant.truth import Vector

_FULL_STICK = 1000.0
_THROTTLE_MIDDLE = 500.0
_DEAD_BAND = 0.05
_YAW_RATE_MAX_RADPS = math.radians(90.0)


class ManualControl:
    """The last stick positions and their age."""

    def __init__(self) -> None:
        self._received_s = -math.inf
        self._forward = self._right = self._up = self._clockwise = 0.0

    def receive(self, message: Any, now_s: float) -> None:
        """Take a MANUAL_CONTROL; sticks outside their range count as centred."""
        self._forward = _share(message.x, 0.0, _FULL_STICK)
        self._right = _share(message.y, 0.0, _FULL_STICK)
        self._up = _share(message.z, _THROTTLE_MIDDLE, _THROTTLE_MIDDLE)
        self._clockwise = _share(message.r, 0.0, _FULL_STICK)
        self._received_s = now_s

    def age_s(self, now_s: float) -> float:
        """Time since the last MANUAL_CONTROL; ``inf`` before the first."""
        return now_s - self._received_s

    def velocity_ned_mps(
        self, yaw_rad: float, speed_mps: float, climb_mps: float, sink_mps: float
    ) -> Vector:
        """Commanded velocity, given the speeds at full stick."""
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        return (
            speed_mps * (cosine * self._forward - sine * self._right),
            speed_mps * (sine * self._forward + cosine * self._right),
            -self._up * (climb_mps if self._up > 0.0 else sink_mps),
        )

    @property
    def climbs(self) -> bool:
        """Whether the throttle stick asks to climb."""
        return self._up > 0.0

    @property
    def yaw_rate_radps(self) -> float:
        """Commanded yaw rate, clockwise seen from above."""
        return self._clockwise * _YAW_RATE_MAX_RADPS


def _share(value: int, middle: float, reach: float) -> float:
    share = (value - middle) / reach
    return share if _DEAD_BAND < abs(share) <= 1.0 else 0.0
