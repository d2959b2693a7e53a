"""Takes down every way to rest that the service held in a flight, exactly and not as recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.guidance.phases import FLYING_PHASES

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.guidance.navigator import Navigator
    from onboard.motion.trajectory import Trajectory

# At the fastest speed that campaigns draw, points this far apart in time are 0.3 m apart.
_STEP_S: Final = 0.05


@dataclass(frozen=True)
class HeldWay:
    """One way to rest.

    Attributes:
        time_s: when it was held first, on the service's clock.
        points_ned_m: of the way from then on, (n, 2), north and east.
    """

    time_s: float
    points_ned_m: FloatArray


class HeldWays:
    """Follows the way that is held from tick to tick."""

    def __init__(self) -> None:
        self._last: Trajectory | None = None
        self.ways: list[HeldWay] = []

    def follow(self, navigator: Navigator, now_s: float) -> None:
        """Take down the way of a tick, if it is another one than before.

        Before the first certificate none is held: the vehicle stays where it has taken control,
        and the service says of no place there that it is free.
        """
        shield, held = navigator.shield, None
        if shield is not None and navigator.phase in FLYING_PHASES:
            held = None if shield.rest_certified is None else shield.held_way
        if held is self._last:
            return
        self._last = held
        if held is not None:
            times_s = np.append(np.arange(now_s, held.end_s, _STEP_S), max(now_s, held.end_s))
            points_ned_m = navigator.leg.position_ned_from_leg(held.positions_leg_m(times_s))
            self.ways.append(HeldWay(now_s, points_ned_m[:, :2]))
