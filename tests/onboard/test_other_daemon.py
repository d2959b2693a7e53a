"""Two daemons on one vehicle: one of both flies, and the other neither commands nor departs."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import OTHER_DAEMON_SILENCE_S
from onboard.mavlink.transmitter import COMPONENT_ID
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig


def heartbeat(instance: int, component: int = COMPONENT_ID, system: int = 1) -> bytes:
    """Return what a program on the vehicle's link says once a second."""
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, instance, 3, 3
    )
    return bytes(message.pack(mavlink.MAVLink(None, system, component)))


@pytest.fixture
def rig(contract: Contract, mission: Mission) -> Rig:
    autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S, instance=7)
    rig = Rig(autonomy, mode=OFFBOARD)
    rig.position_ned_m = (0.0, 0.0, -4.0)
    return rig


def hear(rig: Rig, data: bytes, seconds: float) -> None:
    for _ in range(round(seconds)):
        rig.autonomy.receive_mavlink(data, rig.now_s)
        rig.run(1.0)


def test_the_second_neither_commands_nor_departs_until_the_first_has_gone(rig: Rig) -> None:
    rig.autonomy.receive_mavlink(heartbeat(8), rig.now_s)
    hear(rig, heartbeat(8), 6.0)
    assert rig.phase.value == "standby"
    assert rig.setpoints == [], "two that hold it in two places would both command it"
    assert any(
        "another Clearway daemon is on the vehicle's link: stop one of both" in text
        for text in rig.texts("refused")
    )
    rig.run(OTHER_DAEMON_SILENCE_S + 5.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE


def test_the_second_listens_before_it_departs(rig: Rig) -> None:
    """The first says once a second that it is there; the second may begin just after that."""
    rig.run(0.96)
    assert rig.phase.value == "standby"
    hear(rig, heartbeat(8), 4.0)
    assert rig.phase.value == "standby"


def test_the_first_flies_on(rig: Rig) -> None:
    rig.run(4.0)
    assert rig.phase is Phase.CRUISE
    sent = len(rig.setpoints)
    hear(rig, heartbeat(8), 2.0)
    assert rig.phase is Phase.CRUISE
    assert len(rig.setpoints) == sent + 100


@pytest.mark.parametrize(
    "data",
    [
        heartbeat(7),  # our own, which a router has sent back
        heartbeat(8, component=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER),
        heartbeat(8, system=2),  # the daemon of another vehicle
    ],
)
def test_neither_ourselves_nor_other_companions_are_another_daemon(rig: Rig, data: bytes) -> None:
    hear(rig, data, 5.0)
    assert rig.phase is Phase.CRUISE


def test_our_heartbeat_tells_us_from_others(rig: Rig) -> None:
    codec = mavlink.MAVLink(None)
    rig.autonomy.tick(0.0)
    sent = codec.parse_buffer(rig.autonomy.mavlink_to_send()) or []
    (beat,) = [each for each in sent if each.get_type() == "HEARTBEAT"]
    assert (beat.get_srcComponent(), beat.custom_mode) == (COMPONENT_ID, 7)
