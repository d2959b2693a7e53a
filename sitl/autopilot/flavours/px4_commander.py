"""PX4's decisions: what the user intends, what is flown, and how offboard mode behaves.

After the loss of the offboard stream the intention stays OFFBOARD while another mode is flown, and
offboard resumes by itself when the stream does.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander
from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.attitude_message import attitude_setpoint
from sitl.autopilot.flavours.setpoint_message import (
    NOTHING,
    MotionTarget,
    is_given,
    is_whole,
    read_target,
    turned,
)
from sitl.autopilot.flavours.setpoint_stream import OffboardStream
from sitl.autopilot.land_detector import climbs
from sitl.autopilot.modes import Mode
from sitl.autopilot.settings import FlightSettings, Reaction
from sitl.config import HomeConfig
from sitl.plant.estimator import Estimator
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

MISSION_FIRST_ITEM = 0
_STREAM_RETURN_S = 0.25  # an unbroken stream this long ends the offboard-loss failsafe
_ACCELERATION_HOLD_S = 0.06  # a lost stream freezes at once
_STOP = Setpoint(velocity_north_mps=0.0, velocity_east_mps=0.0, velocity_down_mps=0.0)


class Px4Commander(Commander):
    """PX4's decisions.

    Attributes:
        offboard: the setpoint stream.
    """

    refusal = Verdict.TEMPORARILY_REJECTED
    first_mode = Mode.HOLD

    def __init__(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> None:
        super().__init__(settings, truth, origin, estimator, MISSION_FIRST_ITEM)
        self.offboard = OffboardStream(_ACCELERATION_HOLD_S)
        self._origin = origin
        self._intention = Mode.HOLD
        self._resumes_offboard = False

    def prearm_failures(self) -> list[str]:
        """As every autopilot, and a stream where OFFBOARD is intended."""
        failures = super().prearm_failures()
        if self._intention is Mode.OFFBOARD and not self._offboard_alive:
            failures.append("no offboard signal")
        return failures

    def receive_setpoint(self, message: Any, now_s: float) -> None:
        """Take a setpoint, in any mode."""
        if message.get_type() == "SET_ATTITUDE_TARGET":
            attitude = attitude_setpoint(message, self.settings.hover_thrust)
            self._stream(attitude, now_s, holds_yaw=False)
            return
        target = read_target(message, self._origin, self.home_ned_m)
        setpoint = _setpoint(target, self._truth.yaw_rad)
        self._stream(setpoint, now_s, holds_yaw=target.yaw_rad is None)

    def _stream(self, setpoint: Setpoint | None, now_s: float, *, holds_yaw: bool) -> None:
        """Continue the stream by a setpoint; what PX4 ignores keeps no stream alive."""
        if setpoint is not None:
            timeout_s = self.settings.setpoint_timeout_s
            self.offboard.receive(setpoint, now_s, timeout_s, holds_yaw=holds_yaw)

    def react(self, reaction: Reaction) -> None:
        """Carry out the reaction of a failsafe; offboard does not resume after it."""
        if reaction is not Reaction.NONE:
            self._resumes_offboard = False
        super().react(reaction)

    @property
    def _offboard_alive(self) -> bool:
        return self.offboard.age_s(self._truth.time_s) <= self.settings.setpoint_timeout_s

    @property
    def _go_to_mode(self) -> Mode:
        return Mode.HOLD

    def _mode_refusal(self, mode: Mode) -> str | None:
        if mode.needs_sticks and not self.sticks_alive:
            return f"{mode.name} needs manual control"
        if mode is Mode.MISSION and not self.mission.flyable:
            return "No valid mission available"
        if mode is Mode.OFFBOARD and self.airborne and not self._offboard_alive:
            return "OFFBOARD denied: no offboard signal"
        return None

    @property
    def intention(self) -> Mode:
        """The mode that the user asked for, even while a failsafe flies another."""
        return self._intention

    def set_mode(self, mode: Mode) -> Verdict:
        """Change the mode on the user's behalf; take-off is one of them."""
        return self.take_off(None) if mode is Mode.TAKEOFF else super().set_mode(mode)

    def _check_setpoints(self) -> None:
        if self.mode is Mode.OFFBOARD and not self._offboard_alive:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "No offboard control data")
            self.react(self.settings.setpoint_loss)
            self._resumes_offboard = True
        elif (
            self._resumes_offboard
            and self._offboard_alive
            and self.offboard.unbroken_s(self._truth.time_s) >= _STREAM_RETURN_S
        ):
            self.say(mavlink.MAV_SEVERITY_INFO, "Offboard signal regained")
            self._choose(Mode.OFFBOARD)

    def _follow_setpoints(self, _: float) -> Setpoint:
        return self.offboard.setpoint(self._truth.time_s, self._auto.reference.yaw_rad)

    def _setpoints_lift(self, wanted: Setpoint) -> bool:
        return climbs(wanted, self._truth)

    def _choose(self, mode: Mode) -> None:
        self._intention = mode
        self._resumes_offboard = False
        super()._choose(mode)

    def _continue_with(self, mode: Mode) -> None:
        if self.mode is Mode.TAKEOFF:
            self._intention = mode
        super()._continue_with(mode)

    def _disarm(self, reason: str) -> None:
        super()._disarm(reason)
        self._resumes_offboard = False
        if self.mode is not Mode.OFFBOARD:
            self._choose(Mode.HOLD)


def _setpoint(target: MotionTarget, yaw_rad: float) -> Setpoint | None:
    """Return a target as PX4 flies it; None if PX4 ignores it, so that it keeps no stream alive."""
    if target.frame == mavlink.MAV_FRAME_BODY_NED:
        target = target._replace(
            position_m=NOTHING,  # no positions relative to the body
            velocity_mps=turned(target.velocity_mps, yaw_rad),
            acceleration_mps2=turned(target.acceleration_mps2, yaw_rad),
        )
    elif target.frame != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    vectors = (target.position_m, target.velocity_mps, target.acceleration_mps2)
    if not any(map(is_given, vectors)) or not target.plausible:
        return None
    if target.uses_force and is_given(target.acceleration_mps2):
        return None
    return target.setpoint() if _controls_every_axis(vectors) else _STOP


def _controls_every_axis(vectors: tuple[Vector, Vector, Vector]) -> bool:
    """Whether each axis is controlled, and north like east, as PX4's controller requires."""
    if all(map(is_whole, vectors)):
        return True
    paired = all(math.isnan(north) == math.isnan(east) for north, east, _ in vectors)
    return paired and not any(all(map(math.isnan, axis)) for axis in zip(*vectors, strict=True))
