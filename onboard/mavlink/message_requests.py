"""Decides which messages to request from the autopilot, by the rates at which they arrive.

An autopilot may stream messages slower than they are needed, or not at all, and forgets requests
when it restarts.  An acknowledgement tells neither which message it belongs to nor what the link
lets through, so only the rate of arrival counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

# How often the rates are checked.
REQUEST_PERIOD_S: Final = 2.0
# A message that arrives at less than this share of its wanted rate is too slow; links lose a few.
RATE_SHARE: Final = 0.8
# A message that arrives, but stays too slow, is limited by the link or by another client of it:
# after this many requests, the next ones are `PATIENT_PERIOD_S` apart.
EAGER_REQUESTS: Final = 3
PATIENT_PERIOD_S: Final = 30.0


class MessageRequests:
    """Counts the messages that arrive, and returns those to request."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self._slow_requests: dict[int, int] = {}
        self._asked_s: dict[int, float] = {}
        self._looked_s: float | None = None

    def heard(self, message_id: int) -> None:
        """Count a message from the autopilot."""
        self._counts[message_id] = self._counts.get(message_id, 0) + 1

    def due(self, wanted_hz: Iterable[tuple[int, float]], now_s: float) -> list[tuple[int, float]]:
        """Return the messages to request now, with their rates [Hz].

        At first those that have not been heard; then, every `REQUEST_PERIOD_S`, those that are too
        slow.  A message that is faster than wanted is not slowed down: others may need it.
        """
        first = self._looked_s is None
        elapsed_s = REQUEST_PERIOD_S if self._looked_s is None else now_s - self._looked_s
        if elapsed_s < REQUEST_PERIOD_S:
            return []
        counts, self._counts, self._looked_s = self._counts, {}, now_s
        asked = []
        for message_id, rate_hz in wanted_hz:
            count = counts.get(message_id, 0)
            if count == 0 or (not first and self._too_slow(message_id, count, rate_hz * elapsed_s)):
                asked.append((message_id, rate_hz))
        return [request for request in asked if self._may_ask(request[0], counts, now_s)]

    def _too_slow(self, message_id: int, count: int, wanted: float) -> bool:
        slow = count < RATE_SHARE * wanted
        if not slow:
            self._slow_requests.pop(message_id, None)
        return slow

    def _may_ask(self, message_id: int, counts: dict[int, int], now_s: float) -> bool:
        """Tell whether to repeat a request: at once if silent, less often if it stays slow."""
        if counts.get(message_id, 0):
            requests = self._slow_requests.get(message_id, 0) + 1
            self._slow_requests[message_id] = requests
            waited_s = now_s - self._asked_s.get(message_id, -PATIENT_PERIOD_S)
            if requests > EAGER_REQUESTS and waited_s < PATIENT_PERIOD_S:
                return False
        else:
            # The autopilot may have restarted, and then needs the requests at once.
            self._slow_requests.pop(message_id, None)
        self._asked_s[message_id] = now_s
        return True
