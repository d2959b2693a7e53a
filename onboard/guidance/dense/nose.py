"""Turns the nose in flight, a tick's worth at a time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from onboard.contract.assessment import TICK_S
from onboard.geometry.frames import wrap_angle
from onboard.planning.corridor.horizon import PIECE_S
from onboard.planning.corridor.look import TURN_MAX_RADPS, heading_in_flight_rad

if TYPE_CHECKING:
    from onboard.guidance.reference import Reference
    from onboard.planning.corridor.look import Outlook

# After a turn the nose of a vehicle follows its command within this.
_STEADY_S: Final = 1.0
_STEADY_RADPS: Final = math.radians(0.5)


class Nose:
    """Chooses where the nose points until the next node, and turns it there.

    Args:
        reference: whose heading is commanded.

    Attributes:
        steady: whether the nose has been told for a while to point where it does.
    """

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._turned_s = -math.inf
        self._turn_radps = 0.0
        self.steady = False

    def rest(self, now_s: float) -> None:
        """Keep the nose where it is; a look at rest may have turned it just now."""
        self._turned_s, self._turn_radps, self.steady = now_s, 0.0, False

    def follow(self, outlook: Outlook, most_radps: float) -> None:
        """Point along the guide until the next node.

        Args:
            outlook: what is known.
            most_radps: as fast as the limits of plans allow for.
        """
        turn_rad = heading_in_flight_rad(outlook, PIECE_S) - self._reference.heading_rad
        self._turn_radps = max(-most_radps, min(most_radps, turn_rad / PIECE_S))

    def return_to_leg(self) -> None:
        """Turn back along the leg until the next node."""
        turn_radps = wrap_angle(-self._reference.heading_rad) / PIECE_S
        self._turn_radps = max(-TURN_MAX_RADPS, min(TURN_MAX_RADPS, turn_radps))

    def turn(self, now_s: float) -> None:
        """Turn the nose by a tick's worth."""
        self._reference.heading_rad += self._turn_radps * TICK_S
        if abs(self._turn_radps) > _STEADY_RADPS:
            self._turned_s = now_s
        self.steady = now_s - self._turned_s >= _STEADY_S
