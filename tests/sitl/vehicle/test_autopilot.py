"""The autopilot as a client sees it: every test here talks MAVLink bytes to a simulated vehicle."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import LandedState, Mode
from sitl.config import StartConfig, VehicleConfig
from sitl.plant.battery import BatteryConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.sitl.mavlink_client import (
    COMPANION,
    NAN,
    Client,
    Outbox,
    cruising,
    in_air,
    mode_of,
    on_ground,
)

# --- arming --------------------------------------------------------------------------------


def test_arming_waits_for_the_estimator() -> None:
    client = Client(SimulatedVehicle(VehicleConfig()))
    client.wait(0.5)
    assert client.arm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    health = client.of("SYS_STATUS")[-1].onboard_control_sensors_health
    assert not health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    client.wait(1.0)
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED
    client.wait(1.0)
    assert client.of("HEARTBEAT")[-1].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_arming_is_refused_with_an_empty_battery_and_says_why() -> None:
    client = on_ground(battery=BatteryConfig(initial_charge=0.05))
    assert client.arm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    client.wait(0.1)
    assert any("battery" in text for text in client.texts())


def test_offboard_without_a_stream_is_accepted_on_the_ground_but_does_not_arm() -> None:
    client = on_ground()
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
    assert client.arm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    client.setpoint((0.0,) * 9)
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED


def test_forced_arming_skips_the_checks() -> None:
    client = Client(SimulatedVehicle(VehicleConfig()))
    assert client.arm(force=True) == mavlink.MAV_RESULT_ACCEPTED


AUTHORIZER = 77
ASKS = {"COM_ARM_AUTH_REQ": 1, "COM_ARM_AUTH_ID": AUTHORIZER}


def authorizing(client: Client, result: int, *, valid_s: int = 0, system: int = AUTHORIZER) -> bool:
    """Tell the vehicle that may it arm, or not; return whether it was asked."""
    other = Client(client.vehicle, link=7, system=system)
    client.send(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, *(0.0,) * 6))
    assert client.of("COMMAND_ACK") == []  # the arm command waits
    client.wait(0.1)
    other.collect()
    asked = [m for m in other.of("COMMAND_LONG") if m.command == 3001]
    ack = mavlink.MAVLink_command_ack_message(3001, result, 0, valid_s, 1, 1)
    other.send(ack)
    client.collect()
    return [m.target_system for m in asked] == [AUTHORIZER]


def test_who_has_to_be_asked_decides_on_arming() -> None:
    client = on_ground(parameters=ASKS)
    assert authorizing(client, mavlink.MAV_RESULT_DENIED)
    assert client.acknowledged(400) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert not client.vehicle.autopilot.commander.armed
    client.wait(0.1)
    assert any("not authorized" in text for text in client.texts())
    client.received.clear()
    authorizing(client, mavlink.MAV_RESULT_ACCEPTED, valid_s=5)
    assert client.acknowledged(400) == mavlink.MAV_RESULT_ACCEPTED
    assert client.vehicle.autopilot.commander.armed
    client.disarm()
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED  # the permission holds for five seconds
    client.disarm()
    client.wait(6.0)
    client.received.clear()
    authorizing(client, mavlink.MAV_RESULT_DENIED)
    assert not client.vehicle.autopilot.commander.armed


def test_silence_and_strangers_authorize_nothing() -> None:
    client = on_ground(parameters=ASKS)
    authorizing(client, mavlink.MAV_RESULT_ACCEPTED, system=AUTHORIZER + 1)
    assert client.of("COMMAND_ACK") == []
    client.wait(0.5)
    assert client.acknowledged(400) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert not client.vehicle.autopilot.commander.armed
    # An answer that comes too late, or without a request.
    late = Client(client.vehicle, link=8, system=AUTHORIZER)
    late.send(mavlink.MAVLink_command_ack_message(3001, 0, 0, 60, 1, 1))
    client.received.clear()
    authorizing(client, mavlink.MAV_RESULT_DENIED)
    assert not client.vehicle.autopilot.commander.armed


def test_disarming_in_flight_needs_force() -> None:
    client = in_air()
    assert client.disarm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert client.disarm(force=True) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(0.5)
    assert client.vehicle.truth.velocity_ned_mps[2] > 3.0  # it falls


def test_armed_vehicle_that_does_not_take_off_disarms() -> None:
    client = on_ground(parameters={"COM_DISARM_PRFLT": 3.0})
    client.arm()
    client.wait(2.9)
    assert client.vehicle.autopilot.commander.armed
    client.wait(0.2)
    assert not client.vehicle.autopilot.commander.armed


# --- take-off, landing, return --------------------------------------------------------------


def test_take_off_hold_land_disarm() -> None:
    client = on_ground(parameters={"MIS_TAKEOFF_ALT": 3.0})
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(NAN,) * 7) == 0
    assert client.arm() == mavlink.MAV_RESULT_ACCEPTED
    client.wait(6.0)
    truth = client.vehicle.truth
    assert truth.position_ned_m == pytest.approx((0.0, 0.0, -3.0), abs=0.05)
    assert mode_of(client) is Mode.HOLD
    assert client.command(mavlink.MAV_CMD_NAV_LAND) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(10.0)
    assert client.vehicle.truth.position_ned_m[2] == pytest.approx(0.0, abs=0.01)
    assert not client.vehicle.autopilot.commander.armed
    landed = [message.landed_state for message in client.of("EXTENDED_SYS_STATE")]
    changes = [state for i, state in enumerate(landed) if i == 0 or landed[i - 1] != state]
    assert changes == [
        LandedState.ON_GROUND,
        LandedState.TAKEOFF,
        LandedState.IN_AIR,
        LandedState.LANDING,
        LandedState.ON_GROUND,
    ]


def test_take_off_altitude_is_above_mean_sea_level() -> None:
    client = on_ground()
    client.arm()
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 492.0) == 0
    client.wait(6.0)
    assert client.vehicle.truth.position_ned_m[2] == pytest.approx(-4.0, abs=0.05)
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(NAN,) * 7) == 1  # already flying


def test_return_climbs_comes_home_and_lands() -> None:
    client = on_ground(parameters={"RTL_RETURN_ALT": 6.0})
    client.arm()
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(NAN,) * 7)
    client.wait(5.0)
    home = client.vehicle.autopilot.commander.home_ned_m
    target = mavlink.MAVLink_command_int_message(
        1, 1, 6, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, 1.0, 0.0, NAN, 473980000, 85456000, 3.0
    )
    client.send(target)
    assert client.acknowledged(mavlink.MAV_CMD_DO_REPOSITION) == mavlink.MAV_RESULT_ACCEPTED
    client.wait(15.0)
    position = client.of("GLOBAL_POSITION_INT")[-1]
    assert (position.lat, position.lon) == pytest.approx((473980000, 85456000), abs=10)
    assert position.relative_alt == pytest.approx(3000, abs=50)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    highest_m = 0.0

    def note(_: float) -> None:
        nonlocal highest_m
        highest_m = max(highest_m, -client.vehicle.truth.position_ned_m[2])

    client.wait(30.0, note)
    assert highest_m == pytest.approx(6.0, abs=0.1)
    assert client.vehicle.truth.position_ned_m == pytest.approx(home, abs=0.1)
    assert not client.vehicle.autopilot.commander.armed


# --- offboard -------------------------------------------------------------------------------


def test_offboard_in_flight_is_refused_without_a_stream() -> None:
    client = in_air()
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert mode_of(client) is Mode.HOLD


def test_setpoints_outside_offboard_move_nothing() -> None:
    client = in_air()
    client.wait(2.0, lambda _: client.setpoint((50.0, 0.0, -4.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert client.vehicle.truth.position_ned_m == pytest.approx((0.0, 0.0, -4.0), abs=0.01)


@pytest.mark.parametrize("timeout_s", [0.5, 1.0])
def test_offboard_loss_coasts_for_the_timeout_then_stops_and_holds(timeout_s: float) -> None:
    client, _ = cruising(parameters={"COM_OF_LOSS_T": timeout_s})
    lost_at_m, lost_at_s = client.vehicle.truth.position_ned_m[0], client.now_s
    client.wait(timeout_s - 0.05)
    assert mode_of(client) is Mode.OFFBOARD
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(2.8, abs=0.02)
    client.wait(0.1)
    assert mode_of(client) is Mode.HOLD
    assert client.of("HEARTBEAT")[-1].get_srcComponent() == 1
    client.wait(4.0)
    truth = client.vehicle.truth
    assert math.hypot(*truth.velocity_ned_mps) < 0.02
    run_on_m = truth.position_ned_m[0] - lost_at_m
    # The contract's model: coast for the timeout, then brake at g tan 15 deg.
    braking_m = 2.8**2 / (2.0 * 9.80665 * math.tan(math.radians(15.0)))
    assert 2.8 * timeout_s < run_on_m < 2.8 * timeout_s + braking_m
    assert truth.position_ned_m[2] == pytest.approx(-4.0, abs=0.05)
    assert any("No offboard" in text for text in client.texts())
    assert client.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    assert client.now_s > lost_at_s


def test_offboard_resumes_by_itself_when_the_stream_returns() -> None:
    client, stream = cruising()
    client.wait(2.0)
    assert mode_of(client) is Mode.HOLD
    client.wait(0.2, stream)
    assert mode_of(client) is Mode.HOLD
    client.wait(0.2, stream)
    assert mode_of(client) is Mode.OFFBOARD


def test_a_pilots_choice_during_the_failsafe_is_final() -> None:
    client, stream = cruising()
    client.wait(2.0)
    client.set_mode(Mode.HOLD)
    client.wait(1.0, stream)
    assert mode_of(client) is Mode.HOLD


@pytest.mark.parametrize(
    ("action", "mode"), [(3, Mode.RTL), (4, Mode.LAND), (5, Mode.HOLD), (0, Mode.POSCTL)]
)
def test_offboard_loss_action_follows_its_parameter(action: int, mode: Mode) -> None:
    client, _ = cruising(parameters={"COM_OBL_RC_ACT": action})
    client.wait(1.5)
    assert mode_of(client) is mode
    if mode is Mode.POSCTL:  # as on PX4 without remote control: it sinks
        client.wait(8.0)
        assert not client.vehicle.autopilot.commander.armed


PVA = (5.0, 1.0, -4.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("mask", "changes", "counts"),
    [
        (0x0C00, {}, True),
        (0x0DF8, {}, True),  # position
        (0x0DC0, {}, True),  # position and velocity
        (0x0DC7, {}, True),  # velocity
        (0x0C3F, {}, True),  # acceleration
        (0x0DE3, {}, True),  # velocity across, position up
        (0x0DC7, {"frame": mavlink.MAV_FRAME_BODY_NED}, True),
        (0x0C00, {"target_system": 0, "target_component": 0}, True),
        (0x09FF, {}, False),  # yaw only
        (0x0FFF, {}, False),
        (0x0C00, {"frame": mavlink.MAV_FRAME_LOCAL_OFFSET_NED}, False),
        (0x0C00, {"frame": mavlink.MAV_FRAME_BODY_OFFSET_NED}, False),
        (0x0C00, {"target_system": 2}, False),
        (0x0C00, {"target_component": 196}, False),
        (0x0E00, {}, False),  # a force
        (0x0FC0, {}, True),  # no force where acceleration is masked
        (0x0DC6, {}, True),  # not on every axis: it brakes
    ],
)
def test_which_setpoints_count_as_a_sign_of_life(
    mask: int, changes: dict[str, int], *, counts: bool
) -> None:
    client = in_air()
    client.setpoint(PVA, mask, **changes)
    expected = mavlink.MAV_RESULT_ACCEPTED if counts else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert client.set_mode(Mode.OFFBOARD) == expected


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf])
def test_setpoints_that_are_no_numbers_do_not_count(bad: float) -> None:
    client = in_air()
    client.setpoint((bad,) * 9)
    assert client.set_mode(Mode.OFFBOARD) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_body_velocity_turns_with_the_heading() -> None:
    start = StartConfig(position_ned_m=(0.0, 0.0, -4.0), yaw_deg=90.0)
    client = on_ground(start=start)

    def forward(_: float) -> None:
        client.setpoint((0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0x0DC7, frame=8)

    client.wait(0.1, forward)
    client.set_mode(Mode.OFFBOARD)
    client.wait(3.0, forward)
    assert client.vehicle.truth.velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0), abs=0.05)


def test_position_target_echoes_what_is_flown() -> None:
    client, _ = cruising()
    target = client.of("POSITION_TARGET_LOCAL_NED")[-1]
    assert (target.vx, target.z) == pytest.approx((2.8, -4.0))
    assert target.x == pytest.approx(client.vehicle.truth.position_ned_m[0], abs=0.5)


def test_offboard_takes_off_from_the_ground() -> None:
    client = on_ground()
    up = (0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.wait(0.1, lambda _: client.setpoint(up))
    client.set_mode(Mode.OFFBOARD)
    client.arm()
    client.wait(5.0, lambda _: client.setpoint(up))
    assert client.vehicle.truth.position_ned_m[2] == pytest.approx(-2.0, abs=0.05)


# --- parameters -----------------------------------------------------------------------------


def test_parameter_list_is_complete_and_integers_travel_bytewise() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    _, *values = client.of("PARAM_VALUE")  # the hash comes first
    assert [value.param_index for value in values] == list(range(values[0].param_count))
    assert [value.param_id for value in values] == sorted(value.param_id for value in values)
    action = next(value for value in values if value.param_id == "COM_OBL_RC_ACT")
    assert action.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert struct.unpack("<i", struct.pack("<f", action.param_value)) == (5,)


def test_changing_the_tilt_limit_changes_the_flight() -> None:
    client = in_air()
    client.parameter("MPC_TILTMAX_AIR", 20.0)
    assert client.of("PARAM_VALUE")[-1].param_value == 20.0
    far = (200.0, 0.0, -4.0, 10.0, 0.0, 0.0, 8.0, 0.0, 0.0)
    client.wait(0.1, lambda _: client.setpoint(far))
    client.set_mode(Mode.OFFBOARD)
    steepest = 0.0

    def push(_: float) -> None:
        nonlocal steepest
        client.setpoint(far)
        steepest = max(steepest, math.degrees(client.vehicle.truth.tilt_rad))

    client.wait(1.0, push)
    assert 18.0 < steepest < 22.0


def test_changing_the_speed_limit_changes_the_flight() -> None:
    client = in_air()
    client.parameter("MPC_XY_VEL_MAX", 1.5)
    fast = (0.0, 0.0, -4.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.wait(0.1, lambda _: client.setpoint(fast, 0x0DC3))
    client.set_mode(Mode.OFFBOARD)
    client.wait(4.0, lambda _: client.setpoint(fast, 0x0DC3))
    assert client.vehicle.truth.velocity_ned_mps[0] == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("NO_SUCH_PARAM", 1.0, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST),
        ("MPC_TILTMAX_AIR", 95.0, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        ("MPC_TILTMAX_AIR", NAN, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        ("MAV_SYS_ID", 2.0, mavlink.MAV_PARAM_ERROR_READ_ONLY),
    ],
)
def test_bad_parameter_values_are_refused_by_name(name: str, value: float, error: int) -> None:
    client = on_ground()
    before = {n: client.vehicle.autopilot.parameters[n] for n in ("MPC_TILTMAX_AIR", "MAV_SYS_ID")}
    client.parameter(name, value)
    refusal = client.of("PARAM_ERROR")[-1]
    assert (refusal.param_id, refusal.error) == (name, error)
    assert not client.of("PARAM_VALUE")
    assert all(client.vehicle.autopilot.parameters[n] == v for n, v in before.items())


def test_reading_an_unknown_parameter_is_answered_at_once() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"SYS_NO_SUCH", -1))
    assert client.of("PARAM_ERROR")[-1].param_id == "SYS_NO_SUCH"
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 0))
    assert client.of("PARAM_VALUE")[-1].param_index == 0


# --- commands and telemetry ------------------------------------------------------------------


def test_streams_have_their_rates() -> None:
    client = on_ground()
    client.received.clear()
    client.wait(4.0)
    for name, rate_hz in {"ATTITUDE": 50, "LOCAL_POSITION_NED": 50, "HEARTBEAT": 1}.items():
        assert len(client.of(name)) == pytest.approx(4 * rate_hz, abs=1)
    assert not client.of("ODOMETRY")


def test_message_interval_is_set_reported_and_reset() -> None:
    client = on_ground()
    odometry = mavlink.MAVLINK_MSG_ID_ODOMETRY
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, odometry, 100_000) == 0
    assert client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, odometry) == 0
    assert client.of("MESSAGE_INTERVAL")[-1].interval_us == 100_000
    client.wait(2.0)
    assert len(client.of("ODOMETRY")) == pytest.approx(20, abs=1)
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, -1) == 0
    client.received.clear()
    client.wait(1.0)
    assert not client.of("LOCAL_POSITION_NED")
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 0)
    client.wait(1.0)
    assert len(client.of("LOCAL_POSITION_NED")) == pytest.approx(50, abs=2)


@pytest.mark.parametrize(
    "name",
    ["AUTOPILOT_VERSION", "HOME_POSITION", "EXTENDED_SYS_STATE", "GPS_GLOBAL_ORIGIN", "ODOMETRY"],
)
def test_messages_come_on_request(name: str) -> None:
    client = on_ground()
    client.received.clear()
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number) == 0
    assert len(client.of(name)) == 1


@pytest.mark.parametrize(
    ("number", "parameters", "result"),
    [
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (395.0,), mavlink.MAV_RESULT_UNSUPPORTED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (NAN,), mavlink.MAV_RESULT_UNSUPPORTED),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (9999.0, 1.0), mavlink.MAV_RESULT_DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 99.0), mavlink.MAV_RESULT_DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (NAN, 6.0), mavlink.MAV_RESULT_DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 3.0), mavlink.MAV_RESULT_TEMPORARILY_REJECTED),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (0.0, -3.0), mavlink.MAV_RESULT_DENIED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.5,), mavlink.MAV_RESULT_DENIED),
        (31_000, (), mavlink.MAV_RESULT_UNSUPPORTED),
    ],
)
def test_commands_that_cannot_be_done_say_so(
    number: int, parameters: tuple[float, ...], result: int
) -> None:
    assert on_ground().command(number, *parameters) == result


def test_timesync_echoes_the_asked_time_beside_its_own() -> None:
    client = on_ground()
    client.send(mavlink.MAVLink_timesync_message(0, 123_456))
    answer = client.of("TIMESYNC")[-1]
    assert answer.ts1 == 123_456
    assert answer.tc1 == pytest.approx(client.now_s * 1e9)


def test_telemetry_tells_the_truth() -> None:
    client, _ = cruising()
    truth = client.vehicle.truth
    position, attitude = client.of("LOCAL_POSITION_NED")[-1], client.of("ATTITUDE")[-1]
    assert (position.x, position.y, position.z) == pytest.approx(truth.position_ned_m, abs=0.06)
    assert (position.vx, position.vy) == pytest.approx(truth.velocity_ned_mps[:2], abs=0.02)
    assert attitude.pitch == pytest.approx(truth.pitch_rad, abs=0.01)
    assert client.of("BATTERY_STATUS")[-1].voltages[0] == pytest.approx(16_500, abs=400)


# --- links ------------------------------------------------------------------------------------


def test_status_texts_go_only_where_a_ground_station_speaks() -> None:
    client = on_ground()
    other = Client(client.vehicle, link=1)
    other.send(
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 0, 3)
    )
    client.arm()
    client.wait(0.1)
    other.collect()
    assert client.texts() == ["Armed"]
    assert not other.texts()


def test_a_companions_messages_reach_the_ground_station_but_commands_stay() -> None:
    ground = on_ground()
    companion = Client(ground.vehicle, link=1)
    companion.send(mavlink.MAVLink_statustext_message(4, b"obstacle ahead"))
    companion.setpoint(PVA)
    ground.collect()
    (text,) = ground.of("STATUSTEXT")
    assert (text.text, text.get_srcComponent()) == ("obstacle ahead", COMPANION)
    assert not ground.of("SET_POSITION_TARGET_LOCAL_NED")
    companion.collect()
    assert not companion.of("STATUSTEXT")


def test_each_command_is_acknowledged_on_its_own_link() -> None:
    first = on_ground()
    second = Client(first.vehicle, link=7, system=245, component=190)
    assert second.command(mavlink.MAV_CMD_GET_HOME_POSITION) == 0
    first.collect()
    assert not first.of("COMMAND_ACK")
    assert second.of("COMMAND_ACK")[-1].target_system == 245


def frame(message: Any) -> bytes:
    outbox = Outbox()
    mavlink.MAVLink(outbox, 1, COMPANION).send(message)
    return bytes(outbox)


ARM = frame(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))


@given(st.binary(max_size=300), st.lists(st.integers(1, 40), max_size=8))
@settings(max_examples=150, deadline=None)
def test_an_intact_frame_survives_any_garbage_around_it(garbage: bytes, cuts: list[int]) -> None:
    vehicle = SimulatedVehicle(VehicleConfig())
    data = garbage + ARM + bytes(300)  # zeros start no frame, and end every false one
    start = 0
    for cut in [*cuts, len(data)]:
        vehicle.receive(data[start : start + cut])
        start += cut
    acks = mavlink.MAVLink(None, 1, COMPANION).parse_buffer(vehicle.bytes_to_send()) or []
    assert "COMMAND_ACK" in {message.get_type() for message in acks}
    assert vehicle.autopilot.bytes_dropped(0) == len(garbage) + 300


@given(st.binary(max_size=2000))
@settings(max_examples=200, deadline=None)
def test_garbage_is_counted_and_moves_nothing(garbage: bytes) -> None:
    vehicle = SimulatedVehicle(VehicleConfig())
    vehicle.receive(garbage + bytes(300))
    vehicle.advance(0.05)
    assert vehicle.autopilot.bytes_dropped(0) == len(garbage) + 300
    assert vehicle.truth.position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


@given(position=st.integers(0, len(ARM) - 1), flip=st.integers(1, 255))
@settings(max_examples=100, deadline=None)
def test_a_damaged_frame_is_not_obeyed(position: int, flip: int) -> None:
    vehicle = SimulatedVehicle(VehicleConfig())
    vehicle.advance(1.5)
    damaged = bytearray(ARM)
    damaged[position] ^= flip
    vehicle.receive(bytes(damaged) + bytes(300))
    assert not vehicle.autopilot.commander.armed


def valid_frame(message_id: int, payload: bytes) -> bytes:
    """A frame with the right checksum around any payload, built by hand."""
    kind = mavlink.mavlink_map[message_id]
    size = kind.unpacker.size
    body = payload[:size].ljust(size, b"\0")
    header = bytes([size, 0, 0, 0, 1, COMPANION, *message_id.to_bytes(3, "little")])
    checksum = mavlink.x25crc(header + body + bytes([kind.crc_extra])).crc
    return b"\xfd" + header + body + int(checksum).to_bytes(2, "little")


HANDLED = [
    getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    for name in SimulatedVehicle(VehicleConfig()).autopilot._handlers
]


@given(st.lists(st.tuples(st.sampled_from(HANDLED), st.binary(max_size=64)), max_size=12))
@settings(max_examples=150, deadline=None)
def test_valid_frames_with_any_content_never_raise(frames: list[tuple[int, bytes]]) -> None:
    start = StartConfig(position_ned_m=(0.0, 0.0, -4.0))
    vehicle = SimulatedVehicle(VehicleConfig(start=start))
    for message_id, payload in frames:
        vehicle.receive(valid_frame(message_id, payload))
        vehicle.advance(vehicle.truth.time_s + 0.02)
    vehicle.bytes_to_send()
    assert all(map(math.isfinite, vehicle.truth.position_ned_m))


numbers = st.floats(width=32)


@given(
    st.sampled_from([16, 20, 21, 22, 176, 178, 185, 192, 400, 410, 510, 511, 512, 520]),
    st.lists(numbers, min_size=7, max_size=7),
)
@settings(max_examples=50, deadline=None)
def test_commands_with_any_numbers_never_raise(number: int, parameters: list[float]) -> None:
    client = in_air()
    client.command(number, *parameters)
    client.wait(0.1)
    assert all(map(math.isfinite, client.vehicle.truth.position_ned_m))


@given(st.lists(numbers, min_size=11, max_size=11), st.integers(0, 0xFFFF), st.integers(0, 20))
@settings(max_examples=50, deadline=None)
def test_setpoints_with_any_numbers_keep_the_vehicle_flying(
    values: list[float], mask: int, coordinate_frame: int
) -> None:
    client = in_air()
    hold = (0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    client.setpoint(hold)
    client.set_mode(Mode.OFFBOARD)
    client.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, coordinate_frame, mask, *values
        )
    )
    client.wait(0.2)
    truth = client.vehicle.truth
    assert all(map(math.isfinite, (*truth.position_ned_m, *truth.attitude_quaternion)))
    assert truth.tilt_rad < math.radians(60.0)
