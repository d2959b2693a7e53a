"""Whether what arrives on a link is believed: signed, where a key is configured."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final

from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.mavlink.signing import LinkSigning, Objection, is_signed, may_be_unsigned

# Of the vehicle's messages none has been accepted for this long: it is not a single forged one.
_SILENT_S: Final = 2.0
_NO_KEY: Final = (
    "the vehicle signs its messages and mavlink.signing names no key: it refuses what is sent to it"
)


class LinkSecurity:
    """Refuses what is not signed where signing is on; notices signatures where it is off.

    Args:
        signing: key and memory; None while signing is off.

    Attributes:
        signing: as given.
        refused: messages so far, by reason.
    """

    def __init__(self, signing: LinkSigning | None) -> None:
        self.signing = signing
        self.refused: Counter[Objection] = Counter()
        self._limiter = EventLimiter()
        self._accepted_s = self._refused_s = self._signed_s = -math.inf
        self._last: Objection | None = None
        self._news: list[Event] = []

    def admits(self, message: Any, now_s: float, *, of_vehicle: bool) -> bool:
        """Tell whether to read a message; count and report one that is refused.

        Args:
            message: decoded, with the bytes that it arrived in.
            now_s: the time.
            of_vehicle: whether it says that the vehicle's autopilot sent it.
        """
        frame = bytes(message.get_msgbuf())
        if self.signing is None:
            if of_vehicle and is_signed(frame):
                self._signed_s = now_s
                self._report("no key", _NO_KEY, now_s)
            return True
        objection = self.signing.accept(frame)
        if objection is None or (objection is Objection.UNSIGNED and may_be_unsigned(message)):
            if of_vehicle:
                self._accepted_s = now_s
            return True
        self.refused[objection] += 1
        if of_vehicle:
            self._refused_s, self._last = now_s, objection
        sender = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
        text = f"MAVLink messages of {sender} are refused: {objection.value}"
        self._report(objection.value, text, now_s)
        return False

    def doubt(self, now_s: float) -> str | None:
        """Return why the link does not carry commands; None while nothing speaks against it."""
        if now_s - self._signed_s <= _SILENT_S:
            return _NO_KEY
        recently = now_s - self._refused_s <= _SILENT_S
        if recently and self._last is not None and now_s - self._accepted_s > _SILENT_S:
            return f"every message of the vehicle is refused: {self._last.value} (mavlink.signing)"
        return None

    def take_news(self) -> list[Event]:
        """Return and forget what is to be reported."""
        news, self._news = self._news, []
        return news

    def _report(self, kind: str, text: str, now_s: float) -> None:
        if self._limiter.allows(kind, now_s):
            self._news.append(Event(now_s, EventName.LINK_REFUSED, Severity.WARNING, text))
