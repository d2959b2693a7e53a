"""SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT as sent, before a flavour evaluates them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import GeographicPosition, ned_from_geographic
from sitl.autopilot.mission import ABSOLUTE_FRAMES, RELATIVE_FRAMES
from sitl.config import HomeConfig
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector

NOTHING: Vector = (math.nan, math.nan, math.nan)
_PLAUSIBLE_MAX = 1e6  # metres, metres per second, ...: anything larger, infinity included, is noise
_TERRAIN_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
}
_GLOBAL_FRAMES = ABSOLUTE_FRAMES | RELATIVE_FRAMES | _TERRAIN_FRAMES


class MotionTarget(NamedTuple):
    """The content of a setpoint message; ``nan`` stands for masked components.

    Attributes:
        frame: MAV_FRAME of the vectors; LOCAL_NED for a global message in a known frame, whose
            position has been converted.
        mask: POSITION_TARGET_TYPEMASK.
        position_m, velocity_mps, acceleration_mps2: in ``frame``.
        yaw_rad, yaw_rate_radps: None where masked or implausible.
    """

    frame: int
    mask: int
    position_m: Vector
    velocity_mps: Vector
    acceleration_mps2: Vector
    yaw_rad: float | None
    yaw_rate_radps: float | None

    @property
    def uses_force(self) -> bool:
        """Whether the third vector means a force, which no autopilot here flies."""
        return bool(self.mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET)

    @property
    def plausible(self) -> bool:
        """Whether every component is finite and within 1e6."""
        every = (*self.position_m, *self.velocity_mps, *self.acceleration_mps2)
        return not any(abs(value) > _PLAUSIBLE_MAX for value in every)

    def setpoint(self) -> Setpoint:
        """Return the setpoint of a target whose vectors are NED."""
        x, y, z = (0.0 if math.isnan(value) else value for value in self.acceleration_mps2)
        return Setpoint.of(
            self.position_m,
            self.velocity_mps,
            (x, y, z),
            (0.0, 0.0, 0.0),
            self.yaw_rad or 0.0,
            self.yaw_rate_radps or 0.0,
        )


def read_target(message: Any, origin: HomeConfig, home_ned_m: Vector) -> MotionTarget:
    """Return the content of a message, masks applied."""
    mask = int(message.type_mask)
    frame = int(message.coordinate_frame)
    if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
        position_m = (message.x, message.y, message.z)
    elif frame in _GLOBAL_FRAMES:
        position_m = _ned_from_global(message, frame, origin, home_ned_m)
        frame = mavlink.MAV_FRAME_LOCAL_NED
    else:
        position_m, frame = NOTHING, -1  # a local frame does not belong into a global message
    return MotionTarget(
        frame,
        mask,
        _given(mask, 0, position_m),
        _given(mask, 3, (message.vx, message.vy, message.vz)),
        _given(mask, 6, (message.afx, message.afy, message.afz)),
        _angle(mask, mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE, message.yaw),
        _angle(mask, mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE, message.yaw_rate),
    )


def turned(vector: Vector, yaw_rad: float) -> Vector:
    """Return a levelled body vector (forward, right, down) in NED."""
    forward, right, down = vector
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return cosine * forward - sine * right, sine * forward + cosine * right, down


def is_given(vector: Vector) -> bool:
    """Whether any component is given."""
    return not all(map(math.isnan, vector))


def is_whole(vector: Vector) -> bool:
    """Whether every component is given."""
    return not any(map(math.isnan, vector))


def _ned_from_global(message: Any, frame: int, origin: HomeConfig, home_ned_m: Vector) -> Vector:
    above_sea_m = message.alt
    if frame in RELATIVE_FRAMES:
        above_sea_m += origin.altitude_m - home_ned_m[2]
    elif frame in _TERRAIN_FRAMES:  # flat terrain
        above_sea_m += origin.altitude_m
    place = GeographicPosition(message.lat_int * 1e-7, message.lon_int * 1e-7, above_sea_m)
    return ned_from_geographic(origin, place)


def _given(mask: int, first_bit: int, values: Vector) -> Vector:
    """Replace masked values by ``nan``."""
    if not mask >> first_bit & 0b111:
        return values
    x, y, z = (
        math.nan if mask >> (first_bit + axis) & 1 else value for axis, value in enumerate(values)
    )
    return x, y, z


def _angle(mask: int, ignore: int, value: float) -> float | None:
    return value if not mask & ignore and abs(value) <= _PLAUSIBLE_MAX else None
