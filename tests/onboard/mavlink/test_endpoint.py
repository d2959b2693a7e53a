"""What the service reads from an autopilot: modes, poses, targets, reports, and garbage."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.position_reports import GpsReport, HealthReport
from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.px4 import PX4
from onboard.mavlink.transmitter import COMPONENT_ID, Transmitter

OFFBOARD = 6 << 16
LOITER = 4 << 16 | 3 << 24


class Autopilot:
    """The other end: encodes what an autopilot says, decodes what we say."""

    def __init__(self, system: int = 1, component: int = 1) -> None:
        self._out = bytearray()
        self.mav = mavlink.MAVLink(self, system, component)
        self.mav.robust_parsing = True

    def write(self, data: bytes) -> None:
        self._out += data

    def said(self) -> bytes:
        data, self._out = bytes(self._out), bytearray()
        return data

    def heard(self, data: bytes) -> Iterator[Any]:
        yield from self.mav.parse_buffer(data) or []

    def heartbeat(self, custom_mode: int, *, armed: bool, autopilot: int = 12) -> bytes:
        base_mode = 128 if armed else 0
        self.mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, autopilot, base_mode, custom_mode, 4)
        return self.said()

    def position(self, x_m: float, vx_mps: float = 0.0) -> bytes:
        self.mav.local_position_ned_send(0, x_m, 2.0, -4.0, vx_mps, 0.1, 0.2)
        return self.said()

    def attitude(self, yaw_rad: float = 0.5) -> bytes:
        self.mav.attitude_send(0, 0.1, 0.2, yaw_rad, 0.0, 0.0, 0.0)
        return self.said()

    def target(self) -> bytes:
        self.mav.position_target_local_ned_send(0, mavlink.MAV_FRAME_LOCAL_NED, 0, *(0.0,) * 11)
        return self.said()

    def estimator(self, flags: int) -> bytes:
        self.mav.estimator_status_send(0, flags, 0.25, 0.5, 0.75, 0.1, 0.0, 0.0, 2.0, 3.0)
        return self.said()

    def fix(self, fix_type: int) -> bytes:
        self.mav.gps_raw_int_send(0, fix_type, 0, 0, 0, 70, 90, 0, 0, 10)
        return self.said()

    def health(self, health: int) -> bytes:
        self.mav.sys_status_send(0x2F, 0x2F, health, *(0,) * 10)
        return self.said()

    def landed_state(self, state: int) -> bytes:
        self.mav.extended_sys_state_send(0, state)
        return self.said()


def asks_for_the_origin(message: Any) -> bool:
    """Once in five seconds until it comes: places are known again by it after a restart."""
    once = message.command == mavlink.MAV_CMD_REQUEST_MESSAGE
    return bool(once and message.param1 == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)


@pytest.fixture
def endpoint() -> MavlinkEndpoint:
    return MavlinkEndpoint(system_id=1)


@pytest.fixture
def autopilot() -> Autopilot:
    return Autopilot()


@pytest.mark.parametrize(
    ("custom_mode", "autopilot_type", "name", "external"),
    [
        (OFFBOARD, 12, "OFFBOARD", True),
        (LOITER, 12, "LOITER", False),
        (3 << 16, 12, "POSCTL", False),
        (4, 3, "GUIDED", True),
        (5, 3, "LOITER", False),
        (17, 3, "BRAKE", False),
        (99, 3, "COPTER 99", False),
        (OFFBOARD, 13, f"MODE {OFFBOARD}", False),
        (4, 0, "MODE 4", False),
        (OFFBOARD, 3, "COPTER 393216", False),
    ],
)
def test_mode_is_read_by_the_profile_of_the_autopilot(
    endpoint: MavlinkEndpoint,
    autopilot: Autopilot,
    custom_mode: int,
    autopilot_type: int,
    name: str,
    external: bool,
) -> None:
    endpoint.receive(autopilot.heartbeat(custom_mode, armed=True, autopilot=autopilot_type), 3.0)
    assert endpoint.status.mode == name
    assert endpoint.status.external_control is external
    assert endpoint.status.armed
    assert endpoint.status.heard_s == 3.0


def test_pose_needs_attitude_and_position(endpoint: MavlinkEndpoint, autopilot: Autopilot) -> None:
    endpoint.receive(autopilot.position(1.0), 0.1)
    assert endpoint.pose is None
    endpoint.receive(autopilot.attitude(), 0.2)
    endpoint.receive(autopilot.position(1.5, vx_mps=2.0), 0.3)
    assert endpoint.pose is not None
    assert endpoint.pose.time_s == 0.3
    assert endpoint.pose.position_ned_m == (1.5, 2.0, -4.0)
    assert endpoint.pose.velocity_ned_mps == pytest.approx((2.0, 0.1, 0.2))
    assert endpoint.pose.yaw_rad == 0.5


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_position_that_is_no_number_is_counted_and_dropped(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, bad: float
) -> None:
    endpoint.receive(autopilot.attitude() + autopilot.position(bad) + autopilot.attitude(bad), 0.0)
    assert endpoint.pose is None
    assert endpoint.counters.malformed_messages == 2


@pytest.mark.parametrize(("x_m", "vx_mps"), [(1e20, 0.0), (0.0, 3e38), (-1e7, 0.0), (0.0, -2e3)])
def test_absurd_position_is_counted_and_dropped(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, x_m: float, vx_mps: float
) -> None:
    endpoint.receive(autopilot.attitude() + autopilot.position(x_m, vx_mps=vx_mps), 0.0)
    assert endpoint.pose is None
    assert endpoint.counters.malformed_messages == 1


def test_airborne_is_unknown_until_said(endpoint: MavlinkEndpoint, autopilot: Autopilot) -> None:
    assert endpoint.status.airborne is None
    endpoint.receive(autopilot.landed_state(mavlink.MAV_LANDED_STATE_IN_AIR), 0.0)
    assert endpoint.status.airborne is True
    endpoint.receive(autopilot.landed_state(mavlink.MAV_LANDED_STATE_ON_GROUND), 0.0)
    assert endpoint.status.airborne is False


@pytest.mark.parametrize(("system", "component"), [(2, 1), (1, 195)])
def test_other_systems_and_components_are_ignored(
    endpoint: MavlinkEndpoint, system: int, component: int
) -> None:
    stranger = Autopilot(system, component)
    endpoint.receive(stranger.heartbeat(OFFBOARD, armed=True), 1.0)
    assert endpoint.status.mode == "unknown"
    assert endpoint.counters.foreign_messages == 1


@pytest.mark.parametrize("autopilot_id", [3, 12])
def test_the_profile_is_that_of_the_heartbeat(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, autopilot_id: int
) -> None:
    endpoint.receive(autopilot.heartbeat(0, armed=True, autopilot=autopilot_id), 1.0)
    assert endpoint.profile is {3: ARDUPILOT, 12: PX4}[autopilot_id]


@pytest.mark.parametrize(
    ("type_mask", "has_position", "has_velocity"),
    [
        (0, True, True),  # PX4
        (3072, True, True),  # ArduPilot, as asked for by us
        (3079, False, True),  # a velocity alone; its position reads zero
        (3576, True, False),  # a take-off
        (4, False, True),
        (32, True, False),
    ],
)
def test_what_a_target_ignores_is_no_number(
    endpoint: MavlinkEndpoint,
    autopilot: Autopilot,
    type_mask: int,
    *,
    has_position: bool,
    has_velocity: bool,
) -> None:
    autopilot.mav.position_target_local_ned_send(
        0, mavlink.MAV_FRAME_LOCAL_NED, type_mask, 1.0, 2.0, -4.0, 2.5, 0.5, 0.25, *(0.0,) * 5
    )
    endpoint.receive(autopilot.said(), 3.0)
    position_ned_m, velocity_ned_mps = endpoint.target
    assert endpoint.target_heard_s == 3.0
    nothing = pytest.approx((math.nan,) * 3, nan_ok=True)
    assert position_ned_m == ((1.0, 2.0, -4.0) if has_position else nothing)
    assert velocity_ned_mps == ((2.5, 0.5, 0.25) if has_velocity else nothing)


COMMON_IDS = {1, 24, 30, 32, 85, 245}


@pytest.mark.parametrize(
    ("autopilot_type", "estimator_id"),
    [(mavlink.MAV_AUTOPILOT_PX4, 230), (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 193), (0, 230)],
)
def test_missing_telemetry_is_asked_for_until_it_comes(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, autopilot_type: int, estimator_id: int
) -> None:
    beat = autopilot.heartbeat(LOITER, armed=False, autopilot=autopilot_type)
    asked = []
    for tick in range(250):
        endpoint.receive(beat, tick * 0.02)
        endpoint.keep_alive(tick * 0.02, active=False)
        asked += [
            (message.command, int(message.param1), round(1e6 / message.param2))
            for message in autopilot.heard(endpoint.bytes_to_send())
            if message.get_type() == "COMMAND_LONG" and not asks_for_the_origin(message)
        ]
    assert {command for command, _, _ in asked} == {mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}
    assert {message_id for _, message_id, _ in asked} == COMMON_IDS | {estimator_id}
    assert len(asked) == 3 * 7  # at once, and every two seconds
    rates_hz = {message_id: rate_hz for _, message_id, rate_hz in asked}
    assert (rates_hz[32], rates_hz[24], rates_hz[1], rates_hz[estimator_id]) == (50, 5, 2, 5)


def test_position_that_px4_streams_unasked_at_30_hz_is_asked_for_at_50(
    endpoint: MavlinkEndpoint, autopilot: Autopilot
) -> None:
    """PX4's onboard link: ATTITUDE at 100 Hz is left alone, others may need it."""
    asked = []
    for step in range(300):
        now_s = step * 0.01
        data = autopilot.attitude()
        if step % 3 == 0:
            data += autopilot.position(0.0)
        if step % 20 == 0:
            data += autopilot.landed_state(2) + autopilot.fix(3) + autopilot.health(0x2F)
        if step % 100 == 0:
            data += autopilot.heartbeat(LOITER, armed=True) + autopilot.estimator(0x37F)
        if step % 10 == 0:
            data += autopilot.target()
        endpoint.receive(data, now_s)
        if step % 2:
            endpoint.keep_alive(now_s, active=False)
            heard = autopilot.heard(endpoint.bytes_to_send())
            asked += [
                int(m.param1)
                for m in heard
                if m.get_type() == "COMMAND_LONG" and not asks_for_the_origin(m)
            ]
    assert set(asked) == {32, 85, 230}


