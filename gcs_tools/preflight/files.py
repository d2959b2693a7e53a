"""The files that a pre-flight check reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class PreflightFiles:
    """Files that a check reads.

    Attributes:
        contract, field, mission, geofence, parameters: all but the first may be None.
        daemon: whose sensors are checked; may be None.
        overrides: of the contract, as given to ``--set``.
        picture: to draw the field to; None for no picture.
    """

    contract: Path
    field: Path | None
    mission: Path | None
    overrides: tuple[str, ...]
    picture: Path | None
    geofence: Path | None = None
    parameters: Path | None = None
    daemon: Path | None = None
