"""Every telemetry message, as it is decoded on the other side."""

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.standard_modes import CURRENT_MODE_ID
from sitl.autopilot.protocol.position_messages import controlled
from sitl.autopilot.protocol.snapshot import Snapshot, int16
from sitl.autopilot.protocol.telemetry import BUILDERS
from sitl.config import VehicleConfig
from sitl.plant.battery import BatteryReading
from sitl.plant.setpoint import Setpoint
from sitl.vehicle.autopilot import Autopilot
from tests.sitl.autopilot.truths import truth_at

TRUTH = truth_at(12.5, (10.0, -20.0, -5.0), (3.0, 4.0, -1.0), yaw_rad=math.pi / 2.0)
BATTERY = BatteryReading(voltage_v=15.2, current_a=8.0, remaining=0.6, consumed_ah=2.0)
GPS = mavlink.FAILURE_UNIT_SENSOR_GPS
UNIX_S = 1_790_000_000.0


def snapshot(flavour: str = "px4", realism: str = "ideal") -> Snapshot:
    """Return an armed vehicle in flight, 5 m up, going north-east."""
    config = VehicleConfig.model_validate({"flavour": flavour, "realism": realism})
    autopilot = Autopilot(config, TRUTH, BATTERY, UNIX_S)
    return Snapshot(
        TRUTH,
        BATTERY,
        autopilot.commander,
        config.home,
        autopilot.flavour,
        UNIX_S,
        autopilot.realism,
        autopilot.estimator,
    )


def sent(name: str, s: Snapshot) -> Any:
    """Return a message as it arrives."""
    message = BUILDERS[getattr(mavlink, f"MAVLINK_MSG_ID_{name}")](s)
    (decoded,) = mavlink.MAVLink(None).parse_buffer(message.pack(mavlink.MAVLink(None, 1, 1)))
    assert decoded.get_type() == name
    return decoded


def test_every_builder_makes_the_message_of_its_number() -> None:
    s = snapshot()
    for message_id, builder in BUILDERS.items():
        message = builder(s)
        if message is not None:
            assert message.get_msgId() == message_id


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_a_heartbeat_shows_flavour_and_arming(flavour: str) -> None:
    heartbeat = sent("HEARTBEAT", snapshot(flavour))
    expected = "MAV_AUTOPILOT_PX4" if flavour == "px4" else "MAV_AUTOPILOT_ARDUPILOTMEGA"
    assert heartbeat.autopilot == getattr(mavlink, expected)
    assert heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert heartbeat.system_status == mavlink.MAV_STATE_ACTIVE


def test_position_and_attitude_are_those_of_the_estimate() -> None:
    s = snapshot()
    position, attitude = sent("LOCAL_POSITION_NED", s), sent("ATTITUDE", s)
    assert (position.x, position.y, position.z) == TRUTH.position_ned_m
    assert (position.vx, position.vy, position.vz) == TRUTH.velocity_ned_mps
    assert position.time_boot_ms == attitude.time_boot_ms == 12_500
    assert attitude.yaw == pytest.approx(math.pi / 2.0)
    assert (attitude.roll, attitude.pitch) == (0.0, 0.0)


def test_odometry_has_its_velocity_in_the_body() -> None:
    odometry = sent("ODOMETRY", snapshot())
    # North is to the left of a nose to the east.
    assert (odometry.vx, odometry.vy, odometry.vz) == pytest.approx((4.0, -3.0, -1.0))
    assert odometry.child_frame_id == mavlink.MAV_FRAME_BODY_FRD
    assert math.isnan(odometry.pose_covariance[0])


def test_the_global_position_is_near_home() -> None:
    s = snapshot()
    place = sent("GLOBAL_POSITION_INT", s)
    assert place.lat * 1e-7 == pytest.approx(s.home.latitude_deg, abs=1e-3)
    assert place.alt == round((s.home.altitude_m + 5.0) * 1e3)
    assert (place.vx, place.vy, place.vz) == (300, 400, -100)
    assert place.hdg == 9000


def test_ground_speed_and_course() -> None:
    fix, hud = sent("GPS_RAW_INT", snapshot()), sent("VFR_HUD", snapshot())
    assert fix.vel == 500
    assert fix.cog == round(math.degrees(math.atan2(4.0, 3.0)) * 100.0)
    assert hud.groundspeed == 5.0
    assert hud.climb == 1.0
    assert hud.heading == 90


def test_gps_shows_its_failure() -> None:
    s = snapshot()
    assert sent("GPS_RAW_INT", s).fix_type == mavlink.GPS_FIX_TYPE_3D_FIX
    s.commander.failures.inject(GPS, mavlink.FAILURE_TYPE_OFF, 0.0, 10.0)
    lost = sent("GPS_RAW_INT", s)
    assert lost.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX
    assert (lost.satellites_visible, lost.h_acc) == (0, 100_000)


def test_health_follows_the_sensors_and_the_checks() -> None:
    s = snapshot()
    prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert sent("SYS_STATUS", s).onboard_control_sensors_health & prearm
    mag = mavlink.FAILURE_UNIT_SENSOR_MAG
    s.commander.failures.inject(mag, mavlink.FAILURE_TYPE_OFF, 0.0, 0.0)
    health = sent("SYS_STATUS", s).onboard_control_sensors_health
    assert not health & prearm
    assert not health & mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    assert health & mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO


