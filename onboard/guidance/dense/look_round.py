"""Turning the nose at rest, and dwelling at each heading until enough frames have counted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from onboard.contract.assessment import TICK_S
from onboard.geometry.frames import wrap_angle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.guidance.reference import Reference

# Frames that are taken at this rate do not count; at rest the nose may turn so all the same.
TURN_AT_REST_RADPS: Final = math.radians(60.0)
# The nose points where it was told to within this.
POINTING_RAD: Final = math.radians(5.0)


class LookRound:
    """Looks at a few headings, one after another.

    Args:
        headings_rad: from the leg towards its right, in order.
        frames_needed: frames that have to count at each of them.
    """

    def __init__(self, headings_rad: Sequence[float], frames_needed: int) -> None:
        self._left_rad = list(headings_rad)
        self._needed = frames_needed
        # Frames that had counted when the nose came to point there; None while it turns.
        self._counted_before: int | None = None

    def advance(self, reference: Reference, heading_rad: float, frames_counted: int) -> bool:
        """Turn and look for one tick; tell whether all has been looked at.

        Args:
            reference: whose heading is commanded.
            heading_rad: of the nose, measured, from the leg.
            frames_counted: so far.
        """
        if not self._left_rad:
            return True
        wanted_rad = self._left_rad[0]
        turn_rad = wrap_angle(wanted_rad - reference.heading_rad)
        step_rad = TURN_AT_REST_RADPS * TICK_S
        reference.heading_rad += max(-step_rad, min(step_rad, turn_rad))
        if abs(turn_rad) > step_rad or not points_at(heading_rad, wanted_rad):
            self._counted_before = None
        elif self._counted_before is None:
            self._counted_before = frames_counted
        elif frames_counted - self._counted_before >= self._needed:
            self._left_rad.pop(0)
            self._counted_before = None
        return not self._left_rad


def points_at(heading_rad: float, wanted_rad: float) -> bool:
    """Tell whether the nose points where it was told to."""
    return abs(wrap_angle(heading_rad - wanted_rad)) <= POINTING_RAD
