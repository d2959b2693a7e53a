"""To the height of the leg on the spot, where the vehicle starts at another.

What is seen free is so at one height: no frame counts before, and nothing is flown along the leg.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from onboard.motion.trajectory import State
from onboard.planning.closed_form import cruise

if TYPE_CHECKING:
    from onboard.guidance.situation import Situation
    from onboard.motion.trajectory import Vector
    from onboard.planning.problem import Envelope

# A start nearer to the height of the leg than this is at it.
LEVEL_M: Final = 0.02
# Time is of no importance here, and nothing has been seen above or below.
CLIMB_MPS: Final = 0.5


def climbing(envelope: Envelope) -> Envelope:
    """Return the limits of a climb or descent on the spot."""
    return replace(envelope, speed_max_mps=min(envelope.speed_max_mps, CLIMB_MPS))


class Level:
    """Climbs or descends, at rest horizontally.

    Args:
        situation: what is flown.

    Attributes:
        changing: whether the vehicle is on its way to the height of the leg.
    """

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self.changing = False

    def begin(self, position_leg_m: Vector, now_s: float) -> bool:
        """Go to the height of the leg; tell whether the vehicle has to."""
        self.changing = abs(position_leg_m[2]) > LEVEL_M
        if self.changing:
            hovering = State(position_leg_m, (0.0, 0.0, 0.0))
            climb = cruise(hovering, now_s, climbing(self._situation.envelope), 0.0, z_m=0.0)
            self._situation.reference.fly(climb)
        return self.changing

    def reached_leg_m(self, now_s: float) -> Vector | None:
        """Return where the vehicle has come to rest; None while it climbs or descends."""
        climb = self._situation.reference.current
        assert climb is not None  # noqa: S101  it is flown
        return climb.final.position_leg_m if now_s >= climb.end_s else None
