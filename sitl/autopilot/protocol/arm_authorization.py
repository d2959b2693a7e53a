"""Arm authorization: PX4 asks another system before it arms, and arms only if it agrees in time.

PX4 with COM_ARM_AUTH_REQ sends MAV_CMD_ARM_AUTHORIZATION_REQUEST to system COM_ARM_AUTH_ID when it
receives the arm command (COM_ARM_AUTH_MET 0), and waits COM_ARM_AUTH_TO for the COMMAND_ACK:
accepted, with the seconds of validity in ``result_param2``, or a refusal.  The arm command is
acknowledged after that.
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
    """An arm command that waits for an answer, and its deadline."""

    answer: Callable[[bool], None]
    until_s: float


class ArmAuthorization:
    """Keep the open request, and the authorization that is valid."""

    def __init__(self) -> None:
        self._question: _Question | None = None
        self._permitted_until_s = -math.inf

    def permits(self, now_s: float) -> bool:
        """Return whether an earlier authorization is still valid."""
        return now_s <= self._permitted_until_s

    def ask(
        self, authorizer: int, timeout_s: float, answer: Callable[[bool], None], now_s: float
    ) -> Any:
        """Open a request, and return the message to send.

        Args:
            authorizer: system id that decides.
            timeout_s: no answer by then is a refusal.
            answer: called once, with whether arming is permitted.
            now_s: time.
        """
        self._close(permitted=False)
        self._question = _Question(answer, now_s + timeout_s)
        return mavlink.MAVLink_command_long_message(authorizer, 0, REQUEST, 0, *(0.0,) * 7)

    def receive(self, message: Any, authorizer: int, now_s: float) -> None:
        """Take a COMMAND_ACK; ignore all but the authorizer's answers to the request."""
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
        """Refuse a request that has not been answered in time."""
        if self._question is not None and now_s > self._question.until_s:
            self._close(permitted=False)

    def _close(self, *, permitted: bool) -> None:
        question, self._question = self._question, None
        if question is not None:
            question.answer(permitted)
