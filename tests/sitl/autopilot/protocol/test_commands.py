"""Which command does what, and with which result it is acknowledged."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.decisions import Verdict
from sitl.autopilot.modes import Mode
from sitl.autopilot.protocol.commands import Command, CommandContext, execute
from sitl.autopilot.protocol.files.file_transfer import FileServer
from sitl.autopilot.protocol.files.onboard_files import metadata_files
from sitl.autopilot.protocol.link import MavlinkLink
from sitl.autopilot.protocol.snapshot import Snapshot
from sitl.autopilot.protocol.streams import StreamSchedule
from sitl.config import VehicleConfig
from sitl.plant.battery import BatteryReading
from sitl.vehicle.autopilot import Autopilot
from tests.sitl.autopilot.truths import truth_at

NAN = math.nan
FLYING = truth_at(10.0, (5.0, 6.0, -7.0))
STANDING = truth_at(10.0)
ACCEPTED, DENIED, UNSUPPORTED = Verdict.ACCEPTED, Verdict.DENIED, Verdict.UNSUPPORTED


class Bench:
    """An autopilot that flies, or stands, and a link to it."""

    def __init__(self, *, flying: bool = True, **config: Any) -> None:
        truth = FLYING if flying else STANDING
        battery = BatteryReading(16.0, 1.0, 1.0, 0.0)
        vehicle = VehicleConfig.model_validate({"realism": "ideal", **config})
        autopilot = Autopilot(vehicle, truth, battery)
        self.commander = autopilot.commander
        self.link, self.streams = MavlinkLink(1, 1), StreamSchedule({0: 1.0})
        snapshot = Snapshot(
            truth,
            battery,
            autopilot.commander,
            vehicle.home,
            autopilot.flavour,
            0.0,
            autopilot.realism,
            autopilot.estimator,
        )
        self._context = CommandContext(
            autopilot.commander,
            autopilot.flavour,
            vehicle.home,
            snapshot,
            self.link,
            self.streams,
            FileServer(metadata_files(autopilot.parameters)),
        )

    def do(self, number: int, *parameters: float, frame: int = mavlink.MAV_FRAME_GLOBAL) -> Verdict:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return execute(Command(number, padded, frame), self._context)

    def sent(self) -> list[str]:
        messages = mavlink.MAVLink(None).parse_buffer(self.link.take()) or []
        return [message.get_type() for message in messages]


@pytest.mark.parametrize(
    ("number", "parameters", "result"),
    [
        (65_000, (), UNSUPPORTED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (2.0,), DENIED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (NAN,), DENIED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), ACCEPTED),
        (mavlink.MAV_CMD_DO_SET_MODE, (0.0, 4.0, 3.0), DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 99.0, 0.0), DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, NAN, 0.0), DENIED),
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 4.0, 6.0), ACCEPTED),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, 5.0), ACCEPTED),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, -1.0), DENIED),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, NAN), DENIED),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, 100.0), DENIED),
        (mavlink.MAV_CMD_MISSION_START, (0.5,), DENIED),
        (mavlink.MAV_CMD_MISSION_START, (0.0,), DENIED),
        (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, (0.0,), DENIED),
        (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, (0.0,), DENIED),
        (mavlink.MAV_CMD_INJECT_FAILURE, (4.0, 1.0, 0.0), DENIED),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (9999.0, 1000.0), DENIED),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (30.0, NAN), DENIED),
        (mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, (9999.0,), ACCEPTED),
        (mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, (70_000.0,), DENIED),
        (mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, (NAN,), DENIED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (9999.0,), UNSUPPORTED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (30.5,), UNSUPPORTED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (85.0,), Verdict.TEMPORARILY_REJECTED),
        (mavlink.MAV_CMD_DO_SET_STANDARD_MODE, (99.0,), DENIED),
        (mavlink.MAV_CMD_DO_SET_STANDARD_MODE, (NAN,), DENIED),
        (mavlink.MAV_CMD_DO_SET_STANDARD_MODE, (7.0,), ACCEPTED),
    ],
)
def test_a_command_has_its_result(
    number: int, parameters: tuple[float, ...], result: Verdict
) -> None:
    assert Bench().do(number, *parameters) is result


@pytest.mark.parametrize(
    ("number", "mode"),
    [(mavlink.MAV_CMD_NAV_LAND, Mode.LAND), (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, Mode.RTL)],
)
def test_landing_and_return_are_modes(number: int, mode: Mode) -> None:
    bench = Bench()
    assert bench.do(number) is ACCEPTED
    assert bench.commander.mode is mode


def test_termination_stops_the_rotors_in_flight() -> None:
    bench = Bench()
    assert bench.do(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0) is ACCEPTED
    assert not bench.commander.armed


@pytest.mark.parametrize(
    ("frame", "altitude_m", "result"),
    [
        (mavlink.MAV_FRAME_GLOBAL, 500.0, ACCEPTED),
        (mavlink.MAV_FRAME_GLOBAL, NAN, ACCEPTED),
        (mavlink.MAV_FRAME_GLOBAL, 400.0, DENIED),  # below the ground
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 20.0, ACCEPTED),
        (mavlink.MAV_FRAME_LOCAL_NED, 20.0, DENIED),
    ],
)
def test_a_reposition_needs_a_global_frame_and_a_place_above_the_ground(
    frame: int, altitude_m: float, result: Verdict
) -> None:
    bench = Bench()
    parameters = (-1.0, 0.0, 0.0, NAN, NAN, NAN, altitude_m)
    assert bench.do(mavlink.MAV_CMD_DO_REPOSITION, *parameters, frame=frame) is result


def test_a_reposition_to_another_country_is_denied() -> None:
    parameters = (-1.0, 0.0, 0.0, NAN, 50.0, 8.5, 500.0)
    assert Bench().do(mavlink.MAV_CMD_DO_REPOSITION, *parameters) is DENIED


@pytest.mark.parametrize(
    ("flavour", "altitude_m", "result"),
    [
        ("px4", NAN, ACCEPTED),
        ("px4", 491.0, ACCEPTED),  # 3 m above home, which is 488 m above the sea
        ("px4", 3.0, DENIED),
        ("ardupilot", 3.0, Verdict.FAILED),  # not armed
    ],
)
def test_a_take_off_counts_its_altitude_as_the_flavour_does(
    flavour: str, altitude_m: float, result: Verdict
) -> None:
    bench = Bench(flying=False, flavour=flavour)
    parameters = (NAN, 0.0, 0.0, NAN, NAN, NAN, altitude_m)
    assert bench.do(mavlink.MAV_CMD_NAV_TAKEOFF, *parameters) is result


def test_a_message_interval_is_set_reported_reset_and_stopped() -> None:
    bench, attitude = Bench(), 30.0
    for interval_us, expected_s in ((20_000.0, 0.02), (-1.0, math.inf), (0.0, math.inf)):
        bench.do(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, attitude, interval_us)
        assert bench.streams.interval_s(30) == pytest.approx(expected_s)
    assert bench.do(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 0.0) is ACCEPTED
    assert bench.sent() == ["MESSAGE_INTERVAL"]


@pytest.mark.parametrize("name", ["ATTITUDE", "AUTOPILOT_VERSION", "HOME_POSITION", "SYS_STATUS"])
def test_a_message_comes_on_request(name: str) -> None:
    bench = Bench()
    number = float(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
    assert bench.do(mavlink.MAV_CMD_REQUEST_MESSAGE, number) is ACCEPTED
    assert bench.sent() == [name]


@pytest.mark.parametrize(("realism", "result"), [("ideal", ACCEPTED), ("field", UNSUPPORTED)])
@pytest.mark.parametrize(
    "number",
    [mavlink.MAV_CMD_GET_HOME_POSITION, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES],
)
def test_px4_no_longer_supports_two_requests(number: int, realism: str, result: Verdict) -> None:
    assert Bench(realism=realism).do(number) is result


@pytest.mark.parametrize(
    ("parameters", "arms"),
    [((1.0, 0.0), True), ((1.0, 21196.0), False), ((0.0, 0.0), False), ((2.0, 0.0), False)],
)
def test_only_arming_without_force_needs_authorization(
    parameters: tuple[float, float], arms: bool
) -> None:
    number = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert Command(number, (*parameters, *(0.0,) * 5), 0).arms is arms
    assert not Command(number + 1, (*parameters, *(0.0,) * 5), 0).arms


def test_both_messages_carry_the_same_command() -> None:
    long = mavlink.MAVLink_command_long_message(1, 1, 192, 0, 1, 2, 3, 4, 47.5, 8.5, 500)
    short = mavlink.MAVLink_command_int_message(
        1, 1, mavlink.MAV_FRAME_GLOBAL, 192, 0, 0, 1, 2, 3, 4, 475_000_000, 85_000_000, 500
    )
    assert Command.of(long).parameters == pytest.approx(Command.of(short).parameters)
    assert Command.of(long).frame == Command.of(short).frame


def test_the_largest_integer_means_no_coordinate() -> None:
    message = mavlink.MAVLink_command_int_message(
        1, 1, 0, 192, 0, 0, 0, 0, 0, 0, 2**31 - 1, 2**31 - 1, 500
    )
    assert all(map(math.isnan, Command.of(message).parameters[4:6]))


@given(parameters=st.tuples(*[st.floats()] * 7), data=st.data())
@settings(max_examples=60, deadline=None)
def test_any_numbers_have_a_result(parameters: tuple[float, ...], data: st.DataObject) -> None:
    numbers = (16, 20, 21, 22, 176, 178, 185, 192, 262, 300, 400, 410, 420, 510, 511, 512, 520)
    number = data.draw(st.sampled_from(numbers))
    assert isinstance(Bench().do(number, *parameters), Verdict)
