"""Telemetry: one builder for each message, and when each link is due to get it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.standard_modes import CURRENT_MODE_ID, CurrentMode
from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.battery import BatteryReading
from sitl.plant.controller import Setpoint
from sitl.plant.estimator import Estimator
from sitl.plant.multirotor import rotate_frd_from_ned
from sitl.plant.truth import Vector, VehicleTruth

# Vertical feedback [1/s], which no parameter here changes: MPC_Z_P and MPC_Z_VEL_P_ACC.
HEIGHT_GAIN_PER_S = 1.0
CLIMB_GAIN_PER_S = 4.0

_ESTIMATOR_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
)
_POSITION_CONTROL = mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
_OTHER_SENSORS = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY


class Snapshot(NamedTuple):
    """Everything that telemetry tells about, at one instant."""

    truth: VehicleTruth
    battery: BatteryReading
    commander: Commander
    home: HomeConfig
    flavour: Flavour
    start_unix_s: float
    realism: Realism
    estimator: Estimator

    @property
    def tells_position(self) -> bool:
        """Whether LOCAL_POSITION_NED is sent: real autopilots send one that nothing measures."""
        if self.commander.estimator_ready:
            return True
        return 0.0 < self.estimator.lost_for_s < self.realism.tells_lost_position_s

    @property
    def boot_ms(self) -> int:
        """Time since start [ms]."""
        return round(self.truth.time_s * 1e3) & 0xFFFFFFFF

    @property
    def unix_us(self) -> int:
        """Time of day [us]."""
        return round((self.start_unix_s + self.truth.time_s) * 1e6)


class StreamSchedule:
    """When each message is due on one link.

    Args:
        default_rates_hz: what the link gets unasked.
    """

    def __init__(self, default_rates_hz: Mapping[int, float]) -> None:
        self._default_rates_hz = dict(default_rates_hz)
        self._interval_s: dict[int, float] = {}
        self._next_s: dict[int, float] = {}
        self._earliest_s = math.inf
        for message_id, rate_hz in default_rates_hz.items():
            self.set_interval(message_id, 1.0 / rate_hz, 0.0)

    def set_interval(self, message_id: int, interval_s: float, now_s: float) -> None:
        """Send the message at this interval from now on; ``inf`` stops it."""
        self._interval_s[message_id] = interval_s
        if math.isfinite(interval_s):
            self._next_s[message_id] = now_s
        else:
            self._next_s.pop(message_id, None)
        self._earliest_s = min(self._next_s.values(), default=math.inf)

    def reset_interval(self, message_id: int, now_s: float) -> None:
        """Send the message at its default interval."""
        rate_hz = self._default_rates_hz.get(message_id, 0.0)
        self.set_interval(message_id, 1.0 / rate_hz if rate_hz else math.inf, now_s)

    def interval_s(self, message_id: int) -> float:
        """Interval of a message; ``inf`` if it is not streamed."""
        return self._interval_s.get(message_id, math.inf)

    def due(self, now_s: float) -> list[int]:
        """Return the messages to send now; each call takes them off the schedule."""
        if self._earliest_s > now_s + 1e-6:
            return []
        ids = [message_id for message_id, next_s in self._next_s.items() if next_s <= now_s + 1e-6]
        for message_id in ids:
            interval_s = self._interval_s[message_id]
            # Keep the phase, but never owe more than one message.
            self._next_s[message_id] = max(self._next_s[message_id] + interval_s, now_s)
        self._earliest_s = min(self._next_s.values())
        return ids


def heartbeat(s: Snapshot) -> Any:
    """HEARTBEAT: type, mode, armed, system status."""
    commander = s.commander
    base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    base_mode |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    status = mavlink.MAV_STATE_STANDBY
    if commander.armed:
        base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = mavlink.MAV_STATE_CRITICAL if commander.failsafe else mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        s.flavour.autopilot,
        base_mode,
        s.flavour.custom_mode(commander.mode),
        status,
        3,
    )


def attitude(s: Snapshot) -> Any:
    """ATTITUDE: Euler angles and body rates."""
    truth = s.truth
    return mavlink.MAVLink_attitude_message(
        s.boot_ms, truth.roll_rad, truth.pitch_rad, truth.yaw_rad, *truth.body_rates_radps
    )


def attitude_quaternion(s: Snapshot) -> Any:
    """ATTITUDE_QUATERNION."""
    return mavlink.MAVLink_attitude_quaternion_message(
        s.boot_ms, *s.truth.attitude_quaternion, *s.truth.body_rates_radps
    )


def local_position_ned(s: Snapshot) -> Any:
    """LOCAL_POSITION_NED; None while the autopilot does not tell the position."""
    if not s.tells_position:
        return None
    return mavlink.MAVLink_local_position_ned_message(
        s.boot_ms, *s.truth.position_ned_m, *s.truth.velocity_ned_mps
    )


def position_target_local_ned(s: Snapshot) -> Any:
    """POSITION_TARGET_LOCAL_NED: the setpoint flown; None while there is none."""
    setpoint = s.commander.setpoint
    if setpoint is None:
        return None
    if s.realism.echoes_controller:
        setpoint = controlled(setpoint, s.truth, s.commander.settings)
    return mavlink.MAVLink_position_target_local_ned_message(
        s.boot_ms,
        mavlink.MAV_FRAME_LOCAL_NED,
        s.flavour.target_type_mask,
        *setpoint[:9],
        setpoint.yaw_rad,
        setpoint.yaw_rate_radps,
    )


def controlled(setpoint: Setpoint, estimate: VehicleTruth, settings: FlightSettings) -> Setpoint:
    """Return what a position controller hands on of a setpoint, which is what PX4 reports.

    The velocity is the wanted one plus gain times error of the position, the acceleration the
    wanted one plus gain times error of that velocity.  Axes without a position or velocity stay so.
    """
    at_m, going_mps = estimate.position_ned_m, estimate.velocity_ned_mps
    gains_per_s = (settings.position_gain_per_s,) * 2 + (HEIGHT_GAIN_PER_S,)
    velocity_gains_per_s = (settings.velocity_gain_per_s,) * 2 + (CLIMB_GAIN_PER_S,)
    wanted = []
    for axis in range(3):
        place_m, velocity_mps, push_mps2 = setpoint[axis : axis + 9 : 3]
        if not math.isnan(place_m):
            forward_mps = 0.0 if math.isnan(velocity_mps) else velocity_mps
            velocity_mps = forward_mps + gains_per_s[axis] * (place_m - at_m[axis])
        if not math.isnan(velocity_mps):
            push_mps2 += velocity_gains_per_s[axis] * (velocity_mps - going_mps[axis])
        wanted.append((velocity_mps, push_mps2))
    (vn, an), (ve, ae), (vd, ad) = wanted
    return setpoint._replace(
        velocity_north_mps=vn,
        velocity_east_mps=ve,
        velocity_down_mps=vd,
        acceleration_north_mps2=an,
        acceleration_east_mps2=ae,
        acceleration_down_mps2=ad,
    )


def global_position_int(s: Snapshot) -> Any:
    """GLOBAL_POSITION_INT."""
    truth = s.truth
    place = geographic_from_ned(s.home, truth.position_ned_m)
    north, east, down = truth.velocity_ned_mps
    return mavlink.MAVLink_global_position_int_message(
        s.boot_ms,
        round(place.latitude_deg * 1e7),
        round(place.longitude_deg * 1e7),
        round(place.altitude_m * 1e3),
        round((s.commander.home_ned_m[2] - truth.position_ned_m[2]) * 1e3),
        _int16(north * 100.0),
        _int16(east * 100.0),
        _int16(down * 100.0),
        round(math.degrees(truth.yaw_rad) * 100.0) % 36000,
    )


def gps_raw_int(s: Snapshot) -> Any:
    """GPS_RAW_INT: a good three-dimensional fix, or none and accuracies of 100 m, as PX4 says."""
    fix = s.commander.failures.gps_has_fix
    dilution, accuracy_mm, accuracy_mmps = (80, 900, 400) if fix else (10_000, 100_000, 100_000)
    place = geographic_from_ned(s.home, s.truth.position_ned_m)
    north, east, _ = s.truth.velocity_ned_mps
    return mavlink.MAVLink_gps_raw_int_message(
        s.unix_us,
        mavlink.GPS_FIX_TYPE_3D_FIX if fix else s.realism.fix_when_lost,
        round(place.latitude_deg * 1e7),
        round(place.longitude_deg * 1e7),
        round(place.altitude_m * 1e3),
        dilution,
        dilution,
        min(round(s.truth.ground_speed_mps * 100.0), 65534),
        round(math.degrees(math.atan2(east, north)) * 100.0) % 36000,
        14 if fix else 0,
        h_acc=accuracy_mm,
        v_acc=accuracy_mm,
        vel_acc=accuracy_mmps,
    )


def vfr_hud(s: Snapshot) -> Any:
    """VFR_HUD."""
    truth = s.truth
    return mavlink.MAVLink_vfr_hud_message(
        truth.ground_speed_mps,
        truth.ground_speed_mps,
        round(math.degrees(truth.yaw_rad)) % 360,
        0 if s.commander.setpoint is None else 50,
        s.home.altitude_m - truth.position_ned_m[2],
        -truth.velocity_ned_mps[2],
    )


def altitude(s: Snapshot) -> Any:
    """ALTITUDE."""
    height_m = -s.truth.position_ned_m[2]
    above_home_m = s.commander.home_ned_m[2] + height_m
    above_sea_m = s.home.altitude_m + height_m
    return mavlink.MAVLink_altitude_message(
        s.unix_us, above_sea_m, above_sea_m, height_m, above_home_m, height_m, height_m
    )


def sys_status(s: Snapshot) -> Any:
    """SYS_STATUS: health, battery, and in the pre-arm bit whether arming would succeed."""
    present = _ESTIMATOR_SENSORS | _OTHER_SENSORS | _POSITION_CONTROL
    present |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
    # Nothing breaches a geofence that is not enforced; MAVProxy announces a breach without this.
    health = _OTHER_SENSORS | mavlink.MAV_SYS_STATUS_GEOFENCE
    failed = s.commander.failures.failed_sensors
    if s.estimator.lost_for_s < s.realism.drops_gps_after_s:
        failed &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
    elif s.realism.drops_gps_after_s > 0.0:
        present &= ~(failed & mavlink.MAV_SYS_STATUS_SENSOR_GPS)
    if s.tells_position:
        health |= _ESTIMATOR_SENSORS & ~failed
    if s.commander.estimator_ready:
        health |= _POSITION_CONTROL
    if not s.commander.prearm_failures():
        health |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
    battery = s.battery
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        health,
        200,
        round(battery.voltage_v * 1e3),
        _int16(battery.current_a * 100.0),
        round(battery.remaining * 100.0),
        *(0,) * 6,
    )


def battery_status(s: Snapshot) -> Any:
    """BATTERY_STATUS: one pack, its voltage reported as a whole."""
    battery = s.battery
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        2500,
        [round(battery.voltage_v * 1e3), *(0xFFFF,) * 9],
        _int16(battery.current_a * 100.0),
        round(battery.consumed_ah * 1e3),
        -1,
        round(battery.remaining * 100.0),
    )


def extended_sys_state(s: Snapshot) -> Any:
    """EXTENDED_SYS_STATE: the landed state."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, s.commander.landed_state
    )


