"""Operator commands that prove who sent them, and that they are new: HMAC-SHA256 in an envelope.

An envelope is a JSON object that carries the command as the very text that was authenticated:

    {"version": 1, "stamp_unix_ms": 1790000000000, "nonce": "32 hexadecimal digits",
     "payload": "{...}", "hmac_sha256": "64 hexadecimal digits"}

The code is that of RFC 2104 over these bytes, so that no two commands share one: the text
``clearway-operator-command-1``, vehicle, kind, stamp in decimal digits and nonce, each followed by
a zero byte; then the payload in UTF-8.  A command for one vehicle, or of one kind, is therefore
refused by or as another.

A command is accepted once.  Its stamp has to be within `SKEW_MAX_S` of the receiver's clock; nonces
are remembered for as long as their stamps would be accepted, and in a file over a restart.  A clock
that is set back does not bring back old commands: their stamps lie too far behind the newest one.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.yaml_file import FileError

SKEW_MAX_S: Final = 30.0
_SKEW_MAX_MS: Final = round(SKEW_MAX_S * 1e3)
# More authentic commands than this within a minute are a fault of the operator's program.
_REMEMBERED_MAX: Final = 1000
_DOMAIN: Final = b"clearway-operator-command-1"

Milliseconds = Annotated[int, Field(ge=0, le=1 << 53)]
Nonce = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]


class CommandKind(StrEnum):
    """What an operator may command; the value is the last part of its Zenoh key."""

    CLEARANCE = "clearance"
    MISSION = "mission"
    RESUME = "resume"


class CommandRefusedError(ValueError):
    """A command that is not authentic, or not new; the message says why."""


class Envelope(BaseModel):
    """A command as it crosses Zenoh."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    version: Literal[1] = 1
    stamp_unix_ms: Milliseconds
    nonce: Nonce
    payload: str
    hmac_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class CommandJournal(BaseModel):
    """The commands that were accepted and whose stamps would still be: stamp by nonce."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    newest_unix_ms: Milliseconds = 0
    accepted: dict[Nonce, Milliseconds] = Field(default_factory=dict, max_length=_REMEMBERED_MAX)


def sealed(
    payload: bytes, *, key: bytes, vehicle: str, kind: CommandKind, now_unix_s: float
) -> bytes:
    """Return a command in its envelope.

    Args:
        payload: the command, JSON in UTF-8.
        key: the operator's.
        vehicle: its name in the Zenoh keys.
        kind: of the command.
        now_unix_s: by the daemon's clock, if that is known.
    """
    stamp_unix_ms, nonce = round(now_unix_s * 1e3), secrets.token_hex(16)
    code = _code(key, vehicle, kind, stamp_unix_ms, nonce, payload)
    envelope = Envelope(
        stamp_unix_ms=stamp_unix_ms, nonce=nonce, payload=payload.decode(), hmac_sha256=code
    )
    return envelope.model_dump_json().encode()


class CommandGate:
    """Opens the envelopes of one vehicle's operator.

    It is not safe for use by several threads at a time.

    Args:
        key: the operator's.
        vehicle: its name in the Zenoh keys.
        journal: as `remember` left it.
        remember: stores the journal before a command takes effect; may raise `FileError`.
    """

    def __init__(
        self,
        key: bytes,
        vehicle: str,
        journal: CommandJournal,
        remember: Callable[[CommandJournal], None] = lambda _: None,
    ) -> None:
        self._key, self._vehicle = key, vehicle
        self._journal, self._remember = journal, remember

    def open(self, kind: CommandKind, data: bytes, now_unix_s: float) -> bytes:
        """Return the command in an envelope, once.

        Args:
            kind: what is expected.
            data: as received.
            now_unix_s: by this computer's clock.

        Raises:
            CommandRefusedError: not signed, forged, stamped by another clock, or received before;
                or the journal cannot be written.
        """
        try:
            envelope = parse(data, Envelope)
            payload = envelope.payload.encode()
        except (MalformedPayloadError, UnicodeEncodeError) as error:
            raise CommandRefusedError("not signed with the operator's key") from error
        stamp_unix_ms, nonce = envelope.stamp_unix_ms, envelope.nonce
        expected = _code(self._key, self._vehicle, kind, stamp_unix_ms, nonce, payload)
        if not hmac.compare_digest(expected, envelope.hmac_sha256):
            raise CommandRefusedError("signed with another key, or altered")
        self._check_new(stamp_unix_ms, nonce, round(now_unix_s * 1e3))
        return payload

    def _check_new(self, stamp_unix_ms: int, nonce: str, now_unix_ms: int) -> None:
        journal = self._journal
        if nonce in journal.accepted:
            raise CommandRefusedError("received before: a replay")
        ahead_ms = stamp_unix_ms - now_unix_ms
        if abs(ahead_ms) > _SKEW_MAX_MS:
            where = "ahead of" if ahead_ms > 0 else "behind"
            raise CommandRefusedError(
                f"its stamp is {abs(ahead_ms) / 1e3:.1f} s {where} this computer's clock "
                f"(limit {SKEW_MAX_S:g} s): a replay, or a clock that is wrong"
            )
        # From here on nothing older is remembered, nor accepted.
        newest_unix_ms = max(journal.newest_unix_ms, stamp_unix_ms)
        oldest_unix_ms = newest_unix_ms - 2 * _SKEW_MAX_MS
        if stamp_unix_ms < oldest_unix_ms:
            raise CommandRefusedError("its stamp is older than what was accepted: a replay")
        accepted = {n: t for n, t in journal.accepted.items() if t >= oldest_unix_ms}
        if len(accepted) >= _REMEMBERED_MAX:
            raise CommandRefusedError(f"more than {_REMEMBERED_MAX} commands within a minute")
        accepted[nonce] = stamp_unix_ms
        journal = CommandJournal(newest_unix_ms=newest_unix_ms, accepted=accepted)
        try:
            self._remember(journal)
        except FileError as error:
            raise CommandRefusedError(f"it cannot be remembered: {error}") from error
        self._journal = journal


def _code(
    key: bytes, vehicle: str, kind: CommandKind, stamp_unix_ms: int, nonce: str, payload: bytes
) -> str:
    head = (_DOMAIN, vehicle.encode(), kind.value.encode(), b"%d" % stamp_unix_ms, nonce.encode())
    return hmac.new(key, b"\0".join((*head, payload)), "sha256").hexdigest()
