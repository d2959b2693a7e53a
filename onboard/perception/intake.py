"""Detection messages wait here until the next tick reads them; nothing of them ever raises."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from onboard.perception.detection import DetectionFrame
from onboard.perception.sources.detection_source import DetectionSource

# At 20 Hz a tick sees one frame; a burst beyond this is a fault: the oldest are dropped.
MAX_PENDING_FRAMES: Final = 32


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


class DetectionIntake:
    """Latches messages and decodes them.

    Args:
        source: decodes them.

    Attributes:
        names_taken: of other sensors; frames that come under them count as malformed.
    """

    def __init__(self, source: DetectionSource) -> None:
        self.counters = DetectionCounters()
        self.names_taken: frozenset[str] = frozenset()
        self._source = source
        self._pending: deque[bytes] = deque()

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
                if frame.source in self.names_taken:
                    self.counters.malformed_frames += 1
                else:
                    yield frame
