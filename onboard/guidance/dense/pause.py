"""PAUSE: nothing better certifies, so look: along the guide first, then all round.

A pause is not a failure: every assumption holds, and the vehicle stays on its way to rest.  From
the second look in a row on, the guide's cost just ahead is raised, so that another gap is tried.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from onboard.guidance.dense.look_round import LookRound
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.planning.corridor.guide import along
from onboard.planning.corridor.look import looks_at_rest_rad

if TYPE_CHECKING:
    from onboard.guidance.reference import Reference
    from onboard.planning.corridor.guide import Guide
    from onboard.planning.corridor.look import Outlook

# Of one leg; then the vehicle gives up.
PAUSES_MAX: Final = 25
# About one place: so many and for so long.  Obstacles stand still, so that more looks from there
# show nothing new, while the vehicle's battery empties.
PAUSES_HERE_MAX: Final = 4
HERE_MAX_S: Final = 90.0
_HERE_M: Final = 4.0
# This far ahead the guide's cost is raised.
_COST_AHEAD_M: Final = 0.8
# Nearer to the leg's end than before by this: what was tried has helped.
_PROGRESS_M: Final = 1.0
# After a look, a plan has this long to certify before the next look.
_PLANNING_S: Final = 1.0


class Pause:
    """Counts the pauses of a leg, and looks around in each.

    Args:
        reference: whose heading is commanded.
        guide: towards the leg's end.

    Attributes:
        count: pauses on this leg.
    """

    def __init__(self, reference: Reference, guide: Guide) -> None:
        self._reference, self._guide = reference, guide
        self._round = LookRound((), 0)
        self.count = self._in_a_row = 0
        self._left_m: float | None = None
        self._looked_s: float | None = None
        # Where the vehicle pauses, since when, and how often so far.
        self._place_leg_m, self._here_since_s = (math.inf, math.inf), 0.0
        self._count_here = 0

    @property
    def exhausted(self) -> bool:
        """Whether the vehicle has looked often enough on this leg."""
        return self.count >= PAUSES_MAX

    def exhaustion(self, now_s: float) -> Violation | None:
        """Return what says that the vehicle has looked often enough, on this leg or from here."""
        if self.exhausted:
            pauses = float(self.count)
            return Violation(Assumption.NO_PASSAGE, pauses, float(PAUSES_MAX), "pauses")
        here_s = now_s - self._here_since_s
        if self._count_here >= PAUSES_HERE_MAX and here_s > HERE_MAX_S:
            return Violation(Assumption.NO_PASSAGE, here_s, HERE_MAX_S, "s at one place")
        return None

    @property
    def looking(self) -> bool:
        """Whether the nose turns, or has come to point somewhere."""
        return self._looked_s is None

    @property
    def repeated(self) -> bool:
        """Whether the vehicle has looked since it last got on."""
        return self._in_a_row > 0

    def begin_leg(self) -> None:
        """Count from zero again."""
        self.count = self._in_a_row = self._count_here = 0
        self._left_m = None

    def look_round(self, headings_rad: tuple[float, ...], frames_needed: int) -> None:
        """Begin to look at some headings."""
        self._round, self._looked_s = LookRound(headings_rad, frames_needed), None

    def begin(
        self, outlook: Outlook, frames_needed: int, now_s: float, *, along_leg: bool = False
    ) -> None:
        """Begin a pause.

        Args:
            outlook: what is known.
            frames_needed: frames that have to count at each heading.
            now_s: the time.
            along_leg: turn the nose back along the leg at the end: nothing is planned before.
        """
        if math.dist(outlook.position_leg_m, self._place_leg_m) > _HERE_M or not self._count_here:
            self._place_leg_m, self._here_since_s = outlook.position_leg_m, now_s
            self._count_here = 0
        self._count_here += 1
        self.count += 1
        self._in_a_row += 1
        looks_rad = looks_at_rest_rad(outlook, all_round=self._in_a_row > 1)
        nothing_new = len(looks_rad) == 1
        if (self._in_a_row > 1 or nothing_new) and outlook.path_leg_m is not None:
            x_m, y_m = along(outlook.path_leg_m, (_COST_AHEAD_M,))[0].tolist()
            self._guide.penalized_leg_m.append((x_m, y_m))
        self.look_round((*looks_rad, 0.0) if along_leg else looks_rad, frames_needed)

    def advance(self, heading_rad: float, frames_counted: int, now_s: float) -> bool:
        """Look for one tick; tell whether the look is over and planning has had its time, too.

        Args:
            heading_rad: of the nose, measured, from the leg.
            frames_counted: so far.
            now_s: the time.
        """
        if self._looked_s is None:
            if self._round.advance(self._reference, heading_rad, frames_counted):
                self._looked_s = now_s
            return False
        return now_s - self._looked_s >= _PLANNING_S

    def note_progress(self, left_m: float) -> None:
        """Begin with the guide again at the next pause, if the vehicle has got on since."""
        if self._left_m is None or left_m < self._left_m - _PROGRESS_M:
            self._left_m, self._in_a_row = left_m, 0
