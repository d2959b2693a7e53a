"""The ArduPilot Copter flavour: parameters, modes, streams, and how GUIDED behaves.

ArduPilot is silent until asked for messages, accepts modes before it could fly them, takes off only
by command, and in GUIDED flies to a position for ever but forgets a velocity after GUID_TIMEOUT.
Behaviour is that of ArduCopter 4.6 to 4.7, as measured in its own simulator.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander, Verdict
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.guided_reference import GuidedReference, ReferenceLimits
from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore
from sitl.autopilot.flavours.setpoint_message import (
    MotionTarget,
    is_given,
    is_whole,
    read_target,
    turned,
)
from sitl.autopilot.flavours.setpoint_stream import OffboardStream
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings, Reaction
from sitl.config import HomeConfig
from sitl.plant.controller import Setpoint
from sitl.plant.estimator import Estimator, EstimatorProfile
from sitl.plant.multirotor import GRAVITY_MPS2
from sitl.plant.truth import Vector, VehicleTruth

_ARM_MODES = {Mode.OFFBOARD, Mode.MISSION, Mode.STABILIZED, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO}

# Defaults are ArduPilot's, except where a comment says otherwise.
_PARAMETERS = (
    ParameterSpec("ANGLE_MAX", 3000, 1000, 8000, "tilt limit [cdeg]"),
    ParameterSpec("ARMING_CHECK", 1, 0, 0x7FFFFF, "0: arm without checks"),
    ParameterSpec("ATC_ANG_PIT_P", 4.5, 3.0, 12.0, "pitch feedback [1/s]"),
    ParameterSpec("ATC_ANG_RLL_P", 4.5, 3.0, 12.0, "roll feedback [1/s]"),
    ParameterSpec("ATC_RATE_P_MAX", 0.0, 0.0, 1080.0, "pitch rate limit [deg/s]; 0: none"),
    ParameterSpec("ATC_RATE_R_MAX", 0.0, 0.0, 1080.0, "roll rate limit [deg/s]; 0: none"),
    ParameterSpec("BATT_CAPACITY", 5000, 0, 100_000, "pack [mAh]"),
    ParameterSpec("BATT_CRT_MAH", 0.0, 0.0, 100_000.0, "remaining charge: critical [mAh]"),
    ParameterSpec("BATT_FS_CRT_ACT", 0, 0, 5, "critical battery: 1 land, 2 return, 5 terminate"),
    ParameterSpec("BATT_FS_LOW_ACT", 0, 0, 5, "low battery: 1 land, 2 return, 5 terminate"),
    ParameterSpec("BATT_LOW_MAH", 0.0, 0.0, 100_000.0, "remaining charge: low [mAh]"),
    ParameterSpec("DISARM_DELAY", 10, 0, 127, "armed on the ground to disarmed [s]; 0: never"),
    ParameterSpec("FENCE_ALT_MAX", 100.0, 10.0, 1000.0, "fence height [m]; fences: not simulated"),
    ParameterSpec("FENCE_ENABLE", 0, 0, 1, "whether fences are enforced"),
    ParameterSpec("FENCE_RADIUS", 150.0, 30.0, 10000.0, "fence radius [m]"),
    ParameterSpec("FENCE_TOTAL", 0, 0, 20, "points of the fence"),
    ParameterSpec("FENCE_TYPE", 7, 0, 15, "bits: 1 height, 2 circle, 4 polygon, 8 floor"),
    ParameterSpec("FRAME_CLASS", 1, 0, 17, "1: quadrotor", read_only=True),
    ParameterSpec("FS_GCS_ENABLE", 0, 0, 7, "ground station lost: 0 nothing, 1 return, 5 land"),
    ParameterSpec("FS_GCS_TIMEOUT", 5.0, 2.0, 120.0, "ground station silent to lost [s]"),
    ParameterSpec("FS_OPTIONS", 16, 0, 255, "bits: when failsafes do not act; not simulated"),
    ParameterSpec("FS_THR_ENABLE", 1, 0, 7, "manual control lost: 0 nothing, 1 return, 3 land"),
    ParameterSpec("GUID_TIMEOUT", 3.0, 0.1, 5.0, "velocity targets missing to stop [s]"),
    ParameterSpec("LAND_SPEED", 50, 30, 200, "sink rate near the ground [cm/s]"),
    ParameterSpec("LOIT_SPEED", 1250.0, 20.0, 3500.0, "speed at full stick [cm/s]"),
    ParameterSpec(
        "PSC_ANGLE_MAX", 0.0, 0.0, 45.0, "tilt limit of autonomous flight; 0: ANGLE_MAX [deg]"
    ),
    ParameterSpec("PSC_POSXY_P", 1.0, 0.5, 4.0, "horizontal position feedback [1/s]"),
    ParameterSpec("PSC_VELXY_P", 2.0, 0.1, 6.0, "horizontal velocity feedback [1/s]"),
    ParameterSpec("PSC_JERK_XY", 5.0, 1.0, 20.0, "horizontal jerk limit [m/s^3]"),
    ParameterSpec("RTL_ALT", 1500, 30, 300_000, "least altitude of the return [cm]"),
    ParameterSpec("SCR_USER1", 0.0, -1e9, 1e9, "for scripts"),
    ParameterSpec("SIM_FAILURE_EN", 0, 0, 1, "obey MAV_CMD_INJECT_FAILURE; this simulator's own"),
    ParameterSpec(
        "WPNAV_ACCEL", 250.0, 50.0, 1000.0, "autonomous horizontal acceleration [cm/s^2]"
    ),
    ParameterSpec("WPNAV_ACCEL_Z", 100.0, 50.0, 500.0, "autonomous vertical acceleration [cm/s^2]"),
    ParameterSpec("WPNAV_RADIUS", 200.0, 5.0, 1000.0, "waypoint acceptance radius [cm]"),
    ParameterSpec("WPNAV_SPEED", 1000.0, 10.0, 2000.0, "autonomous speed [cm/s]"),
    ParameterSpec("WPNAV_SPEED_DN", 150.0, 10.0, 500.0, "autonomous sink rate [cm/s]"),
    ParameterSpec("WPNAV_SPEED_UP", 250.0, 10.0, 1000.0, "autonomous climb rate [cm/s]"),
)
_SPEED_MAX_MPS = 35.0  # guided mode has no limit of its own: what LOIT_SPEED allows at most
_BODY_RATE_UNLIMITED_DEGPS = 400.0
_TAKE_OFF_HEIGHT_M = 2.5
_GROUND_LOSS = {1: Reaction.RETURN, 3: Reaction.RETURN, 4: Reaction.RETURN, 5: Reaction.LAND}
_STICK_LOSS = {1: Reaction.RETURN, 3: Reaction.LAND, 4: Reaction.RETURN, 5: Reaction.RETURN}
_BATTERY = {
    1: Reaction.LAND,
    2: Reaction.RETURN,
    3: Reaction.RETURN,
    4: Reaction.RETURN,
    5: Reaction.DISARM,
}
_MODES = {
    Mode.STABILIZED: 0,
    Mode.ACRO: 1,
    Mode.ALTCTL: 2,
    Mode.MISSION: 3,
    Mode.OFFBOARD: 4,
    Mode.POSCTL: 5,
    Mode.RTL: 6,
    Mode.LAND: 9,
    Mode.HOLD: 17,  # BRAKE
}
_MODE_OF_NUMBER = {number: mode for mode, number in _MODES.items()}
# GUIDED steers towards where its target will be by then: so the measured swerves come out right.
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
        super().__init__(settings, truth, origin, estimator, Copter.mission_first_item)
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
        """Leave the ground in AUTO, or go on from an item."""
        verdict = super().start_mission(max(first_item, self.mission.first))
        self._mission_started = verdict is Verdict.ACCEPTED
        return verdict

    def receive_setpoint(self, message: Any, now_s: float) -> None:
        """Take a setpoint in GUIDED; during take-off it ends the take-off."""
        if self.mode not in {Mode.OFFBOARD, Mode.TAKEOFF}:
            return
        target = _ned_target(read_target(message, self._origin, self.home_ned_m), self._truth)
        if target is not None and not _says_anything(target):
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
    """Return the target in local NED; None in a frame that ArduPilot does not know."""
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


def _says_anything(target: MotionTarget) -> bool:
    """Whether anything but yaw is meant."""
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


class Copter(Flavour):
    """ArduPilot Copter's names and numbers."""

    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    version = 4 << 24 | 6 << 16 | 255  # 4.6.0, official release
    capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    default_rates_hz = MappingProxyType({mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0})
    texts_need_ground_station = False
    integers_bytewise = False
    mission_first_item = 1
    take_off_above_sea = False
    modes = tuple(_MODES)
    target_type_mask = (
        mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
        | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    )
    field = Realism(
        estimator=EstimatorProfile(
            position_m=0.06,
            height_m=0.05,
            velocity_mps=0.04,
            climb_mps=0.01,
            heading_rad=math.radians(1.1),
            drift_mps2=0.03,
            drift_max_mps=0.30,
            dead_reckoning_s=7.9,
            aiding_stops_s=15.0,
        ),
        jerk_share=0.3,  # the rest is shaped away by ATC_INPUT_TC
        drag_share=0.0,
        trim_time_s=2.0,  # PSC_VELXY_P / PSC_VELXY_I
        tells_lost_position_s=15.0,
        levels_when_lost=True,
    )
    ideal = Realism(
        parameters=MappingProxyType(
            {"ATC_ANG_PIT_P": 11.0, "ATC_ANG_RLL_P": 11.0, "PSC_POSXY_P": 1.3, "PSC_VELXY_P": 4.5}
        )
    )

    def parameter_specs(self, system_id: int) -> tuple[ParameterSpec, ...]:
        """Return all parameters with their defaults."""
        own = ParameterSpec("SYSID_THISMAV", system_id, 1, 255, "system id", read_only=True)
        return (*_PARAMETERS, own)

    def settings(self, parameters: ParameterStore) -> FlightSettings:
        """Return what the parameters mean."""
        p = parameters
        angle_max_deg = p["PSC_ANGLE_MAX"] or p["ANGLE_MAX"] / 100.0
        rates_degps = [
            p[name] or _BODY_RATE_UNLIMITED_DEGPS for name in ("ATC_RATE_R_MAX", "ATC_RATE_P_MAX")
        ]
        capacity_mah = max(p["BATT_CAPACITY"], 1.0)
        return FlightSettings(
            tilt_max_rad=math.radians(min(angle_max_deg, p["ANGLE_MAX"] / 100.0)),
            body_rate_max_radps=math.radians(min(rates_degps)),
            roll_gain_per_s=p["ATC_ANG_RLL_P"],
            pitch_gain_per_s=p["ATC_ANG_PIT_P"],
            position_gain_per_s=p["PSC_POSXY_P"],
            velocity_gain_per_s=p["PSC_VELXY_P"],
            speed_max_mps=_SPEED_MAX_MPS,
            climb_max_mps=p["WPNAV_SPEED_UP"] / 100.0,
            sink_max_mps=p["WPNAV_SPEED_DN"] / 100.0,
            cruise_speed_mps=p["WPNAV_SPEED"] / 100.0,
            climb_speed_mps=p["WPNAV_SPEED_UP"] / 100.0,
            sink_speed_mps=p["WPNAV_SPEED_DN"] / 100.0,
            take_off_speed_mps=p["WPNAV_SPEED_UP"] / 100.0,
            landing_speed_mps=p["LAND_SPEED"] / 100.0,
            stick_speed_mps=p["LOIT_SPEED"] / 100.0,
            acceleration_mps2=p["WPNAV_ACCEL"] / 100.0,
            acceleration_vertical_mps2=p["WPNAV_ACCEL_Z"] / 100.0,
            jerk_mps3=p["PSC_JERK_XY"],
            take_off_height_m=_TAKE_OFF_HEIGHT_M,
            return_height_m=p["RTL_ALT"] / 100.0,
            acceptance_radius_m=p["WPNAV_RADIUS"] / 100.0,
            setpoint_timeout_s=p["GUID_TIMEOUT"],
            setpoint_loss=Reaction.NONE,
            manual_timeout_s=0.5,
            manual_loss=_STICK_LOSS.get(int(p["FS_THR_ENABLE"]), Reaction.NONE),
            manual_allowed=True,
            ground_timeout_s=p["FS_GCS_TIMEOUT"],
            ground_loss=_GROUND_LOSS.get(int(p["FS_GCS_ENABLE"]), Reaction.NONE),
            battery_low=p["BATT_LOW_MAH"] / capacity_mah,
            battery_critical=p["BATT_CRT_MAH"] / capacity_mah,
            battery_emergency=0.0,
            low_reaction=_BATTERY.get(int(p["BATT_FS_LOW_ACT"]), Reaction.NONE),
            critical_reaction=_BATTERY.get(int(p["BATT_FS_CRT_ACT"]), Reaction.NONE),
            emergency_reaction=Reaction.NONE,
            disarm_landed_s=0.0,
            disarm_grounded_s=p["DISARM_DELAY"] or -1.0,
            failure_injection=bool(p["SIM_FAILURE_EN"]),
        )

    def commander(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> CopterCommander:
        """Return this autopilot's decisions."""
        return CopterCommander(settings, truth, origin, estimator)

    def custom_mode(self, mode: Mode) -> int:
        """Return HEARTBEAT.custom_mode; a take-off is part of GUIDED."""
        return _MODES[Mode.OFFBOARD if mode is Mode.TAKEOFF else mode]

    def mode_of_command(self, main: int, _: int) -> Mode | None:
        """Return the mode of MAV_CMD_DO_SET_MODE's second parameter; there are no sub modes."""
        return _MODE_OF_NUMBER.get(main)

    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE.custom_mode."""
        return _MODE_OF_NUMBER.get(custom_mode)
