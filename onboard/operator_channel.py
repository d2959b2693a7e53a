"""The operator's commands on Zenoh: clearances, missions, to end a hold, and to return.

Where the daemon has the operator's key, each has to be signed with it
(`onboard.authentication.operator_command`).
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from functools import partial

import zenoh

from onboard.authentication.operator_command import CommandGate, CommandKind, CommandRefusedError
from onboard.autonomy import Autonomy
from onboard.files.daemon_config import DaemonConfig
from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.resume_payload import ResumeAnswer, ResumeCommand, ResumeReason
from onboard.guidance.departure import Refusal, reason_of
from onboard.timing import Clock


class OperatorChannel:
    """Passes the operator's commands from Zenoh's threads into the event loop.

    Args:
        session: an open session.
        vehicle: name in the keys.
        autonomy: takes what is authentic, and reports what is not.
        clock: that stamps are compared with.
        gate: opens signed commands; None where none has to be signed.
    """

    def __init__(
        self,
        session: zenoh.Session,
        vehicle: str,
        autonomy: Autonomy,
        clock: Clock,
        gate: CommandGate | None,
    ) -> None:
        self._session, self._prefix = session, f"clearway/{vehicle}"
        self._autonomy, self._clock = autonomy, clock
        self._gate, self._opening = gate, threading.Lock()
        self._loop = asyncio.get_running_loop()

    def open(self, config: DaemonConfig) -> None:
        """Take every command that the daemon's file permits."""
        self.subscribe(accept_mission_updates=config.accept_mission_updates)
        self.answer_resumes(config.zenoh.remote_access)

    def subscribe(self, *, accept_mission_updates: bool) -> None:
        """Pass on clearances and, if allowed, other missions."""
        self._pass_on(CommandKind.CLEARANCE, self._autonomy.receive_flight_authorization)
        if accept_mission_updates:
            self._pass_on(CommandKind.MISSION, self._autonomy.receive_mission)

    def answer_resumes(self, remote_access: str | None) -> None:
        """Pass on the commands to end a hold and to return, and answer them.

        Without the operator's key nothing proves who sends it, so that it is refused wherever
        another computer might.

        Args:
            remote_access: why another computer might reach this session; None if none can.
        """
        key = f"{self._prefix}/resume"

        def receive(query: zenoh.Query) -> None:
            data = b"" if query.payload is None else query.payload.to_bytes()
            payload, unproven = self._opened(CommandKind.RESUME, data)
            if unproven is not None:
                query.reply(key, _refusal("authentication", unproven))
                self._report(CommandKind.RESUME, unproven)
                return
            try:
                command = parse(payload, ResumeCommand).command
            except MalformedPayloadError as error:
                query.reply(key, _refusal("malformed", f"no command to resume: {error}"))
                return
            routed = "a Zenoh router has joined, which may pass on what other computers send"
            remote = remote_access or (routed if self._session.info.routers_zid() else None)
            if remote is not None and self._gate is None:
                text = f"{remote}: without operator_key_file, it is for this computer only"
                query.reply(key, _refusal("remote", text))
                return

            def answer(refusals: list[Refusal]) -> None:
                query.reply(key, _resume_answer(refusals))

            self._in_loop(partial(self._autonomy.receive_resume, answer, command))

        self._session.declare_queryable(key, receive)

    def _pass_on(self, kind: CommandKind, take: Callable[[bytes, float], None]) -> None:
        """Subscribe to one kind; what is not authentic is reported and dropped."""

        def receive(sample: zenoh.Sample) -> None:
            payload, unproven = self._opened(kind, sample.payload.to_bytes())
            if unproven is not None:
                self._report(kind, unproven)
            else:
                self._in_loop(lambda: take(payload, self._clock.now_s()))

        self._session.declare_subscriber(f"{self._prefix}/{kind.value}", receive)

    def _opened(self, kind: CommandKind, data: bytes) -> tuple[bytes, str | None]:
        """Return a command, and why it is refused; in Zenoh's thread, since it writes a file."""
        if self._gate is None:
            return data, None
        now_unix_s = self._clock.epoch_unix_s + self._clock.now_s()
        try:
            with self._opening:
                return self._gate.open(kind, data, now_unix_s), None
        except CommandRefusedError as error:
            return b"", str(error)

    def _report(self, kind: CommandKind, reason: str) -> None:
        report = self._autonomy.report_refused_command
        self._in_loop(lambda: report(kind.value, reason, self._clock.now_s()))

    def _in_loop(self, call: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
            self._loop.call_soon_threadsafe(call)


def _refusal(kind: str, text: str) -> bytes:
    reason = ResumeReason(kind=kind, text=text)
    return ResumeAnswer(accepted=False, reasons=(reason,)).model_dump_json().encode()


def _resume_answer(refusals: list[Refusal]) -> bytes:
    reasons = tuple(ResumeReason(**reason_of(refusal)) for refusal in refusals)
    return ResumeAnswer(accepted=not refusals, reasons=reasons).model_dump_json().encode()
