"""The mission protocol message by message: upload, download, repetition, refusal."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import ITEMS_MAX, MissionStore
from sitl.autopilot.plan.fence import FenceStore
from sitl.autopilot.plan.rally import RallyStore
from sitl.autopilot.protocol.mission_transfer import ItemStore, MissionTransfer
from sitl.config import HomeConfig

FENCE = mavlink.MAV_MISSION_TYPE_FENCE
RALLY = mavlink.MAV_MISSION_TYPE_RALLY
ALL = mavlink.MAV_MISSION_TYPE_ALL
UNKNOWN = 77


class Peer:
    """One ground station of a vehicle's mission protocol."""

    def __init__(self, transfer: MissionTransfer, system: int = 255) -> None:
        self.heard: list[Any] = []
        self._transfer = transfer
        self._codec = mavlink.MAVLink(None, system, 190)

    def send(self, message: Any, now_s: float = 0.0) -> None:
        (decoded,) = mavlink.MAVLink(None).parse_buffer(message.pack(self._codec))
        self._transfer.receive(decoded, self.heard.append, now_s)

    @property
    def last(self) -> Any:
        return self.heard[-1]

    @property
    def result(self) -> int:
        """Result of the last MISSION_ACK."""
        assert self.last.get_type() == "MISSION_ACK"
        return int(self.last.type)


class Vehicle:
    """The vehicle's side: stores and protocol."""

    def __init__(self) -> None:
        self.mission = MissionStore(HomeConfig(), 0)
        self.fence, self.rally = FenceStore(HomeConfig()), RallyStore(HomeConfig())
        places: dict[int, ItemStore] = {FENCE: self.fence, RALLY: self.rally}
        self.transfer = MissionTransfer(self.mission, places, partial=True)
        self.peer = Peer(self.transfer)


def count(number: int, kind: int = 0) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, number, kind)


def item(number: int, kind: int = 0, command: int = mavlink.MAV_CMD_NAV_WAYPOINT) -> Any:
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return mavlink.MAVLink_mission_item_int_message(
        1,
        1,
        number,
        frame,
        command,
        0,
        1,
        4.0,
        0.0,
        0.0,
        math.nan,
        473_977_420,
        85_455_940,
        10.0,
        kind,
    )


def uploaded(number: int) -> Vehicle:
    vehicle = Vehicle()
    vehicle.peer.send(count(number))
    for index in range(number):
        vehicle.peer.send(item(index))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    return vehicle


def test_an_upload_asks_for_item_after_item() -> None:
    vehicle = Vehicle()
    vehicle.peer.send(count(2))
    for index in range(2):
        assert vehicle.peer.last.get_type() == "MISSION_REQUEST_INT"
        assert vehicle.peer.last.seq == index
        assert not vehicle.mission.items
        vehicle.peer.send(item(index))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    assert len(vehicle.mission.items) == 2


def test_an_empty_upload_empties_the_mission() -> None:
    vehicle = uploaded(2)
    vehicle.peer.send(count(0))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    assert not vehicle.mission.items


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (count(1, UNKNOWN), mavlink.MAV_MISSION_UNSUPPORTED),
        (
            mavlink.MAVLink_mission_request_list_message(1, 1, UNKNOWN),
            mavlink.MAV_MISSION_UNSUPPORTED,
        ),
        (
            mavlink.MAVLink_mission_clear_all_message(1, 1, UNKNOWN),
            mavlink.MAV_MISSION_UNSUPPORTED,
        ),
        (
            mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, UNKNOWN),
            mavlink.MAV_MISSION_UNSUPPORTED,
        ),
        (mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0), mavlink.MAV_MISSION_ERROR),
        (count(ITEMS_MAX + 1), mavlink.MAV_MISSION_NO_SPACE),
        (item(0), mavlink.MAV_MISSION_ERROR),
        (
            mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0),
            mavlink.MAV_MISSION_INVALID_SEQUENCE,
        ),
        (
            mavlink.MAVLink_mission_request_int_message(1, 1, 0, RALLY),
            mavlink.MAV_MISSION_INVALID_SEQUENCE,
        ),
        (
            mavlink.MAVLink_mission_set_current_message(1, 1, 0),
            mavlink.MAV_MISSION_INVALID_SEQUENCE,
        ),
    ],
)
def test_what_cannot_be_done_is_refused(message: Any, result: int) -> None:
    peer = Vehicle().peer
    peer.send(message)
    assert peer.result == result


def test_a_refused_item_ends_the_upload_and_keeps_the_old_mission() -> None:
    vehicle = uploaded(1)
    vehicle.peer.send(count(2))
    vehicle.peer.send(item(0, command=mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT))
    assert vehicle.peer.result == mavlink.MAV_MISSION_UNSUPPORTED
    assert len(vehicle.mission.items) == 1
    vehicle.peer.send(item(1))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ERROR


def test_a_repeated_or_early_item_is_ignored() -> None:
    vehicle = Vehicle()
    vehicle.peer.send(count(3))
    vehicle.peer.send(item(0))
    asked = len(vehicle.peer.heard)
    for index in (0, 2):
        vehicle.peer.send(item(index))
    assert len(vehicle.peer.heard) == asked
    vehicle.peer.send(item(1))
    assert vehicle.peer.last.seq == 2


