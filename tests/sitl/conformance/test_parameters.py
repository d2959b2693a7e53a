"""The parameter protocol over the wire, in the encoding that each firmware announces."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.parameter_protocol import TYPE_MISMATCH
from tests.sitl.conformance.operator import Operator

FLAVOURS = ("px4", "ardupilot")
FLOAT = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}
INTEGER = {"px4": "NAV_DLL_ACT", "ardupilot": "FS_GCS_ENABLE"}
READ_ONLY = {"px4": "MAV_SYS_ID", "ardupilot": "SYSID_THISMAV"}
INT32, REAL32 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32
HASH = "_HASH_CHECK"


def listed(operator: Operator) -> list[Any]:
    operator.received.clear()
    operator.send(mavlink.MAVLink_param_request_list_message(1, 1))
    return [value for value in operator.of("PARAM_VALUE") if value.param_id != HASH]


def read(operator: Operator, name: str = "", index: int = -1) -> Any:
    operator.received.clear()
    operator.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), index))
    (answer,) = [*operator.of("PARAM_VALUE"), *operator.of("PARAM_ERROR")]
    return answer


def write(operator: Operator, name: str, value: float, kind: int) -> Any:
    operator.received.clear()
    operator.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    (answer,) = [*operator.of("PARAM_VALUE"), *operator.of("PARAM_ERROR")]
    return answer


def encoded(operator: Operator, number: int) -> float:
    """Return an integer as the vehicle's capabilities say that it travels."""
    operator.request("AUTOPILOT_VERSION")
    capabilities = operator.last("AUTOPILOT_VERSION").capabilities
    if capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE:
        return float(struct.unpack("<f", struct.pack("<i", number))[0])
    assert capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    return float(number)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_list_is_complete_and_agrees_with_every_index_and_name(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    values = listed(operator)
    assert [value.param_index for value in values] == list(range(values[0].param_count))
    assert len({value.param_id for value in values}) == len(values)
    for value in values:
        for again in (read(operator, index=value.param_index), read(operator, value.param_id)):
            assert again.to_dict() == value.to_dict()


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_value_is_set_acknowledged_to_every_link_and_kept(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    operator.vehicle.autopilot.open_link(5)
    assert write(operator, FLOAT[flavour], 0.5, REAL32).param_value == 0.5
    assert read(operator, FLOAT[flavour]).param_value == 0.5
    assert FLOAT[flavour].encode() in operator.vehicle.bytes_to_send(5)
    number = encoded(operator, 1)
    assert write(operator, INTEGER[flavour], number, INT32).param_value == number
    assert read(operator, INTEGER[flavour]).param_type == INT32


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_what_cannot_be_read_or_set_is_an_error(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    unknown = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
    assert read(operator, "NO_SUCH_PARAM").error == unknown
    assert read(operator, index=9999).error == unknown
    assert write(operator, "NO_SUCH_PARAM", 1.0, REAL32).error == unknown
    outside = write(operator, FLOAT[flavour], -5.0, REAL32)
    assert outside.error == mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    protected = write(operator, READ_ONLY[flavour], encoded(operator, 9), INT32)
    assert protected.error == mavlink.MAV_PARAM_ERROR_READ_ONLY


def test_px4_refuses_a_value_of_another_type_and_ardupilot_converts_it() -> None:
    px4 = Operator()
    assert write(px4, INTEGER["px4"], 1.0, REAL32).error == TYPE_MISMATCH
    assert write(px4, FLOAT["px4"], encoded(px4, 1), INT32).error == TYPE_MISMATCH
    copter = Operator(flavour="ardupilot")
    assert write(copter, INTEGER["ardupilot"], 1.0, REAL32).param_value == 1.0
    assert write(copter, FLOAT["ardupilot"], 1.0, INT32).param_value == 1.0


def test_the_hash_tells_a_client_whether_its_copy_is_current() -> None:
    operator = Operator()
    before = struct.pack("<f", read(operator, HASH).param_value)
    assert struct.pack("<f", read(operator, HASH).param_value) == before
    write(operator, "COM_OF_LOSS_T", 0.7, REAL32)
    assert struct.pack("<f", read(operator, HASH).param_value) != before
    write(operator, "COM_OF_LOSS_T", 1.0, REAL32)
    assert struct.pack("<f", read(operator, HASH).param_value) == before


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_extended_parameters_are_those_of_cameras_not_answered_here(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    operator.received.clear()
    operator.send(mavlink.MAVLink_param_ext_request_list_message(1, 1))
    assert operator.received == []
