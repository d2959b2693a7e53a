"""States of the vehicle for the unit tests of the autopilot."""

import math

from sitl.plant.truth import Vector, VehicleTruth


def truth_at(
    time_s: float = 0.0,
    position_ned_m: Vector = (0.0, 0.0, 0.0),
    velocity_ned_mps: Vector = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    acceleration_ned_mps2: Vector = (0.0, 0.0, 0.0),
) -> VehicleTruth:
    """Return a level state."""
    return VehicleTruth(
        time_s=time_s,
        position_ned_m=position_ned_m,
        velocity_ned_mps=velocity_ned_mps,
        acceleration_ned_mps2=acceleration_ned_mps2,
        attitude_quaternion=(math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0)),
        body_rates_radps=(0.0, 0.0, 0.0),
        rotor_speeds_rpm=(0.0, 0.0, 0.0, 0.0),
    )
