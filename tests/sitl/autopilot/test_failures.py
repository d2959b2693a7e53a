"""Failures by MAV_CMD_INJECT_FAILURE: which are simulated, what they change, how they end."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.failures import Failures
from sitl.plant.multirotor import INTACT

OK, OFF, STUCK, WRONG = (
    mavlink.FAILURE_TYPE_OK,
    mavlink.FAILURE_TYPE_OFF,
    mavlink.FAILURE_TYPE_STUCK,
    mavlink.FAILURE_TYPE_WRONG,
)
GPS, MOTOR = mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_UNIT_SYSTEM_MOTOR
BATTERY, STICKS = mavlink.FAILURE_UNIT_SYSTEM_BATTERY, mavlink.FAILURE_UNIT_SYSTEM_RC_SIGNAL
GYRO, ACCEL = mavlink.FAILURE_UNIT_SENSOR_GYRO, mavlink.FAILURE_UNIT_SENSOR_ACCEL
MAG, BARO = mavlink.FAILURE_UNIT_SENSOR_MAG, mavlink.FAILURE_UNIT_SENSOR_BARO
SENSORS = {
    GYRO: mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    ACCEL: mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    MAG: mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
    BARO: mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    GPS: mavlink.MAV_SYS_STATUS_SENSOR_GPS,
}


def injected(unit: float, kind: float, instance: float = 0.0, now_s: float = 0.0) -> Failures:
    failures = Failures()
    assert failures.inject(unit, kind, instance, now_s)
    return failures


def test_nothing_has_failed_at_first() -> None:
    failures = Failures()
    assert failures.failed_sensors == 0
    assert failures.rotor_shares == INTACT
    assert failures.gps_has_fix
    assert failures.gps_lost_for_s(100.0) == 0.0
    assert failures.gps_wrong_m == 0.0
    assert not failures.attitude_lost
    assert not failures.battery_failed
    assert not failures.sticks_cut
    assert not failures.modes_refused


@pytest.mark.parametrize("unit", SENSORS)
@pytest.mark.parametrize("kind", [OFF, STUCK])
def test_a_failed_sensor_shows_its_bit_until_it_is_ok(unit: int, kind: int) -> None:
    failures = injected(unit, kind)
    assert failures.failed_sensors == SENSORS[unit]
    assert failures.inject(unit, OK, 0.0, 1.0)
    assert failures.failed_sensors == 0


def test_the_bits_of_several_sensors_add_up() -> None:
    failures = injected(MAG, OFF)
    failures.inject(BARO, STUCK, 0.0, 0.0)
    assert failures.failed_sensors == SENSORS[MAG] | SENSORS[BARO]


@pytest.mark.parametrize(("unit", "lost"), [(GYRO, True), (ACCEL, True), (MAG, False)])
def test_the_attitude_is_lost_with_the_inertial_sensors(unit: int, lost: bool) -> None:
    assert injected(unit, OFF).attitude_lost is lost


def test_battery_and_sticks_fail() -> None:
    assert injected(BATTERY, OFF).battery_failed
    assert injected(STICKS, OFF).sticks_cut


@pytest.mark.parametrize(("kind", "fix"), [(OFF, False), (STUCK, True)])
def test_gps_is_missing_from_the_first_failure_on(kind: int, fix: bool) -> None:
    failures = injected(GPS, kind, now_s=10.0)
    assert failures.gps_has_fix is fix
    assert failures.gps_lost_for_s(12.0) == 2.0
    failures.inject(GPS, kind, 0.0, 13.0)
    assert failures.gps_lost_for_s(14.0) == 4.0
    failures.inject(GPS, OK, 0.0, 15.0)
    assert failures.gps_lost_for_s(16.0) == 0.0


def test_a_wrong_gps_has_a_fix_and_an_error() -> None:
    failures = injected(GPS, WRONG)
    assert failures.gps_has_fix
    assert failures.gps_wrong_m == 5.0
    assert failures.gps_lost_for_s(1.0) == 0.0


@pytest.mark.parametrize("instance", [1.0, 2.0, 3.0, 4.0])
def test_one_motor_stops_and_runs_again(instance: float) -> None:
    failures = injected(MOTOR, OFF, instance)
    assert list(failures.rotor_shares) == [
        0.0 if rotor == instance else 1.0 for rotor in (1, 2, 3, 4)
    ]
    failures.inject(MOTOR, OK, instance, 0.0)
    assert failures.rotor_shares == INTACT


def test_instance_zero_stands_for_all_motors() -> None:
    failures = injected(MOTOR, OFF)
    assert list(failures.rotor_shares) == [0.0] * 4
    failures.inject(MOTOR, OK, 2.0, 0.0)
    assert list(failures.rotor_shares) == [0.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("unit", "kind", "instance"),
    [
        (MOTOR, OFF, 5.0),
        (MOTOR, OFF, -1.0),
        (MOTOR, OFF, 1.5),
        (MOTOR, OFF, math.nan),
        (MOTOR, STUCK, 1.0),
        (GPS, OFF, 2.0),
        (GPS, OFF, math.nan),
        (BATTERY, WRONG, 0.0),
        (MAG, WRONG, 0.0),
        (math.nan, OFF, 0.0),
        (math.inf, OFF, 0.0),
        (GPS, math.nan, 0.0),
        (999.0, OFF, 0.0),
    ],
)
def test_what_is_not_simulated_is_refused_and_changes_nothing(
    unit: float, kind: float, instance: float
) -> None:
    failures = Failures()
    assert not failures.inject(unit, kind, instance, 0.0)
    assert failures.rotor_shares == INTACT
    assert failures.failed_sensors == 0


@given(st.floats(), st.floats(), st.floats())
def test_any_numbers_are_taken_or_refused_without_an_exception(
    unit: float, kind: float, instance: float
) -> None:
    failures = Failures()
    failures.inject(unit, kind, instance, 0.0)
    assert all(share in (0.0, 1.0) for share in failures.rotor_shares)
