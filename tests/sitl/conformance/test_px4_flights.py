"""What PX4's own MAVSDK tests of a multicopter fly, against the simulated PX4.

``docs/conformance.md`` says which test of PX4 is which here.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase

from sitl.autopilot.modes import Mode
from sitl.plant.truth import Vector
from tests.sitl.conformance.operator import (
    ACCEPTED,
    DENIED,
    RETURN,
    Item,
    Operator,
    waypoint,
)
from tests.sitl.mavlink_client import mode_of

LEG_M, HEIGHT_M = 20.0, 10.0
SQUARE = [
    waypoint(LEG_M, 0.0, HEIGHT_M),
    waypoint(LEG_M, LEG_M, HEIGHT_M),
    waypoint(0.0, LEG_M, HEIGHT_M),
]
HOME: Vector = (0.0, 0.0, 0.0)
LOW_RETURN = {"RTL_RETURN_ALT": HEIGHT_M}
GPS, MAG = mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_UNIT_SENSOR_MAG
BARO = mavlink.FAILURE_UNIT_SENSOR_BARO
OFF, STUCK = mavlink.FAILURE_TYPE_OFF, mavlink.FAILURE_TYPE_STUCK


def from_home_m(operator: Operator) -> float:
    return math.hypot(*operator.position_ned_m[:2])


def off_leg_m(place: Vector, start: Vector, end: Vector) -> float:
    """Distance of a place from the line through two others."""
    along = [b - a for a, b in zip(start, end, strict=True)]
    offset = [b - a for a, b in zip(start, place, strict=True)]
    length = math.hypot(*along)
    share = sum(a * b for a, b in zip(along, offset, strict=True)) / length**2
    return math.dist(offset, [share * each for each in along])


def track_mission(operator: Operator, items: list[Item], corridor_m: float) -> None:
    """Fly until the mission is done; between its items the vehicle stays in the corridor."""

    def check() -> None:
        number = operator.vehicle.autopilot.commander.mission.current
        if number > 0 and not operator.finished:
            start, end = (
                (one.north_m, one.east_m, -one.height_m) for one in items[number - 1 : number + 1]
            )
            assert off_leg_m(operator.position_ned_m, start, end) < corridor_m

    operator.until(lambda: operator.finished, 120.0, check)


# --- basics and missions -------------------------------------------------------------------


def test_takeoff_and_hold_position() -> None:
    operator = Operator()
    operator.take_off(10.0)
    operator.until(lambda: abs(operator.height_m - 10.0) < 0.1, 10.0)

    def check() -> None:
        assert operator.position_ned_m == pytest.approx((0.0, 0.0, -10.0), abs=0.25)

    end_s = operator.now_s + 60.0
    operator.until(lambda: operator.now_s >= end_s, 61.0, check)
    assert mode_of(operator) is Mode.HOLD


def test_takeoff_and_land() -> None:
    operator = Operator()
    operator.take_off(2.5)
    assert operator.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    operator.until_disarmed(60.0)
    assert from_home_m(operator) < 0.5
    operator.wait(1.5)
    assert not operator.armed
    assert operator.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND


def test_square_mission_that_ends_in_a_return() -> None:
    operator = Operator(parameters=LOW_RETURN)
    operator.fly_mission([*SQUARE, RETURN])
    operator.until_disarmed(180.0)
    assert from_home_m(operator) < 0.5
    reached = [message.seq for message in operator.of("MISSION_ITEM_REACHED")]
    assert reached[:3] == [0, 1, 2]


def test_square_mission_and_a_return_by_command() -> None:
    operator = Operator(parameters=LOW_RETURN)
    operator.fly_mission(SQUARE)
    track_mission(operator, SQUARE, 5.0)
    operator.until_hovering()
    assert operator.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    operator.until_disarmed(180.0)
    assert from_home_m(operator) < 0.5


def test_straight_mission_is_flown_through_without_slowing_down() -> None:
    legs = [waypoint(number * LEG_M, 0.0, HEIGHT_M, radius_m=2.0) for number in range(5)]
    operator = Operator(parameters=LOW_RETURN)
    operator.fly_mission(legs)
    mission = operator.vehicle.autopilot.commander.mission
    operator.until(lambda: mission.current == 2, 60.0)
    slowest_mps = math.inf
    while mission.current == 2:
        slowest_mps = min(slowest_mps, operator.vehicle.truth.ground_speed_mps)
        operator.wait(0.1)
    assert slowest_mps > 4.0
    track_mission(operator, legs, 5.0)
    operator.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    operator.until_disarmed(180.0)


# --- failsafes -----------------------------------------------------------------------------


def breaking(unit: int, kind: int, height_reference: int, **config: Any) -> Operator:
    """Return a vehicle on its mission's second leg whose sensor has just failed."""
    parameters = {"SYS_FAILURE_EN": 1, "EKF2_HGT_REF": height_reference, "RTL_RETURN_ALT": 4.0}
    operator = Operator(parameters=parameters, **config)
    legs = [item._replace(height_m=4.0) for item in SQUARE]
    operator.fly_mission([*legs, RETURN])
    mission = operator.vehicle.autopilot.commander.mission
    operator.until(lambda: mission.current == 1, 60.0)
    assert operator.command(mavlink.MAV_CMD_INJECT_FAILURE, unit, kind, 0.0) == ACCEPTED
    return operator


