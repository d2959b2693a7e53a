"""Listens to what the daemon publishes on Zenoh for a few seconds."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Final

import zenoh
from pydantic import ValidationError

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight.live.bus import BusConfig
from onboard.files.contract_file import Contract
from onboard.files.yaml_file import FileError, validate
from onboard.recording.messages import ADAPTERS, ZENOH_KEYS, EventRecord, Margins, StateRecord
from onboard.zenoh_session import open_session

# How long the daemon has to be heard; Zenoh takes a moment to connect.
HEAR_TIMEOUT_S: Final = 4.0
# From the first status on: ten of them, and what is repeated every second.
LISTEN_S: Final = 1.5
_POLL_S: Final = 0.05


@dataclass(frozen=True)
class Observation:
    """What was heard of one daemon.

    Attributes:
        states: statuses in order; empty if no daemon was heard.
        ahead_s: the daemon's clock less this computer's; None if no daemon was heard.
        margins: of its contract, as it would be flown now.
        events: that happened meanwhile.
        contract: that it has; None if it did not answer.
    """

    states: tuple[StateRecord, ...] = ()
    ahead_s: float | None = None
    margins: Margins | None = None
    events: tuple[EventRecord, ...] = ()
    contract: Contract | None = None

    @property
    def state(self) -> StateRecord | None:
        """The newest status."""
        return self.states[-1] if self.states else None

    def dropped(self, counter: str) -> int:
        """Return how much input was dropped meanwhile, by the name of its counter."""
        if len(self.states) < 2:
            return 0
        first, last = self.states[0].dropped, self.states[-1].dropped
        return int(getattr(last, counter)) - int(getattr(first, counter))


class _Inbox:
    """Collects in Zenoh's thread; what is malformed is of another program."""

    def __init__(self) -> None:
        self.states: list[StateRecord] = []
        self.aheads_s: list[float] = []
        self.margins: Margins | None = None
        self.events: list[EventRecord] = []

    def receive(self, kind: type[StateRecord | Margins | EventRecord], payload: bytes) -> None:
        now_unix_s = time.time()
        try:
            record = ADAPTERS[kind].validate_json(payload, strict=True)
        except ValidationError:
            return
        if isinstance(record, StateRecord):
            self.states.append(record)
            self.aheads_s.append(record.time_s - now_unix_s)
        elif isinstance(record, Margins):
            self.margins = record
        else:
            self.events.append(record)


def observe(
    bus: BusConfig, *, hear_timeout_s: float = HEAR_TIMEOUT_S, listen_s: float = LISTEN_S
) -> Observation:
    """Listen to a daemon.

    Args:
        bus: how to reach it, and its name.
        hear_timeout_s: how long to wait for its first status.
        listen_s: how long to listen from then on.

    Raises:
        CommandError: no Zenoh session.
    """
    try:
        with open_session(bus) as session:
            return _observe(session, f"clearway/{bus.vehicle}", hear_timeout_s, listen_s)
    except zenoh.ZError as error:
        where = ", ".join((*bus.connect, *bus.listen)) or "multicast"
        raise CommandError(f"no Zenoh session with {where}: {error}") from error


def _observe(
    session: zenoh.Session, prefix: str, hear_timeout_s: float, listen_s: float
) -> Observation:
    inbox = _Inbox()
    kinds: tuple[type[StateRecord | Margins | EventRecord], ...]
    kinds = (StateRecord, Margins, EventRecord)
    for kind in kinds:

        def receive(
            sample: zenoh.Sample, kind: type[StateRecord | Margins | EventRecord] = kind
        ) -> None:
            inbox.receive(kind, sample.payload.to_bytes())

        session.declare_subscriber(f"{prefix}/{ZENOH_KEYS[kind]}", receive)
    deadline_s = time.monotonic() + hear_timeout_s
    while not inbox.states:
        if time.monotonic() >= deadline_s:
            return Observation()
        time.sleep(_POLL_S)
    time.sleep(listen_s)
    return Observation(
        states=tuple(inbox.states),
        # The status with the shortest transit; it is too low by that transit.
        ahead_s=max(inbox.aheads_s),
        margins=inbox.margins,
        events=tuple(inbox.events),
        contract=contract_of(session, prefix, hear_timeout_s),
    )


def contract_of(session: zenoh.Session, prefix: str, timeout_s: float) -> Contract | None:
    """Ask a daemon for its contract; None if it does not answer with one.

    Args:
        session: an open session.
        prefix: of the daemon's keys.
        timeout_s: how long to wait.
    """
    for reply in session.get(f"{prefix}/contract", timeout=timeout_s):
        if reply.ok is None:
            continue
        try:
            document = json.loads(reply.ok.payload.to_bytes())["contract"]
            return validate(document, Contract, source="the daemon's contract")
        except (ValueError, KeyError, TypeError, FileError):
            continue
    return None
