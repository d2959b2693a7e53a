"""Arm authorization: PX4 asks somebody else before it arms, and arms only if they agree in time.

PX4 with COM_ARM_AUTH_REQ sends MAV_CMD_ARM_AUTHORIZATION_REQUEST to system COM_ARM_AUTH_ID as it is
told to arm (COM_ARM_AUTH_MET 0), and waits COM_ARM_AUTH_TO for the COMMAND_ACK: accepted, with the
seconds for which that holds in ``result_param2``, or a refusal.  Meanwhile whoever asked waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

REQUEST = mavlink.MAV_CMD_ARM_AUTHORIZATION_REQUEST
_PERMITTED = mavlink.MAV_RESULT_ACCEPTED


@dataclass(frozen=True)
class _Question:
    """An arm command that waits: what answers it, and until when."""

    answer: Callable[[bool], None]
    until_s: float


class ArmAuthorization:
    """The question that is open, and the permission that holds."""

    def __init__(self) -> None:
        self._question: _Question | None = None
        self._permitted_until_s = -math.inf

    def permits(self, now_s: float) -> bool:
        """Tell whether an earlier permission still holds."""
        return now_s <= self._permitted_until_s

    def ask(
        self, authorizer: int, timeout_s: float, answer: Callable[[bool], None], now_s: float
    ) -> Any:
        """Ask, and return the message that does.

        Args:
            authorizer: system id of whoever decides.
            timeout_s: no answer by then is a refusal.
            answer: called once, with whether arming is permitted.
            now_s: time.
        """
        self._close(permitted=False)
        self._question = _Question(answer, now_s + timeout_s)
        return mavlink.MAVLink_command_long_message(authorizer, 0, REQUEST, 0, *(0.0,) * 7)

    def receive(self, message: Any, authorizer: int, now_s: float) -> None:
        """Take a COMMAND_ACK; others than the authorizer's answers to the question are ignored."""
        answers = message.command == REQUEST and message.get_srcSystem() == authorizer
        if not answers or self._question is None:
            return
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return
        permitted = message.result == _PERMITTED
        if permitted:
            self._permitted_until_s = now_s + max(message.result_param2, 0)
        self._close(permitted=permitted)

    def step(self, now_s: float) -> None:
        """Refuse what nobody has answered in time."""
        if self._question is not None and now_s > self._question.until_s:
            self._close(permitted=False)

    def _close(self, *, permitted: bool) -> None:
        question, self._question = self._question, None
        if question is not None:
            question.answer(permitted)
