"""The PX4 flavour: parameters, modes, streams, and how its offboard mode behaves.

PX4's split between what the user intends and what is flown: after the loss of the offboard stream
the intention stays OFFBOARD while another mode is flown, and offboard resumes by itself when the
stream does.  Behaviour is that of PX4 1.15 to 1.16, as measured in its own simulator.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander, Verdict
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore
from sitl.autopilot.flavours.setpoint_message import (
    NOTHING,
    MotionTarget,
    is_given,
    is_whole,
    read_target,
    turned,
)
from sitl.autopilot.flavours.setpoint_stream import OffboardStream
from sitl.autopilot.flavours.standard_modes import CURRENT_MODE_ID
from sitl.autopilot.land_detector import climbs
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings, Reaction
from sitl.config import HomeConfig
from sitl.plant.controller import Setpoint
from sitl.plant.estimator import Estimator, EstimatorProfile
from sitl.plant.truth import Vector, VehicleTruth

_STREAM_RETURN_S = 0.25  # an unbroken stream this long ends the offboard-loss failsafe
_ACCELERATION_HOLD_S = 0.06  # a lost stream freezes at once

# Defaults are PX4's, except where a comment says otherwise.
_PARAMETERS = (
    ParameterSpec("BAT_CRIT_THR", 0.07, 0.05, 0.5, "remaining charge: critical"),
    ParameterSpec("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "remaining charge: emergency"),
    ParameterSpec("BAT_LOW_THR", 0.15, 0.0, 0.5, "remaining charge: low"),
    ParameterSpec("COM_ARM_AUTH_ID", 10, 0, 255, "system that authorises arming"),
    ParameterSpec("COM_ARM_AUTH_REQ", 0, 0, 1, "arming needs authorisation"),
    ParameterSpec("COM_ARM_AUTH_TO", 0.4, 0.1, 5.0, "authorisation unanswered to denied [s]"),
    ParameterSpec("COM_DISARM_LAND", 2.0, -1.0, 20.0, "landed to disarmed [s]; negative: never"),
    ParameterSpec("COM_DISARM_PRFLT", 10.0, -1.0, 120.0, "armed without take-off to disarmed [s]"),
    ParameterSpec("COM_DL_LOSS_T", 10, 5, 300, "ground station silent to lost [s]"),
    ParameterSpec("COM_LOW_BAT_ACT", 0, 0, 3, "low battery: 0 warn, 2 land, 3 return, then land"),
    # PX4's own default, 0, descends where there is no remote control; 5 holds.
    ParameterSpec("COM_OBL_RC_ACT", 5, 0, 7, "after loss of offboard: 3 return, 4 land, 5 hold"),
    ParameterSpec("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "offboard setpoints missing to failsafe [s]"),
    ParameterSpec("COM_DLL_EXCEPT", 0, 0, 15, "bits: modes without ground station; not simulated"),
    ParameterSpec("COM_RCL_EXCEPT", 0, 0, 31, "bits: modes without manual control; not simulated"),
    ParameterSpec("COM_RC_IN_MODE", 3, 0, 4, "manual control: 0 radio only, 4 none, else MAVLink"),
    ParameterSpec("COM_RC_LOSS_T", 0.5, 0.0, 35.0, "manual control silent to lost [s]"),
    ParameterSpec("GF_ACTION", 2, 0, 5, "geofence: 0 nothing, 1 warn, 2 hold; not simulated"),
    ParameterSpec("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "geofence radius [m]; 0: none"),
    ParameterSpec("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "geofence height [m]; 0: none"),
    ParameterSpec("MC_PITCH_P", 6.5, 1.0, 12.0, "pitch feedback [1/s]"),
    ParameterSpec("MC_PITCHRATE_MAX", 400.0, 0.0, 1800.0, "pitch rate limit [deg/s]"),
    ParameterSpec("MC_ROLL_P", 6.5, 1.0, 12.0, "roll feedback [1/s]"),
    ParameterSpec("MC_ROLLRATE_MAX", 400.0, 0.0, 1800.0, "roll rate limit [deg/s]"),
    ParameterSpec("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "default take-off altitude [m]"),
    ParameterSpec("MPC_ACC_DOWN_MAX", 3.0, 2.0, 15.0, "autonomous acceleration downwards [m/s^2]"),
    ParameterSpec("MPC_ACC_HOR", 5.0, 2.0, 15.0, "autonomous horizontal acceleration [m/s^2]"),
    ParameterSpec("MPC_ACC_UP_MAX", 4.0, 2.0, 15.0, "autonomous acceleration upwards [m/s^2]"),
    # Higher than PX4's 4 m/s^3 so that hold brakes like the plans do.
    ParameterSpec("MPC_JERK_AUTO", 30.0, 1.0, 80.0, "autonomous jerk [m/s^3]"),
    ParameterSpec("MPC_LAND_SPEED", 0.7, 0.6, 5.0, "sink rate when landing [m/s]"),
    ParameterSpec("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "tilt limit in flight [deg]"),
    ParameterSpec("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "climb rate at take-off [m/s]"),
    ParameterSpec("MPC_VEL_MANUAL", 10.0, 3.0, 20.0, "speed at full stick [m/s]"),
    ParameterSpec("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "autonomous speed [m/s]"),
    ParameterSpec("MPC_XY_P", 0.95, 0.0, 2.0, "horizontal position feedback [1/s]"),
    ParameterSpec("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "speed limit in every mode [m/s]"),
    ParameterSpec("MPC_XY_VEL_P_ACC", 1.8, 1.2, 5.0, "horizontal velocity feedback [1/s]"),
    ParameterSpec("MPC_Z_V_AUTO_DN", 1.5, 0.5, 4.0, "autonomous sink rate [m/s]"),
    ParameterSpec("MPC_Z_V_AUTO_UP", 3.0, 0.5, 8.0, "autonomous climb rate [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "sink rate limit in every mode [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "climb rate limit in every mode [m/s]"),
    # Smaller than PX4's 10 m: missions among obstacles.
    ParameterSpec("NAV_ACC_RAD", 2.0, 0.05, 200.0, "waypoint acceptance radius [m]"),
    ParameterSpec(
        "NAV_DLL_ACT", 0, 0, 6, "ground station lost: 0 nothing, 1 hold, 2 return, 3 land"
    ),
    ParameterSpec("NAV_RCL_ACT", 2, 1, 6, "manual control lost: 1 hold, 2 return, 3 land"),
    ParameterSpec("RTL_RETURN_ALT", 60.0, 0.0, 150.0, "least altitude of the return [m]"),
    ParameterSpec("SYS_FAILURE_EN", 0, 0, 1, "obey MAV_CMD_INJECT_FAILURE"),
)
_LINK_LOSS = (
    Reaction.NONE,
    Reaction.HOLD,
    Reaction.RETURN,
    Reaction.LAND,
    Reaction.NONE,
    Reaction.DISARM,
    Reaction.DISARM,
)
_OFFBOARD_LOSS = (
    Reaction.MANUAL,
    Reaction.MANUAL,
    Reaction.MANUAL,
    Reaction.RETURN,
    Reaction.LAND,
    Reaction.HOLD,
    Reaction.DISARM,
    Reaction.DISARM,
)
_MODES = {
    Mode.MANUAL: (1, 0),
    Mode.ALTCTL: (2, 0),
    Mode.POSCTL: (3, 0),
    Mode.TAKEOFF: (4, 2),
    Mode.HOLD: (4, 3),
    Mode.MISSION: (4, 4),
    Mode.RTL: (4, 5),
    Mode.LAND: (4, 6),
    Mode.ACRO: (5, 0),
    Mode.OFFBOARD: (6, 0),
    Mode.STABILIZED: (7, 0),
}
_MODE_OF_CODE = {code: mode for mode, code in _MODES.items()}


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
        super().__init__(settings, truth, origin, estimator, Px4.mission_first_item)
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
        """Take a setpoint, in whatever mode."""
        target = read_target(message, self._origin, self.home_ned_m)
        setpoint = _setpoint(target, self._truth.yaw_rad)
        if setpoint is not None:
            self.offboard.receive(
                setpoint,
                now_s,
                self.settings.setpoint_timeout_s,
                holds_yaw=target.yaw_rad is None,
            )

    def react(self, reaction: Reaction) -> None:
        """Do what a failsafe asks for; offboard does not resume after it."""
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
        """The mode that the user wants, whatever a failsafe flies."""
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
    """Judge a setpoint as PX4 does; None if it is none, and so no sign of life either."""
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
    """PX4's position controller wants something on each axis, and north and east alike."""
    if all(map(is_whole, vectors)):
        return True
    paired = all(math.isnan(north) == math.isnan(east) for north, east, _ in vectors)
    return paired and not any(all(map(math.isnan, axis)) for axis in zip(*vectors, strict=True))


