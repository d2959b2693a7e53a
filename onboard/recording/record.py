"""One line of the flight log."""

from __future__ import annotations

from typing import Any, NamedTuple

# Seven times as fast as `json`, and pydantic brings it anyway: logs are written every tick.
from pydantic_core import to_json


class Record(NamedTuple):
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

    def as_json(self) -> bytes:
        """Return the payload in UTF-8; a number that is not finite is null, as JSON has none."""
        return to_json(self.payload, inf_nan_mode="null")
