"""Sends the daemon the command to end a hold or to return, and writes its answer."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import zenoh

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, write_document
from gcs_tools.preflight.live.bus import BusConfig
from onboard.authentication.operator_command import CommandKind, sealed
from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.resume_payload import Command, ResumeAnswer, ResumeCommand
from onboard.zenoh_session import open_session

if TYPE_CHECKING:
    from rich.console import Console

# The daemon answers with its next tick.
ANSWER_TIMEOUT_S: Final = 3.0


def send(
    bus: BusConfig,
    command: Command,
    key: bytes | None = None,
    *,
    form: Format,
    output: Path | None,
) -> bool:
    """Ask the daemon to fly on, or to return; write and return whether it does.

    Args:
        bus: the vehicle, and how to reach it.
        command: which of both.
        key: the operator's, where the daemon has it.
        form: of the answer.
        output: file for it; None for standard output.

    Raises:
        CommandError: no session, no answer, or more than one.
    """
    try:
        with open_session(bus) as session:
            answer = ask(session, bus.vehicle, command, operator_key=key)
    except zenoh.ZError as error:
        raise CommandError(f"cannot open a Zenoh session: {error}") from error
    write_document(
        answer.model_dump(), partial(print_answer, answer, command), form=form, path=output
    )
    return answer.accepted


def ask(
    session: zenoh.Session,
    vehicle: str,
    command: Command = "resume",
    timeout_s: float = ANSWER_TIMEOUT_S,
    operator_key: bytes | None = None,
) -> ResumeAnswer:
    """Send the command, and return the daemon's answer.

    Args:
        session: an open session.
        vehicle: its name in the Zenoh keys.
        command: to end a hold, or to return.
        timeout_s: how long to wait.
        operator_key: signs the command; None where the daemon needs no signature.

    Raises:
        CommandError: no answer, one that cannot be read, or more than one.
    """
    key = f"clearway/{vehicle}/resume"
    payload = ResumeCommand(command=command).model_dump_json().encode()
    if operator_key is not None:
        payload = sealed(
            payload,
            key=operator_key,
            vehicle=vehicle,
            kind=CommandKind.RESUME,
            now_unix_s=time.time(),
        )
    replies = session.get(key, payload=payload, timeout=timeout_s)
    answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
    if not answers:
        raise CommandError(f"{key}: no daemon answered within {timeout_s:g} s")
    if len(answers) > 1:
        raise CommandError(f"{key}: {len(answers)} daemons answered (expected 1)")
    try:
        return parse(answers[0], ResumeAnswer)
    except MalformedPayloadError as error:
        raise CommandError(f"{key}: the answer cannot be read: {error}") from error


_ACCEPTED: Final[dict[Command, str]] = {
    "resume": "resumed: the vehicle flies on, from standby once it is given control",
    "return": "returning: the vehicle flies back along the way flown",
}
_REFUSED: Final[dict[Command, str]] = {
    "resume": "refused: the vehicle stays as it is",
    "return": "refused: the vehicle does not return",
}


def print_answer(answer: ResumeAnswer, command: Command, console: Console) -> None:
    """Print whether the vehicle obeys, and every reason if it does not."""
    if answer.accepted:
        console.print(_ACCEPTED[command], style="green")
        return
    console.print(_REFUSED[command], style="red")
    for reason in answer.reasons:
        console.print(f"  • {reason.text}", markup=False, soft_wrap=True)
