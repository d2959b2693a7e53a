"""Missions, fences, rally points and files over the wire, with both firmwares."""

from __future__ import annotations

import json
import lzma
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.files.file_transfer import FileError, Header, Operation, crc32, packed
from sitl.autopilot.protocol.identity_messages import COMPONENT_METADATA_ID
from tests.sitl.conformance.operator import (
    ACCEPTED,
    GROUND_STATION,
    RETURN,
    UNSUPPORTED,
    Item,
    Operator,
    payload_of,
    waypoint,
)

FLAVOURS = ("px4", "ardupilot")
MISSION, FENCE = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE
RALLY, ALL = mavlink.MAV_MISSION_TYPE_RALLY, mavlink.MAV_MISSION_TYPE_ALL
CORNER = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
LISTS = {
    MISSION: [waypoint(0.0, 0.0, 5.0), waypoint(10.0, 0.0, 5.0), RETURN],
    FENCE: [
        Item(CORNER, north, east, 0.0, (4.0, 0.0, 0.0, 0.0))
        for north, east in ((-50.0, -50.0), (-50.0, 50.0), (50.0, 50.0), (50.0, -50.0))
    ],
    RALLY: [Item(mavlink.MAV_CMD_NAV_RALLY_POINT, 5.0, 5.0, 10.0)],
}


def count_of(operator: Operator, mission_type: int) -> int:
    operator.received.clear()
    operator.send(mavlink.MAVLink_mission_request_list_message(1, 1, mission_type))
    return int(operator.last("MISSION_COUNT").count)


def download(operator: Operator, mission_type: int) -> list[Any]:
    count = count_of(operator, mission_type)
    for number in range(count):
        operator.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, mission_type))
    operator.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, mission_type))
    return operator.of("MISSION_ITEM_INT")


def result_of(operator: Operator, message: Any) -> int:
    operator.received.clear()
    operator.send(message)
    return int(operator.last("MISSION_ACK").type)


# --- plans ---------------------------------------------------------------------------------


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_list_comes_back_as_it_was_uploaded_and_is_cleared_alone(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    for kind, items in LISTS.items():
        assert operator.upload(items, kind) == mavlink.MAV_MISSION_ACCEPTED
    for kind, items in LISTS.items():
        found = download(operator, kind)
        for number, (sent, back) in enumerate(zip(items, found, strict=True)):
            expected = operator.item(number, sent, kind).to_dict()
            same = {
                key: back.to_dict()[key] for key in expected if key not in {"current", "param4"}
            }
            assert same == {key: expected[key] for key in same} | {
                "target_system": GROUND_STATION[0],
                "target_component": GROUND_STATION[1],
            }
    for kind in (RALLY, FENCE, MISSION):
        assert result_of(operator, mavlink.MAVLink_mission_clear_all_message(1, 1, kind)) == 0
        assert count_of(operator, kind) == 0
    assert operator.upload(LISTS[RALLY], RALLY) == mavlink.MAV_MISSION_ACCEPTED
    assert result_of(operator, mavlink.MAVLink_mission_clear_all_message(1, 1, ALL)) == 0
    assert count_of(operator, RALLY) == 0


def item_refused(operator: Operator, item: Item, kind: int) -> int:
    assert operator.upload(LISTS[kind], kind) == mavlink.MAV_MISSION_ACCEPTED
    result = operator.upload([item], kind)
    assert count_of(operator, kind) == len(LISTS[kind])  # the old list stays
    return result


@pytest.mark.parametrize(
    ("kind", "item", "result"),
    [
        (
            MISSION,
            waypoint(1.0, 0.0, 5.0)._replace(frame=mavlink.MAV_FRAME_LOCAL_NED),
            mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        ),
        (MISSION, Item(mavlink.MAV_CMD_NAV_PATHPLANNING), mavlink.MAV_MISSION_UNSUPPORTED),
        (
            MISSION,
            Item(mavlink.MAV_CMD_DO_JUMP, parameters=(-1.0, 1.0, 0.0, 0.0)),
            mavlink.MAV_MISSION_INVALID_PARAM1,
        ),
        (FENCE, waypoint(1.0, 0.0, 5.0), mavlink.MAV_MISSION_UNSUPPORTED),
        (FENCE, Item(CORNER), mavlink.MAV_MISSION_INVALID_PARAM1),
        (RALLY, waypoint(1.0, 0.0, 5.0), mavlink.MAV_MISSION_UNSUPPORTED),
    ],
)
def test_an_item_that_does_not_belong_ends_the_upload(kind: int, item: Item, result: int) -> None:
    assert item_refused(Operator(), item, kind) == result


def test_an_upload_survives_lost_and_repeated_messages() -> None:
    operator = Operator()
    first, second, third = LISTS[MISSION]
    operator.send(mavlink.MAVLink_mission_count_message(1, 1, 3))
    operator.wait(0.7)  # the first item was lost: it is asked for again
    assert [request.seq for request in operator.of("MISSION_REQUEST_INT")] == [0, 0]
    for number, item in ((0, first), (2, third), (0, first), (1, second), (2, third)):
        operator.send(operator.item(number, item))
    assert operator.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    assert count_of(operator, MISSION) == 3


def test_an_abandoned_upload_is_cancelled_and_the_old_mission_stays() -> None:
    operator = Operator()
    operator.upload(LISTS[MISSION])
    operator.received.clear()
    operator.send(mavlink.MAVLink_mission_count_message(1, 1, 9))
    operator.wait(7.0)
    assert operator.last("MISSION_ACK").type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert count_of(operator, MISSION) == 3


def test_the_sender_may_cancel_its_upload() -> None:
    operator = Operator()
    operator.send(mavlink.MAVLink_mission_count_message(1, 1, 2))
    cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
    operator.send(mavlink.MAVLink_mission_ack_message(1, 1, cancelled))
    operator.received.clear()
    operator.wait(2.0)
    assert operator.of("MISSION_REQUEST_INT") == []
    late = operator.item(0, LISTS[MISSION][0])
    assert result_of(operator, late) == mavlink.MAV_MISSION_ERROR


def test_the_current_item_is_set_by_message_and_by_command() -> None:
    operator = Operator()
    operator.upload(LISTS[MISSION])
    operator.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    operator.wait(0.1)
    assert operator.last("MISSION_CURRENT").seq == 2
    assert operator.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1.0) == ACCEPTED
    operator.wait(0.1)
    assert operator.last("MISSION_CURRENT").seq == 1
    beyond = mavlink.MAVLink_mission_set_current_message(1, 1, 9)
    assert result_of(operator, beyond) == mavlink.MAV_MISSION_INVALID_SEQUENCE


