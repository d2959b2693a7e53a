"""What a command leaves behind, as the tests see it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

CONFIG = Path(__file__).parents[2] / "config"


class Ran(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


Clearway = Callable[..., Ran]