@pytest.mark.parametrize(
    ("system_status", "failsafe"), [(3, False), (4, False), (5, True), (6, True)]
)
def test_failsafe_is_read(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, system_status: int, *, failsafe: bool
) -> None:
    autopilot.mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, 12, 128, LOITER, system_status)
    endpoint.receive(autopilot.said(), 0.0)
    assert endpoint.status.failsafe is failsafe


def test_what_the_autopilot_says_of_its_position_is_read(
    endpoint: MavlinkEndpoint, autopilot: Autopilot
) -> None:
    reports = endpoint.position_reports
    assert (reports.estimator.report, reports.gps.report, reports.health.report) == (None,) * 3
    endpoint.receive(autopilot.heartbeat(4, armed=True, autopilot=3), 1.0)
    assert reports.facts is ARDUPILOT.estimator
    endpoint.receive(autopilot.estimator(0x37F), 1.1)
    assert reports.estimator.report is not None
    assert reports.estimator.report.name == "ESTIMATOR_STATUS"
    assert reports.estimator.report[1:] == pytest.approx((0x37F, 0.25, 0.5, 0.75, 2.0))
    autopilot.mav.ekf_status_report_send(0x33F, 0.25, 0.5, 0.75, 0.1, 0.0)
    endpoint.receive(autopilot.said(), 1.2)
    assert reports.estimator.report.name == "EKF_STATUS_REPORT"
    assert reports.estimator.report[1:5] == (0x33F, 0.25, 0.5, 0.75)
    assert math.isnan(reports.estimator.report.accuracy_m)
    assert reports.estimator.heard_s == 1.2
    assert reports.estimator.interval_s == pytest.approx(0.1)
    endpoint.receive(autopilot.fix(3), 1.3)
    endpoint.receive(autopilot.fix(1), 1.5)
    assert (reports.gps.report, reports.fix_s) == (GpsReport(1), 1.3)
    endpoint.receive(autopilot.health(0x20), 1.6)
    assert reports.health.report == HealthReport(0x2F, 0x2F, 0x20)
    for severity in range(8):
        autopilot.mav.statustext_send(severity, f"text {severity}".encode())
    endpoint.receive(autopilot.said(), 1.7)
    assert reports.texts == [(1.7, f"text {severity}") for severity in range(5)]


