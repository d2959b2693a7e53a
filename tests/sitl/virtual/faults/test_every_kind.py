"""No kind of fault of detections or MAVLink is without effect on what passes."""

from typing import get_args

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.virtual.faults import detections
from sitl.virtual.faults import mavlink as mavlink_faults
from sitl.virtual.faults.detections import DetectionFaults
from sitl.virtual.faults.mavlink import MavlinkFaults
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind
from tests.sitl.virtual.faults.frames import arriving, two_boxes

STEPS, STEP_S = 60, 0.02
KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


def frames_through(*faults: Fault) -> list[list[bytes]]:
    schedule = FaultSchedule(faults, seed=1)
    applied, arrived = DetectionFaults(schedule), []
    for step in range(STEPS):
        schedule.advance(step * STEP_S, "cruise")
        sent = two_boxes().replace(b"100.0", b"%.2f" % (100.0 + step * STEP_S))
        arrived.append(arriving(applied, [sent]))
    return arrived


def bytes_through(*faults: Fault) -> list[tuple[bytes, bytes, bytes]]:
    schedule = FaultSchedule(faults, seed=1)
    applied, arrived = MavlinkFaults(schedule), []
    vehicle, service = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 1, 191)
    for step in range(STEPS):
        schedule.advance(step * STEP_S, "cruise")
        down = b"".join(
            message.pack(vehicle)
            for message in (
                vehicle.heartbeat_encode(2, 12, 0, step, 4),
                vehicle.attitude_encode(step, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0),
                vehicle.local_position_ned_encode(step, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0),
            )
        )
        up = service.set_position_target_local_ned_encode(
            step, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0, *(1.0,) * 11
        ).pack(service)
        arrived.append((applied.telemetry(down), applied.setpoints(up), applied.second_commander()))
    return arrived


@pytest.mark.parametrize("kind", sorted(detections.KINDS))
def test_every_kind_of_detections_changes_frames(kind: FaultKind) -> None:
    assert frames_through(Fault(kind=kind)) != frames_through()


@pytest.mark.parametrize("kind", sorted(mavlink_faults.KINDS))
def test_every_kind_of_mavlink_changes_bytes(kind: FaultKind) -> None:
    assert bytes_through(Fault(kind=kind)) != bytes_through()


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_repeats_what_a_fault_does(kind: FaultKind) -> None:
    fault = Fault(kind=kind)
    assert frames_through(fault) == frames_through(fault)
    assert bytes_through(fault) == bytes_through(fault)


@pytest.mark.parametrize("kind", KINDS)
def test_other_modules_leave_the_kind_alone(kind: FaultKind) -> None:
    if kind not in detections.KINDS:
        assert frames_through(Fault(kind=kind)) == frames_through()
    if kind not in mavlink_faults.KINDS:
        assert bytes_through(Fault(kind=kind)) == bytes_through()


@pytest.mark.parametrize("kind", KINDS)
def test_after_its_end_nothing_changes_any_more(kind: FaultKind) -> None:
    fault = Fault(kind=kind, duration_s=STEP_S * 10)
    assert frames_through(fault)[-20:] == frames_through()[-20:]
    received = zip(bytes_through(fault)[-5:], bytes_through()[-5:], strict=True)
    for (down, up, foreign), (plain_down, plain_up, _) in received:
        # A misreported position takes longer to drift back.
        assert len(down) == len(plain_down)
        assert up == plain_up
        assert foreign == b""
