"""The violation where a report contradicts what has been seen free."""

from __future__ import annotations

from onboard.monitoring.assumptions import Assumption, Violation


def contradiction(track_id: str) -> Violation:
    """Return the violation: an obstacle that is reported where all was seen free."""
    sentence = f"{track_id} is reported where all was seen free"
    return Violation(
        Assumption.SENSOR_CONTRADICTION, 1.0, 0.0, "boxes", track_id, sentence=sentence
    )
