"""One clause of a contract: what is required, what is declared, and why."""

from __future__ import annotations

from typing import Any, Generic, Literal, NamedTuple

from onboard.geometry.frames import Q

Concern = Literal["safety", "progress"]


class Clause(NamedTuple, Generic[Q]):
    """One requirement; the declared value must exceed it strictly (erratum 13).

    Attributes:
        concerns: ``"safety"``, or ``"progress"`` where breaking it costs time, never a contact.
    """

    name: str
    required: Q
    declared: Q
    unit: str
    reason: str
    concerns: Concern = "safety"

    @property
    def margin(self) -> Q:
        """Declared less required, in the clause's unit; positive is safe."""
        return self.declared - self.required

    @property
    def holds(self) -> Any:
        """Whether the requirement is met, element by element for arrays."""
        return self.margin > 0.0
