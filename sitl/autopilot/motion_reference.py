"""Reference motion of the autonomous modes: braking, take-off, landing, go-to, return.

A reference (position, velocity, acceleration) is steered towards a wanted velocity within limits
of acceleration and jerk, so that the controller can follow it with full feed-forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

_ARRIVED_M = 0.1
_NEAR_GAIN_PER_S = 1.2  # speed per distance close to the target
_SOFTNESS = 0.7  # share of the limits that planned stops use; the rest absorbs their simplification


@dataclass(frozen=True)
class MotionLimits:
    """Limits of autonomous motion."""

    acceleration_horizontal_mps2: float
    acceleration_vertical_mps2: float
    jerk_mps3: float


class MotionReference:
    """A point with limited acceleration and jerk, NED; it starts with the vehicle's motion.

    Attributes:
        position_ned_m: where the reference is.
        yaw_rad: the heading to hold meanwhile.
    """

    def __init__(self, truth: VehicleTruth) -> None:
        self.position_ned_m = truth.position_ned_m
        self.yaw_rad = truth.yaw_rad
        self._velocity_mps = truth.velocity_ned_mps
        self._acceleration_mps2 = truth.acceleration_ned_mps2
        self._jerk_mps3 = (0.0, 0.0, 0.0)

    @property
    def speed_mps(self) -> float:
        """Speed of the reference."""
        return math.hypot(*self._velocity_mps)

    def setpoint(self) -> Setpoint:
        """Return what the controller is to fly until the next update."""
        return Setpoint.of(
            self.position_ned_m,
            self._velocity_mps,
            self._acceleration_mps2,
            self._jerk_mps3,
            self.yaw_rad,
            0.0,
        )

    def is_at(self, target_ned_m: Vector) -> bool:
        """Whether the reference has come to rest at the target."""
        return math.dist(self.position_ned_m, target_ned_m) < _ARRIVED_M and self.speed_mps < 0.1

    def steer(self, velocity_ned_mps: Vector, limits: MotionLimits, time_s: float) -> None:
        """Move on for ``time_s``, changing the velocity towards the wanted one."""
        error_n = velocity_ned_mps[0] - self._velocity_mps[0]
        error_e = velocity_ned_mps[1] - self._velocity_mps[1]
        error = math.hypot(error_n, error_e)
        push = _approach(error, limits.acceleration_horizontal_mps2, limits.jerk_mps3)
        horizontal = push / error if error > 0.0 else 0.0
        error_d = velocity_ned_mps[2] - self._velocity_mps[2]
        push_d = _approach(abs(error_d), limits.acceleration_vertical_mps2, limits.jerk_mps3)
        wanted = (horizontal * error_n, horizontal * error_e, math.copysign(push_d, error_d))
        self._move(wanted, limits.jerk_mps3, time_s)

    def go_to(
        self,
        target_ned_m: Vector,
        speed_mps: float,
        vertical_speed_mps: float,
        limits: MotionLimits,
        time_s: float,
        ahead_m: float = 0.0,
    ) -> None:
        """Move on for ``time_s`` straight to the target, slowing down to stop there.

        Horizontally, the stop is as much as ``ahead_m`` behind the target.
        """
        north = target_ned_m[0] - self.position_ned_m[0]
        east = target_ned_m[1] - self.position_ned_m[1]
        down = target_ned_m[2] - self.position_ned_m[2]
        distance = math.hypot(north, east)
        speed = _stopping_speed(distance + ahead_m, speed_mps, limits.acceleration_horizontal_mps2)
        scale = speed / distance if distance > 0.0 else 0.0
        sink = _stopping_speed(abs(down), vertical_speed_mps, limits.acceleration_vertical_mps2)
        self.steer((scale * north, scale * east, math.copysign(sink, down)), limits, time_s)

    def _move(self, wanted_mps2: Vector, jerk_max_mps3: float, time_s: float) -> None:
        change = tuple(
            wanted - now for wanted, now in zip(wanted_mps2, self._acceleration_mps2, strict=True)
        )
        largest = math.hypot(*change)
        share = min(1.0, jerk_max_mps3 * time_s / largest) if largest > 0.0 else 0.0
        per_second = share / time_s
        jerk = (per_second * change[0], per_second * change[1], per_second * change[2])
        acceleration, velocity = self._acceleration_mps2, self._velocity_mps
        t, t2, t3 = time_s, time_s**2 / 2.0, time_s**3 / 6.0
        self.position_ned_m = _sum(
            self.position_ned_m, (t, velocity), (t2, acceleration), (t3, jerk)
        )
        self._velocity_mps = _sum(velocity, (t, acceleration), (t2, jerk))
        self._acceleration_mps2 = _sum(acceleration, (t, jerk))
        self._jerk_mps3 = jerk


def _sum(vector: Vector, *scaled: tuple[float, Vector]) -> Vector:
    """``vector`` plus the others, each times its factor."""
    x, y, z = vector
    for factor, other in scaled:
        x += factor * other[0]
        y += factor * other[1]
        z += factor * other[2]
    return x, y, z


def _approach(error_mps: float, acceleration_mps2: float, jerk_mps3: float) -> float:
    """Acceleration from which the jerk limit lets the velocity error end without overshoot."""
    planned = math.sqrt(2.0 * _SOFTNESS * jerk_mps3 * error_mps)
    return min(acceleration_mps2, planned, 10.0 * error_mps)


def _stopping_speed(distance_m: float, speed_mps: float, acceleration_mps2: float) -> float:
    """Speed from which the acceleration limit allows to stop within the distance."""
    stopping = math.sqrt(_SOFTNESS * acceleration_mps2 * distance_m)
    return min(speed_mps, stopping, _NEAR_GAIN_PER_S * distance_m)
