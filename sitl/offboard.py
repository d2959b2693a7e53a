"""The offboard setpoint stream: SET_POSITION_TARGET_LOCAL_NED as PX4 takes it.

Frames LOCAL_NED and BODY_NED only; any other frame, or a mask that controls no axis, does not
count as a setpoint, and so not as a sign of life either.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.controller import Setpoint, ahead

_IGNORE_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_IGNORE_YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_FORCE = mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET

_PLAUSIBLE_MAX = 1e6  # metres, metres per second, ...: anything larger, infinity included, is noise
_JERK_MAX_MPS3 = 30.0
_JERK_PERIOD_MAX_S = 0.25  # successive setpoints farther apart say nothing about jerk
_ACCELERATION_HOLD_S = 0.06  # acceleration acts this long beyond the last setpoint, then velocity


class OffboardStream:
    """The last setpoint, its age, and how long the stream has been unbroken."""

    def __init__(self) -> None:
        self._setpoint: Setpoint | None = None
        self._received_s = -math.inf
        self._unbroken_since_s = math.inf
        self._holds_yaw = True

    def receive(self, message: Any, now_s: float, yaw_rad: float, loss_s: float) -> bool:
        """Take a SET_POSITION_TARGET_LOCAL_NED; False if it is no setpoint to this autopilot.

        Args:
            message: the decoded message.
            now_s: time of arrival.
            yaw_rad: the vehicle's heading, which turns BODY_NED.
            loss_s: a longer silence breaks the stream.
        """
        setpoint = _decoded(message, yaw_rad)
        if setpoint is None:
            return False
        age_s = self.age_s(now_s)
        if age_s > loss_s:
            self._unbroken_since_s = now_s
        elif self._setpoint is not None and 0.0 < age_s <= _JERK_PERIOD_MAX_S:
            setpoint = _with_jerk(setpoint, self._setpoint, age_s)
        self._setpoint = setpoint
        self._received_s = now_s
        self._holds_yaw = bool(message.type_mask & _IGNORE_YAW)
        return True

    def age_s(self, now_s: float) -> float:
        """Time since the last setpoint; ``inf`` before the first."""
        return now_s - self._received_s

    def unbroken_s(self, now_s: float) -> float:
        """For how long setpoints have come without a gap."""
        return max(0.0, now_s - self._unbroken_since_s)

    def setpoint(self, now_s: float, held_yaw_rad: float) -> Setpoint:
        """Return the motion wanted at ``now_s``: the last setpoint, moved along by its age.

        Acceleration acts for a short time only; after that the vehicle coasts at the velocity
        reached, until the loss of the stream is noticed.

        Raises:
            RuntimeError: no setpoint has come yet.
        """
        if self._setpoint is None:
            raise RuntimeError("no offboard setpoint has been received")
        age_s = self.age_s(now_s)
        moved = ahead(self._setpoint, min(age_s, _ACCELERATION_HOLD_S))
        if age_s > _ACCELERATION_HOLD_S:
            moved = ahead(_coasting(moved), age_s - _ACCELERATION_HOLD_S)
        return moved._replace(yaw_rad=held_yaw_rad) if self._holds_yaw else moved


def _decoded(message: Any, yaw_rad: float) -> Setpoint | None:
    mask = int(message.type_mask)
    position = _given(mask, 0, (message.x, message.y, message.z))
    velocity = _given(mask, 3, (message.vx, message.vy, message.vz))
    acceleration = _given(mask, 6, (message.afx, message.afy, message.afz))
    if message.coordinate_frame == mavlink.MAV_FRAME_BODY_NED:
        position = (math.nan, math.nan, math.nan)  # as PX4: no positions relative to the body
        velocity, acceleration = _turned(velocity, yaw_rad), _turned(acceleration, yaw_rad)
    elif message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    if mask & _FORCE or all(map(math.isnan, (*position, *velocity, *acceleration))):
        return None
    if any(abs(value) > _PLAUSIBLE_MAX for value in (*position, *velocity, *acceleration)):
        return None
    yaw_given = not mask & _IGNORE_YAW and abs(message.yaw) <= _PLAUSIBLE_MAX
    rate_given = not mask & _IGNORE_YAW_RATE and abs(message.yaw_rate) <= _PLAUSIBLE_MAX
    x, y, z = (0.0 if math.isnan(component) else component for component in acceleration)
    return Setpoint.of(
        position,
        velocity,
        (x, y, z),
        (0.0, 0.0, 0.0),
        message.yaw if yaw_given else 0.0,
        message.yaw_rate if rate_given else 0.0,
    )


def _given(
    mask: int, first_bit: int, values: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Replace masked values by ``nan``."""
    x, y, z = (
        math.nan if mask >> (first_bit + axis) & 1 else value for axis, value in enumerate(values)
    )
    return x, y, z


def _turned(vector: tuple[float, float, float], yaw_rad: float) -> tuple[float, float, float]:
    forward, right, down = vector
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return cosine * forward - sine * right, sine * forward + cosine * right, down


def _with_jerk(setpoint: Setpoint, previous: Setpoint, period_s: float) -> Setpoint:
    """Estimate the jerk from the change of acceleration between two setpoints."""

    def rate(new_mps2: float, old_mps2: float) -> float:
        return min(max((new_mps2 - old_mps2) / period_s, -_JERK_MAX_MPS3), _JERK_MAX_MPS3)

    return setpoint._replace(
        jerk_north_mps3=rate(setpoint.acceleration_north_mps2, previous.acceleration_north_mps2),
        jerk_east_mps3=rate(setpoint.acceleration_east_mps2, previous.acceleration_east_mps2),
        jerk_down_mps3=rate(setpoint.acceleration_down_mps2, previous.acceleration_down_mps2),
    )


def _coasting(setpoint: Setpoint) -> Setpoint:
    """Return the setpoint without acceleration and jerk."""
    return setpoint._replace(
        acceleration_north_mps2=0.0,
        acceleration_east_mps2=0.0,
        acceleration_down_mps2=0.0,
        jerk_north_mps3=0.0,
        jerk_east_mps3=0.0,
        jerk_down_mps3=0.0,
    )
