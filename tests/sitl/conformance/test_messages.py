"""Streams, requests and small services: what comes unasked, at which rate, and on request."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.standard_modes import (
    AVAILABLE_MODES_ID,
    AVAILABLE_MODES_MONITOR_ID,
    CURRENT_MODE_ID,
)
from sitl.autopilot.modes import Mode
from sitl.autopilot.protocol.identity_messages import COMPONENT_METADATA_ID, PROTOCOL_VERSION_ID
from sitl.autopilot.protocol.telemetry import BUILDERS
from tests.sitl.conformance.operator import (
    ACCEPTED,
    DENIED,
    FAILED,
    GROUND_STATION,
    REJECTED,
    UNSUPPORTED,
    Operator,
    message_id,
    number_of,
    payload_of,
)
from tests.sitl.mavlink_client import mode_of

FLAVOURS = ("px4", "ardupilot")
EVERY_MESSAGE = sorted({*mavlink.mavlink_map, *BUILDERS, 395, 396, 60_000} - {0})
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
# A standing vehicle has no target, and does not report one.
NOTHING_FLOWN = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
INTERVAL = mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL


def heard_in(operator: Operator, duration_s: float) -> Counter[int]:
    """Return how often each message comes."""
    operator.received.clear()
    operator.wait(duration_s)
    return Counter(number_of(message) for message in operator.received)


def interval_us(operator: Operator, number: int) -> tuple[int, int]:
    """Ask for an interval; return the result and the interval."""
    operator.received.clear()
    result = operator.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, number)
    return result, int(operator.last("MESSAGE_INTERVAL").interval_us)


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("realism", ["ideal", "field"])
def test_what_comes_unasked_comes_at_the_rate_that_is_reported(flavour: str, realism: str) -> None:
    operator = Operator(fast=False, flavour=flavour, realism=realism)
    heard = heard_in(operator, 10.0)
    rates_hz = {
        **operator.vehicle.autopilot.flavour.default_rates_hz,
        **operator.vehicle.autopilot.realism.rates_hz,
    }
    assert set(heard) <= set(rates_hz)
    if flavour == "ardupilot":
        assert set(heard) == {mavlink.MAVLINK_MSG_ID_HEARTBEAT}
    for number, rate_hz in rates_hz.items():
        flown = number != NOTHING_FLOWN
        sent_hz = min(rate_hz, 50.0) if flown else 0.0  # it decides fifty times a second here
        assert heard[number] == pytest.approx(10.0 * sent_hz, abs=1.0), number
        assert interval_us(operator, number) == (ACCEPTED, round(1e6 / rate_hz))


def test_the_heartbeat_comes_from_the_autopilot_once_a_second() -> None:
    operator = Operator()
    operator.received.clear()
    operator.wait(5.0)
    beats = operator.of("HEARTBEAT")
    assert len(beats) == 5
    assert {(beat.get_srcSystem(), beat.get_srcComponent()) for beat in beats} == {(1, 1)}
    assert {beat.type for beat in beats} == {mavlink.MAV_TYPE_QUADROTOR}
    assert {beat.mavlink_version for beat in beats} == {3}


@pytest.mark.parametrize(("flavour", "unknown"), [("px4", ACCEPTED), ("ardupilot", FAILED)])
def test_every_message_has_an_interval_or_is_said_not_to_be_sent(
    flavour: str, unknown: int
) -> None:
    operator = Operator(flavour=flavour)
    for number in EVERY_MESSAGE:
        result, reported_us = interval_us(operator, number)
        if number in BUILDERS:
            assert (result, reported_us != 0) == (ACCEPTED, True), number
        else:
            assert (result, reported_us) == (unknown, 0), number


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_message_that_exists_streams_at_the_rate_asked_for(flavour: str) -> None:
    operator = Operator(fast=False, flavour=flavour)
    for number in (mavlink.MAVLINK_MSG_ID_HEARTBEAT, *EVERY_MESSAGE):
        known = ACCEPTED if number in BUILDERS else DENIED
        result = operator.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 500_000.0)
        assert result == known, number
    heard = heard_in(operator, 5.0)
    assert set(heard) == set(BUILDERS) - {NOTHING_FLOWN}
    assert all(count == pytest.approx(10, abs=1) for count in heard.values()), heard


def test_an_interval_is_reset_stopped_and_requested_as_a_message() -> None:
    operator = Operator(fast=False)
    for asked_us, reported_us in ((40_000.0, 40_000), (-1.0, -1), (0.0, 20_000)):
        operator.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE, asked_us)
        operator.received.clear()
        assert operator.request(INTERVAL, ATTITUDE) == ACCEPTED
        assert operator.last("MESSAGE_INTERVAL").message_id == ATTITUDE
        assert operator.last("MESSAGE_INTERVAL").interval_us == reported_us


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_request_for_a_message_is_answered(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    on_request = {AVAILABLE_MODES_ID, INTERVAL}
    if flavour == "px4":
        on_request |= {COMPONENT_METADATA_ID, PROTOCOL_VERSION_ID}
    for number in {*EVERY_MESSAGE, *on_request, COMPONENT_METADATA_ID, PROTOCOL_VERSION_ID}:
        operator.received.clear()
        result = operator.request(number)
        sent = [one for one in operator.received if number_of(one) == number]
        if result == REJECTED:
            assert number == NOTHING_FLOWN
        elif number in BUILDERS or number in on_request:
            assert (result, bool(sent)) == (ACCEPTED, True), number
        elif number != mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            assert (result, sent) == (UNSUPPORTED, []), number


# --- standard modes ------------------------------------------------------------------------


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_modes_are_told_on_request_only_each_once(flavour: str) -> None:
    operator = Operator(flavour=flavour, realism="field")
    assert AVAILABLE_MODES_ID not in heard_in(operator, 5.0)
    assert AVAILABLE_MODES_MONITOR_ID not in heard_in(operator, 5.0)
    operator.received.clear()
    assert operator.request(AVAILABLE_MODES_ID) == ACCEPTED
    modes = [one for one in operator.received if number_of(one) == AVAILABLE_MODES_ID]
    indices = [bytes(one.get_msgbuf())[10 + 9] for one in modes]
    counts = {bytes(one.get_msgbuf())[10 + 8] for one in modes}
    assert indices == list(range(1, len(modes) + 1))
    assert counts == {len(modes)}
    assert operator.request(AVAILABLE_MODES_ID, len(modes) + 1) == DENIED
    assert operator.request(AVAILABLE_MODES_MONITOR_ID) == ACCEPTED


def test_the_current_mode_follows_a_standard_mode_that_was_set() -> None:
    operator = Operator()
    operator.take_off(3.0)
    standard = mavlink.MAV_CMD_DO_SET_STANDARD_MODE
    assert operator.command(standard, 5.0) == ACCEPTED  # return
    assert mode_of(operator) is Mode.RTL
    operator.received.clear()
    assert operator.request(CURRENT_MODE_ID) == ACCEPTED
    assert payload_of(operator, CURRENT_MODE_ID)[8] == 5
    assert operator.command(standard, 200.0) == DENIED


# --- identity and small services -----------------------------------------------------------


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_version_announces_what_works(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    assert operator.request("AUTOPILOT_VERSION") == ACCEPTED
    version = operator.last("AUTOPILOT_VERSION")
    for name in ("MAVLINK2", "COMMAND_INT", "MISSION_INT", "MISSION_FENCE", "MISSION_RALLY", "FTP"):
        bit = getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{name}")
        assert version.capabilities & bit, name
    assert version.flight_sw_version >> 24 == (1 if flavour == "px4" else 4)


def test_the_protocol_version_is_that_of_mavlink_2() -> None:
    operator = Operator()
    assert operator.request(PROTOCOL_VERSION_ID) == ACCEPTED
    payload = payload_of(operator, PROTOCOL_VERSION_ID)
    assert int.from_bytes(payload[:2], "little") == 200
    assert operator.command(mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION) == ACCEPTED


def test_a_ping_to_all_is_answered_and_an_answer_is_not() -> None:
    operator = Operator()
    operator.send(mavlink.MAVLink_ping_message(123_456, 7, 0, 0))
    answer = operator.last("PING")
    assert (answer.time_usec, answer.seq) == (123_456, 7)
    assert (answer.target_system, answer.target_component) == GROUND_STATION
    operator.received.clear()
    operator.send(mavlink.MAVLink_ping_message(123_456, 7, 1, 1))
    assert operator.of("PING") == []


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_clocks_are_compared_and_answers_are_not_answered(flavour: str) -> None:
    operator = Operator(flavour=flavour, realism="field")
    operator.send(mavlink.MAVLink_timesync_message(0, 42))
    answer: Any = operator.last("TIMESYNC")
    assert answer.ts1 == 42
    assert answer.tc1 == pytest.approx(operator.now_s * 1e9, abs=1e6)
    operator.received.clear()
    operator.send(mavlink.MAVLink_timesync_message(5, 42))
    assert operator.of("TIMESYNC") == []


def test_a_long_text_comes_in_chunks_that_belong_together() -> None:
    operator = Operator()
    said = "Preflight: " + "x" * 100
    for severity in (mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_WARNING):
        operator.vehicle.autopilot.commander.say(severity, said)
    operator.vehicle.autopilot.commander.say(mavlink.MAV_SEVERITY_INFO, "short")
    operator.wait(0.1)
    *chunks, short = operator.of("STATUSTEXT")
    first, second = chunks[:3], chunks[3:]
    for part in (first, second):
        assert "".join(chunk.text for chunk in part) == said
        assert [chunk.chunk_seq for chunk in part] == [0, 1, 2]
        assert len({chunk.id for chunk in part}) == 1
    assert first[0].id not in {0, second[0].id}
    assert (short.text, short.id) == ("short", 0)


def test_px4_talks_only_where_a_ground_station_listens() -> None:
    operator = Operator()
    operator.vehicle.autopilot.open_link(5)
    operator.vehicle.autopilot.commander.say(mavlink.MAV_SEVERITY_INFO, "to the ground")
    operator.wait(0.1)
    assert operator.texts() == ["to the ground"]
    assert b"to the ground" not in operator.vehicle.bytes_to_send(5)


def test_the_home_that_was_set_is_reported() -> None:
    operator = Operator()
    latitude, longitude = operator.place(30.0, 40.0)
    operator.send(
        mavlink.MAVLink_command_int_message(
            *(1, 1, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_SET_HOME, 0, 0),
            *(0.0, 0.0, 0.0, 0.0, latitude, longitude, operator.home.altitude_m - 5.0),
        )
    )
    assert operator.last("COMMAND_ACK").result == ACCEPTED
    assert operator.request("HOME_POSITION") == ACCEPTED
    home = operator.last("HOME_POSITION")
    assert math.dist((home.latitude, home.longitude), (latitude, longitude)) < 30
    assert home.altitude == pytest.approx((operator.home.altitude_m - 5.0) * 1e3, abs=20)
    assert message_id("HOME_POSITION") == 242
