"""What the service tells the operator, the log and Zenoh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any


class Severity(IntEnum):
    """MAV_SEVERITY, as far as it is used."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True)
class Event:
    """Something that an operator should be able to read about afterwards.

    Attributes:
        time_s: when, on the service's clock.
        name: what kind, for machines.
        severity: how bad.
        text: one line for people.
        data: the numbers behind it; JSON values only.
    """

    time_s: float
    name: str
    severity: Severity
    text: str
    data: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the event as it is published and logged, but for its time."""
        return {
            "name": self.name,
            "severity": self.severity.name.lower(),
            "text": self.text,
            "data": dict(self.data),
        }