def test_ardupilot_takes_a_part_of_a_mission_and_px4_ignores_it() -> None:
    part = mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 1)
    for flavour, asked in (("ardupilot", [1]), ("px4", [])):
        operator = Operator(flavour=flavour)
        operator.upload(LISTS[MISSION])
        operator.received.clear()
        operator.send(part)
        assert [request.seq for request in operator.of("MISSION_REQUEST_INT")] == asked


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_unknown_kind_of_plan_is_unsupported(flavour: str) -> None:
    operator = Operator(flavour=flavour)
    for message in (
        mavlink.MAVLink_mission_count_message(1, 1, 1, 42),
        mavlink.MAVLink_mission_request_list_message(1, 1, 42),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 42),
    ):
        assert result_of(operator, message) == mavlink.MAV_MISSION_UNSUPPORTED


# --- files ---------------------------------------------------------------------------------


class FileClient:
    """A client of MAVLink FTP over the wire."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._sequence = 0

    def ask(self, operation: int, data: bytes = b"", offset: int = 0) -> tuple[Header, bytes]:
        self._sequence += 2
        head = Header(self._sequence, 0, operation, len(data), offset=offset)
        self._operator.received.clear()
        payload = packed(head, data)
        self._operator.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        answer = self._operator.of("FILE_TRANSFER_PROTOCOL")[0]
        assert (answer.target_system, answer.target_component) == GROUND_STATION
        content = bytes(answer.payload)
        header = Header.of(content)
        return header, content[12 : 12 + header.size]

    def read(self, path: str) -> bytes:
        header, size = self.ask(Operation.OPEN_FILE_RO, path.encode())
        assert header.operation == 128, size
        content = b""
        while len(content) < struct.unpack("<I", size)[0]:
            content += self.ask(Operation.READ_FILE, offset=len(content))[1]
        self.ask(Operation.TERMINATE_SESSION)
        return content


def test_the_component_metadata_lead_to_the_description_of_every_parameter() -> None:
    operator = Operator()
    assert operator.request(COMPONENT_METADATA_ID) == ACCEPTED
    payload = payload_of(operator, COMPONENT_METADATA_ID)
    (checksum,) = struct.unpack_from("<I", payload, 4)
    uri = payload[8:].rstrip(b"\0").decode()
    files = FileClient(operator)
    general = files.read(uri.removeprefix("mftp://"))
    assert crc32(general) == checksum
    _, told = files.ask(Operation.CALC_FILE_CRC32, uri.removeprefix("mftp://").encode())
    assert struct.unpack("<I", told)[0] == checksum
    (entry,) = json.loads(lzma.decompress(general))["metadataTypes"]
    described = files.read(entry["uri"].removeprefix("mftp://"))
    assert crc32(described) == entry["fileCrc"]
    names = [each["name"] for each in json.loads(lzma.decompress(described))["parameters"]]
    operator.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert [each.param_id for each in operator.of("PARAM_VALUE")[1:]] == names


def test_ardupilot_serves_its_parameters_packed_and_no_component_metadata() -> None:
    operator = Operator(flavour="ardupilot")
    content = FileClient(operator).read("@PARAM/param.pck?withdefaults=1")
    magic, count, _ = struct.unpack_from("<HHH", content)
    assert magic == 0x671B
    operator.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert count == len(operator.of("PARAM_VALUE"))
    assert operator.request(COMPONENT_METADATA_ID) == UNSUPPORTED


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_files_that_do_not_exist_or_cannot_be_written_are_refused(flavour: str) -> None:
    files = FileClient(Operator(flavour=flavour))
    for operation, path, error in (
        (Operation.OPEN_FILE_RO, b"/fs/microsd/log.ulg", FileError.FILE_NOT_FOUND),
        (Operation.LIST_DIRECTORY, b"/fs", FileError.FILE_NOT_FOUND),
        (Operation.CREATE_FILE, b"/new.txt", FileError.FILE_PROTECTED),
        (Operation.REMOVE_FILE, b"/etc", FileError.FILE_PROTECTED),
        (Operation.READ_FILE, b"", FileError.INVALID_SESSION),
        (77, b"", FileError.UNKNOWN_COMMAND),
    ):
        header, data = files.ask(operation, path)
        assert (header.operation, header.requested, data[0]) == (129, operation, error)
    _, listed = files.ask(Operation.LIST_DIRECTORY, b"/")
    assert listed.split(b"\0")[0] == (b"Detc" if flavour == "px4" else b"D@PARAM")
    assert files.ask(Operation.RESET_SESSIONS)[0].operation == 128
