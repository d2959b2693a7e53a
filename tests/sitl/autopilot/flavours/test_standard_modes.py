"""AVAILABLE_MODES, CURRENT_MODE, standard modes, and commands that newer firmware dropped."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from sitl.autopilot.flavours.standard_modes import AVAILABLE_MODES_ID, STANDARD_MODES
from sitl.autopilot.modes import Mode
from tests.sitl.mavlink_client import Client, in_air, mode_of, on_ground

FIELD: dict[str, Any] = {"realism": "field"}


def heard(client: Client, duration_s: float = 0.0) -> list[Any]:
    """What a peer with a complete dialect decodes of the next bytes."""
    codec = development.MAVLink(None)
    end_s = client.now_s + duration_s
    found: list[Any] = []
    while True:
        found += codec.parse_buffer(client.vehicle.bytes_to_send(client.link)) or []
        if client.now_s >= end_s:
            return found
        client.vehicle.advance(client.now_s + 0.02)


def send(client: Client, command: int, *parameters: float) -> None:
    padded = (*parameters, *(0.0,) * (7 - len(parameters)))
    message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded)
    client.vehicle.receive(message.pack(mavlink.MAVLink(None, 255, 190)), client.link)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_every_available_mode_is_told_with_its_number_and_standard_mode(flavour: str) -> None:
    client = on_ground(flavour=flavour, **FIELD)
    heard(client)
    send(client, mavlink.MAV_CMD_REQUEST_MESSAGE, AVAILABLE_MODES_ID, 0)
    sent = [each for each in heard(client) if each.get_type() == "AVAILABLE_MODES"]
    modes = client.vehicle.autopilot.flavour.modes
    assert [each.mode_index for each in sent] == list(range(1, len(modes) + 1))
    assert {each.number_modes for each in sent} == {len(modes)}
    for each, mode in zip(sent, modes, strict=True):
        assert each.custom_mode == client.vehicle.autopilot.flavour.custom_mode(mode)
        assert each.standard_mode == STANDARD_MODES.get(mode, 0)
        assert each.mode_name.upper() == mode.name


@pytest.mark.parametrize(("index", "sent", "result"), [(2, 1, 0), (99, 0, 2), (-1, 0, 2)])
def test_one_mode_by_its_index(index: float, sent: int, result: int) -> None:
    client = on_ground(**FIELD)
    heard(client)
    send(client, mavlink.MAV_CMD_REQUEST_MESSAGE, AVAILABLE_MODES_ID, index)
    answers = heard(client)
    assert len([each for each in answers if each.get_type() == "AVAILABLE_MODES"]) == sent
    assert [each.result for each in answers if each.get_type() == "COMMAND_ACK"] == [result]


def test_px4_streams_its_current_mode_as_recorded() -> None:
    """The bytes of a recording of PX4: landing is standard mode 7 with number 0x06040000."""
    client = in_air(**FIELD)
    client.set_mode(Mode.LAND)
    sent = [each for each in heard(client, 4.5) if each.get_type() == "CURRENT_MODE"]
    assert len(sent) == 2
    assert (sent[-1].custom_mode, sent[-1].standard_mode) == (0x06040000, 7)
    assert bytes(sent[-1].get_msgbuf())[10:19].hex() == "000004060000040607"


@pytest.mark.parametrize(
    ("number", "result", "mode"),
    [
        (5, mavlink.MAV_RESULT_ACCEPTED, Mode.RTL),
        (7, mavlink.MAV_RESULT_ACCEPTED, Mode.LAND),
        # Without a radio real PX4 refuses a pilot's mode, and flies on.
        (1, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, Mode.HOLD),
        (3, mavlink.MAV_RESULT_DENIED, Mode.HOLD),
        (0, mavlink.MAV_RESULT_DENIED, Mode.HOLD),
        (math.nan, mavlink.MAV_RESULT_DENIED, Mode.HOLD),
    ],
)
def test_standard_modes_are_set_by_their_number(number: float, result: int, mode: Mode) -> None:
    client = in_air(**FIELD)
    assert client.command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, number) == result
    assert mode_of(client) is mode


@pytest.mark.parametrize(
    "command", [mavlink.MAV_CMD_GET_HOME_POSITION, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES]
)
@pytest.mark.parametrize(
    ("config", "result"),
    [
        (FIELD, mavlink.MAV_RESULT_UNSUPPORTED),
        ({"flavour": "ardupilot", **FIELD}, mavlink.MAV_RESULT_ACCEPTED),
        ({}, mavlink.MAV_RESULT_ACCEPTED),
    ],
)
def test_px4_no_longer_supports_two_old_requests(
    command: int, config: dict[str, Any], result: int
) -> None:
    client = on_ground(**config)
    assert client.command(command, 1) == result
    message_id = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id) == 0
