"""Named random numbers of one adversarial flight, so that a search can move some of them."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeVar

from gcs_tools.console.errors import CommandError

_Option = TypeVar("_Option")

# Those that move the field and the timing of one flight, and leave its contract as it is.
SEARCHED: Final = (
    "along_0", "across_0", "turn_0", "aspect_0", "size_0",
    "along_1", "across_1", "turn_1", "size_1", "late",
)  # fmt: skip
# A gene is written with so many decimals, and flown as it is written.
DECIMALS: Final = 4


@dataclass(frozen=True)
class Genes:
    """Values in [0, 1] by name: drawn from the flight's seed, unless they have been moved.

    Attributes:
        seed: of the flight; text that names it.
        moved: values that replace the drawn ones.
    """

    seed: str
    moved: Mapping[str, float] = field(default_factory=dict)

    def value(self, name: str) -> float:
        """Return a gene, in [0, 1]."""
        if name in self.moved:
            return self.moved[name]
        return round(random.Random(f"{self.seed} {name}").random(), DECIMALS)

    def uniform(self, name: str, low: float, high: float) -> float:
        """Return a gene as a number between two others."""
        return low + (high - low) * self.value(name)

    def choice(self, name: str, options: Sequence[_Option]) -> _Option:
        """Return the option that a gene chooses."""
        return options[min(math.floor(self.value(name) * len(options)), len(options) - 1)]


def genes_text(genes: Mapping[str, float]) -> str:
    """Return genes as one argument: ``name=value,…``."""
    return ",".join(f"{name}={value:.{DECIMALS}f}" for name, value in genes.items())


def genes_of(text: str) -> dict[str, float]:
    """Read genes from one argument.

    Raises:
        CommandError: the text is not of the form ``name=value,…``, a name is not that of a gene
            that can be moved, or a value is not in [0, 1].
    """
    found: dict[str, float] = {}
    for item in filter(None, text.split(",")):
        name, _, written = item.partition("=")
        if name not in SEARCHED:
            raise CommandError(f"--genes {item}: unknown gene; expected {', '.join(SEARCHED)}")
        try:
            value = float(written)
        except ValueError:
            value = math.nan
        if not 0.0 <= value <= 1.0:
            raise CommandError(f"--genes {item}: expected {name}=VALUE with a value from 0 to 1")
        found[name] = round(value, DECIMALS)
    return found
