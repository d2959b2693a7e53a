"""What each fault makes of the bytes between vehicle and service."""

from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.virtual.faults.mavlink import LINK_KEYS, MavlinkFaults
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind
from tests.sitl.virtual.faults.frames import present

SENT = b"".join(b"%05d" % step for step in range(200))


def vehicle() -> mavlink.MAVLink:
    return mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_AUTOPILOT1)


def heard(data: bytes) -> dict[str, Any]:
    """Return the messages in some bytes, by type."""
    codec = mavlink.MAVLink(None)
    return {message.get_type(): message for message in codec.parse_buffer(data) or []}


def telemetry() -> bytes:
    """Return a heartbeat, an attitude, a position and an echoed setpoint."""
    out = vehicle()
    messages = (
        out.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 0),
        out.attitude_encode(20, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
        out.local_position_ned_encode(20, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0),
        out.position_target_local_ned_encode(20, 1, 0, 1.5, 2.5, *(0.0,) * 9),
    )
    return b"".join(message.pack(out) for message in messages)


def through(kind: FaultKind, amount: float) -> tuple[list[bytes], list[bytes]]:
    """Return what arrives of 200 datagrams, down and up."""
    schedule, down, up = FaultSchedule((Fault(kind=kind, amount=amount),), seed=1), [], []
    faults = MavlinkFaults(schedule)
    for step in range(220):
        schedule.advance(step * 0.02, "cruise")
        sent = b"%05d" % step if step < 200 else b""
        down.append(faults.telemetry(sent))
        up.append(faults.setpoints(sent))
    return [d for d in down if d], [d for d in up if d]


def test_without_faults_bytes_pass_untouched() -> None:
    schedule = FaultSchedule((), seed=1)
    faults = MavlinkFaults(schedule)
    for data in (telemetry(), b"garbage", b""):
        assert faults.telemetry(data) == data
        assert faults.setpoints(data) == data
    assert faults.second_commander() == b""


@pytest.mark.parametrize(
    ("kind", "arrives_down", "arrives_up"),
    [
        ("telemetry_lost", False, True),
        ("setpoints_lost", True, False),
        ("link_partitioned", False, False),
    ],
)
def test_a_silenced_way_lets_nothing_pass(
    kind: FaultKind, arrives_down: bool, arrives_up: bool
) -> None:
    faults = MavlinkFaults(present(kind))
    assert bool(faults.telemetry(telemetry())) is arrives_down
    assert bool(faults.setpoints(b"setpoint")) is arrives_up


@pytest.mark.parametrize(
    ("kind", "fewest", "most"), [("link_lossy", 110, 170), ("link_duplicating", 230, 290)]
)
def test_links_lose_and_double_as_named(kind: FaultKind, fewest: int, most: int) -> None:
    for arrived in through(kind, 0.3):
        assert fewest < len(b"".join(arrived)) // 5 < most


def test_a_reordering_link_loses_nothing() -> None:
    for arrived in through("link_reordering", 0.5):
        whole = b"".join(arrived)
        assert sorted(whole[i : i + 5] for i in range(0, 1000, 5)) == sorted(
            SENT[i : i + 5] for i in range(0, 1000, 5)
        )
        assert whole != SENT


def test_a_corrupting_link_keeps_lengths() -> None:
    for arrived in through("link_corrupting", 0.3):
        whole = b"".join(arrived)
        assert len(whole) == len(SENT)
        assert whole != SENT


@pytest.mark.parametrize("kind", sorted(LINK_KEYS))
def test_the_two_ways_have_different_chances_and_a_seed_repeats_them(kind: FaultKind) -> None:
    assert through(kind, 0.3) == through(kind, 0.3)
    down, up = through(kind, 0.3)
    assert down != up


