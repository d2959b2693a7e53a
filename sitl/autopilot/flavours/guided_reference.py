"""How ArduPilot follows the targets of a companion computer: by a reference, NED.

GUIDED does not fly a target itself.  It steers a reference after it, whose acceleration changes no
faster than PSC_JERK_XY, so that the reference lags behind a target that asks for more.  WPNAV_ACCEL
does not limit the reference, but sets its feedback: J/A on the velocity, a quarter of that on the
position.  The lean angle limits its acceleration.  GUIDED reads all of them when it begins to
follow targets.  Heights pass unchanged.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import VehicleTruth

_POSITION_SHARE = 0.25  # of the velocity's gain
_PULL_SHARE = 1.0 - _POSITION_SHARE  # of the acceleration, planned with in closing a distance


@dataclass(frozen=True)
class ReferenceLimits:
    """PSC_JERK_XY, WPNAV_ACCEL, and the acceleration at ANGLE_MAX."""

    jerk_mps3: float
    acceleration_mps2: float
    acceleration_max_mps2: float


class GuidedReference:
    """The reference; it starts as the vehicle moves."""

    def __init__(self, truth: VehicleTruth, limits: ReferenceLimits) -> None:
        self._limits = limits
        self._gain_per_s = limits.jerk_mps3 / limits.acceleration_mps2
        self._position_m = complex(*truth.position_ned_m[:2])
        self._velocity_mps = complex(*truth.velocity_ned_mps[:2])
        self._acceleration_mps2 = complex(*truth.acceleration_ned_mps2[:2])

    def follow(self, target: Setpoint, time_s: float) -> Setpoint:
        """Return what is flown of a target for the next period, and move on by it.

        Horizontal vectors are complex numbers, north + i east, all given or none of them.
        """
        wanted_mps2 = complex(target.acceleration_north_mps2, target.acceleration_east_mps2)
        velocity_mps = complex(target.velocity_north_mps, target.velocity_east_mps)
        if not math.isnan(target.north_m):
            away_m = complex(target.north_m, target.east_m) - self._position_m
            given_mps = velocity_mps if cmath.isfinite(velocity_mps) else 0j
            pull_mps2 = _PULL_SHARE * self._limits.acceleration_mps2
            velocity_mps = given_mps + _closing(
                away_m, _POSITION_SHARE * self._gain_per_s, pull_mps2
            )
        if cmath.isfinite(velocity_mps):
            error_mps = velocity_mps - self._velocity_mps
            catching_mps2 = _closing(error_mps, self._gain_per_s, self._limits.jerk_mps3)
            wanted_mps2 += _shortened(catching_mps2, self._limits.acceleration_mps2)
        wanted_mps2 = _shortened(wanted_mps2, self._limits.acceleration_max_mps2)
        change_mps2 = _shortened(
            wanted_mps2 - self._acceleration_mps2, self._limits.jerk_mps3 * time_s
        )
        flown = self._setpoint(target, change_mps2 / time_s)
        self._move(change_mps2 / time_s, time_s)
        return flown

    def _setpoint(self, target: Setpoint, jerk_mps3: complex) -> Setpoint:
        return target._replace(
            north_m=self._position_m.real,
            east_m=self._position_m.imag,
            velocity_north_mps=self._velocity_mps.real,
            velocity_east_mps=self._velocity_mps.imag,
            acceleration_north_mps2=self._acceleration_mps2.real,
            acceleration_east_mps2=self._acceleration_mps2.imag,
            jerk_north_mps3=jerk_mps3.real,
            jerk_east_mps3=jerk_mps3.imag,
        )

    def _move(self, jerk_mps3: complex, time_s: float) -> None:
        t2, t3 = time_s**2 / 2.0, time_s**3 / 6.0
        self._position_m += (
            time_s * self._velocity_mps + t2 * self._acceleration_mps2 + t3 * jerk_mps3
        )
        self._velocity_mps += time_s * self._acceleration_mps2 + t2 * jerk_mps3
        self._acceleration_mps2 += time_s * jerk_mps3


def _closing(error: complex, gain_per_s: float, slowing: float) -> complex:
    """Return the rate at which to close an error: by the gain when near, to stop in time when far.

    Args:
        error: of a position [m] or a velocity [m/s].
        gain_per_s: rate for an error, near.
        slowing: change of the rate that is planned with, far away.
    """
    size = abs(error)
    near = slowing / gain_per_s**2
    if size <= near:
        return gain_per_s * error
    return error / size * math.sqrt(2.0 * slowing * (size - near / 2.0))


def _shortened(vector: complex, length_max: float) -> complex:
    length = abs(vector)
    return vector if length <= length_max else vector * (length_max / length)
