"""The scripted operator: which command follows which report, for both flavours."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.virtual.scripted_operator import PATIENCE_S, STREAMS, Operator, Step

ALTITUDE_M = 4.0
PX4, COPTER = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
OFFBOARD_CODE = {PX4: 6 << 16, COPTER: 4}
IDLE_CODE = {PX4: 4 << 16 | 3 << 24, COPTER: 0}


class Script:
    """An operator, and a vehicle that reports what a test says."""

    def __init__(self, autopilot: int = PX4) -> None:
        self.operator = Operator(1, ALTITUDE_M)
        self.now_s = 0.0
        self._autopilot = autopilot
        self._vehicle = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._reader = mavlink.MAVLink(None)

    def report(self, *, armed: bool = False, offboard: bool = False, component: int = 1) -> None:
        code = (OFFBOARD_CODE if offboard else IDLE_CODE)[self._autopilot]
        base_mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        message = self._vehicle.heartbeat_encode(2, self._autopilot, base_mode, code, 4)
        sender = mavlink.MAVLink(None, 1, component)
        self.operator.receive(message.pack(sender))

    def report_ready(self) -> None:
        health = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        message = self._vehicle.sys_status_encode(health, health, health, *(0,) * 10)
        self.operator.receive(message.pack(self._vehicle))

    def report_height(self, height_m: float, time_s: float = 0.0) -> None:
        message = self._vehicle.local_position_ned_encode(
            round(time_s * 1e3), 0.0, 0.0, -height_m, 0.0, 0.0, 0.0
        )
        self.operator.receive(message.pack(self._vehicle))

    def after(self, time_s: float) -> list[Any]:
        """Let time pass; return the commands that the operator sends now."""
        self.now_s += time_s
        self.operator.advance(self.now_s)
        messages = self._reader.parse_buffer(self.operator.bytes_to_send()) or []
        return [one for one in messages if one.get_type() == "COMMAND_LONG"]

    def numbers_after(self, time_s: float) -> list[int]:
        return [command.command for command in self.after(time_s)]


def armed_and_airborne(autopilot: int = PX4) -> Script:
    script = Script(autopilot)
    script.report_ready()
    script.report(armed=True)
    script.after(0.1)
    script.report_height(1.0)
    script.after(1.0)
    assert script.operator.step is Step.CLIMB
    return script


def watching() -> Script:
    script = armed_and_airborne()
    for tick in range(60):
        script.report_height(ALTITUDE_M, tick * 0.1)
    script.after(1.0)
    script.report(armed=True, offboard=True)
    script.after(1.0)
    assert script.operator.step is Step.WATCH
    return script


def test_it_asks_for_its_streams_once() -> None:
    script = Script()
    asked = [command.param1 for command in script.after(0.1)]
    assert asked == list(map(float, STREAMS))
    assert script.after(1.0) == []


def test_it_arms_when_the_vehicle_is_ready_and_repeats_until_it_is_armed() -> None:
    script = Script()
    script.after(0.1)
    script.report(armed=False)
    script.report_ready()
    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert script.numbers_after(1.0) == [arm]
    assert script.numbers_after(0.2) == []
    assert script.numbers_after(0.5) == [arm]
    script.report(armed=True)
    assert script.numbers_after(0.1) == [mavlink.MAV_CMD_NAV_TAKEOFF]


def test_a_copter_is_armed_in_guided_and_told_its_height() -> None:
    script = Script(COPTER)
    script.after(0.1)
    script.report()
    script.report_ready()
    (mode,) = script.after(1.0)
    assert (mode.command, mode.param2) == (mavlink.MAV_CMD_DO_SET_MODE, 4.0)
    script.report(offboard=True)
    assert script.numbers_after(1.0) == [mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    script.report(armed=True, offboard=True)
    (take_off,) = script.after(1.0)
    assert take_off.param7 == ALTITUDE_M


def test_it_gives_up_a_vehicle_that_cannot_be_armed() -> None:
    script = Script()
    script.after(PATIENCE_S)
    assert script.operator.gave_up is None
    script.after(0.1)
    assert script.operator.step is Step.DONE
    assert script.operator.gave_up == "the vehicle cannot be armed"


def test_it_lands_a_vehicle_that_does_not_climb() -> None:
    script = armed_and_airborne()
    script.after(PATIENCE_S + ALTITUDE_M / 0.2 + 1.0)
    assert script.operator.step is Step.LAND
    assert script.operator.gave_up == "the vehicle does not climb"


def test_it_hands_over_at_rest_at_the_altitude_and_watches() -> None:
    script = armed_and_airborne()
    for tick in range(60):
        script.report_height(ALTITUDE_M, tick * 0.1)
    commands = script.after(1.0)
    assert script.operator.step is Step.HAND_OVER
    assert mavlink.MAV_CMD_DO_SET_MODE in [command.command for command in commands]
    assert script.operator.gave_up is None


@pytest.mark.parametrize("height_m", [ALTITUDE_M - 1.0, ALTITUDE_M + 1.0])
def test_it_does_not_hand_over_away_from_the_altitude(height_m: float) -> None:
    script = armed_and_airborne()
    for tick in range(60):
        script.report_height(height_m, tick * 0.1)
    script.after(1.0)
    assert script.operator.step is Step.CLIMB


def test_heartbeats_of_other_components_are_ignored() -> None:
    script = Script()
    script.report_ready()
    script.report(armed=True, component=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    script.after(1.0)
    assert script.operator.step is Step.ARM


def test_it_takes_over_hands_back_and_lands() -> None:
    script = watching()
    script.operator.take_over()
    (hold,) = script.after(0.1)
    assert (hold.param2, hold.param3) == (4.0, 3.0)
    script.report(armed=True, offboard=False)
    script.operator.hand_back()
    (offboard,) = script.after(0.1)
    assert offboard.param2 == 6.0
    script.operator.land()
    assert script.numbers_after(0.1) == [mavlink.MAV_CMD_NAV_LAND]
    script.report(armed=False)
    script.after(0.1)
    assert script.operator.step is Step.DONE


def test_orders_that_do_not_fit_the_step_change_nothing() -> None:
    script = Script()
    for order in (script.operator.take_over, script.operator.hand_back, script.operator.land):
        order()
        assert script.operator.step is Step.ARM
