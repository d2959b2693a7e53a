"""What the service sends to an autopilot: setpoints, heartbeats, requests and texts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.contract.assessment import TICK_S
from onboard.mavlink.status_text import CHUNK_BYTES, TEXT_BYTES_MAX, chunks
from onboard.mavlink.transmitter import COMPONENT_ID, Transmitter
from onboard.vehicle_state import Setpoint
from tests.status_texts import status_texts

CONTROL = dict.fromkeys((*range(0x20), *range(0x7F, 0xA0)), " ")


class Receiver:
    """The other end: decodes what the service sends."""

    def __init__(self) -> None:
        self._mavlink = mavlink.MAVLink(None, 1, 1)

    def heard(self, data: bytes) -> Iterator[Any]:
        yield from self._mavlink.parse_buffer(data) or []


@pytest.fixture
def transmitter() -> Transmitter:
    return Transmitter(system_id=1)


@pytest.fixture
def receiver() -> Receiver:
    return Receiver()


def test_setpoint_carries_everything(transmitter: Transmitter, receiver: Receiver) -> None:
    setpoint = Setpoint((1.0, 2.0, -4.0), (2.5, 0.5, 0.0), (0.25, -0.5, 0.125), 0.75)
    transmitter.send_setpoint(setpoint, now_s=1.5)
    (message,) = receiver.heard(transmitter.bytes_to_send())
    assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, COMPONENT_ID)
    assert (message.target_system, message.target_component) == (1, 1)
    assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    assert message.type_mask == mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    assert (message.x, message.y, message.z) == setpoint.position_ned_m
    assert (message.vx, message.vy, message.vz) == setpoint.velocity_ned_mps
    assert (message.afx, message.afy, message.afz) == setpoint.acceleration_ned_mps2
    assert message.yaw == 0.75
    assert message.time_boot_ms == 1500
    assert transmitter.bytes_to_send() == b""


def test_heartbeat_goes_out_once_a_second(transmitter: Transmitter, receiver: Receiver) -> None:
    beats = []
    for tick in range(150):
        transmitter.keep_alive(tick * 0.02, active=True)
        beats += list(receiver.heard(transmitter.bytes_to_send()))
    assert [beat.get_type() for beat in beats] == ["HEARTBEAT"] * 3
    assert beats[0].type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER


def texts_heard(transmitter: Transmitter, receiver: Receiver, seconds: float) -> list[Any]:
    messages: list[Any] = []
    for tick in range(round(seconds / TICK_S)):
        transmitter.keep_alive(tick * TICK_S, active=True)
        messages += receiver.heard(transmitter.bytes_to_send())
    return [message for message in messages if message.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "short",
        "x" * 50,
        "x" * 51,
        "x" * 99,
        "x" * 100,
        "x" * 101,
        "x" * 249,
        "Clearway: tracking error 0.40 > 0.25 m with 3.2 m/s², obstacle front/7: braking to hover",
        "é" * 25,
        "é" * 60,
    ],
)
def test_a_long_text_is_sent_in_chunks(
    transmitter: Transmitter, receiver: Receiver, text: str
) -> None:
    transmitter.send_text(mavlink.MAV_SEVERITY_ERROR, text)
    heard = texts_heard(transmitter, receiver, 1.0)
    assert status_texts(heard) == [text]
    assert {message.severity for message in heard} == {mavlink.MAV_SEVERITY_ERROR}
    assert [message.chunk_seq for message in heard] == list(range(len(heard)))
    if len(text.encode()) <= 50:
        assert [message.id for message in heard] == [0]
    else:
        (text_id,) = {message.id for message in heard}
        assert text_id > 0
        # The first NUL ends a text: every chunk but the last is full, and the last is not.
        *full, last = (bytes(message._text_raw).rstrip(b"\0") for message in heard)
        assert {len(part) for part in full} == {50}
        assert len(last) < 50


def test_texts_do_not_mix_and_leave_room_for_setpoints(
    transmitter: Transmitter, receiver: Receiver
) -> None:
    texts = [f"{number}: " + "x" * 120 for number in range(20)]
    for text in texts:
        transmitter.send_text(mavlink.MAV_SEVERITY_WARNING, text)
    heard = texts_heard(transmitter, receiver, 1.0)
    assert 10 <= len(heard) <= 11
    transmitter._text_due_s = 0.0
    heard += texts_heard(transmitter, receiver, 6.0)
    assert status_texts(heard) == texts
    assert len({message.id for message in heard}) == len(texts)


def test_a_character_that_would_straddle_two_chunks_is_moved() -> None:
    assert chunks("x" * 49 + "² end") == [b"x" * 49 + b" ", "² end".encode()]


def test_a_text_id_is_never_zero(transmitter: Transmitter, receiver: Receiver) -> None:
    transmitter._text_id = 0xFFFE
    for _ in range(3):
        transmitter.send_text(mavlink.MAV_SEVERITY_WARNING, "x" * 60)
    ids = [message.id for message in texts_heard(transmitter, receiver, 1.0)]
    assert ids == [0xFFFF, 0xFFFF, 1, 1, 2, 2]


@given(st.text(max_size=300))
def test_chunks_decode_one_by_one_and_lose_nothing_but_the_end(text: str) -> None:
    parts = chunks(text)
    assert all(len(part) == CHUNK_BYTES for part in parts[:-1])
    assert len(parts) <= 5
    assert len(parts) == 1 or len(parts[-1]) < CHUNK_BYTES
    joined = "".join(part.decode() for part in parts)  # each is UTF-8 by itself
    assert joined.isprintable() or not text.isprintable()
    assert "\0" not in joined
    squeezed, expected = "".join(joined.split()), "".join(text.translate(CONTROL).split())
    if joined.endswith("...") and len(joined.encode()) >= TEXT_BYTES_MAX - 4:
        assert expected.startswith(squeezed.removesuffix("...")) or squeezed == expected
    else:
        assert squeezed == expected


@pytest.mark.parametrize("active", [True, False])
def test_the_heartbeat_states_whether_the_service_flies(
    transmitter: Transmitter, receiver: Receiver, *, active: bool
) -> None:
    transmitter.keep_alive(0.0, active=active)
    (beat,) = receiver.heard(transmitter.bytes_to_send())
    expected = mavlink.MAV_STATE_ACTIVE if active else mavlink.MAV_STATE_STANDBY
    assert beat.system_status == expected
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_INVALID


def test_each_request_is_an_interval_in_microseconds(
    transmitter: Transmitter, receiver: Receiver
) -> None:
    transmitter.request([(32, 50.0), (245, 5.0)])
    found = [
        (m.get_type(), m.command, m.target_system, m.target_component, m.param1, m.param2)
        for m in receiver.heard(transmitter.bytes_to_send())
    ]
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert found == [
        ("COMMAND_LONG", interval, 1, 1, 32.0, 20_000.0),
        ("COMMAND_LONG", interval, 1, 1, 245.0, 200_000.0),
    ]


def test_the_time_of_a_setpoint_wraps_after_49_days(
    transmitter: Transmitter, receiver: Receiver
) -> None:
    setpoint = Setpoint((0.0, 0.0, -4.0), (0.0,) * 3, (0.0,) * 3, 0.0)
    transmitter.send_setpoint(setpoint, 2**32 / 1e3 + 0.25)
    (message,) = receiver.heard(transmitter.bytes_to_send())
    assert message.time_boot_ms == 250


def test_a_link_that_takes_nothing_drops_the_oldest(
    transmitter: Transmitter, receiver: Receiver
) -> None:
    setpoint = Setpoint((0.0, 0.0, -4.0), (0.0,) * 3, (0.0,) * 3, 0.0)
    for number in range(1200):
        transmitter.send_setpoint(setpoint, float(number))
    times_ms = [m.time_boot_ms for m in receiver.heard(transmitter.bytes_to_send())]
    assert times_ms == [1000 * number for number in range(200, 1200)]


def test_old_texts_give_way_to_new_ones(transmitter: Transmitter, receiver: Receiver) -> None:
    for number in range(150):
        transmitter.send_text(mavlink.MAV_SEVERITY_WARNING, f"{number}")
    heard = texts_heard(transmitter, receiver, 15.0)
    assert status_texts(heard) == [f"{number}" for number in range(50, 150)]
