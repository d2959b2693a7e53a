"""The plant of an adversary: it moves exactly as it is told, plus the error that it wants.

A named simulation in place of rotors and controller.  The vehicle is where its setpoint is, plus a
tracking error; it flies at the setpoint's velocity, plus a velocity error; its attitude delivers
the setpoint's acceleration without lag.  So every allowance of a contract can be used to its end
and at will, which no physical vehicle does, and a flight takes no integration.

Simplification: position and velocity error are chosen apart from one another, as if the velocity
error were a ripple that is too fast to be seen in the position.
"""

from __future__ import annotations

import math
from typing import Final

from sitl.plant.inner_loop import STATE, UNTRIMMED, Flight, Plain
from sitl.plant.multirotor import GRAVITY_MPS2
from sitl.plant.setpoint import Setpoint, ahead

# Below this speed the velocity error shrinks with the speed: a vehicle at rest stands still.
_SLOW_MPS: Final = 1.0
# How fast the nose follows the commanded heading.
_YAW_RATE_MAX_RADPS: Final = 2.0


def follow(
    flight: Flight,
    setpoint: Setpoint,
    age_s: float,
    passed_s: float,
    velocity_error_ned_mps: tuple[float, float] = (0.0, 0.0),
) -> Flight:
    """Return where the vehicle is after a time under a moving setpoint.

    Args:
        flight: before.
        setpoint: with the tracking error already added to its position; where it has no position,
            its velocity is flown, where it has no velocity either, the vehicle stays.
        age_s: of the setpoint when the time begins.
        passed_s: the time.
        velocity_error_ned_mps: in full from a speed of 1 m/s on, in proportion below.
    """
    wanted = ahead(setpoint, age_s + passed_s)
    n, e, d, *_ = flight.values[STATE]
    vn, ve, vd, an, ae, ad = (0.0 if math.isnan(value) else value for value in wanted[3:9])
    position = (
        n + vn * passed_s if math.isnan(wanted.north_m) else wanted.north_m,
        e + ve * passed_s if math.isnan(wanted.east_m) else wanted.east_m,
        min(d + vd * passed_s if math.isnan(wanted.down_m) else wanted.down_m, 0.0),
    )
    share = min(math.hypot(vn, ve) / _SLOW_MPS, 1.0)
    error_north, error_east = velocity_error_ned_mps
    velocity = (vn + share * error_north, ve + share * error_east, vd)
    yaw_before_rad = _yaw_rad(flight.values[STATE])
    most_rad = _YAW_RATE_MAX_RADPS * passed_s
    turn_rad = math.remainder(wanted.yaw_rad - yaw_before_rad, 2.0 * math.pi)
    turn_rad = max(-most_rad, min(most_rad, turn_rad))
    attitude = _attitude(an, ae, ad, yaw_before_rad + turn_rad)
    rates = (0.0, 0.0, turn_rad / passed_s if passed_s else 0.0)
    rotors = flight.values[STATE][13:17]
    state: Plain = (*position, *velocity, *attitude, *rates, *rotors)
    return Flight(state + UNTRIMMED + (an, ae, ad))


def _yaw_rad(state: Plain) -> float:
    w, x, y, z = state[6:10]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _attitude(
    north_mps2: float, east_mps2: float, down_mps2: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of the attitude whose thrust gives an acceleration, at a heading."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    ahead_mps2 = cosine * north_mps2 + sine * east_mps2
    aside_mps2 = cosine * east_mps2 - sine * north_mps2
    lift_mps2 = GRAVITY_MPS2 - down_mps2
    pitch_rad = math.atan2(-ahead_mps2, lift_mps2)
    roll_rad = math.atan2(aside_mps2 * math.cos(pitch_rad), lift_mps2)
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle / 2.0), math.sin(angle / 2.0)) for angle in (roll_rad, pitch_rad, yaw_rad)
    )
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
