"""Every MAV_CMD is acknowledged, by both firmwares, in both messages, as each one supports it."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.autopilot.packed_message import PackedMessage
from sitl.autopilot.protocol.commands import SUPPORTED
from tests.sitl.conformance.operator import (
    ACCEPTED,
    DENIED,
    FAILED,
    GROUND_STATION,
    REJECTED,
    UNSUPPORTED,
    Operator,
    waypoint,
)
from tests.sitl.conformance.pages import table_of
from tests.sitl.mavlink_client import NAN, mode_of

FLAVOURS = ("px4", "ardupilot")
EVERY_COMMAND = sorted(set(mavlink.enums["MAV_CMD"]) | {65_000})
LEGACY = {
    mavlink.MAV_CMD_GET_HOME_POSITION,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION,
}


def long(number: int, *parameters: float, system: int = 1, component: int = 1) -> Any:
    padded = (*parameters, *(0.0,) * (7 - len(parameters)))
    return mavlink.MAVLink_command_long_message(system, component, number, 0, *padded)


def integer(number: int, *_: float) -> Any:
    return mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, *(0.0,) * 4, 0, 0, 0.0)


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("message_of", [long, integer])
def test_every_command_is_acknowledged_to_its_sender(flavour: str, message_of: Any) -> None:
    operator = Operator(flavour=flavour, realism="field")
    unsupported = set()
    for number in EVERY_COMMAND:
        operator.received.clear()
        operator.send(message_of(number))
        (ack,) = operator.of("COMMAND_ACK")
        assert ack.command == number
        assert (ack.target_system, ack.target_component) == GROUND_STATION
        if ack.result == UNSUPPORTED:
            unsupported.add(number)
    without = LEGACY if flavour == "px4" else {mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION}
    # A request for message 0 is one for HEARTBEAT, hence none of the others is missing.
    assert set(EVERY_COMMAND) - unsupported == set(SUPPORTED) - without


def test_the_page_lists_the_supported_commands() -> None:
    names = {mavlink.enums["MAV_CMD"][number].name for number in SUPPORTED}
    listed = {f"MAV_CMD_{row[0].strip('`')}" for row in table_of("Commands")}
    assert listed == names


def test_a_repeated_command_is_acknowledged_again() -> None:
    operator = Operator()
    for confirmation in range(3):
        message = long(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
        message.confirmation = confirmation
        operator.send(message)
    assert [ack.result for ack in operator.of("COMMAND_ACK")] == [ACCEPTED] * 3


@pytest.mark.parametrize(
    ("system", "component", "answered"),
    [(1, 1, True), (0, 0, True), (1, 0, True), (2, 1, False), (1, 154, False)],
)
def test_only_commands_for_this_autopilot_are_answered(
    system: int, component: int, answered: bool
) -> None:
    operator = Operator()
    home = mavlink.MAVLINK_MSG_ID_HOME_POSITION
    command = mavlink.MAV_CMD_REQUEST_MESSAGE
    operator.send(long(command, home, system=system, component=component))
    assert bool(operator.of("COMMAND_ACK")) is answered


@pytest.mark.parametrize(
    ("flavour", "number", "parameters", "result"),
    [
        ("px4", mavlink.MAV_CMD_MISSION_START, (), DENIED),  # there is no mission
        ("ardupilot", mavlink.MAV_CMD_MISSION_START, (), DENIED),
        ("px4", mavlink.MAV_CMD_DO_REPOSITION, (-1.0, 0.0, 0.0, NAN, NAN, NAN, NAN), REJECTED),
        ("ardupilot", mavlink.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, 5.0), FAILED),  # disarmed
        ("px4", mavlink.MAV_CMD_INJECT_FAILURE, (4.0, 1.0), DENIED),  # switched off
        ("px4", mavlink.MAV_CMD_DO_SET_MODE, (1.0, 6.0), ACCEPTED),  # offboard, on the ground
        ("px4", mavlink.MAV_CMD_DO_SET_MODE, (1.0, 3.0), REJECTED),  # position control, no sticks
        ("px4", mavlink.MAV_CMD_RUN_PREARM_CHECKS, (), ACCEPTED),
        ("px4", mavlink.MAV_CMD_DO_SET_HOME, (0.0, 0, 0, 0, NAN, NAN, NAN), DENIED),
        ("px4", mavlink.MAV_CMD_DO_SET_HOME, (1.0,), ACCEPTED),
    ],
)
def test_a_standing_vehicle_refuses_what_it_cannot_do(
    flavour: str, number: int, parameters: tuple[float, ...], result: int
) -> None:
    assert Operator(flavour=flavour).command(number, *parameters) == result


@pytest.mark.parametrize(
    ("number", "parameters"),
    [
        (mavlink.MAV_CMD_NAV_TAKEOFF, (NAN,) * 7),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,)),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 6.0)),  # offboard, without a stream
        (mavlink.MAV_CMD_RUN_PREARM_CHECKS, ()),
    ],
)
def test_a_flying_vehicle_refuses_what_it_cannot_do(
    number: int, parameters: tuple[float, ...]
) -> None:
    operator = Operator()
    operator.take_off(3.0)
    assert operator.command(number, *parameters) == REJECTED
    operator.wait(1.0)
    assert operator.height_m > 2.5
    assert mode_of(operator) is Mode.HOLD


def test_what_keeps_the_vehicle_from_arming_is_said_on_request() -> None:
    operator = Operator(parameters={"SYS_FAILURE_EN": 1})
    gyro = mavlink.FAILURE_UNIT_SENSOR_GYRO
    operator.command(mavlink.MAV_CMD_INJECT_FAILURE, gyro, mavlink.FAILURE_TYPE_OFF)
    operator.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS)
    operator.wait(0.1)
    assert "Preflight: sensor failure" in operator.texts()
    assert operator.arm() == REJECTED


def test_an_arm_command_in_progress_is_superseded_by_its_repetition() -> None:
    """PX4 answers when the authorizer has: once for each command, whichever came first."""
    asks = {"COM_ARM_AUTH_REQ": 1, "COM_ARM_AUTH_ID": 77}
    operator = Operator(parameters=asks)
    arm = long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    operator.send(arm)
    assert operator.of("COMMAND_ACK") == []
    operator.send(arm)
    assert [ack.result for ack in operator.of("COMMAND_ACK")] == [REJECTED]
    operator.wait(1.0)
    assert [ack.result for ack in operator.of("COMMAND_ACK")] == [REJECTED] * 2


class CommandCancel(PackedMessage):
    """COMMAND_CANCEL, which neither firmware implements, nor pymavlink's dialect."""

    layout = struct.Struct("<HBB")


def test_command_cancel_is_dropped_and_stops_nothing() -> None:
    operator = Operator()
    operator.take_off(3.0)
    target = waypoint(30.0, 0.0, 3.0)
    operator.fly_mission([target])
    operator.wait(2.0)
    operator.received.clear()
    dropped = operator.vehicle.autopilot.bytes_dropped(0)
    operator.send(CommandCancel(80, "COMMAND_CANCEL", 14, mavlink.MAV_CMD_MISSION_START, 1, 1))
    assert operator.of("COMMAND_ACK") == []
    assert operator.vehicle.autopilot.bytes_dropped(0) > dropped
    operator.until(lambda: operator.finished, 30.0)
