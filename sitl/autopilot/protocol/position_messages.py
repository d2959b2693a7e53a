"""Messages about pose, motion and setpoint, each built from a snapshot."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.protocol.snapshot import Snapshot, int16
from sitl.autopilot.settings import FlightSettings
from sitl.plant.multirotor import rotate_frd_from_ned
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

# Vertical feedback [1/s], which no parameter here changes: MPC_Z_P and MPC_Z_VEL_P_ACC.
HEIGHT_GAIN_PER_S = 1.0


CLIMB_GAIN_PER_S = 4.0


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
    """LOCAL_POSITION_NED; None while the autopilot does not report the position."""
    if not s.reports_position:
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
    """Return a setpoint as the position controller passes it on, which is what PX4 reports.

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
        int16(north * 100.0),
        int16(east * 100.0),
        int16(down * 100.0),
        round(math.degrees(truth.yaw_rad) * 100.0) % 36000,
    )


def gps_raw_int(s: Snapshot) -> Any:
    """GPS_RAW_INT: a good 3D fix, or none and accuracies of 100 m, as PX4 reports."""
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


def _frd_from_ned(truth: VehicleTruth, vector_ned: Vector) -> Vector:
    w, x, y, z = truth.attitude_quaternion
    return rotate_frd_from_ned(w, x, y, z, *vector_ned)
