"""Why control that was granted is not taken, and how often that is said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Final

from onboard.events import Event, EventName, RefusalReason, Severity

# A refusal that changes in kind is said, but not more often than this.
REFUSAL_PERIOD_S: Final = 5.0


@unique
class RefusalKind(StrEnum):
    """What keeps the service in STANDBY."""

    HOLDING = "holding"
    CONTRACT = "contract"
    PREFLIGHT = "preflight"
    DETECTIONS = "detections"
    CONTRADICTION = "contradiction"
    TELEMETRY = "telemetry"
    POSITION = "position"
    WIND = "wind"
    BEFORE_LEG = "before_leg"
    LEG_FLOWN = "leg_flown"
    BESIDE_LEG = "beside_leg"
    OFF_HEIGHT = "off_height"
    MOVING = "moving"
    INSIDE_REGION = "inside_region"
    ENVIRONMENT = "environment"


@dataclass(frozen=True)
class Refusal:
    """One reason for not leaving STANDBY.

    Attributes:
        kind: what it is.
        text: the same for people, with numbers that may change from tick to tick.
        subject: what it is about, such as an obstacle's id.
    """

    kind: RefusalKind
    text: str
    subject: str = ""


class RefusalReport:
    """Says why the service does not leave STANDBY when that changes in kind, not in numbers."""

    def __init__(self) -> None:
        self._said: frozenset[tuple[RefusalKind, str]] = frozenset()
        self._due_s = -math.inf

    def end(self) -> None:
        """Forget what was said: control was taken, or taken back."""
        self._said = frozenset()

    def news(self, refusals: Sequence[Refusal], now_s: float) -> Event | None:
        """Return what there is to say, at most once in `REFUSAL_PERIOD_S`.

        Args:
            refusals: every reason that holds now, at least one.
            now_s: the time.
        """
        kinds = frozenset((refusal.kind, refusal.subject) for refusal in refusals)
        if kinds == self._said or now_s < self._due_s:
            return None
        self._said, self._due_s = kinds, now_s + REFUSAL_PERIOD_S
        text = "not leaving standby: " + "; ".join(refusal.text for refusal in refusals)
        reasons: list[RefusalReason] = [
            {"kind": refusal.kind.value, "subject": refusal.subject, "text": refusal.text}
            for refusal in refusals
        ]
        return Event(now_s, EventName.REFUSED, Severity.WARNING, text, {"reasons": reasons})
