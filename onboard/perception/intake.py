"""Detection messages wait here until the next tick reads them; nothing of them ever raises."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from onboard.perception.detection import MAX_PENDING_FRAMES, DetectionFrame
from onboard.perception.sources.detection_source import DetectionSource

VIRTUAL_ONLY: Final = (
    "only virtual obstacles are stated: no real sensor without beside_real_sensors"
)
NAME_TAKEN: Final = "detections as JSON come under its name"


@dataclass
class DetectionCounters:
    """What arrived from the sensors and was not used.

    Attributes:
        malformed_frames: messages that their source could not decode.
        unplaced_frames: frames from a body whose pose was unknown or too blurred.
        dropped_frames: messages that arrived faster than they were read.
    """

    malformed_frames: int = 0
    unplaced_frames: int = 0
    dropped_frames: int = 0


class Refusal(NamedTuple):
    """Why messages of a sensor are dropped."""

    sensor: str
    reason: str


class DetectionIntake:
    """Latches messages and decodes them.

    Args:
        source: decodes them.

    Attributes:
        names_taken: of other sensors; frames that come under them count as malformed.
        virtual_only: whether no frame counts, since the vehicle flies among virtual obstacles.
    """

    def __init__(self, source: DetectionSource) -> None:
        self.counters = DetectionCounters()
        self.names_taken: frozenset[str] = frozenset()
        self.virtual_only = False
        self._source = source
        self._pending: deque[bytes] = deque()
        # No more of them than names are taken.
        self._said: set[Refusal] = set()
        self._news: list[Refusal] = []

    def receive(self, payload: bytes) -> None:
        """Latch one message."""
        if len(self._pending) == MAX_PENDING_FRAMES:
            self._pending.popleft()
            self.counters.dropped_frames += 1
        self._pending.append(payload)

    def take(self, now_unix_s: float) -> Iterator[DetectionFrame]:
        """Decode what has arrived, in order; malformed messages are counted and dropped.

        Args:
            now_unix_s: Unix time by the clock that stamps are compared with.
        """
        while self._pending:
            before = self._source.malformed
            frames = self._source.read(self._pending.popleft(), now_unix_s)
            self.counters.malformed_frames += self._source.malformed - before
            for frame in frames:
                if self.virtual_only or frame.source in self.names_taken:
                    self.counters.malformed_frames += 1
                    reason = VIRTUAL_ONLY if self.virtual_only else NAME_TAKEN
                    self._say(Refusal(frame.source, reason))
                else:
                    yield frame

    def take_news(self) -> list[Refusal]:
        """Return and forget the refusals that have come for the first time."""
        news, self._news = self._news, []
        return news

    def _say(self, refusal: Refusal) -> None:
        if refusal not in self._said:
            self._said.add(refusal)
            self._news.append(refusal)
