"""How often the autopilot decides is not seen from outside, except in how often it reports."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.config import StartConfig, VehicleConfig
from sitl.plant.truth import Vector
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.sitl.mavlink_client import Client, mode_of

SPEED_MPS, RAMP_S = 4.0, 3.0


def flying(ticks_per_decision: int) -> Client:
    start = StartConfig(position_ned_m=(0.0, 0.0, -4.0))
    vehicle = SimulatedVehicle(
        VehicleConfig(start=start, realism="ideal"), ticks_per_decision=ticks_per_decision
    )
    client = Client(vehicle)
    client.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3))
    client.wait(1.5)
    return client


def north_at(time_s: float) -> tuple[float, float, float]:
    """Position, speed and acceleration of a vehicle that speeds up and cruises."""
    push_mps2 = SPEED_MPS / RAMP_S
    if time_s < RAMP_S:
        return push_mps2 * time_s**2 / 2.0, push_mps2 * time_s, push_mps2
    return SPEED_MPS * (time_s - RAMP_S / 2.0), SPEED_MPS, 0.0


def flown(ticks_per_decision: int) -> list[Vector]:
    """Where the vehicle is at every setpoint of a flight in offboard."""
    client = flying(ticks_per_decision)
    began_s, path_ned_m = client.now_s, []

    def follow(now_s: float) -> None:
        north_m, speed_mps, push_mps2 = north_at(now_s - began_s)
        client.setpoint((north_m, 0.0, -4.0, speed_mps, 0.0, 0.0, push_mps2, 0.0, 0.0))
        path_ned_m.append(client.vehicle.truth.position_ned_m)

    client.wait(0.1, follow)
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(RAMP_S + 3.0, follow)
    assert mode_of(client) is Mode.OFFBOARD
    return path_ned_m


@pytest.mark.parametrize("ticks_per_decision", [1, 2])
def test_the_vehicle_is_where_the_setpoint_says_when_it_comes(ticks_per_decision: int) -> None:
    path_ned_m = flown(ticks_per_decision)
    for number, (north_m, _, _) in enumerate(path_ned_m[-50:], start=len(path_ned_m) - 50):
        # Neither ahead nor behind by what is flown in 2 ms.
        assert north_m == pytest.approx(north_at(0.02 * number)[0], abs=0.002 * SPEED_MPS)


def test_deciding_half_as_often_flies_the_same_way() -> None:
    for one, other in zip(flown(1), flown(2), strict=True):
        assert one == pytest.approx(other, abs=0.005)


@pytest.mark.parametrize(("ticks_per_decision", "rate_hz"), [(1, 100), (2, 50)])
def test_telemetry_comes_as_often_as_is_decided(ticks_per_decision: int, rate_hz: int) -> None:
    client = flying(ticks_per_decision)
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert client.command(interval, mavlink.MAVLINK_MSG_ID_ATTITUDE, 10_000.0) == 0
    client.received.clear()
    client.wait(1.0)
    assert len(client.of("ATTITUDE")) == rate_hz
