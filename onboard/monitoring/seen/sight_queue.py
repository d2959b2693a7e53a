"""Sights that wait to be counted, and the sensors whose row of frames ends between them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

# More frames than these wait only if a tick has come late: the oldest do not count.
PENDING_MAX: Final = 8

Sight = TypeVar("Sight")


class SightQueue(Generic[Sight]):
    """Keeps sights in the order of their frames, with the breaks of their rows.

    A frame that does not count breaks its sensor's row after the frames that were taken before it,
    not before they are counted.

    Args:
        break_row: begins the row of a sensor again.
    """

    def __init__(self, break_row: Callable[[str], None]) -> None:
        self._break_row = break_row
        # With each sensor; None for a break of its row.
        self._waiting: deque[tuple[str, Sight | None]] = deque()

    def __len__(self) -> int:
        """Return how many sights wait."""
        return sum(sight is not None for _, sight in self._waiting)

    def add(self, source: str, sight: Sight) -> None:
        """Have a sight of a sensor wait; one too many takes the place of the oldest."""
        self._waiting.append((source, sight))
        if len(self) > PENDING_MAX:
            self._break_due_rows()
            oldest, _ = self._waiting.popleft()
            self._break_row(oldest)

    def add_break(self, source: str) -> None:
        """Take note that a sensor's row ends after what waits."""
        if not self._waiting:
            self._break_row(source)
        elif self._waiting[-1] != (source, None):
            self._waiting.append((source, None))

    def pop(self) -> Sight | None:
        """Return the next sight, after the breaks before it; None if none waits."""
        self._break_due_rows()
        if not self._waiting:
            return None
        _, sight = self._waiting.popleft()
        return sight

    def clear(self) -> None:
        """Forget all that waits."""
        self._waiting.clear()

    def _break_due_rows(self) -> None:
        while self._waiting and self._waiting[0][1] is None:
            source, _ = self._waiting.popleft()
            self._break_row(source)