@pytest.mark.parametrize("height_reference", [0, 1], ids=["0", "1"])
def test_gps_lost_during_a_mission_lands(height_reference: int) -> None:
    operator = breaking(GPS, OFF, height_reference, realism="field")
    operator.until(lambda: mode_of(operator) is Mode.LAND, 15.0)
    operator.until_disarmed(30.0)
    assert not operator.finished
    assert operator.height_m < 0.5


@pytest.mark.parametrize(
    ("unit", "kind", "height_reference", "bit"),
    [
        (MAG, OFF, 1, mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG),
        (MAG, STUCK, 1, mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG),
        (BARO, OFF, 0, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
        (BARO, OFF, 1, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
        (BARO, STUCK, 0, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
        (BARO, STUCK, 1, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
    ],
    ids=[
        "mag lost",
        "mag stuck",
        "baro lost, baro height",
        "baro lost, GPS height",
        "baro stuck, baro height",
        "baro stuck, GPS height",
    ],
)
def test_mission_goes_on_without_magnetometer_or_barometer(
    unit: int, kind: int, height_reference: int, bit: int
) -> None:
    operator = breaking(unit, kind, height_reference)
    operator.wait(1.0)
    assert not operator.last("SYS_STATUS").onboard_control_sensors_health & bit
    operator.until_disarmed(120.0)
    assert {1, 2} <= {message.seq for message in operator.of("MISSION_ITEM_REACHED")}
    assert from_home_m(operator) < 0.5


def test_failures_are_rejected_while_injection_is_disabled() -> None:
    operator = Operator()
    motor = (mavlink.FAILURE_UNIT_SYSTEM_MOTOR, OFF, 1.0)
    assert operator.command(mavlink.MAV_CMD_INJECT_FAILURE, *motor) == DENIED  # before arming
    operator.take_off(2.5)
    assert operator.command(mavlink.MAV_CMD_INJECT_FAILURE, *motor) == DENIED
    operator.wait(1.0)
    assert operator.vehicle.truth.tilt_rad < 0.02


# --- sticks --------------------------------------------------------------------------------


def pushed(operator: Operator, forward: int = 0, throttle: int = 500) -> Any:
    message = mavlink.MAVLink_manual_control_message(1, forward, 0, throttle, 0, 0)
    return lambda *_: operator.send(message)


@pytest.mark.parametrize("mode", [Mode.POSCTL, Mode.ALTCTL], ids=["POSCTL", "ALTCTL"])
def test_a_pilot_takes_off_flies_forward_and_lands_by_stick(mode: Mode) -> None:
    operator = Operator()
    operator.wait(1.0, pushed(operator))
    assert operator.set_mode(mode) == ACCEPTED
    operator.wait(0.2, pushed(operator))
    assert operator.arm() == ACCEPTED
    operator.wait(1.0, pushed(operator))
    assert operator.height_m < 0.05  # a centred throttle does not take off
    operator.wait(5.0, pushed(operator, throttle=1000))
    assert operator.height_m > 5.0
    operator.wait(10.0, pushed(operator, forward=500))
    operator.until_disarmed(60.0, pushed(operator, throttle=0))
    assert operator.position_ned_m[0] > 5.0
    assert mode_of(operator) is Mode.HOLD


# --- offboard ------------------------------------------------------------------------------

POSITION_AND_YAW = 0x09F8  # position and yaw count, the rest is ignored


def positioned(operator: Operator, place: Vector, yaw_deg: float) -> Any:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        *(0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, POSITION_AND_YAW, *place),
        *(0.0,) * 6,
        *(math.radians(yaw_deg), 0.0),
    )
    return lambda *_: operator.send(message)


def go_offboard(operator: Operator, place: Vector, yaw_deg: float, limit_s: float) -> None:
    stream = positioned(operator, place, yaw_deg)
    stream()
    assert operator.set_mode(Mode.OFFBOARD) == ACCEPTED
    operator.until(lambda: math.dist(operator.position_ned_m, place) < 0.3, limit_s, stream)


def test_offboard_takeoff_and_land() -> None:
    operator = Operator(parameters={"COM_RCL_EXCEPT": 4})
    positioned(operator, (0.0, 0.0, -2.0), 0.0)()
    assert operator.arm() == ACCEPTED
    go_offboard(operator, (0.0, 0.0, -2.0), 0.0, 90.0)
    assert operator.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    operator.until_disarmed(120.0)
    assert from_home_m(operator) < 2.0


def test_offboard_position_control() -> None:
    operator = Operator(parameters={"COM_RCL_EXCEPT": 4})
    assert operator.arm() == ACCEPTED
    for place, yaw_deg in (
        ((0.0, 0.0, -2.0), 0.0),
        ((0.0, 5.0, -2.0), 180.0),
        ((5.0, 5.0, -4.0), 180.0),
        ((5.0, 0.0, -4.0), 90.0),
        ((0.0, 0.0, -2.0), 0.0),
    ):
        go_offboard(operator, place, yaw_deg, 10.0)
    assert operator.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    operator.until_disarmed(120.0)
    assert from_home_m(operator) < 2.0


def tilted(operator: Operator, pitch_deg: float, thrust: float) -> Any:
    quaternion = QuaternionBase([0.0, math.radians(pitch_deg), 0.0])
    message = mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, 0x07, list(quaternion.q), 0.0, 0.0, 0.0, thrust
    )
    return lambda *_: operator.send(message)


def sinking(operator: Operator, speed_mps: float) -> Any:
    """Level, at the thrust that brings the vehicle to a sink rate."""

    def send(*_: float) -> None:
        excess_mps = operator.vehicle.truth.velocity_ned_mps[2] - speed_mps
        tilted(operator, 0.0, min(max(0.5 + 0.05 * excess_mps, 0.3), 0.7))()

    return send


def test_offboard_attitude_control() -> None:
    operator = Operator(realism="field", fast=False)
    tilted(operator, 0.0, 0.0)()
    assert operator.set_mode(Mode.OFFBOARD) == ACCEPTED
    assert operator.arm() == ACCEPTED
    operator.wait(0.5, tilted(operator, 0.0, 0.3))
    assert operator.height_m < 0.05  # too little thrust to lift off
    operator.until(lambda: operator.height_m > 10.0, 20.0, tilted(operator, 0.0, 0.6))
    operator.wait(3.0, tilted(operator, -20.0, 0.53))
    attitude = operator.last("ATTITUDE")
    assert math.degrees(attitude.pitch) == pytest.approx(-20.0, abs=5.0)
    assert math.degrees(attitude.roll) == pytest.approx(0.0, abs=5.0)
    assert operator.vehicle.truth.velocity_ned_mps[0] > 5.0
    operator.wait(2.5, tilted(operator, 20.0, 0.53))
    operator.until(lambda: operator.height_m < 0.1, 60.0, sinking(operator, 1.0))
    operator.until_disarmed(20.0, tilted(operator, 0.0, 0.0))