def home_position(s: Snapshot) -> Any:
    """HOME_POSITION."""
    place = geographic_from_ned(s.home, s.commander.home_ned_m)
    return mavlink.MAVLink_home_position_message(
        round(place.latitude_deg * 1e7),
        round(place.longitude_deg * 1e7),
        round(place.altitude_m * 1e3),
        *s.commander.home_ned_m,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
        s.unix_us,
    )


def gps_global_origin(s: Snapshot) -> Any:
    """GPS_GLOBAL_ORIGIN: where local NED is zero."""
    return mavlink.MAVLink_gps_global_origin_message(
        round(s.home.latitude_deg * 1e7),
        round(s.home.longitude_deg * 1e7),
        round(s.home.altitude_m * 1e3),
        s.unix_us,
    )


def system_time(s: Snapshot) -> Any:
    """SYSTEM_TIME."""
    return mavlink.MAVLink_system_time_message(s.unix_us, s.boot_ms)


def odometry(s: Snapshot) -> Any:
    """ODOMETRY: pose in local NED, velocity in FRD, covariances unknown."""
    truth = s.truth
    unknown = [math.nan] * 21
    return mavlink.MAVLink_odometry_message(
        s.unix_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_BODY_FRD,
        *truth.position_ned_m,
        list(truth.attitude_quaternion),
        *_frd_from_ned(truth, truth.velocity_ned_mps),
        *truth.body_rates_radps,
        unknown,
        unknown,
        reset_counter=s.estimator.resets % 256,
        estimator_type=mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )


