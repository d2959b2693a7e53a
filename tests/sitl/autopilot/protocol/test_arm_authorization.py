"""Who may authorize arming, for how long, and what silence means."""

from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.arm_authorization import REQUEST, ArmAuthorization

AUTHORIZER = 10


class Asking:
    """An open request, and the answers that it got."""

    def __init__(self, timeout_s: float = 0.4) -> None:
        self.authorization = ArmAuthorization()
        self.answers: list[bool] = []
        self.message = self.authorization.ask(AUTHORIZER, timeout_s, self.answers.append, 0.0)

    def acknowledge(
        self,
        result: int,
        now_s: float,
        *,
        valid_s: int = 0,
        system: int = AUTHORIZER,
        command: int = REQUEST,
    ) -> None:
        message = SimpleNamespace(
            command=command, result=result, result_param2=valid_s, get_srcSystem=lambda: system
        )
        self.authorization.receive(message, AUTHORIZER, now_s)


def test_the_request_goes_to_the_authorizer() -> None:
    message = Asking().message
    assert message.target_system == AUTHORIZER
    assert message.command == mavlink.MAV_CMD_ARM_AUTHORIZATION_REQUEST


@pytest.mark.parametrize(
    ("result", "answers"),
    [
        (mavlink.MAV_RESULT_ACCEPTED, [True]),
        (mavlink.MAV_RESULT_DENIED, [False]),
        (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, [False]),
        (mavlink.MAV_RESULT_FAILED, [False]),
        (mavlink.MAV_RESULT_IN_PROGRESS, []),
    ],
)
def test_a_result_answers_the_request(result: int, answers: list[bool]) -> None:
    asking = Asking()
    asking.acknowledge(result, 0.1)
    assert asking.answers == answers


def test_an_authorization_is_valid_for_its_seconds() -> None:
    asking = Asking()
    assert not asking.authorization.permits(0.0)
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.1, valid_s=5)
    assert asking.authorization.permits(5.1)
    assert not asking.authorization.permits(5.2)


def test_a_negative_validity_counts_as_zero() -> None:
    asking = Asking()
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 1.0, valid_s=-5)
    assert asking.authorization.permits(1.0)
    assert not asking.authorization.permits(1.01)


def test_a_refusal_gives_no_authorization() -> None:
    asking = Asking()
    asking.acknowledge(mavlink.MAV_RESULT_DENIED, 0.1, valid_s=60)
    assert not asking.authorization.permits(0.2)


def test_other_systems_and_other_commands_do_not_answer() -> None:
    asking = Asking()
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.1, system=AUTHORIZER + 1)
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.1, command=400)
    assert asking.answers == []


def test_silence_is_a_refusal_after_the_timeout() -> None:
    asking = Asking(timeout_s=0.4)
    asking.authorization.step(0.4)
    assert asking.answers == []
    asking.authorization.step(0.41)
    assert asking.answers == [False]


def test_a_request_is_answered_once() -> None:
    asking = Asking()
    for _ in range(3):
        asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.1)
        asking.authorization.step(10.0)
    assert asking.answers == [True]


def test_an_answer_without_a_request_authorizes_nothing() -> None:
    asking = Asking()
    asking.acknowledge(mavlink.MAV_RESULT_DENIED, 0.1)
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.2, valid_s=60)
    assert not asking.authorization.permits(0.3)


def test_a_second_request_refuses_the_first() -> None:
    asking = Asking()
    second: list[bool] = []
    asking.authorization.ask(AUTHORIZER, 0.4, second.append, 0.1)
    assert asking.answers == [False]
    asking.acknowledge(mavlink.MAV_RESULT_ACCEPTED, 0.2)
    assert (asking.answers, second) == ([False], [True])