def test_texts_are_bounded(endpoint: MavlinkEndpoint, autopilot: Autopilot) -> None:
    for number in range(100):
        autopilot.mav.statustext_send(2, f"{number}".encode())
    endpoint.receive(autopilot.said(), 0.0)
    assert [text for _, text in endpoint.position_reports.texts][-1] == "99"
    assert len(endpoint.position_reports.texts) == 20


@given(st.binary(max_size=400))
def test_garbage_never_raises_and_is_counted(data: bytes) -> None:
    endpoint = MavlinkEndpoint(system_id=1)
    endpoint.receive(data, 0.0)
    assert endpoint.pose is None
    assert endpoint.counters.garbage_bytes <= len(data)


def test_good_messages_survive_garbage_around_them(
    endpoint: MavlinkEndpoint, autopilot: Autopilot
) -> None:
    data = b"\x00garbage" + autopilot.heartbeat(OFFBOARD, armed=True) + b"\xff" * 7
    data += autopilot.attitude() + autopilot.position(3.0)
    for index in range(len(data)):  # byte by byte, as a slow serial line does
        endpoint.receive(data[index : index + 1], 1.0)
    assert endpoint.status.mode == "OFFBOARD"
    assert endpoint.pose is not None
    assert endpoint.counters.garbage_bytes >= 8