def test_a_missing_item_is_requested_again_and_the_upload_cancelled_in_the_end() -> None:
    vehicle = Vehicle()
    vehicle.peer.send(count(1))
    vehicle.transfer.step(0.4)
    assert len(vehicle.peer.heard) == 1
    vehicle.transfer.step(0.6)
    assert len(vehicle.peer.heard) == 2
    assert vehicle.peer.last.seq == 0
    vehicle.transfer.step(5.1)
    assert vehicle.peer.result == mavlink.MAV_MISSION_OPERATION_CANCELLED
    vehicle.transfer.step(10.0)
    assert len(vehicle.peer.heard) == 3


def test_a_second_station_waits_and_the_first_may_start_again() -> None:
    vehicle = Vehicle()
    other = Peer(vehicle.transfer, system=254)
    vehicle.peer.send(count(2))
    other.send(count(1))
    assert other.result == mavlink.MAV_MISSION_DENIED
    other.send(item(0))
    assert other.result == mavlink.MAV_MISSION_ERROR
    vehicle.peer.send(count(1))
    vehicle.peer.send(item(0))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED


@pytest.mark.parametrize(
    "request_of",
    [mavlink.MAVLink_mission_request_int_message, mavlink.MAVLink_mission_request_message],
)
def test_a_download_returns_what_was_uploaded(request_of: Any) -> None:
    vehicle = uploaded(3)
    vehicle.peer.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert vehicle.peer.last.count == 3
    for index in range(3):
        vehicle.peer.send(request_of(1, 1, index, 0))
        found, sent = vehicle.peer.last, item(index)
        assert (found.seq, found.x, found.y, found.z) == (index, sent.x, sent.y, sent.z)
        assert found.current == (index == 0)


def test_rally_points_are_a_list_of_their_own() -> None:
    vehicle = uploaded(1)
    vehicle.peer.send(count(1, RALLY))
    vehicle.peer.send(item(0, RALLY, mavlink.MAV_CMD_NAV_RALLY_POINT))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    vehicle.peer.send(mavlink.MAVLink_mission_request_list_message(1, 1, RALLY))
    assert (vehicle.peer.last.get_type(), vehicle.peer.last.count) == ("MISSION_COUNT", 1)
    assert (len(vehicle.mission.items), len(vehicle.rally.items)) == (1, 1)


def test_a_part_of_the_mission_is_replaced() -> None:
    vehicle = uploaded(4)
    before = vehicle.mission.items
    vehicle.peer.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 2))
    for index in (1, 2):
        assert vehicle.peer.last.seq == index
        vehicle.peer.send(item(index, command=mavlink.MAV_CMD_NAV_LOITER_UNLIM))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    first, second, third, fourth = vehicle.mission.items
    assert (first, fourth) == (before[0], before[3])
    assert {second.command, third.command} == {mavlink.MAV_CMD_NAV_LOITER_UNLIM}


@pytest.mark.parametrize(("first", "last"), [(-1, 0), (2, 1), (3, 4)])
def test_a_part_that_does_not_exist_is_refused(first: int, last: int) -> None:
    vehicle = uploaded(4)
    vehicle.peer.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ERROR


@pytest.mark.parametrize(
    ("system", "result", "kind", "ended"),
    [
        (255, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0, True),
        (254, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0, False),
        (255, mavlink.MAV_MISSION_OPERATION_CANCELLED, FENCE, False),
        (255, mavlink.MAV_MISSION_ACCEPTED, 0, False),
    ],
)
def test_only_its_sender_cancels_an_upload(
    system: int, result: int, kind: int, ended: bool
) -> None:
    vehicle = uploaded(1)
    vehicle.peer.send(count(2))
    other = Peer(vehicle.transfer, system)
    other.send(mavlink.MAVLink_mission_ack_message(1, 1, result, kind))
    asked = len(vehicle.peer.heard)
    vehicle.transfer.step(1.0)
    assert (len(vehicle.peer.heard) == asked) is ended
    assert len(vehicle.mission.items) == 1


@pytest.mark.parametrize(
    ("kind", "items", "corners"), [(0, 0, 3), (FENCE, 1, 0), (ALL, 0, 0), (RALLY, 1, 3)]
)
def test_clearing_empties_the_lists_of_its_type(kind: int, items: int, corners: int) -> None:
    vehicle = uploaded(1)
    vehicle.peer.send(count(3, FENCE))
    polygon = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    for index in range(3):
        vehicle.peer.send(item(index, FENCE, polygon))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    vehicle.peer.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind))
    assert vehicle.peer.result == mavlink.MAV_MISSION_ACCEPTED
    assert (len(vehicle.mission.items), len(vehicle.fence.items)) == (items, corners)


def test_the_current_item_is_set() -> None:
    vehicle = uploaded(3)
    answered = len(vehicle.peer.heard)
    vehicle.peer.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert vehicle.mission.current == 2
    assert len(vehicle.peer.heard) == answered
