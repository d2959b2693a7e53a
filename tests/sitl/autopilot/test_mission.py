"""Missions over MAVLink bytes: the protocol, and the flight that follows from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.modes import Mode
from tests.sitl.mavlink_client import NAN, Client, in_air, mode_of, on_ground

MISSION, FENCE = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
Item = tuple[int, tuple[float, float, float, float], tuple[float, float, float]]


def place(client: Client, north_m: float, east_m: float) -> tuple[int, int]:
    """Latitude and longitude of a local position, as integers."""
    there = geographic_from_ned(client.vehicle.autopilot._home, (north_m, east_m, 0.0))
    return round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)


def waypoint(north_m: float, east_m: float, height_m: float, hold_s: float = 0.0) -> Item:
    command = mavlink.MAV_CMD_NAV_WAYPOINT
    return command, (hold_s, 0.0, 0.0, NAN), (north_m, east_m, height_m)


def message(
    client: Client, number: int, item: Item, frame: int = RELATIVE, mission_type: int = MISSION
) -> Any:
    command, parameters, (north_m, east_m, height_m) = item
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, number, frame, command, 0, 1, *parameters, *place(client, north_m, east_m), height_m,
        mission_type,
    )  # fmt: skip


def result_of(client: Client) -> int:
    return int(client.of("MISSION_ACK")[-1].type)


def upload(client: Client, items: Sequence[Item], mission_type: int = MISSION) -> int:
    """Answer the vehicle's requests, as a ground station does; return the acknowledgement."""
    client.received.clear()
    client.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), mission_type))
    while not client.of("MISSION_ACK"):
        request = client.of("MISSION_REQUEST_INT")[-1]
        assert request.mission_type == mission_type
        client.send(message(client, request.seq, items[request.seq], mission_type=mission_type))
    assert client.of("MISSION_ACK")[-1].mission_type == mission_type
    return result_of(client)


TAKE_OFF: Item = (mavlink.MAV_CMD_NAV_TAKEOFF, (0.0, 0.0, 0.0, NAN), (0.0, 0.0, 4.0))
LAND: Item = (mavlink.MAV_CMD_NAV_LAND, (0.0, 0.0, 0.0, NAN), (12.0, 5.0, 0.0))
RETURN: Item = (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, (0.0,) * 4, (0.0, 0.0, 0.0))
SLOW: Item = (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, 1.5, -1.0, 0.0), (0.0, 0.0, 0.0))


def test_a_mission_comes_back_as_it_was_uploaded() -> None:
    client = on_ground()
    items = [TAKE_OFF, waypoint(10.0, 0.0, 4.0, hold_s=2.0), SLOW, LAND]
    assert upload(client, items) == mavlink.MAV_MISSION_ACCEPTED
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert client.of("MISSION_COUNT")[-1].count == 4
    for number, item in enumerate(items):
        client.send(mavlink.MAVLink_mission_request_int_message(1, 1, number))
        answer, sent = client.of("MISSION_ITEM_INT")[-1], message(client, number, item)
        for field in ("seq", "frame", "command", "param1", "param2", "x", "y", "z"):
            assert getattr(answer, field) == getattr(sent, field)


def test_a_mission_flies_from_the_ground_to_the_ground() -> None:
    client = on_ground(parameters={"COM_DISARM_LAND": 0.1})
    corner = waypoint(12.0, 0.0, 6.0, hold_s=2.0)
    upload(client, [TAKE_OFF, corner, SLOW, waypoint(12.0, 5.0, 6.0), LAND])
    assert client.set_mode(Mode.MISSION) == mavlink.MAV_RESULT_ACCEPTED
    client.arm()
    track: list[tuple[float, float, float, float]] = []

    def note(now_s: float) -> None:
        truth = client.vehicle.truth
        track.append((now_s, *truth.position_ned_m))

    client.wait(45.0, note)
    assert [reached.seq for reached in client.of("MISSION_ITEM_REACHED")] == [0, 1, 2, 3, 4]
    assert client.of("MISSION_CURRENT")[-1].mission_state == mavlink.MISSION_STATE_COMPLETE
    assert not client.vehicle.autopilot.commander.armed
    assert client.vehicle.truth.position_ned_m == pytest.approx((12.0, 5.0, 0.0), abs=0.15)
    held = [t for t, *position in track if math.dist(position, (12.0, 0.0, -6.0)) < 0.15]
    assert held[-1] - held[0] > 2.0
    east = [(t, y) for t, _, y, _ in track if 1.0 < y < 4.0]
    assert (east[-1][1] - east[0][1]) / (east[-1][0] - east[0][0]) < 1.55  # the changed speed


def test_a_mission_without_take_off_climbs_first() -> None:
    client = on_ground(parameters={"MIS_TAKEOFF_ALT": 3.0})
    upload(client, [waypoint(8.0, 0.0, 5.0), RETURN])
    client.set_mode(Mode.MISSION)
    client.arm()
    moved_below_m = []
    client.wait(
        8.0,
        lambda _: (
            moved_below_m.append(client.vehicle.truth.position_ned_m[0])
            if client.vehicle.truth.position_ned_m[2] > -2.5
            else None
        ),
    )
    assert max(moved_below_m) < 0.1
    client.wait(5.0)
    assert mode_of(client) is Mode.RTL