def test_corrupted_message_is_dropped(endpoint: MavlinkEndpoint, autopilot: Autopilot) -> None:
    beat = bytearray(autopilot.heartbeat(OFFBOARD, armed=True))
    beat[12] ^= 0x01
    endpoint.receive(bytes(beat), 1.0)
    assert endpoint.status.mode == "unknown"
    assert endpoint.counters.garbage_bytes == len(beat)


def test_position_with_an_old_attitude_is_no_pose(
    endpoint: MavlinkEndpoint, autopilot: Autopilot
) -> None:
    endpoint.receive(autopilot.attitude(), 0.0)
    endpoint.receive(autopilot.position(1.0), 0.1)
    endpoint.receive(autopilot.position(2.0), 1.0)
    assert endpoint.pose is not None
    assert endpoint.pose.position_ned_m[0] == 1.0


def obstacle_distance(system: int, component: int) -> bytes:
    stranger = Autopilot(system, component)
    stranger.mav.obstacle_distance_send(0, 0, [500] * 72, 5, 20, 1000)
    return stranger.said()


@pytest.mark.parametrize("component", [1, 195])
def test_ranges_are_taken_from_any_component_of_the_vehicle(
    endpoint: MavlinkEndpoint, component: int
) -> None:
    endpoint.range_messages = frozenset({mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE})
    data = obstacle_distance(1, component)
    endpoint.receive(data + obstacle_distance(2, 1), 1.0)
    assert endpoint.take_ranges() == [(mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, data)]
    assert endpoint.take_ranges() == []
    assert endpoint.counters.foreign_messages == 0


def test_our_own_ranges_routed_back_to_us_are_no_measurement(endpoint: MavlinkEndpoint) -> None:
    endpoint.range_messages = frozenset({mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE})
    ours = Transmitter(1)
    ours.send_obstacle_distance([500] * 72, 1.79e9)
    sent = ours.bytes_to_send()
    endpoint.receive(sent + obstacle_distance(1, COMPONENT_ID), 1.0)
    assert sent
    assert endpoint.take_ranges() == []
    assert endpoint.counters.foreign_messages == 2


def test_a_flood_of_ranges_keeps_the_newest(endpoint: MavlinkEndpoint) -> None:
    endpoint.range_messages = frozenset({mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE})
    endpoint.receive(obstacle_distance(1, 1) * 100, 1.0)
    assert len(endpoint.take_ranges()) == 32


@pytest.mark.parametrize("wanted", [True, False])
def test_ranges_are_requested_where_they_are_wanted(
    endpoint: MavlinkEndpoint, autopilot: Autopilot, wanted: bool
) -> None:
    if wanted:
        endpoint.range_messages = frozenset({mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR})
    endpoint.receive(autopilot.heartbeat(OFFBOARD, armed=True), 0.0)
    endpoint.keep_alive(0.1, active=False)
    requested = {
        int(message.param1)
        for message in autopilot.heard(endpoint.bytes_to_send())
        if message.get_type() == "COMMAND_LONG"
    }
    assert (mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR in requested) is wanted
