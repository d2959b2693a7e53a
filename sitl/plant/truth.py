"""True state of the vehicle, as the world, the sensors and the ideal estimator see it."""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]


class VehicleTruth(NamedTuple):
    """State at one instant.

    Attributes:
        time_s: seconds since the start of the simulation.
        position_ned_m, velocity_ned_mps, acceleration_ned_mps2: local NED; at rest on the ground
            the acceleration is zero.
        attitude_quaternion: (w, x, y, z), turns FRD vectors into NED.
        body_rates_radps: (roll, pitch, yaw) rates, FRD.
        rotor_speeds_rpm: front right, rear left, front left, rear right.
    """

    time_s: float
    position_ned_m: Vector
    velocity_ned_mps: Vector
    acceleration_ned_mps2: Vector
    attitude_quaternion: tuple[float, float, float, float]
    body_rates_radps: Vector
    rotor_speeds_rpm: tuple[float, float, float, float]

    @property
    def roll_rad(self) -> float:
        """Z-Y-X Euler angle about the forward axis."""
        w, x, y, z = self.attitude_quaternion
        return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))

    @property
    def pitch_rad(self) -> float:
        """Z-Y-X Euler angle about the right axis."""
        w, x, y, z = self.attitude_quaternion
        return math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))

    @property
    def yaw_rad(self) -> float:
        """Heading from north towards east, in (-pi, pi]."""
        w, x, y, z = self.attitude_quaternion
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def tilt_rad(self) -> float:
        """Angle between the thrust axis and the vertical."""
        _, x, y, _ = self.attitude_quaternion
        return math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))

    @property
    def ground_speed_mps(self) -> float:
        """Horizontal speed."""
        return math.hypot(self.velocity_ned_mps[0], self.velocity_ned_mps[1])
