"""A rule of the pre-flight check: what is required, what was found, and what depends on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from onboard.contract.clause import Concern

# Sizes and distances that a file states as equal are sums of floats: equal to one in a billion.
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Rule:
    """One rule, checked on a whole field or on a contract.

    Attributes:
        name: of the rule.
        required, declared: the rule holds while ``declared`` is at least ``required``.
        unit: of both.
        reason: the purpose of the rule.
        offenders: obstacles that break it, at most `field_check.OFFENDERS_MAX`.
        note: a condition of the verdict, or a limit of the check; may be empty.
        concerns: what depends on it where every flown way ends at rest in seen-free space: no
            collision, or only that the vehicle arrives.
    """

    name: str
    required: float
    declared: float
    unit: str
    reason: str
    offenders: tuple[str, ...] = ()
    note: str = ""
    concerns: Concern = "progress"

    @property
    def margin(self) -> float:
        """Declared less required; 0 or more complies."""
        return self.declared - self.required

    @property
    def holds(self) -> bool:
        """Whether the rule is kept; a margin that is not a number does not hold."""
        return self.margin >= -ROUND_OFF * max(1.0, abs(self.required))

    def document(self) -> dict[str, Any]:
        """Return the rule as JSON values; a number that is not finite, which JSON lacks, is null.

        A single obstacle has no nearest neighbour, for instance.
        """
        return {
            "name": self.name,
            "concerns": self.concerns,
            "required": _finite(self.required),
            "declared": _finite(self.declared),
            "margin": _finite(self.margin),
            "unit": self.unit,
            "holds": self.holds,
            "reason": self.reason,
            "offenders": list(self.offenders),
            "note": self.note,
        }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
