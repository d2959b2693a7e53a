"""Failsafes and injected failures of the PX4 flavour, and the pilot's sticks."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.plant.battery import BatteryConfig
from tests.sitl.mavlink_client import Client, cruising, in_air, mode_of, on_ground

GPS, MOTOR = mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_UNIT_SYSTEM_MOTOR
OK, OFF, WRONG = (
    mavlink.FAILURE_TYPE_OK,
    mavlink.FAILURE_TYPE_OFF,
    mavlink.FAILURE_TYPE_WRONG,
)


def breakable(**parameters: float) -> dict[str, Any]:
    return {"parameters": {"SYS_FAILURE_EN": 1, **parameters}}


def inject(client: Client, unit: int, kind: int, instance: float = 0.0) -> int:
    return client.command(mavlink.MAV_CMD_INJECT_FAILURE, unit, kind, instance)


# --- battery, links ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("charge", "action", "mode"),
    [
        (0.12, 3, Mode.HOLD),  # low: a warning only
        (0.06, 0, Mode.HOLD),
        (0.06, 2, Mode.LAND),
        (0.06, 3, Mode.RTL),
        (0.03, 3, Mode.LAND),
    ],
)
def test_low_battery_reaction_follows_its_parameter(charge: float, action: int, mode: Mode) -> None:
    client = in_air(
        battery=BatteryConfig(initial_charge=charge), parameters={"COM_LOW_BAT_ACT": action}
    )
    assert mode_of(client) is mode
    assert any("battery level" in text for text in client.texts())


def test_battery_failsafe_ends_offboard_although_the_stream_goes_on() -> None:
    client, stream = cruising(**breakable(COM_LOW_BAT_ACT=2))
    inject(client, mavlink.FAILURE_UNIT_SYSTEM_BATTERY, OFF)
    client.wait(1.0, stream)
    assert mode_of(client) is Mode.LAND


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.HOLD), (2, Mode.RTL), (3, Mode.LAND)])
def test_ground_station_loss_follows_its_parameter(action: int, mode: Mode) -> None:
    client = in_air(parameters={"NAV_DLL_ACT": action, "COM_DL_LOSS_T": 5})
    client.wait(3.0)
    assert mode_of(client) is Mode.HOLD
    client.wait(1.5)
    assert mode_of(client) is mode


def test_a_ground_station_that_never_spoke_is_not_lost() -> None:
    client = in_air(parameters={"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 5})
    client.vehicle.autopilot.commander._ground_heard_s = -math.inf
    client.wait(7.0)
    assert mode_of(client) is Mode.HOLD


# --- sticks --------------------------------------------------------------------------------


def push(client: Client, forward: int, throttle: int = 500) -> None:
    client.send(mavlink.MAVLink_manual_control_message(1, forward, 0, throttle, 0, 0))


def test_a_pilot_flies_by_stick_and_losing_him_returns() -> None:
    client = in_air(parameters={"MPC_VEL_MANUAL": 4.0})
    assert client.set_mode(Mode.POSCTL) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    push(client, 500)
    assert client.set_mode(Mode.POSCTL) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(4.0, lambda _: push(client, 500))
    assert client.vehicle.truth.velocity_ned_mps == pytest.approx((2.0, 0.0, 0.0), abs=0.05)
    client.wait(2.0, lambda _: push(client, 0, 750))
    assert client.vehicle.truth.velocity_ned_mps == pytest.approx((0.0, 0.0, -1.5), abs=0.1)
    client.wait(1.0)
    assert mode_of(client) is Mode.RTL


def test_sticks_can_be_disabled_and_cut() -> None:
    client = in_air(parameters={"COM_RC_IN_MODE": 4})
    push(client, 0)
    assert client.set_mode(Mode.POSCTL) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    client = in_air(**breakable())
    inject(client, mavlink.FAILURE_UNIT_SYSTEM_RC_SIGNAL, OFF)
    push(client, 0)
    assert client.set_mode(Mode.POSCTL) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


# --- injected failures ---------------------------------------------------------------------


def test_failures_are_injected_only_where_that_is_enabled() -> None:
    client = in_air()
    assert inject(client, MOTOR, OFF, 1) == mavlink.MAV_RESULT_DENIED
    client.wait(0.5)
    assert client.vehicle.truth.tilt_rad < 0.02


@pytest.mark.parametrize(
    ("unit", "kind", "instance"),
    [
        (MOTOR, OFF, 5),
        (MOTOR, OFF, 0.5),
        (MOTOR, WRONG, 1),
        (GPS, 7, 0),
        (7, OFF, 0),
        (GPS, OFF, 2),
    ],
)
def test_failures_that_are_not_simulated_are_unsupported(
    unit: int, kind: int, instance: float
) -> None:
    client = on_ground(**breakable())
    assert inject(client, unit, kind, instance) == mavlink.MAV_RESULT_UNSUPPORTED


def test_a_stopped_motor_brings_the_vehicle_down() -> None:
    client = in_air(**breakable())
    assert inject(client, MOTOR, OFF, 1) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(0.5)
    assert client.vehicle.truth.rotor_speeds_rpm[0] < 10.0
    assert client.vehicle.truth.tilt_rad > math.radians(20.0)
    client.wait(2.0)
    assert client.vehicle.truth.position_ned_m[2] > -1.0


def test_a_restored_motor_flies_again() -> None:
    client = in_air(**breakable())
    inject(client, MOTOR, OFF, 0)
    client.wait(0.2)
    inject(client, MOTOR, OK, 0)
    client.wait(4.0)
    assert client.vehicle.truth.position_ned_m == pytest.approx((0.0, 0.0, -4.0), abs=0.05)


def test_losing_gps_keeps_flying_for_a_while_then_descends() -> None:
    client, stream = cruising(**breakable())
    inject(client, GPS, OFF)
    client.wait(4.5, stream)
    assert mode_of(client) is Mode.OFFBOARD
    assert client.of("GPS_RAW_INT")[-1].fix_type == mavlink.GPS_FIX_TYPE_NO_FIX
    client.wait(1.0, stream)
    client.received.clear()
    client.wait(1.0, stream)
    assert mode_of(client) is Mode.LAND
    assert not client.of("LOCAL_POSITION_NED")
    health = client.of("SYS_STATUS")[-1].onboard_control_sensors_health
    assert not health & mavlink.MAV_SYS_STATUS_SENSOR_GPS


def test_a_wrong_gps_shifts_the_vehicle_and_counts_a_reset() -> None:
    client = in_air(**breakable())
    client.command(mavlink.MAV_CMD_DO_REPOSITION, -1.0, 1.0, 0.0, *(math.nan,) * 3, 492.0)
    client.wait(1.0)
    inject(client, GPS, WRONG)
    client.wait(5.0)
    assert client.of("LOCAL_POSITION_NED")[-1].x == pytest.approx(0.0, abs=0.1)
    assert client.vehicle.truth.position_ned_m[0] == pytest.approx(-5.0, abs=0.1)
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_ODOMETRY)
    assert client.of("ODOMETRY")[-1].reset_counter == 1


@pytest.mark.parametrize(
    ("unit", "bit"),
    [
        (mavlink.FAILURE_UNIT_SENSOR_MAG, mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG),
        (mavlink.FAILURE_UNIT_SENSOR_BARO, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
        (mavlink.FAILURE_UNIT_SENSOR_GYRO, mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO),
    ],
)
def test_a_failed_sensor_shows_and_keeps_from_arming(unit: int, bit: int) -> None:
    client = on_ground(**breakable())
    inject(client, unit, OFF)
    client.wait(0.6)
    assert not client.of("SYS_STATUS")[-1].onboard_control_sensors_health & bit
    assert client.arm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_without_gyroscopes_the_flight_is_over() -> None:
    client = in_air(**breakable())
    inject(client, mavlink.FAILURE_UNIT_SENSOR_GYRO, OFF)
    client.wait(0.1)
    assert not client.vehicle.autopilot.commander.armed
