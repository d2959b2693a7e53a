"""Whose request to arm is permitted, among several vehicles on one connection."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.console.processes import free_ports
from gcs_tools.preflight.arm_authorization import AUTHORIZER_SYSTEM_ID, answer_arm_requests
from gcs_tools.preflight.finding import Verdict
from gcs_tools.vehicle.connection import AmbiguousVehicleError
from tests.gcs_tools.vehicle.fake_autopilot import FakeAutopilot, autopilots

pytestmark = [pytest.mark.real_time, pytest.mark.waiting]

REQUEST = mavlink.MAV_CMD_ARM_AUTHORIZATION_REQUEST
CHECKED, OTHER = 1, 2


def asks_every_second(once: list[str]) -> Callable[[FakeAutopilot], None]:
    """Ask from the moment on that the authorizer has said that it answers."""
    due_s = [0.0]

    def stream(autopilot: FakeAutopilot) -> None:
        if once and time.monotonic() > due_s[0]:
            due_s[0] = time.monotonic() + 1.0
            autopilot.link.mav.command_long_send(
                AUTHORIZER_SYSTEM_ID, 0, REQUEST, 0, *(0.0,) * 7
            )  # as PX4, which does not fill in its own id

    return stream


@pytest.mark.parametrize(
    ("asking", "result"),
    [(CHECKED, mavlink.MAV_RESULT_ACCEPTED), (OTHER, mavlink.MAV_RESULT_DENIED)],
)
def test_only_the_vehicle_that_was_checked_may_arm(asking: int, result: int) -> None:
    (port,) = free_ports(1)
    answers: list[int] = []
    said: list[str] = []

    def hear(_: FakeAutopilot, message: Any) -> None:
        if message.command == REQUEST:
            answers.append(message.result)

    quiet = FakeAutopilot(port, CHECKED + OTHER - asking)
    asker = FakeAutopilot(
        port, asking, behaviour={"COMMAND_ACK": hear}, stream=asks_every_second(said)
    )
    with autopilots(asker, quiet):
        url = f"udpin://127.0.0.1:{port}"
        answer_arm_requests(url, Verdict.HOLDS, 4.0, said.append, system_id=CHECKED)
    assert answers
    assert set(answers) == {result}
    permitted = result == mavlink.MAV_RESULT_ACCEPTED
    assert said[1] == ("arming permitted" if permitted else "arming denied")


def test_among_two_vehicles_the_checked_one_has_to_be_named() -> None:
    (port,) = free_ports(1)
    with autopilots(FakeAutopilot(port, CHECKED), FakeAutopilot(port, OTHER)):
        url = f"udpin://127.0.0.1:{port}"
        with pytest.raises(AmbiguousVehicleError, match="system ids 1, 2"):
            answer_arm_requests(url, Verdict.HOLDS, 1.0, lambda _: None)
