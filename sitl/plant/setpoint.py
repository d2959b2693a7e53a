"""What the controller flies: wanted motion at one instant.

A ``nan`` means "not controlled" (PX4's convention): without position the velocity is flown, without
velocity the acceleration.  Between updates a setpoint moves along its own derivatives.
"""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]


class Setpoint(NamedTuple):
    """Wanted motion at one instant, NED; ``nan`` = not controlled."""

    north_m: float = math.nan
    east_m: float = math.nan
    down_m: float = math.nan
    velocity_north_mps: float = math.nan
    velocity_east_mps: float = math.nan
    velocity_down_mps: float = math.nan
    acceleration_north_mps2: float = 0.0
    acceleration_east_mps2: float = 0.0
    acceleration_down_mps2: float = 0.0
    jerk_north_mps3: float = 0.0
    jerk_east_mps3: float = 0.0
    jerk_down_mps3: float = 0.0
    yaw_rad: float = 0.0
    yaw_rate_radps: float = 0.0

    @staticmethod
    def of(
        position_ned_m: Vector,
        velocity_ned_mps: Vector,
        acceleration_ned_mps2: Vector,
        jerk_ned_mps3: Vector,
        yaw_rad: float,
        yaw_rate_radps: float,
    ) -> Setpoint:
        """Return the setpoint of these vectors, NED."""
        north_m, east_m, down_m = position_ned_m
        velocity_north, velocity_east, velocity_down = velocity_ned_mps
        acceleration_north, acceleration_east, acceleration_down = acceleration_ned_mps2
        jerk_north, jerk_east, jerk_down = jerk_ned_mps3
        return Setpoint(
            north_m,
            east_m,
            down_m,
            velocity_north,
            velocity_east,
            velocity_down,
            acceleration_north,
            acceleration_east,
            acceleration_down,
            jerk_north,
            jerk_east,
            jerk_down,
            yaw_rad,
            yaw_rate_radps,
        )


def ahead(setpoint: Setpoint, age_s: float) -> Setpoint:
    """Return the setpoint moved along its own derivatives by ``age_s``; ``nan`` stays ``nan``."""
    t, t2, t3 = age_s, 0.5 * age_s * age_s, age_s * age_s * age_s / 6.0
    vn, ve, vd = (
        setpoint.velocity_north_mps,
        setpoint.velocity_east_mps,
        setpoint.velocity_down_mps,
    )
    an, ae, ad = (
        setpoint.acceleration_north_mps2,
        setpoint.acceleration_east_mps2,
        setpoint.acceleration_down_mps2,
    )
    jn, je, jd = setpoint.jerk_north_mps3, setpoint.jerk_east_mps3, setpoint.jerk_down_mps3
    return Setpoint(
        setpoint.north_m + (0.0 if math.isnan(vn) else vn * t + an * t2 + jn * t3),
        setpoint.east_m + (0.0 if math.isnan(ve) else ve * t + ae * t2 + je * t3),
        setpoint.down_m + (0.0 if math.isnan(vd) else vd * t + ad * t2 + jd * t3),
        vn + an * t + jn * t2,
        ve + ae * t + je * t2,
        vd + ad * t + jd * t2,
        an + jn * t,
        ae + je * t,
        ad + jd * t,
        jn,
        je,
        jd,
        setpoint.yaw_rad + setpoint.yaw_rate_radps * t,
        setpoint.yaw_rate_radps,
    )