def test_the_battery_is_reported_in_both_messages() -> None:
    s = snapshot()
    status, battery = sent("SYS_STATUS", s), sent("BATTERY_STATUS", s)
    assert status.voltage_battery == battery.voltages[0] == 15_200
    assert status.current_battery == battery.current_battery == 800
    assert status.battery_remaining == battery.battery_remaining == 60
    assert battery.current_consumed == 2000


def test_altitudes_count_from_their_origins() -> None:
    s = snapshot()
    altitude, home = sent("ALTITUDE", s), sent("HOME_POSITION", s)
    assert altitude.altitude_local == 5.0
    assert altitude.altitude_relative == 5.0
    assert altitude.altitude_amsl == pytest.approx(s.home.altitude_m + 5.0)
    assert home.altitude == round(s.home.altitude_m * 1e3)


def test_clocks_agree() -> None:
    time = sent("SYSTEM_TIME", snapshot())
    assert time.time_boot_ms == 12_500
    assert time.time_unix_usec == round((UNIX_S + 12.5) * 1e6)


def test_no_setpoint_is_reported_while_none_is_flown() -> None:
    assert BUILDERS[mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED](snapshot()) is None


def test_an_empty_mission_is_no_mission() -> None:
    current = sent("MISSION_CURRENT", snapshot())
    assert current.total == 0
    assert current.mission_state == mavlink.MISSION_STATE_NO_MISSION


def test_the_current_mode_has_its_own_layout() -> None:
    message = BUILDERS[CURRENT_MODE_ID](snapshot())
    frame = message.pack(mavlink.MAVLink(None, 1, 1))
    assert int.from_bytes(frame[7:10], "little") == CURRENT_MODE_ID


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_estimator_flags_fall_step_by_step_without_gps(flavour: str) -> None:
    s = snapshot(flavour, "field")
    horizontal, predicted = mavlink.EKF_POS_HORIZ_ABS, mavlink.EKF_PRED_POS_HORIZ_ABS
    profile = s.estimator.profile
    name = "ESTIMATOR_STATUS" if flavour == "px4" else "EKF_STATUS_REPORT"
    found = []
    for lost_for_s in (0.0, profile.dead_reckoning_s - 0.1, profile.dead_reckoning_s + 0.1):
        s.estimator.lost_for_s = lost_for_s
        found.append(bool(sent(name, s).flags & horizontal))
    assert found == [True, True, False]
    assert sent(name, s).flags & predicted
    s.estimator.lost_for_s = profile.aiding_stops_s
    assert not sent(name, s).flags & predicted


def test_px4s_accuracy_grows_and_its_ratios_end_without_gps() -> None:
    s = snapshot("px4", "field")
    accuracies_m = []
    for lost_for_s in (0.0, 2.0, 5.0, 10.0):
        s.estimator.lost_for_s = lost_for_s
        accuracies_m.append(sent("ESTIMATOR_STATUS", s).pos_horiz_accuracy)
    assert accuracies_m == sorted(accuracies_m)
    assert math.isnan(sent("ESTIMATOR_STATUS", s).vel_ratio)


def test_ardupilots_variance_rises_when_the_position_is_lost() -> None:
    s = snapshot("ardupilot", "field")
    assert sent("EKF_STATUS_REPORT", s).velocity_variance < 0.8
    s.estimator.lost_for_s = s.estimator.profile.dead_reckoning_s
    assert sent("EKF_STATUS_REPORT", s).velocity_variance >= 0.8


def test_an_ideal_autopilot_stops_reporting_a_lost_position() -> None:
    s = snapshot()
    assert s.reports_position
    s.estimator.lost_for_s = 6.0
    assert not s.reports_position
    assert BUILDERS[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED](s) is None


def test_the_controllers_setpoint_adds_its_feedback() -> None:
    settings = replace(
        snapshot().commander.settings, position_gain_per_s=1.0, velocity_gain_per_s=2.0
    )
    wanted = Setpoint(12.0, -20.0, -5.0, 1.0, 0.0, 0.0)
    found = controlled(wanted, TRUTH, settings)
    assert found.velocity_north_mps == pytest.approx(1.0 + 1.0 * (12.0 - 10.0))
    assert found.acceleration_north_mps2 == pytest.approx(2.0 * (3.0 - 3.0))
    assert found.acceleration_east_mps2 == pytest.approx(2.0 * (0.0 - 4.0))
    assert found[:3] == wanted[:3]


def test_axes_that_are_not_controlled_stay_so() -> None:
    found = controlled(Setpoint(), TRUTH, snapshot().commander.settings)
    assert all(map(math.isnan, found[:6]))
    assert found[6:9] == (0.0, 0.0, 0.0)
    velocity = Setpoint(velocity_north_mps=3.0, velocity_east_mps=4.0, velocity_down_mps=-1.0)
    followed = controlled(velocity, TRUTH, snapshot().commander.settings)
    assert followed[3:9] == pytest.approx((3.0, 4.0, -1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("value", "field"), [(0.4, 0), (-0.6, -1), (1e9, 32767), (-1e9, -32767), (32767.4, 32767)]
)
def test_int16_rounds_and_saturates(value: float, field: int) -> None:
    assert int16(value) == field