_STOP = Setpoint(velocity_north_mps=0.0, velocity_east_mps=0.0, velocity_down_mps=0.0)


class Px4(Flavour):
    """PX4's names and numbers."""

    autopilot = mavlink.MAV_AUTOPILOT_PX4
    version = 1 << 24 | 15 << 16 | 255  # 1.15.0, official release
    capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    # PX4's onboard link, with rates between its own; others are on request only.
    default_rates_hz = MappingProxyType(
        {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        }
    )
    texts_need_ground_station = True
    integers_bytewise = True
    mission_first_item = 0
    take_off_above_sea = True
    modes = tuple(_MODES)
    field = Realism(
        estimator=EstimatorProfile(
            position_m=0.45,
            height_m=0.30,
            velocity_mps=0.60,
            climb_mps=0.20,
            heading_rad=math.radians(3.5),
            drift_mps2=0.30,
            drift_max_mps=1.0,
            dead_reckoning_s=5.7,
            aiding_stops_s=7.7,
        ),
        jerk_share=0.0,
        drag_share=0.0,
        trim_time_s=4.5,  # MPC_XY_VEL_P_ACC / MPC_XY_VEL_I_ACC
        rate_per_s=15.0,
        rates_hz=MappingProxyType(
            {
                mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
                mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
                mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
                mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
                mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
                mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
                CURRENT_MODE_ID: 0.5,
            }
        ),
        echoes_controller=True,
        rest_is_constant_position=True,
        timesync_misaddressed=True,
        legacy_requests=False,
        tells_lost_position_s=math.inf,
        levels_when_lost=True,
        fix_when_lost=mavlink.GPS_FIX_TYPE_NO_GPS,
        drops_gps_after_s=7.3,
    )
    ideal = Realism(
        parameters=MappingProxyType(
            {"MC_PITCH_P": 11.0, "MC_ROLL_P": 11.0, "MPC_XY_P": 1.3, "MPC_XY_VEL_P_ACC": 4.5}
        )
    )

    def parameter_specs(self, system_id: int) -> tuple[ParameterSpec, ...]:
        """Return all parameters with their defaults."""
        own = ParameterSpec("MAV_SYS_ID", system_id, 1, 250, "system id", read_only=True)
        return (*_PARAMETERS, own)

    def settings(self, parameters: ParameterStore) -> FlightSettings:
        """Return what the parameters mean."""
        p = parameters
        low_battery = int(p["COM_LOW_BAT_ACT"])
        lands = Reaction.LAND if low_battery in {2, 3} else Reaction.NONE
        return FlightSettings(
            tilt_max_rad=math.radians(p["MPC_TILTMAX_AIR"]),
            body_rate_max_radps=math.radians(min(p["MC_ROLLRATE_MAX"], p["MC_PITCHRATE_MAX"])),
            roll_gain_per_s=p["MC_ROLL_P"],
            pitch_gain_per_s=p["MC_PITCH_P"],
            position_gain_per_s=p["MPC_XY_P"],
            velocity_gain_per_s=p["MPC_XY_VEL_P_ACC"],
            speed_max_mps=p["MPC_XY_VEL_MAX"],
            climb_max_mps=p["MPC_Z_VEL_MAX_UP"],
            sink_max_mps=p["MPC_Z_VEL_MAX_DN"],
            cruise_speed_mps=p["MPC_XY_CRUISE"],
            climb_speed_mps=min(p["MPC_Z_V_AUTO_UP"], p["MPC_Z_VEL_MAX_UP"]),
            sink_speed_mps=min(p["MPC_Z_V_AUTO_DN"], p["MPC_Z_VEL_MAX_DN"]),
            take_off_speed_mps=p["MPC_TKO_SPEED"],
            landing_speed_mps=p["MPC_LAND_SPEED"],
            stick_speed_mps=min(p["MPC_VEL_MANUAL"], p["MPC_XY_VEL_MAX"]),
            acceleration_mps2=p["MPC_ACC_HOR"],
            acceleration_vertical_mps2=min(p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"]),
            jerk_mps3=p["MPC_JERK_AUTO"],
            take_off_height_m=p["MIS_TAKEOFF_ALT"],
            return_height_m=p["RTL_RETURN_ALT"],
            acceptance_radius_m=p["NAV_ACC_RAD"],
            setpoint_timeout_s=p["COM_OF_LOSS_T"],
            setpoint_loss=_OFFBOARD_LOSS[int(p["COM_OBL_RC_ACT"])],
            manual_timeout_s=p["COM_RC_LOSS_T"],
            manual_loss=_LINK_LOSS[int(p["NAV_RCL_ACT"])],
            manual_allowed=int(p["COM_RC_IN_MODE"]) not in {0, 4},
            ground_timeout_s=p["COM_DL_LOSS_T"],
            ground_loss=_LINK_LOSS[int(p["NAV_DLL_ACT"])],
            battery_low=p["BAT_LOW_THR"],
            battery_critical=p["BAT_CRIT_THR"],
            battery_emergency=p["BAT_EMERGEN_THR"],
            low_reaction=Reaction.NONE,
            critical_reaction=Reaction.RETURN if low_battery == 3 else lands,
            emergency_reaction=lands,
            disarm_landed_s=p["COM_DISARM_LAND"],
            disarm_grounded_s=p["COM_DISARM_PRFLT"],
            failure_injection=bool(p["SYS_FAILURE_EN"]),
            arm_authoriser=int(p["COM_ARM_AUTH_ID"]) if p["COM_ARM_AUTH_REQ"] else None,
            arm_authorisation_timeout_s=p["COM_ARM_AUTH_TO"],
        )

    def commander(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> Px4Commander:
        """Return this autopilot's decisions."""
        return Px4Commander(settings, truth, origin, estimator)

    def custom_mode(self, mode: Mode) -> int:
        """Return HEARTBEAT.custom_mode: main mode in the third byte, sub mode in the fourth."""
        main, sub = _MODES[mode]
        return main << 16 | sub << 24

    def mode_of_command(self, main: int, sub: int) -> Mode | None:
        """Return the mode of MAV_CMD_DO_SET_MODE; sub modes matter in AUTO only."""
        return _MODE_OF_CODE.get((main, sub if main == 4 else 0))

    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE.custom_mode."""
        return self.mode_of_command(custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)
