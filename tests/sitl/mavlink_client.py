"""A MAVLink client of a simulated vehicle, in virtual time, for the tests of the autopilot."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.config import StartConfig, VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle

COMPANION = mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE
STREAM_S = 0.02
NAN = math.nan


class Outbox(bytearray):
    def write(self, data: bytes) -> None:
        self.extend(data)


class Client:
    """One MAVLink peer of a vehicle, on one link."""

    def __init__(
        self, vehicle: SimulatedVehicle, link: int = 0, system: int = 1, component: int = COMPANION
    ) -> None:
        self.vehicle = vehicle
        self.link = link
        self.received: list[Any] = []
        self._outbox = Outbox()
        self._codec = mavlink.MAVLink(self._outbox, system, component)
        vehicle.autopilot.open_link(link)

    @property
    def now_s(self) -> float:
        return self.vehicle.truth.time_s

    def send(self, message: Any) -> None:
        self._codec.send(message)
        self.vehicle.receive(bytes(self._outbox), self.link)
        self._outbox.clear()
        self.collect()

    def collect(self) -> None:
        self.received += self._codec.parse_buffer(self.vehicle.bytes_to_send(self.link)) or []

    def of(self, name: str) -> list[Any]:
        return [message for message in self.received if message.get_type() == name]

    def texts(self) -> list[str]:
        return [message.text for message in self.of("STATUSTEXT")]

    def wait(self, duration_s: float, each: Callable[[float], None] | None = None) -> None:
        end_s = self.now_s + duration_s
        while self.now_s < end_s - 1e-6:
            if each is not None:
                each(self.now_s)
            self.vehicle.advance(self.now_s + STREAM_S)
            self.collect()

    def command(self, number: int, *parameters: float) -> int:
        """Send a COMMAND_LONG and return the result of its acknowledgement."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        return self.acknowledged(number)

    def acknowledged(self, number: int) -> int:
        ack = self.of("COMMAND_ACK")[-1]
        assert (ack.command, ack.target_component) == (number, self._codec.srcComponent)
        return int(ack.result)

    def set_mode(self, mode: Mode) -> int:
        code = self.vehicle.autopilot.flavour.custom_mode(mode)
        if self.vehicle.autopilot.flavour.autopilot == mavlink.MAV_AUTOPILOT_PX4:
            return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, code >> 16 & 0xFF, code >> 24)
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, code)

    def arm(self, *, force: bool = False) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196 if force else 0)

    def disarm(self, *, force: bool = False) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196 if force else 0)

    def setpoint(self, values: tuple[float, ...], mask: int = 0x0C00, **changes: int) -> None:
        """Send position, velocity and acceleration, yaw ignored unless the mask says otherwise."""
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0,
            changes.get("target_system", 1),
            changes.get("target_component", 1),
            changes.get("frame", mavlink.MAV_FRAME_LOCAL_NED),
            mask,
            *values,
            0.0,
            0.0,
        )
        self.send(message)

    def parameter(self, name: str, value: float) -> None:
        self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))


def on_ground(seed: int = 0, **config: Any) -> Client:
    """Return a client of a vehicle that stands; ideal unless the test is about the field."""
    client = Client(SimulatedVehicle(VehicleConfig(**{"realism": "ideal", **config}), seed))
    client.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3))
    client.wait(1.5)
    return client


def in_air(**config: Any) -> Client:
    return on_ground(start=StartConfig(position_ned_m=(0.0, 0.0, -4.0)), **config)


def cruising(speed_mps: float = 2.8, **config: Any) -> tuple[Client, Callable[[float], None]]:
    """Return a client in offboard at cruise speed, and the stream that keeps it so."""
    client = in_air(**config)
    began_s = client.now_s
    ramp_s = speed_mps / 1.5

    def stream(now_s: float) -> None:
        t = now_s - began_s
        if t < ramp_s:
            motion = (0.75 * t * t, 1.5 * t, 1.5)
        else:
            motion = (0.75 * ramp_s**2 + speed_mps * (t - ramp_s), speed_mps, 0.0)
        north, speed, acceleration = motion
        client.setpoint((north, 0.0, -4.0, speed, 0.0, 0.0, acceleration, 0.0, 0.0))

    client.wait(0.1, stream)
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(ramp_s + 2.0, stream)
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(speed_mps, abs=0.02)
    return client, stream


def mode_of(client: Client) -> Mode:
    return client.vehicle.autopilot.commander.mode
