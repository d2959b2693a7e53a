"""Keeps what a daemon publishes on Zenoh for the viewers: the latest of each kind, and a past."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeVar, cast

from pydantic import ValidationError
from pydantic_core import to_json

from gcs_tools.watch.departure import Departure, DepartureCheck
from onboard.files.contract_file import Contract
from onboard.recording.messages import (
    ADAPTERS,
    ZENOH_KEYS,
    EventRecord,
    Record,
    StateRecord,
    as_json,
)

TRAIL_POINTS: Final = 5000
EVENTS_KEPT: Final = 200
# A listener that is further behind starts again with a snapshot.
_BACKLOG: Final = 500
_TYPES: Final[dict[str, type[Record]]] = {key: kind for kind, key in ZENOH_KEYS.items()}

_R = TypeVar("_R", bound=Record)


@dataclass(frozen=True)
class Trail:
    """The path flown so far; each point is north, east, down."""

    points_ned_m: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Declared:
    """What the daemon's contract says of vehicle and view, as far as it is drawn."""

    radius_m: float
    detection_range_m: float
    field_of_view_rad: float

    @classmethod
    def of(cls, contract: Contract) -> Declared:
        """Return it from a contract."""
        width_rad = math.radians(contract.sensor.field_of_view_deg)
        return cls(contract.vehicle.radius_m, contract.sensor.detection_range_m, width_rad)


# What is made of the daemon's records, by its key on the page.
Derived = Trail | Declared | Departure
_DERIVED_KEYS: Final[dict[type[Derived], str]] = {
    Trail: "trail",
    Declared: "declared",
    Departure: "departure",
}


@dataclass(frozen=True)
class Message:
    """A record, or what was derived from several, as the page receives it."""

    content: Record | Derived

    @property
    def key(self) -> str:
        """The daemon's key of the record, or the page's of what was derived."""
        content = self.content
        if isinstance(content, Derived):
            return _DERIVED_KEYS[type(content)]
        return ZENOH_KEYS[type(content)]

    def as_json(self) -> str:
        """Return key and payload as one JSON object on one line."""
        content = self.content
        payload = to_json(content) if isinstance(content, Derived) else as_json(content)
        return f'{{"key":"{self.key}","payload":{payload.decode()}}}'


@dataclass
class Feed:
    """Collects records in one thread and hands them out in others.

    Attributes:
        dropped: malformed messages.
        on_record: called with each record, in the thread that received it.
    """

    dropped: int = 0
    on_record: Callable[[Record], None] | None = None
    _check: DepartureCheck = field(default_factory=DepartureCheck)
    _departure: Departure = field(default_factory=Departure)
    _latest: dict[type[object], Record] = field(default_factory=dict)
    _trail: deque[tuple[float, float, float]] = field(
        default_factory=lambda: deque(maxlen=TRAIL_POINTS)
    )
    _events: deque[EventRecord] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    _recent: deque[Message] = field(default_factory=lambda: deque(maxlen=_BACKLOG))
    _count: int = 0
    _closed: bool = False
    _changed: threading.Condition = field(default_factory=threading.Condition)

    def receive(self, key: str, data: bytes) -> None:
        """Take a message as it came; a malformed one is counted and dropped."""
        try:
            record: Record = ADAPTERS[_TYPES[key]].validate_json(data, strict=True)
        except (KeyError, ValidationError):
            with self._changed:
                self.dropped += 1
            return
        with self._changed:
            self._keep(record)
            self._pass_on(record)
            self._check.take(record)
            if (departure := self._check.departure()) != self._departure:
                self._departure = departure
                self._pass_on(departure)
            self._changed.notify_all()
        if (on_record := self.on_record) is not None:
            on_record(record)

    def declare(self, contract: Contract) -> None:
        """Take the daemon's contract."""
        with self._changed:
            if self._check.contract != contract:
                self._check.contract = contract
                self._pass_on(Declared.of(contract))
                self._changed.notify_all()

    @property
    def departure(self) -> Departure:
        """What is missing before the daemon will fly."""
        with self._changed:
            return self._departure

    def _pass_on(self, content: Record | Derived) -> None:
        self._recent.append(Message(content))
        self._count += 1

    def _keep(self, record: Record) -> None:
        if isinstance(record, EventRecord):
            self._events.append(record)
            return
        self._latest[type(record)] = record
        if isinstance(record, StateRecord) and record.position_ned_m is not None:
            self._trail.append(record.position_ned_m)

    def latest(self, record_type: type[_R]) -> _R | None:
        """Return the last record of a type; None before the first."""
        with self._changed:
            return cast("_R | None", self._latest.get(record_type))

    def events(self) -> list[EventRecord]:
        """Return the latest events, in order."""
        with self._changed:
            return list(self._events)

    def snapshot(self) -> tuple[list[Message], int]:
        """Return all that a viewer who joins now has missed, and where `wait` goes on from."""
        with self._changed:
            declared = self._check.contract
            missed = [] if declared is None else [Message(Declared.of(declared))]
            missed += [Message(record) for record in self._latest.values()]
            # After the status, whose position it holds already.
            missed.append(Message(Trail(tuple(self._trail))))
            missed += [Message(event) for event in self._events]
            missed.append(Message(self._departure))
            return missed, self._count

    def wait(self, after: int, timeout_s: float) -> tuple[list[Message], int]:
        """Return the messages after the first ``after``, once there are any; none after a timeout.

        A listener that has fallen far behind gets a snapshot instead.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._count > after or self._closed, timeout_s)
            fresh = self._count - after
            if fresh <= len(self._recent):
                return list(self._recent)[len(self._recent) - fresh :], self._count
        return self.snapshot()

    @property
    def closed(self) -> bool:
        """Whether no further messages will come."""
        return self._closed

    def close(self) -> None:
        """Wake every waiting listener for the last time."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