def autopilot_version(s: Snapshot) -> Any:
    """AUTOPILOT_VERSION: what this autopilot can do."""
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | s.flavour.capabilities
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )
    nothing = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, s.flavour.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
    )


def mission_current(s: Snapshot) -> Any:
    """MISSION_CURRENT: which item is flown, and how far the mission is."""
    mission = s.commander.mission
    if not mission.flyable:
        state = mavlink.MISSION_STATE_NO_MISSION
    elif mission.finished:
        state = mavlink.MISSION_STATE_COMPLETE
    elif s.commander.mode is Mode.MISSION:
        state = mavlink.MISSION_STATE_ACTIVE
    else:
        state = mavlink.MISSION_STATE_NOT_STARTED
    in_mission_mode = 1 if s.commander.mode is Mode.MISSION else 2
    return mavlink.MAVLink_mission_current_message(
        mission.current, len(mission.items), state, in_mission_mode
    )


def ekf_status_report(s: Snapshot) -> Any:
    """EKF_STATUS_REPORT: ArduPilot's way to say how good the estimate is.

    Its variances rise at the failover; they are not measured, but the failsafe needs 0.8.
    """
    flags, variance = _estimator_flags(s), 0.02
    if not flags:
        flags = mavlink.EKF_UNINITIALIZED
    elif s.estimator.lost_for_s >= s.estimator.profile.dead_reckoning_s:
        variance = 1.0
    return mavlink.MAVLink_ekf_status_report_message(flags, variance, variance, 0.02, 0.05, 0.0)


