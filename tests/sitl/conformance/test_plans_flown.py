"""Geofences, rally points, jumps and repositions as flown: newer tests of PX4, and more."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.plant.truth import Vector
from tests.sitl.conformance.operator import ACCEPTED, Item, Operator, waypoint
from tests.sitl.mavlink_client import NAN, mode_of

FENCE, RALLY = mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY
FAR: Vector = (40.0, 0.0, -5.0)


def reposition(operator: Operator, place_ned_m: Vector) -> int:
    latitude, longitude = operator.place(*place_ned_m[:2])
    altitude_m = operator.home.altitude_m - place_ned_m[2]
    operator.send(
        mavlink.MAVLink_command_int_message(
            *(1, 1, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_REPOSITION, 0, 0),
            *(-1.0, 1.0, 0.0, NAN, latitude, longitude, altitude_m),
        )
    )
    return operator.acknowledged(mavlink.MAV_CMD_DO_REPOSITION)


def flying(**parameters: float) -> Operator:
    operator = Operator(parameters={"RTL_RETURN_ALT": 5.0, **parameters})
    operator.take_off(5.0)
    return operator


def north_m(operator: Operator) -> float:
    return operator.position_ned_m[0]


# --- reposition ----------------------------------------------------------------------------


def test_a_reposition_is_flown_to_and_held() -> None:
    operator = flying()
    assert reposition(operator, FAR) == ACCEPTED
    operator.until_at(FAR, 0.5, 60.0)
    operator.wait(10.0)
    assert math.dist(operator.position_ned_m, FAR) < 0.5
    assert mode_of(operator) is Mode.HOLD


def test_a_pause_on_the_way_holds_near_where_it_came() -> None:
    operator = flying()
    reposition(operator, (200.0, 0.0, -5.0))
    operator.wait(4.0)
    paused_m = north_m(operator)
    assert operator.set_mode(Mode.HOLD) == ACCEPTED
    operator.wait(5.0)
    held_m = north_m(operator)
    assert paused_m < held_m < paused_m + 10.0
    operator.wait(5.0)
    assert north_m(operator) == pytest.approx(held_m, abs=0.2)


def test_a_speed_change_applies_on_the_way() -> None:
    operator = flying()
    reposition(operator, (200.0, 0.0, -5.0))
    operator.wait(5.0)
    assert operator.vehicle.truth.ground_speed_mps > 4.0
    assert operator.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1.0, 2.0) == ACCEPTED
    operator.wait(3.0)
    assert operator.vehicle.truth.ground_speed_mps == pytest.approx(2.0, abs=0.1)
    assert mode_of(operator) is Mode.HOLD


# --- jumps ---------------------------------------------------------------------------------


def test_setting_the_current_item_to_a_jump_flies_on_and_lands() -> None:
    take_off = Item(mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 5.0)
    jump = Item(mavlink.MAV_CMD_DO_JUMP, parameters=(1.0, 1.0, 0.0, 0.0))
    land = Item(mavlink.MAV_CMD_NAV_LAND, 0.0, 0.0, 0.0)
    square = [waypoint(15.0, 0.0, 5.0), waypoint(15.0, 15.0, 5.0)]
    operator = Operator()
    operator.fly_mission([take_off, *square, jump, waypoint(0.0, 15.0, 5.0), land])
    mission = operator.vehicle.autopilot.commander.mission
    operator.until(lambda: mission.current == 2, 60.0)
    operator.wait(1.5)
    operator.send(mavlink.MAVLink_mission_set_current_message(1, 1, 3))
    operator.wait(0.1)
    assert mission.current == 1
    operator.until_disarmed(120.0)
    assert math.hypot(*operator.position_ned_m[:2]) < 0.5


# --- rally points --------------------------------------------------------------------------


def returned(operator: Operator, *rally_north_m: float) -> float:
    """Return from 40 m north with these rally points; return how far north that ends."""
    points = [Item(mavlink.MAV_CMD_NAV_RALLY_POINT, north, 0.0, 10.0) for north in rally_north_m]
    assert operator.upload(points, RALLY) == mavlink.MAV_MISSION_ACCEPTED
    operator.until_at(FAR, 0.5, 60.0)
    assert operator.set_mode(Mode.RTL) == ACCEPTED
    operator.until_disarmed(120.0)
    return north_m(operator)


@pytest.mark.parametrize(
    ("rally_north_m", "ends_m"), [((), 0.0), ((100.0,), 0.0), ((100.0, 30.0), 30.0)]
)
def test_px4_returns_to_the_nearest_of_home_and_rally_points(
    rally_north_m: tuple[float, ...], ends_m: float
) -> None:
    operator = flying()
    reposition(operator, FAR)
    assert returned(operator, *rally_north_m) == pytest.approx(ends_m, abs=0.5)


@pytest.mark.parametrize(
    ("parameters", "ends_m"),
    [({}, 100.0), ({"RALLY_INCL_HOME": 1}, 0.0), ({"RALLY_LIMIT_KM": 0.05}, 0.0)],
)
def test_ardupilot_prefers_rally_points_within_its_limit(
    parameters: dict[str, Any], ends_m: float
) -> None:
    operator = Operator(flavour="ardupilot", parameters={"RTL_ALT": 500, **parameters})
    operator.set_mode(Mode.OFFBOARD)
    operator.arm()
    assert operator.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, 5.0) == ACCEPTED
    operator.until(lambda: operator.height_m > 4.9, 30.0)
    operator.wait(1.0)
    reposition(operator, FAR)
    assert returned(operator, 100.0) == pytest.approx(ends_m, abs=0.5)


# --- geofences -----------------------------------------------------------------------------


def fenced(north_max_m: float, side_m: float = 25.0) -> list[Item]:
    corner = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    corners = [(-side_m, -side_m), (-side_m, side_m), (north_max_m, side_m), (north_max_m, -side_m)]
    return [Item(corner, north, east, 0.0, (4.0, 0.0, 0.0, 0.0)) for north, east in corners]


@pytest.mark.parametrize(
    ("action", "mode"),
    [(1, Mode.HOLD), (2, Mode.HOLD), (3, Mode.RTL), (5, Mode.LAND)],
)
def test_px4_reacts_to_a_breach_as_its_parameter_says(action: int, mode: Mode) -> None:
    operator = flying(GF_ACTION=action)
    assert operator.upload(fenced(20.0), FENCE) == mavlink.MAV_MISSION_ACCEPTED
    reposition(operator, FAR)
    operator.until(lambda: north_m(operator) > 20.5, 30.0)
    operator.wait(3.0)
    assert operator.texts().count("Geofence breached") == 1
    assert mode_of(operator) is mode
    stays = action != 1  # a warning only: the flight goes on
    assert (north_m(operator) < 27.0) is stays


def test_a_breach_shows_in_the_status_until_the_vehicle_is_back() -> None:
    operator = flying(GF_ACTION=1)
    operator.upload(fenced(20.0), FENCE)
    bit = mavlink.MAV_SYS_STATUS_GEOFENCE
    for place, healthy in ((FAR, False), ((10.0, 0.0, -5.0), True)):
        reposition(operator, place)
        operator.until_at(place, 0.5, 60.0)
        operator.wait(1.0)
        assert bool(operator.last("SYS_STATUS").onboard_control_sensors_health & bit) is healthy


def test_a_breach_ends_offboard_although_the_stream_goes_on() -> None:
    operator = flying(GF_ACTION=2, GF_MAX_HOR_DIST=10.0, MPC_XY_VEL_MAX=3.0)

    def stream(*_: float) -> None:
        operator.setpoint((20.0, 0.0, -5.0, *(0.0,) * 6), mask=0x0FF8)

    stream()
    assert operator.set_mode(Mode.OFFBOARD) == ACCEPTED
    operator.wait(10.0, stream)
    assert mode_of(operator) is Mode.HOLD
    assert 10.0 < north_m(operator) < 13.0


@pytest.mark.parametrize(("enabled", "mode"), [(0, Mode.OFFBOARD), (1, Mode.RTL)])
def test_ardupilot_watches_its_fence_only_where_it_is_enabled(enabled: int, mode: Mode) -> None:
    fence = {"FENCE_ENABLE": enabled, "FENCE_RADIUS": 30.0, "FENCE_TYPE": 2, "RTL_ALT": 500}
    operator = Operator(flavour="ardupilot", parameters=fence)
    operator.set_mode(Mode.OFFBOARD)
    operator.arm()
    operator.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, 5.0)
    operator.until(lambda: operator.height_m > 4.9, 30.0)
    operator.wait(1.0)
    reposition(operator, FAR)
    operator.until(lambda: north_m(operator) > 31.0, 30.0)
    operator.wait(1.0)
    assert mode_of(operator) is mode
