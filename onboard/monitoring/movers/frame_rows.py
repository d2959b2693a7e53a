"""Why no place is known to hold no mover: which sensor's frames do not count, and what they lack.

A place counts once enough successive frames of one sensor have shown it.  A vehicle that waits for
that without a word would seem to wait for a mover.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Final

from onboard.monitoring.assumptions import ALL_ROUND_DEG
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.tracker import TRACKS_MAX

# Sensors beyond these are not told apart: whatever publishes chooses their names.
_SOURCES_MAX: Final = 50


@unique
class Uncounted(StrEnum):
    """Why a frame shows no place free of movers."""

    INCOMPLETE = "they do not say that they name all they see (frame_complete)"
    DOUBTED = "they contradict what the contract says of their sensor"
    PLACELESS = "the vehicle turned or left its height, they are too old, or no pose fits them"
    CROWDED = f"there are more than {TRACKS_MAX} movers, which is as many as are followed"
    LATE = "frames of other sensors have overtaken them by too much"

    @property
    def stays(self) -> bool:
        """Whether waiting does not end it: the sensor has to be set up differently."""
        return self in (Uncounted.INCOMPLETE, Uncounted.LATE)


@dataclass
class _Row:
    all_round: bool
    why: Uncounted | None = None
    # Successive frames that did not count for this reason.
    frames: int = 0


class FrameRows:
    """Takes note of each frame that may show where no mover is.

    Args:
        frames_needed: K, successive frames of one sensor that have to show a place.
    """

    def __init__(self, frames_needed: int) -> None:
        self._needed = frames_needed
        self._rows: dict[str, _Row] = {}

    def note(self, frame: DetectionFrame, why: Uncounted | None) -> None:
        """Take note of a frame.

        Args:
            frame: of a sensor.
            why: it does not count; None if it does.
        """
        row = self._rows.get(frame.source)
        if row is None:
            if len(self._rows) >= _SOURCES_MAX:
                return
            row = self._rows[frame.source] = _Row(all_round=False)
        row.all_round = frame.field_of_view_deg >= ALL_ROUND_DEG
        row.frames = row.frames + 1 if why is row.why else 1
        row.why = why

    def _telling(self) -> dict[str, _Row]:
        """Return the sensors that tell of the place around the vehicle."""
        rings = {source: row for source, row in self._rows.items() if row.all_round}
        return rings or self._rows

    def refusal(self) -> str | None:
        """Return why no frame will count until a sensor is set up differently; None if one may."""
        reasons = []
        for source, row in sorted(self._telling().items()):
            if row.why is None or not row.why.stays or row.frames < self._needed:
                return None
            reasons.append(f"frames of {source} show no place free of movers: {row.why}")
        return "; ".join(reasons) or None

    def missing(self, in_row: Callable[[str], int]) -> str | None:
        """Return what is missing before a place around the vehicle counts; None if nothing is.

        Args:
            in_row: tells how many successive frames of a sensor have counted.
        """
        telling = self._telling()
        if not telling:
            return "no sensor has said where no mover is"
        best = max(sorted(telling), key=in_row)
        if in_row(best) >= self._needed:
            return None
        text = f"{in_row(best)} of {self._needed} successive frames of {best} have counted"
        why = telling[best].why
        return text if why is None else f"{text}: {why}"