def estimator_status(s: Snapshot) -> Any:
    """ESTIMATOR_STATUS: PX4's way to say the same.

    Without GPS the ratios of innovations say nothing: only the accuracies grow, until the
    horizontal flags go, and ratios with them.
    """
    estimator = s.estimator
    lost_for_s, error = estimator.lost_for_s, estimator.error
    ratios = (0.03 + 0.2 * abs(error.velocity_north_mps), 0.02 + 0.05 * abs(error.north_m))
    accuracy_m = 0.29
    if lost_for_s > 0.0:
        ratios = (0.01, 0.05)
        accuracy_m += 0.06 * lost_for_s + 0.045 * lost_for_s**2
    if lost_for_s >= estimator.profile.dead_reckoning_s:
        accuracy_m += 4.0
    if lost_for_s >= estimator.profile.aiding_stops_s:
        ratios = (math.nan, math.nan)
    flags = _estimator_flags(s)
    if not flags:
        flags = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_CONST_POS_MODE
    return mavlink.MAVLink_estimator_status_message(
        round(s.truth.time_s * 1e6),
        flags,
        *ratios,
        0.02,
        0.08,
        math.nan,  # no range finder
        math.nan,  # no air speed
        accuracy_m,
        0.3,
    )


def _estimator_flags(s: Snapshot) -> int:
    """What the filter vouches for; the flags mean the same in both messages.  0: nothing yet."""
    profile, lost_for_s = s.estimator.profile, s.estimator.lost_for_s
    if not s.tells_position and lost_for_s <= 0.0:
        return 0
    flags: int = _EKF_GOOD
    if s.realism.rest_is_constant_position and s.commander.on_ground and not s.commander.armed:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE
    if lost_for_s >= profile.dead_reckoning_s:
        if not s.realism.tells_lost_position_s:
            return 0
        flags &= ~_EKF_HORIZONTAL
    if lost_for_s >= profile.aiding_stops_s:
        flags &= ~_EKF_PREDICTED
    return flags


# These flags mean the same in both messages.
_EKF_GOOD = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)
_EKF_HORIZONTAL = mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS
_EKF_PREDICTED = mavlink.EKF_PRED_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_ABS

BUILDERS: dict[int, Callable[[Snapshot], Any]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: altitude,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: odometry,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
}


def current_mode(s: Snapshot) -> Any:
    """CURRENT_MODE: the mode flown, and the one wanted."""
    flavour, commander = s.flavour, s.commander
    mode, intended = commander.mode, commander.intention
    return CurrentMode(mode, flavour.custom_mode(mode), flavour.custom_mode(intended))


BUILDERS[CURRENT_MODE_ID] = current_mode

_DATA_STREAMS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}


def messages_of_data_stream(stream: int) -> tuple[int, ...]:
    """Return the messages of one of ArduPilot's data streams, or of all of them."""
    if stream == mavlink.MAV_DATA_STREAM_ALL:
        return tuple(message for group in _DATA_STREAMS.values() for message in group)
    return _DATA_STREAMS.get(stream, ())


def _frd_from_ned(truth: VehicleTruth, vector_ned: Vector) -> Vector:
    w, x, y, z = truth.attitude_quaternion
    return rotate_frd_from_ned(w, x, y, z, *vector_ned)


def _int16(value: float) -> int:
    return min(max(round(value), -32767), 32767)
