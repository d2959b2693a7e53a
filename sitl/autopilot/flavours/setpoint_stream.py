"""The stream of setpoints that a companion computer sends, from one setpoint to the next."""

from __future__ import annotations

import math

from sitl.plant.setpoint import Setpoint, ahead

_JERK_MAX_MPS3 = 30.0
_JERK_PERIOD_MAX_S = 0.25  # setpoints farther apart do not show the jerk


class OffboardStream:
    """The last setpoint, its age, and how long the stream has been unbroken.

    Args:
        acceleration_hold_s: acceleration acts this long beyond a setpoint, then only its velocity.
    """

    def __init__(self, acceleration_hold_s: float) -> None:
        self._acceleration_hold_s = acceleration_hold_s
        self._setpoint: Setpoint | None = None
        self._received_s = -math.inf
        self._unbroken_since_s = math.inf
        self._holds_yaw = True

    def receive(self, setpoint: Setpoint, now_s: float, loss_s: float, *, holds_yaw: bool) -> None:
        """Take a setpoint.

        Args:
            setpoint: what is wanted from now on, NED.
            now_s: time of arrival.
            loss_s: a longer silence breaks the stream.
            holds_yaw: the setpoint leaves the heading open.
        """
        age_s = self.age_s(now_s)
        if age_s > loss_s:
            self._unbroken_since_s = now_s
        elif self._setpoint is not None and 0.0 < age_s <= _JERK_PERIOD_MAX_S:
            setpoint = _with_jerk(setpoint, self._setpoint, age_s)
        self._setpoint = setpoint
        self._received_s = now_s
        self._holds_yaw = holds_yaw

    def age_s(self, now_s: float) -> float:
        """Time since the last setpoint; ``inf`` before the first."""
        return now_s - self._received_s

    def unbroken_s(self, now_s: float) -> float:
        """For how long setpoints have come without a gap."""
        return max(0.0, now_s - self._unbroken_since_s)

    def setpoint(self, now_s: float, held_yaw_rad: float) -> Setpoint:
        """Return the motion wanted at ``now_s``: the last setpoint, moved along by its age.

        After ``acceleration_hold_s`` the vehicle coasts at the velocity reached, until the
        autopilot detects the loss of the stream.

        Raises:
            RuntimeError: no setpoint has come yet.
        """
        if self._setpoint is None:
            raise RuntimeError("no offboard setpoint has been received")
        age_s = self.age_s(now_s)
        moved = self._setpoint
        if age_s > 0.0:
            moved = ahead(moved, min(age_s, self._acceleration_hold_s))
        if age_s > self._acceleration_hold_s:
            moved = ahead(_coasting(moved), age_s - self._acceleration_hold_s)
        return moved._replace(yaw_rad=held_yaw_rad) if self._holds_yaw else moved


def _with_jerk(setpoint: Setpoint, previous: Setpoint, period_s: float) -> Setpoint:
    """Estimate the jerk from the change of acceleration between two setpoints."""

    def rate(new_mps2: float, old_mps2: float) -> float:
        return min(max((new_mps2 - old_mps2) / period_s, -_JERK_MAX_MPS3), _JERK_MAX_MPS3)

    return Setpoint(
        *setpoint[:9],
        rate(setpoint.acceleration_north_mps2, previous.acceleration_north_mps2),
        rate(setpoint.acceleration_east_mps2, previous.acceleration_east_mps2),
        rate(setpoint.acceleration_down_mps2, previous.acceleration_down_mps2),
        *setpoint[12:],
    )


def _coasting(setpoint: Setpoint) -> Setpoint:
    """Return the setpoint without jerk, and without acceleration where a velocity is controlled.

    Where nothing else is controlled, the last acceleration or attitude stays until the loss.
    """
    north, east, down = (
        wanted if math.isnan(velocity) else 0.0
        for velocity, wanted in zip(setpoint[3:6], setpoint[6:9], strict=True)
    )
    return setpoint._replace(
        acceleration_north_mps2=north,
        acceleration_east_mps2=east,
        acceleration_down_mps2=down,
        jerk_north_mps3=0.0,
        jerk_east_mps3=0.0,
        jerk_down_mps3=0.0,
    )