def test_the_user_chooses_the_item_and_comes_back_to_it() -> None:
    client = in_air()
    upload(client, [waypoint(30.0, 0.0, 4.0), waypoint(0.0, 6.0, 4.0), waypoint(0.0, -9.0, 4.0)])
    client.set_mode(Mode.MISSION)
    client.wait(1.0)
    client.send(mavlink.MAVLink_mission_set_current_message(1, 1, 1))
    client.wait(0.1)
    assert client.of("MISSION_CURRENT")[-1].seq == 1
    client.set_mode(Mode.HOLD)
    client.wait(3.0)
    assert client.of("MISSION_CURRENT")[-1].seq == 1
    client.command(mavlink.MAV_CMD_MISSION_START, 1, 2)
    client.wait(20.0)
    assert client.vehicle.truth.position_ned_m == pytest.approx((0.0, -9.0, -4.0), abs=0.15)


def test_a_missing_item_is_asked_for_again_and_given_up_in_the_end() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 2))
    client.wait(1.5)
    assert [request.seq for request in client.of("MISSION_REQUEST_INT")] == [0, 0, 0]
    client.send(message(client, 0, TAKE_OFF))
    client.wait(6.0)
    assert result_of(client) == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert client.set_mode(Mode.MISSION) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


GRIPPER: Item = (mavlink.MAV_CMD_DO_GRIPPER, (0.0,) * 4, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("item", "frame", "result"),
    [
        (GRIPPER, RELATIVE, mavlink.MAV_MISSION_UNSUPPORTED),
        (TAKE_OFF, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (waypoint(0.0, 0.0, NAN), RELATIVE, mavlink.MAV_MISSION_INVALID_PARAM7),
        (waypoint(2e6, 0.0, 4.0), RELATIVE, mavlink.MAV_MISSION_INVALID_PARAM5_X),
    ],
)
def test_what_cannot_be_flown_is_refused(item: Item, frame: int, result: int) -> None:
    client = on_ground()
    upload(client, [TAKE_OFF])
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 1))
    client.send(message(client, 0, item, frame))
    assert result_of(client) == result
    assert client.vehicle.autopilot.commander.mission.items[0].takes_off  # the old one stays


def fence_corner(north_m: float, east_m: float, corners: float = 3.0) -> Item:
    command = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    return command, (corners, 0.0, 0.0, 0.0), (north_m, east_m, 0.0)


def fence_circle(radius_m: float) -> Item:
    return mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, (radius_m, 0.0, 0.0, 0.0), (9.0, 9.0, 0.0)


def test_a_geofence_is_kept_beside_the_mission() -> None:
    client = on_ground()
    fence = [fence_corner(-5.0, 0.0), fence_corner(30.0, -9.0), fence_corner(30.0, 9.0)]
    fence.append(fence_circle(2.0))
    assert upload(client, [TAKE_OFF, LAND]) == mavlink.MAV_MISSION_ACCEPTED
    assert upload(client, fence, FENCE) == mavlink.MAV_MISSION_ACCEPTED
    for mission_type, items in ((MISSION, [TAKE_OFF, LAND]), (FENCE, fence)):
        client.send(mavlink.MAVLink_mission_request_list_message(1, 1, mission_type))
        assert client.of("MISSION_COUNT")[-1].count == len(items)
        for number, item in enumerate(items):
            client.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, mission_type))
            answer = client.of("MISSION_ITEM_INT")[-1]
            sent = message(client, number, item, mission_type=mission_type)
            for field in ("seq", "mission_type", "command", "param1", "x", "y"):
                assert getattr(answer, field) == getattr(sent, field)
    client.send(mavlink.MAVLink_mission_clear_all_message(1, 1, FENCE))
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1, FENCE))
    assert client.of("MISSION_COUNT")[-1].count == 0
    assert len(client.vehicle.autopilot.commander.mission.items) == 2


@pytest.mark.parametrize(
    ("item", "frame", "result"),
    [
        (TAKE_OFF, RELATIVE, mavlink.MAV_MISSION_UNSUPPORTED),
        (fence_circle(2.0), mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (fence_corner(0.0, 0.0, 2.0), RELATIVE, mavlink.MAV_MISSION_INVALID_PARAM1),
        (fence_circle(0.0), RELATIVE, mavlink.MAV_MISSION_INVALID_PARAM1),
        (fence_circle(NAN), RELATIVE, mavlink.MAV_MISSION_INVALID_PARAM1),
    ],
)
def test_what_bounds_nothing_is_refused(item: Item, frame: int, result: int) -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 1, FENCE))
    client.send(message(client, 0, item, frame, FENCE))
    assert result_of(client) == result


def test_an_item_of_the_other_list_is_no_answer() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 1, FENCE))
    client.send(message(client, 0, TAKE_OFF, mission_type=MISSION))
    assert result_of(client) == mavlink.MAV_MISSION_ERROR


def test_a_second_client_waits_for_the_first_ones_upload() -> None:
    client = on_ground()
    other = Client(client.vehicle, link=1, system=255, component=190)
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 1))
    other.send(mavlink.MAVLink_mission_count_message(1, 1, 1))
    assert result_of(other) == mavlink.MAV_MISSION_DENIED


def test_clearing_empties_the_list() -> None:
    client = on_ground()
    upload(client, [TAKE_OFF, LAND])
    client.send(mavlink.MAVLink_mission_clear_all_message(1, 1))
    assert result_of(client) == mavlink.MAV_MISSION_ACCEPTED
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert client.of("MISSION_COUNT")[-1].count == 0
    client.send(mavlink.MAVLink_mission_request_int_message(1, 1, 0))
    assert result_of(client) == mavlink.MAV_MISSION_INVALID_SEQUENCE
    client.send(mavlink.MAVLink_mission_set_current_message(1, 1, 7))
    assert result_of(client) == mavlink.MAV_MISSION_INVALID_SEQUENCE
