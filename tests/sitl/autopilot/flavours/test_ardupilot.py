"""The ArduPilot Copter flavour, where it differs from PX4."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import LandedState, Mode
from sitl.config import VehicleConfig
from sitl.plant.battery import BatteryConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.virtual.simulation import Simulation
from tests.sitl.autopilot.test_mission import LAND, TAKE_OFF, upload, waypoint
from tests.sitl.mavlink_client import Client, mode_of
from tests.sitl.mavlink_client import in_air as px4_in_air
from tests.sitl.mavlink_client import on_ground as px4_on_ground
from tests.sitl.virtual.test_simulation import flight_of

FAILED = mavlink.MAV_RESULT_FAILED
VELOCITY, POSITION = 0x0DC7, 0x0DF8
NORTH = (0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def on_ground(**parameters: float) -> Client:
    return px4_on_ground(flavour="ardupilot", parameters=parameters)


def in_air(realism: str = "ideal", **parameters: float) -> Client:
    client = px4_in_air(flavour="ardupilot", realism=realism, parameters=parameters)
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    return client


def taken_off(client: Client, height_m: float = 3.0) -> None:
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0


def test_only_the_heartbeat_comes_unasked_and_streams_on_request() -> None:
    client = on_ground()
    assert {message.get_type() for message in client.received} == {"HEARTBEAT"}
    heartbeat = client.of("HEARTBEAT")[-1]
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert heartbeat.custom_mode == 0  # STABILIZE
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 50_000)
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    client.received.clear()
    client.wait(2.0)
    assert len(client.of("ATTITUDE")) == pytest.approx(8, abs=1)
    assert client.of("EKF_STATUS_REPORT")[-1].flags & 0x33F == 0x33F
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    client.received.clear()
    client.wait(1.0)
    assert {message.get_type() for message in client.received} == {"HEARTBEAT"}


def test_guided_is_accepted_before_the_estimate_but_arming_fails() -> None:
    client = Client(SimulatedVehicle(VehicleConfig(flavour="ardupilot")))
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    assert client.arm() == FAILED
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 50_000)
    client.wait(0.5)
    assert not client.of("LOCAL_POSITION_NED")
    client.wait(1.0)
    assert client.of("LOCAL_POSITION_NED")
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED


def test_some_modes_do_not_arm() -> None:
    client = on_ground()
    client.set_mode(Mode.LAND)
    assert client.arm() == FAILED
    client.wait(0.1)
    assert any("mode not armable" in text for text in client.texts())


def test_take_off_is_relative_to_home_and_ends_in_guided() -> None:
    client = on_ground()
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0) == FAILED
    taken_off(client)
    client.wait(8.0)
    assert client.vehicle.truth.position_ned_m == pytest.approx((0.0, 0.0, -3.0), abs=0.05)
    assert client.of("HEARTBEAT")[-1].custom_mode == 4
    assert client.disarm() == FAILED
    client.command(mavlink.MAV_CMD_NAV_LAND)
    client.wait(12.0)
    assert not client.vehicle.autopilot.commander.armed


def test_setpoints_during_take_off_keep_the_vehicle_grounded_until_it_disarms() -> None:
    client = on_ground(DISARM_DELAY=5)
    taken_off(client)
    hold = (0.0, 0.0, -3.0, *(0.0,) * 6)
    client.wait(4.5, lambda _: client.setpoint(hold))
    assert client.vehicle.autopilot.commander.landed_state is LandedState.ON_GROUND
    assert client.vehicle.truth.position_ned_m[2] == pytest.approx(0.0, abs=0.01)
    client.wait(1.0, lambda _: client.setpoint(hold))
    assert not client.vehicle.autopilot.commander.armed


@pytest.mark.parametrize("timeout_s", [0.5, 3.0])
def test_velocities_expire_after_guid_timeout_and_guided_stays(timeout_s: float) -> None:
    client = in_air(GUID_TIMEOUT=timeout_s)
    client.wait(4.0, lambda _: client.setpoint(NORTH, VELOCITY))
    lost_at_m = client.vehicle.truth.position_ned_m[0]
    client.wait(timeout_s - 0.1)
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(2.0, abs=0.05)
    client.wait(4.0)
    assert client.vehicle.truth.ground_speed_mps < 0.05
    assert mode_of(client) is Mode.OFFBOARD
    assert client.vehicle.truth.position_ned_m[0] - lost_at_m < 2.0 * timeout_s + 2.2


def test_positions_persist_for_ever() -> None:
    client = in_air(GUID_TIMEOUT=0.5, WPNAV_SPEED=200)
    client.setpoint((20.0, 0.0, -4.0, *(0.0,) * 6), POSITION)
    client.wait(16.0)
    assert client.vehicle.truth.position_ned_m == pytest.approx((20.0, 0.0, -4.0), abs=0.1)


def test_the_last_acceleration_acts_until_the_timeout() -> None:
    client = in_air(GUID_TIMEOUT=1.0)
    client.setpoint((0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 1.5, 0.0, 0.0))
    client.wait(0.95)
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(1.4, abs=0.3)


def test_setpoints_outside_guided_are_ignored() -> None:
    client = in_air()
    client.set_mode(Mode.HOLD)
    client.wait(2.0, lambda _: client.setpoint(NORTH, VELOCITY))
    client.set_mode(Mode.OFFBOARD)
    client.wait(1.0)
    assert client.vehicle.truth.ground_speed_mps < 0.05


def test_brake_stops_and_holds() -> None:
    client = in_air()
    client.wait(4.0, lambda _: client.setpoint(NORTH, VELOCITY))
    assert client.set_mode(Mode.HOLD) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(0.1)
    client.wait(4.0, lambda _: client.setpoint(NORTH, VELOCITY))
    assert client.vehicle.truth.ground_speed_mps < 0.05


def test_loiter_without_radio_control_sinks() -> None:
    client = in_air()
    assert client.set_mode(Mode.POSCTL) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(5.0)
    assert client.vehicle.truth.velocity_ned_mps[2] == pytest.approx(0.5, abs=0.05)


def test_parameters_travel_as_plain_floats() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"ANGLE_MAX", -1))
    value = client.of("PARAM_VALUE")[-1]
    assert (value.param_value, value.param_type) == (3000.0, mavlink.MAV_PARAM_TYPE_INT32)
    client.parameter("GUID_TIMEOUT", 1.0)
    assert client.vehicle.autopilot.commander.settings.setpoint_timeout_s == 1.0


@pytest.mark.parametrize(
    ("changes", "tilt_deg"),
    [({"ANGLE_MAX": 2000}, 20.0), ({"PSC_ANGLE_MAX": 15.0}, 15.0), ({}, 30.0)],
)
def test_angle_limits_bound_the_tilt(changes: dict[str, float], tilt_deg: float) -> None:
    client = in_air("ideal", **changes)
    far = (200.0, 0.0, -4.0, 10.0, 0.0, 0.0, 9.0, 0.0, 0.0)
    tilts = []

    def push(_: float) -> None:
        client.setpoint(far)
        tilts.append(math.degrees(client.vehicle.truth.tilt_rad))

    client.wait(1.5, push)
    assert max(tilts) == pytest.approx(tilt_deg, abs=2.0)


def test_auto_waits_on_the_ground_for_the_start_of_the_mission() -> None:
    client = on_ground()
    assert client.set_mode(Mode.MISSION) == FAILED
    home = waypoint(0.0, 0.0, 0.0)
    upload(client, [home, TAKE_OFF, waypoint(8.0, 0.0, 4.0), LAND])
    assert client.set_mode(Mode.MISSION) == mavlink.MAV_RESULT_ACCEPTED
    client.arm()
    client.wait(2.0)
    assert client.vehicle.autopilot.commander.on_ground
    assert client.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(40.0)
    assert [reached.seq for reached in client.of("MISSION_ITEM_REACHED")] == [1, 2, 3]
    assert client.vehicle.truth.position_ned_m == pytest.approx((12.0, 5.0, 0.0), abs=0.15)


@pytest.mark.parametrize(("action", "mode"), [(1, Mode.LAND), (2, Mode.RTL), (0, Mode.HOLD)])
def test_battery_failsafe_counts_charge(action: int, mode: Mode) -> None:
    parameters = {"BATT_LOW_MAH": 1000.0, "BATT_FS_LOW_ACT": action}
    client = px4_in_air(
        flavour="ardupilot", battery=BatteryConfig(initial_charge=0.19), parameters=parameters
    )
    assert mode_of(client) is mode


def test_texts_go_to_every_link() -> None:
    client = Client(SimulatedVehicle(VehicleConfig(flavour="ardupilot")))
    client.arm()
    client.wait(0.1)
    assert any("Arming denied" in text for text in client.texts())


def test_files_are_refused_at_once() -> None:
    client = on_ground()
    request = bytearray(251)
    request[0:4] = bytes([7, 0, 0, 4])  # sequence 7, open a file for reading
    client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, request))
    answer = bytes(client.of("FILE_TRANSFER_PROTOCOL")[-1].payload)
    assert (answer[0], answer[3], answer[5], answer[12]) == (8, 129, 4, 10)


def test_the_onboard_service_flies_the_papers_example_on_ardupilot() -> None:
    flight = flight_of("paper.yaml")
    parameters = {"GUID_TIMEOUT": 0.5, "ANGLE_MAX": 4500}
    sitl = flight.sitl.model_copy(update={"flavour": "ardupilot", "parameters": parameters})
    simulation = Simulation(replace(flight, sitl=sitl))
    phases: list[str] = []
    while not simulation.over and simulation.now_s < 90.0:
        simulation.advance()
        simulation.autonomy.events()
        phase = simulation.autonomy.navigator.phase.value
        if not phases or phases[-1] != phase:
            phases.append(phase)
    assert simulation.over
    assert phases == ["standby", "cruise", *["avoid", "cruise"] * 3, "arrived", "standby"]
    assert simulation.scene.world.collisions == 0
