"""PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET, in both encodings of integers."""

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore
from sitl.autopilot.protocol.parameter_protocol import TYPE_MISMATCH, ParameterProtocol

SPECS = (
    ParameterSpec("ALFA", 3, 0, 10, "an integer"),
    ParameterSpec("BRAVO", 1.5, 0.0, 2.0, "a float"),
    ParameterSpec("CHARLIE", 7, 7, 7, "read-only", read_only=True),
)


def received(message: Any) -> Any:
    """Return a message as the vehicle receives it, from system 255."""
    sender = mavlink.MAVLink(None, 255, 190)
    (decoded,) = mavlink.MAVLink(None).parse_buffer(message.pack(sender))
    return decoded


def answers(message: Any, *, bytewise: bool = True) -> tuple[ParameterStore, list[Any]]:
    store = ParameterStore(SPECS, {})
    return store, ParameterProtocol(store, bytewise=bytewise).receive(received(message))


def param_set(name: str, value: float, kind: int = mavlink.MAV_PARAM_TYPE_REAL32) -> Any:
    return mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind)


def read(name: str = "", index: int = -1) -> Any:
    return mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), index)


def test_the_list_has_every_parameter_in_order() -> None:
    _, listed = answers(mavlink.MAVLink_param_request_list_message(1, 1), bytewise=False)
    assert [message.param_id for message in listed] == ["ALFA", "BRAVO", "CHARLIE"]
    assert [message.param_index for message in listed] == [0, 1, 2]
    assert {message.param_count for message in listed} == {3}


@pytest.mark.parametrize(("bytewise", "on_the_wire"), [(True, b"\x03\0\0\0"), (False, None)])
def test_integers_travel_bytewise_or_as_floats(bytewise: bool, on_the_wire: bytes | None) -> None:
    _, (message,) = answers(read("ALFA"), bytewise=bytewise)
    packed = struct.pack("<f", message.param_value)
    assert packed == (on_the_wire or struct.pack("<f", 3.0))
    assert message.param_type == mavlink.MAV_PARAM_TYPE_INT32


@pytest.mark.parametrize("message", [read("BRAVO"), read(index=1), read("ALFA", 1)])
def test_a_parameter_is_read_by_name_or_by_index(message: Any) -> None:
    _, (value,) = answers(message)
    assert (value.param_id, value.param_value) == ("BRAVO", 1.5)


@pytest.mark.parametrize("message", [read("DELTA"), read(index=3), read(index=32767)])
def test_reading_what_does_not_exist_is_an_error(message: Any) -> None:
    _, (error,) = answers(message)
    assert error.get_type() == "PARAM_ERROR"
    assert error.error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
    assert (error.target_system, error.target_component) == (255, 190)


def test_setting_answers_with_the_new_value() -> None:
    store, (value,) = answers(param_set("BRAVO", 0.5))
    assert store["BRAVO"] == value.param_value == 0.5


def test_an_integer_is_set_bytewise_or_as_a_float() -> None:
    encoded = struct.unpack("<f", struct.pack("<i", 5))[0]
    store, _ = answers(param_set("ALFA", encoded, mavlink.MAV_PARAM_TYPE_INT32))
    assert store["ALFA"] == 5
    store, _ = answers(param_set("ALFA", 6.0, mavlink.MAV_PARAM_TYPE_INT32), bytewise=False)
    assert store["ALFA"] == 6
    store, _ = answers(param_set("ALFA", 7.0), bytewise=False)  # ArduPilot ignores the type
    assert store["ALFA"] == 7


def bits(value: Any) -> bytes:
    return struct.pack("<f", value.param_value)


def test_px4_lists_a_hash_first_which_changes_with_any_value() -> None:
    store = ParameterStore(SPECS, {})
    protocol = ParameterProtocol(store, bytewise=True)
    first, *listed = protocol.receive(received(mavlink.MAVLink_param_request_list_message(1, 1)))
    assert (first.param_id, first.param_index, first.param_count) == ("_HASH_CHECK", 65_535, 3)
    assert first.param_type == mavlink.MAV_PARAM_TYPE_UINT32
    assert len(listed) == 3
    (again,) = protocol.receive(received(read("_HASH_CHECK")))
    assert bits(again) == bits(first)
    store.set("BRAVO", 1.0)
    (changed,) = protocol.receive(received(read("_HASH_CHECK")))
    assert bits(changed) != bits(first)


def test_ardupilot_has_no_hash() -> None:
    _, (error,) = answers(read("_HASH_CHECK"), bytewise=False)
    assert error.error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (param_set("DELTA", 1.0), mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST),
        (param_set("BRAVO", 3.0), mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        (param_set("BRAVO", math.nan), mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        (param_set("ALFA", 2.0), TYPE_MISMATCH),
        (param_set("BRAVO", 1.0, mavlink.MAV_PARAM_TYPE_INT32), TYPE_MISMATCH),
        (param_set("CHARLIE", 7.0), mavlink.MAV_PARAM_ERROR_READ_ONLY),
    ],
)
def test_a_value_that_cannot_be_set_is_refused_and_changes_nothing(
    message: Any, error: int
) -> None:
    store, (refusal,) = answers(message)
    assert refusal.error == error
    assert [store[name] for name in store.names()] == [3, 1.5, 7]