def test_corrupted_telemetry_differs_by_one_bit_in_its_share_of_datagrams() -> None:
    faults, sent = MavlinkFaults(present("telemetry_corrupted", 0.25)), telemetry()
    changed = 0
    for _ in range(400):
        arrived = faults.telemetry(sent)
        assert len(arrived) == len(sent)
        flipped = sum((a ^ b).bit_count() for a, b in zip(sent, arrived, strict=True))
        assert flipped <= 1
        changed += flipped
    assert 70 < changed < 130
    assert faults.telemetry(b"") == b""


def test_lost_heartbeats_leave_the_rest() -> None:
    arrived = heard(MavlinkFaults(present("heartbeats_lost")).telemetry(telemetry()))
    assert set(arrived) == {"ATTITUDE", "LOCAL_POSITION_NED", "POSITION_TARGET_LOCAL_NED"}
    assert arrived["LOCAL_POSITION_NED"].y == 2.0


def test_a_stuck_attitude_is_level_and_keeps_its_heading() -> None:
    arrived = heard(MavlinkFaults(present("attitude_stuck")).telemetry(telemetry()))
    attitude = arrived["ATTITUDE"]
    assert (attitude.roll, attitude.pitch) == (0.0, 0.0)
    assert attitude.yaw == pytest.approx(0.3)
    assert arrived["LOCAL_POSITION_NED"].y == 2.0


def test_a_reset_moves_what_is_reported_and_moves_setpoints_back() -> None:
    faults = MavlinkFaults(present("position_reset", 3.0))
    arrived = heard(faults.telemetry(telemetry()))
    assert arrived["LOCAL_POSITION_NED"].y == 5.0
    assert arrived["POSITION_TARGET_LOCAL_NED"].y == 5.5
    service = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    service.seq = 17
    heartbeat = service.heartbeat_encode(18, 8, 0, 0, 4).pack(service)
    setpoint = service.set_position_target_local_ned_encode(
        20, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0, 1.0, 5.0, -3.0, *(0.0,) * 8
    ).pack(service)
    flown = heard(faults.setpoints(heartbeat + setpoint))
    assert flown["SET_POSITION_TARGET_LOCAL_NED"].y == 2.0
    assert flown["SET_POSITION_TARGET_LOCAL_NED"].get_seq() == 17
    assert flown["HEARTBEAT"].get_msgbuf() == heartbeat


def test_a_misreported_position_drifts_off_and_back() -> None:
    fault = Fault(kind="position_misreported", start_s=1.0, duration_s=3.0, amount=0.42)
    schedule, out, back = FaultSchedule((fault,), seed=1), vehicle(), mavlink.MAVLink(None)
    faults, reported_m = MavlinkFaults(schedule), []
    for step in range(300):
        schedule.advance(step * 0.02, "cruise")
        position = out.local_position_ned_encode(20 * step, *(0.0,) * 6)
        (message,) = back.parse_buffer(faults.telemetry(position.pack(out)))
        reported_m.append(message.y)
    steps_m = [abs(later - before) for before, later in pairwise(reported_m)]
    assert max(steps_m) <= 0.5 * 0.02 + 1e-6
    assert reported_m[49] == reported_m[-1] == 0.0
    assert reported_m[100] == pytest.approx(0.42)


def test_a_misreported_position_leaves_setpoints_alone() -> None:
    schedule = FaultSchedule((Fault(kind="position_misreported"),), seed=1)
    faults = MavlinkFaults(schedule)
    schedule.advance(2.0, "cruise")
    arrived = heard(faults.telemetry(telemetry()))
    assert arrived["LOCAL_POSITION_NED"].y == pytest.approx(2.3)
    assert arrived["POSITION_TARGET_LOCAL_NED"].y == 2.5
    assert faults.setpoints(b"setpoint") == b"setpoint"


def test_a_second_commander_wants_the_vehicle_at_the_origin() -> None:
    (message,) = heard(MavlinkFaults(present("second_commander")).second_commander()).values()
    assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (message.x, message.y, message.z) == (0.0, 0.0, 0.0)
    assert message.get_srcComponent() == mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
