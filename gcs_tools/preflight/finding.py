"""The verdict of a pre-flight check, and of each single check of something live."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

# Name of the finding that identifies the vehicle.
VEHICLE_IDENTITY: Final = "identity"
# In the name of a finding about obstacles that are not there.
VIRTUAL: Final = "VIRTUAL OBSTACLES"
NOT_SEEN: Final = "real obstacles are not seen: fly in open ground only"


class Verdict(enum.Enum):
    """Result of a check; what could not be checked never counts as holding."""

    HOLDS = "holds"
    BROKEN = "broken"
    UNKNOWN = "could not be checked"

    @classmethod
    def of(cls, *, holds: bool) -> Verdict:
        """Return the verdict for something that could be checked."""
        return cls.HOLDS if holds else cls.BROKEN

    @classmethod
    def worst(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """Return the verdict on several checks: broken beats unknown, unknown beats holding."""
        found = set(verdicts)
        return next((v for v in (cls.BROKEN, cls.UNKNOWN) if v in found), cls.HOLDS)


@dataclass(frozen=True)
class Finding:
    """One check of something live.

    Attributes:
        subject: ``vehicle``, ``detections`` or ``daemon``.
        name: of the check or the parameter.
        verdict: its result.
        text: found and required values, for people.
        settings: parameters of the autopilot and values; setting any one of them cures it.
    """

    subject: str
    name: str
    verdict: Verdict
    text: str
    settings: tuple[tuple[str, float], ...] = ()

    @property
    def holds(self) -> bool:
        """Whether it could be checked and holds."""
        return self.verdict is Verdict.HOLDS

    def document(self) -> dict[str, Any]:
        """Return the finding as JSON values."""
        return {
            "subject": self.subject,
            "name": self.name,
            "verdict": self.verdict.value,
            "text": self.text,
            "settings": dict(self.settings),
        }
