"""What a daemon says on Zenoh, kept for those who watch: the latest of each kind, and a past."""

from __future__ import annotations

import json
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

# Keys of the daemon, under ``clearway/<vehicle>/``.
KEYS: Final = ("status", "monitors", "margins", "map", "plan", "events")
TRAIL_POINTS: Final = 5000
EVENTS_KEPT: Final = 200
# A listener that is this far behind starts anew from what is known now.
_BACKLOG: Final = 500

Payload = dict[str, Any]


@dataclass(frozen=True)
class Message:
    """One message: key without its prefix, and content."""

    key: str
    payload: Payload

    def as_json(self) -> str:
        """Return both as one JSON object."""
        return json.dumps({"key": self.key, "payload": self.payload}, separators=(",", ":"))


@dataclass
class Feed:
    """Collects messages in one thread and hands them out in others.

    Attributes:
        dropped: malformed messages.
    """

    dropped: int = 0
    _latest: dict[str, Payload] = field(default_factory=dict)
    _trail: deque[list[float]] = field(default_factory=lambda: deque(maxlen=TRAIL_POINTS))
    _events: deque[Payload] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    _recent: deque[Message] = field(default_factory=lambda: deque(maxlen=_BACKLOG))
    _count: int = 0
    _closed: bool = False
    _changed: threading.Condition = field(default_factory=threading.Condition)

    def receive(self, key: str, data: bytes) -> None:
        """Take a message as it came; what is no JSON object is counted and dropped."""
        try:
            payload = json.loads(data)
        except ValueError:
            payload = None
        with self._changed:
            if not isinstance(payload, dict):
                self.dropped += 1
                return
            self._keep(key, payload)
            self._recent.append(Message(key, payload))
            self._count += 1
            self._changed.notify_all()

    def _keep(self, key: str, payload: Payload) -> None:
        if key == "events":
            self._events.append(payload)
            return
        self._latest[key] = payload
        position_ned_m = payload.get("position_ned_m") if key == "status" else None
        if position_ned_m is not None:
            self._trail.append(position_ned_m)

    def latest(self, key: str) -> Payload:
        """Return what was last said under a key; empty before that."""
        with self._changed:
            return self._latest.get(key, {})

    def events(self) -> list[Payload]:
        """Return the latest events, in order."""
        with self._changed:
            return list(self._events)

    def snapshot(self) -> tuple[list[Message], int]:
        """Return all that somebody who joins now has missed, and where `wait` goes on from."""
        with self._changed:
            missed = [Message(key, payload) for key, payload in self._latest.items()]
            # After the status, whose position it holds already.
            missed.append(Message("trail", {"points_ned_m": list(self._trail)}))
            missed += [Message("events", event) for event in self._events]
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
        """Whether nothing more will come."""
        return self._closed

    def close(self) -> None:
        """Let everybody who waits go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
