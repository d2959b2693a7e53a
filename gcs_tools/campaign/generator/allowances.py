"""What an adversary is allowed in one flight, and how it uses that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Adversary:
    """An opponent that uses the allowances of a contract to their ends.

    Attributes:
        kind: of field: ``lane``, ``corner`` or ``forest``.
        strategy: how the allowances are used, in words.
        genes: where the search has moved the draw, by name; each in [0, 1].
        by_draw: share of each allowance that the draw itself uses: required over declared.  The
            others are measured in the flight.
    """

    kind: str
    strategy: str
    genes: Mapping[str, float] = field(default_factory=dict)
    by_draw: Mapping[str, float] = field(default_factory=dict)
