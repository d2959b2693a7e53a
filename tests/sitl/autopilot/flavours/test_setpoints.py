"""Setpoint messages: frames and masks of both flavours, and where they make the vehicle go."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.autopilot.modes import Mode
from sitl.config import StartConfig
from tests.sitl.mavlink_client import Client, in_air, mode_of, on_ground

START = (2.0, 1.0, -4.0)
POSITION, VELOCITY, YAW_ONLY = 0x0DF8, 0x0DC7, 0x09FF
LOCAL, LOCAL_OFFSET, BODY, BODY_OFFSET = 1, 7, 8, 9


def facing_east(flavour: str) -> Client:
    """A vehicle in external control, off the origin, its nose to the east."""
    start = StartConfig(position_ned_m=START, yaw_deg=90.0)
    client = on_ground(flavour=flavour, start=start)
    client.setpoint((*START, *(0.0,) * 6), POSITION)
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    client.setpoint((*START, *(0.0,) * 6), POSITION)
    return client


@pytest.mark.parametrize(
    ("frame", "target"),
    [
        (LOCAL, (3.0, 0.0, -4.0)),
        (LOCAL_OFFSET, (5.0, 1.0, -8.0)),
        (BODY, (2.0, 4.0, -8.0)),
        (BODY_OFFSET, (2.0, 4.0, -8.0)),
    ],
)
def test_copter_flies_to_positions_in_four_frames(
    frame: int, target: tuple[float, float, float]
) -> None:
    client = facing_east("ardupilot")
    client.setpoint((3.0, 0.0, -4.0, *(0.0,) * 6), POSITION, frame=frame)
    client.wait(10.0)
    assert client.vehicle.truth.position_ned_m == pytest.approx(target, abs=0.1)


@pytest.mark.parametrize(
    ("flavour", "frame", "velocity"),
    [
        ("px4", LOCAL, (1.0, 0.0)),
        ("px4", BODY, (0.0, 1.0)),
        ("ardupilot", LOCAL, (1.0, 0.0)),
        ("ardupilot", LOCAL_OFFSET, (1.0, 0.0)),
        ("ardupilot", BODY, (0.0, 1.0)),
        ("ardupilot", BODY_OFFSET, (0.0, 1.0)),
    ],
)
def test_velocities_are_turned_with_their_frame(
    flavour: str, frame: int, velocity: tuple[float, float]
) -> None:
    client = facing_east(flavour)
    motion = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.wait(3.0, lambda _: client.setpoint(motion, VELOCITY, frame=frame))
    assert client.vehicle.truth.velocity_ned_mps[:2] == pytest.approx(velocity, abs=0.05)


@pytest.mark.parametrize(
    ("mask", "frame"),
    [
        (0x0DE3, LOCAL),  # velocity across, position up
        (VELOCITY, mavlink.MAV_FRAME_BODY_FRD),
        (VELOCITY, mavlink.MAV_FRAME_GLOBAL),
        (0x0C38, LOCAL),  # position and acceleration
        (0x0E00, LOCAL),  # a force
    ],
)
def test_copter_stops_at_what_it_does_not_fly(mask: int, frame: int) -> None:
    client = facing_east("ardupilot")
    motion = (50.0, 0.0, -4.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    client.wait(3.0, lambda _: client.setpoint(motion, VELOCITY))
    assert client.vehicle.truth.ground_speed_mps > 2.5
    client.wait(6.0, lambda _: client.setpoint(motion, mask, frame=frame))
    assert client.vehicle.truth.ground_speed_mps < 0.05
    assert mode_of(client) is Mode.OFFBOARD


def test_copter_ignores_a_yaw_alone() -> None:
    client = facing_east("ardupilot")
    motion = (0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.wait(3.0, lambda _: client.setpoint(motion, VELOCITY))

    def both(_: float) -> None:
        client.setpoint(motion, VELOCITY)
        client.setpoint(motion, YAW_ONLY)

    client.wait(2.0, both)
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(2.0, abs=0.05)


def test_px4_brakes_at_a_setpoint_that_leaves_an_axis_open() -> None:
    client = facing_east("px4")
    motion = (0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.wait(2.0, lambda _: client.setpoint(motion, VELOCITY))
    client.wait(3.0, lambda _: client.setpoint(motion, 0x0DD7))  # no east
    assert client.vehicle.truth.ground_speed_mps < 0.05
    assert mode_of(client) is Mode.OFFBOARD


def global_setpoint(client: Client, frame: int, altitude_m: float, mask: int = POSITION) -> Any:
    there = geographic_from_ned(client.vehicle.autopilot._home, (7.0, -3.0, 0.0))
    return mavlink.MAVLink_set_position_target_global_int_message(
        0,
        1,
        1,
        frame,
        mask,
        round(there.latitude_deg * 1e7),
        round(there.longitude_deg * 1e7),
        altitude_m,
        *(0.0,) * 8,
    )


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("frame", "altitude_m"),
    [
        (mavlink.MAV_FRAME_GLOBAL_INT, 493.0),
        (mavlink.MAV_FRAME_GLOBAL, 493.0),
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 5.0),
        (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT, 5.0),
    ],
)
def test_global_positions_are_flown_to(flavour: str, frame: int, altitude_m: float) -> None:
    client = in_air(flavour=flavour)
    setpoint = global_setpoint(client, frame, altitude_m)
    client.send(setpoint)
    client.set_mode(Mode.OFFBOARD)
    client.wait(12.0, lambda _: client.send(setpoint))
    assert client.vehicle.truth.position_ned_m == pytest.approx((7.0, -3.0, -5.0), abs=0.1)


def test_a_global_setpoint_in_a_local_frame_is_none() -> None:
    client = in_air()
    client.send(global_setpoint(client, LOCAL, 5.0, 0x0C00))
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_body_setpoint_turns_the_copter_relative_to_its_heading() -> None:
    client = facing_east("ardupilot")
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, BODY_OFFSET, 0x09F8, *(0.0,) * 9, math.radians(90.0), 0.0
    )
    client.send(message)
    client.wait(4.0)
    assert abs(client.vehicle.truth.yaw_rad) == pytest.approx(math.pi, abs=0.05)
