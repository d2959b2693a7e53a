"""One thing that a pre-flight check looked at, and how it came out."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

# Name of the check that says which vehicle was looked at.
VEHICLE_IDENTITY: Final = "identity"


class Verdict(enum.Enum):
    """How a check came out; what is not known is never fine."""

    HOLDS = "holds"
    BROKEN = "broken"
    UNKNOWN = "could not be checked"

    @classmethod
    def of(cls, *, holds: bool) -> Verdict:
        """Return the verdict on what is known."""
        return cls.HOLDS if holds else cls.BROKEN

    @classmethod
    def worst(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """Return the verdict on all together: broken beats unknown, unknown beats holding."""
        found = set(verdicts)
        return next((v for v in (cls.BROKEN, cls.UNKNOWN) if v in found), cls.HOLDS)


@dataclass(frozen=True)
class Finding:
    """One check of something live.

    Attributes:
        subject: what was looked at: ``vehicle``, ``detections``, ``daemon``.
        name: of the check; of the parameter, where it is one.
        verdict: how it came out.
        text: what was found and what is required, for people.
    """

    subject: str
    name: str
    verdict: Verdict
    text: str

    @property
    def holds(self) -> bool:
        """Whether it is known to be fine."""
        return self.verdict is Verdict.HOLDS

    def document(self) -> dict[str, Any]:
        """Return the finding as JSON values."""
        return {
            "subject": self.subject,
            "name": self.name,
            "verdict": self.verdict.value,
            "text": self.text,
        }
