"""ArduPilot Copter's decisions: modes, take-off, and how GUIDED behaves.

Copter accepts modes before it could fly them, takes off only by command, and in GUIDED flies to a
position without a time limit, but drops a velocity after GUID_TIMEOUT.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander
from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.guided_reference import GuidedReference, ReferenceLimits
from sitl.autopilot.flavours.setpoint_message import (
    MotionTarget,
    is_given,
    is_whole,
    read_target,
    turned,
)
from sitl.autopilot.flavours.setpoint_stream import OffboardStream
from sitl.autopilot.modes import Mode
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.estimator import Estimator
from sitl.plant.multirotor import GRAVITY_MPS2
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

MISSION_FIRST_ITEM = 1  # item 0 is home
_ARM_MODES = {Mode.OFFBOARD, Mode.MISSION, Mode.STABILIZED, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO}
# GUIDED steers towards the target this far ahead, which reproduces the measured swerves.
_TARGET_LEAD_S = 0.02


class CopterCommander(Commander):
    """ArduPilot's decisions; OFFBOARD is GUIDED, HOLD is BRAKE, POSCTL is LOITER."""

    refusal = Verdict.FAILED
    first_mode = Mode.STABILIZED
    position_lost_texts = (
        (mavlink.MAV_SEVERITY_CRITICAL, "EKF3 lane switch 1"),
        (mavlink.MAV_SEVERITY_WARNING, "EKF primary changed:1"),
        (mavlink.MAV_SEVERITY_CRITICAL, "EKF variance"),
        (mavlink.MAV_SEVERITY_CRITICAL, "EKF Failsafe: changed to LAND Mode"),
    )

    def __init__(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> None:
        super().__init__(settings, truth, origin, estimator, MISSION_FIRST_ITEM)
        self._origin = origin
        self._stream: OffboardStream | None = None
        self._reference = GuidedReference(truth, _reference_limits(settings))
        self._mission_started = False

    def prearm_failures(self) -> list[str]:
        """As every autopilot, but only in some modes."""
        failures = super().prearm_failures()
        if self.mode not in _ARM_MODES:
            failures.append("mode not armable")
        return failures

    def take_off(self, height_m: float | None) -> Verdict:
        """Climb; only armed and in GUIDED."""
        if not self.armed or self.mode is not Mode.OFFBOARD:
            return self.refusal
        return super().take_off(height_m)

    def start_mission(self, first_item: int) -> Verdict:
        """Leave the ground in AUTO, or continue from an item."""
        verdict = super().start_mission(max(first_item, self.mission.first))
        self._mission_started = verdict is Verdict.ACCEPTED
        return verdict

    def receive_setpoint(self, message: Any, now_s: float) -> None:
        """Take a setpoint in GUIDED; during take-off it ends the take-off.

        Simulation shortcut: attitudes are not flown.
        """
        if self.mode not in {Mode.OFFBOARD, Mode.TAKEOFF}:
            return
        if message.get_type() == "SET_ATTITUDE_TARGET":
            return
        target = _ned_target(read_target(message, self._origin, self.home_ned_m), self._truth)
        if target is not None and not _has_vector(target):
            return
        if self.mode is Mode.TAKEOFF:
            self._enter(Mode.OFFBOARD, failsafe=False)
        if target is None or not _is_flyable(target):
            self._stop()
        elif is_given(target.velocity_mps) or is_given(target.acceleration_mps2):
            self._follow(target, now_s)
        else:
            self._stream = None
            self._auto.target_ned_m = target.position_m
            if target.yaw_rad is not None:
                self._auto.reference.yaw_rad = target.yaw_rad

    def _follow(self, target: MotionTarget, now_s: float) -> None:
        if self._stream is None:
            self._stream = OffboardStream(math.inf)
            self._reference = GuidedReference(self._truth, _reference_limits(self.settings))
            self._auto.target_ned_m = None
        self._stream.receive(
            target.setpoint(),
            now_s,
            self.settings.setpoint_timeout_s,
            holds_yaw=target.yaw_rad is None,
        )

    def _stop(self) -> None:
        """Brake from the present motion, and stay there."""
        if self._stream is not None:
            self._auto.restart(self._truth)
        self._stream = None
        self._auto.target_ned_m = None

    @property
    def _go_to_mode(self) -> Mode:
        return Mode.OFFBOARD

    def _mode_refusal(self, mode: Mode) -> str | None:
        if mode is Mode.MISSION and not self.mission.flyable:
            return "Mode change to AUTO failed: no mission"
        return None

    def _check_setpoints(self) -> None:
        if self._stream is None:
            return
        if self._stream.age_s(self._truth.time_s) > self.settings.setpoint_timeout_s:
            self._stop()

    def _follow_setpoints(self, period_s: float) -> Setpoint:
        if self._stream is not None:
            ahead_s = self._truth.time_s + _TARGET_LEAD_S
            target = self._stream.setpoint(ahead_s, self._auto.reference.yaw_rad)
            return self._reference.follow(target, period_s)
        self._auto.fly(Mode.OFFBOARD, self._truth, period_s)
        return self._auto.setpoint()

    def _setpoints_lift(self, _: Setpoint) -> bool:
        return False  # only the take-off command does

    def _leaves_ground(self, wanted: Setpoint) -> bool:
        waits = self.mode is Mode.MISSION and not self._mission_started
        return not waits and super()._leaves_ground(wanted)

    def _continue_with(self, mode: Mode) -> None:
        super()._continue_with(Mode.OFFBOARD if self.mode is Mode.TAKEOFF else mode)

    def _disarm(self, reason: str) -> None:
        super()._disarm(reason)
        self._mission_started = False
        if self.mode is Mode.TAKEOFF:
            self._enter(Mode.OFFBOARD, failsafe=False)

    def _enter(self, mode: Mode, *, failsafe: bool) -> None:
        super()._enter(mode, failsafe=failsafe)
        self._stream = None


def _reference_limits(settings: FlightSettings) -> ReferenceLimits:
    at_angle_max_mps2 = GRAVITY_MPS2 * math.tan(settings.tilt_max_rad)
    return ReferenceLimits(settings.jerk_mps3, settings.acceleration_mps2, at_angle_max_mps2)


def _ned_target(target: MotionTarget, truth: VehicleTruth) -> MotionTarget | None:
    """Return the target in local NED; None in a frame that ArduPilot does not support."""
    if target.frame == mavlink.MAV_FRAME_LOCAL_NED:
        return target
    if target.frame == mavlink.MAV_FRAME_LOCAL_OFFSET_NED:
        return target._replace(position_m=_moved(truth.position_ned_m, target.position_m))
    if target.frame not in {mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED}:
        return None
    yaw_rad = truth.yaw_rad
    return target._replace(
        position_m=_moved(truth.position_ned_m, turned(target.position_m, yaw_rad)),
        velocity_mps=turned(target.velocity_mps, yaw_rad),
        acceleration_mps2=turned(target.acceleration_mps2, yaw_rad),
        yaw_rad=None if target.yaw_rad is None else target.yaw_rad + yaw_rad,
    )


def _moved(origin: Vector, offset: Vector) -> Vector:
    return origin[0] + offset[0], origin[1] + offset[1], origin[2] + offset[2]


def _has_vector(target: MotionTarget) -> bool:
    """Whether anything but yaw is given."""
    return any(map(is_given, (target.position_m, target.velocity_mps, target.acceleration_mps2)))


def _is_flyable(target: MotionTarget) -> bool:
    """Whether the combination is one that GUIDED flies: whole vectors, and only some of them."""
    if target.uses_force or not target.plausible:
        return False
    vectors = (target.position_m, target.velocity_mps, target.acceleration_mps2)
    if any(is_given(vector) and not is_whole(vector) for vector in vectors):
        return False
    position, velocity, acceleration = map(is_given, vectors)
    return velocity or position != acceleration
