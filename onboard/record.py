"""One line of the flight log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Record:
    """One line of the log.

    Attributes:
        topic: what kind.
        time_unix_s: when.
        payload: JSON values; in topics of our own, ``time_s`` (Unix) among them.
        schema: name of the Foxglove schema that it follows; empty for one of our own.
    """

    topic: str
    time_unix_s: float
    payload: dict[str, Any]
    schema: str = ""
