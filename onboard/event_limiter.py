"""Limits how often a repeating event reaches the log and the operator's screen."""

from __future__ import annotations

import math
from typing import Final

EVENT_PERIOD_S: Final = 5.0
# More kinds than this would be another flood: the oldest are forgotten.
_KINDS_MAX: Final = 256


class EventLimiter:
    """Allows an event of one kind at most once in `EVENT_PERIOD_S`, whatever its numbers."""

    def __init__(self) -> None:
        self._allowed_s: dict[str, float] = {}

    def allows(self, kind: str, now_s: float) -> bool:
        """Tell whether an event of this kind may be emitted now, and record that it is.

        Args:
            kind: the event without its numbers.
            now_s: the time.
        """
        if now_s - self._allowed_s.get(kind, -math.inf) < EVENT_PERIOD_S:
            return False
        self._allowed_s.pop(kind, None)
        self._allowed_s[kind] = now_s
        if len(self._allowed_s) > _KINDS_MAX:
            del self._allowed_s[next(iter(self._allowed_s))]
        return True
