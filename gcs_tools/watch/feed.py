"""Keeps what a daemon publishes on Zenoh for the viewers: the latest of each kind, and a past."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeVar, cast

from pydantic import ValidationError
from pydantic_core import to_json

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
# A listener that is further behind starts anew with a snapshot.
_BACKLOG: Final = 500
_TYPES: Final[dict[str, type[Record]]] = {key: kind for kind, key in ZENOH_KEYS.items()}

_R = TypeVar("_R", bound=Record)


@dataclass(frozen=True)
class Trail:
    """The path flown so far; each point is north, east, down."""

    points_ned_m: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Message:
    """A record, or the trail, as the page receives it."""

    content: Record | Trail

    @property
    def key(self) -> str:
        """The daemon's key of the record, or ``trail``."""
        return "trail" if isinstance(self.content, Trail) else ZENOH_KEYS[type(self.content)]

    def as_json(self) -> str:
        """Return key and payload as one JSON object on one line."""
        content = self.content
        payload = to_json(content) if isinstance(content, Trail) else as_json(content)
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
            self._recent.append(Message(record))
            self._count += 1
            self._changed.notify_all()
        if (on_record := self.on_record) is not None:
            on_record(record)

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
            missed = [Message(record) for record in self._latest.values()]
            # After the status, whose position it holds already.
            missed.append(Message(Trail(tuple(self._trail))))
            missed += [Message(event) for event in self._events]
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
