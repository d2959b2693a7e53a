"""Keeps an event that repeats from filling the log and the operator's screen."""

from __future__ import annotations

import math
from typing import Final

EVENT_PERIOD_S: Final = 5.0
# More kinds than this are another flood: the oldest are forgotten.
_KINDS_MAX: Final = 256


class EventLimiter:
    """Allows an event of one kind at most once in `EVENT_PERIOD_S`, whatever its numbers."""

    def __init__(self) -> None:
        self._said_s: dict[str, float] = {}

    def allows(self, kind: str, now_s: float) -> bool:
        """Tell whether an event of this kind may be said now, and take note that it is.

        Args:
            kind: the event without its numbers.
            now_s: the time.
        """
        if now_s - self._said_s.get(kind, -math.inf) < EVENT_PERIOD_S:
            return False
        self._said_s.pop(kind, None)
        self._said_s[kind] = now_s
        if len(self._said_s) > _KINDS_MAX:
            del self._said_s[next(iter(self._said_s))]
        return True
