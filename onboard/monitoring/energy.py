"""Budgets the battery for the way back: what it has taken to get here, and what it takes to hover.

The way back is the way that was flown, looks and pauses included, so that what has been used since
control was taken bounds it; and at least what hovering takes for as long.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from onboard.files.mission_file import EnergyBudget, Mission

# A battery that is not reported for this long is unknown: then it counts as failing.
SILENCE_S: Final = 5.0
# Charges are reported in whole percent: each may be off by half of one, their difference by one.
RESOLUTION: Final = 0.01
# Before each leg the vehicle turns and looks for about this long.
LOOK_S: Final = 10.0


class EnergyMonitor:
    """Says when the vehicle has to return, and when its reserve is reached."""

    def __init__(self) -> None:
        self._departed_s, self._departure_charge = math.inf, 1.0

    def begin_flight(self, charge: float | None, now_s: float) -> None:
        """Count what is used from here.

        Args:
            charge: of the battery, from 0 to 1; None if it is unknown.
            now_s: the time.
        """
        self._departed_s, self._departure_charge = now_s, 1.0 if charge is None else charge

    def return_cause(self, budget: EnergyBudget, charge: float | None, now_s: float) -> str | None:
        """Return why the vehicle has to fly back now; None while it need not.

        Args:
            budget: of the mission.
            charge: of the battery, from 0 to 1; None if it is unknown.
            now_s: the time.
        """
        if charge is None:
            return f"the battery has not been reported for {SILENCE_S:g} s"
        used = self._departure_charge - charge + RESOLUTION
        hovered = max(now_s - self._departed_s, 0.0) / budget.endurance_s
        needed = max(used, hovered)
        if charge - needed > budget.reserve_fraction:
            return None
        return (
            f"battery at {_percent(charge)}, the way back may take {_percent(needed)},"
            f" reserve {_percent(budget.reserve_fraction)}"
        )


def shortage(
    budget: EnergyBudget, charge: float | None, mission: Mission, speed_mps: float
) -> str | None:
    """Return why a mission may not be begun with a battery; None if it may.

    Args:
        budget: of the mission.
        charge: of the battery, from 0 to 1; None if it is unknown.
        mission: to fly, and to return from.
        speed_mps: of cruise.
    """
    if charge is None:
        return "the battery's charge is unknown, and the mission has an energy budget"
    needed_s = there_and_back_s(mission, speed_mps)
    needed = needed_s / budget.endurance_s + budget.reserve_fraction
    if charge >= needed:
        return None
    return (
        f"battery at {_percent(charge)}: {needed_s:.0f} s there and back and the reserve take"
        f" {_percent(needed)}"
    )


def there_and_back_s(mission: Mission, speed_mps: float) -> float:
    """Return how long the legs of a mission and the way back take at least, looks included."""
    places_ned_m = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
    length_m = math.fsum(math.dist(*leg) for leg in pairwise(places_ned_m))
    return 2.0 * (length_m / speed_mps + LOOK_S * len(mission.legs))


def at_reserve(budget: EnergyBudget, charge: float | None) -> str | None:
    """Return the call to land that an exhausted budget makes; None before."""
    if charge is None or charge > budget.reserve_fraction:
        return None
    return f"battery at {_percent(charge)}, reserve {_percent(budget.reserve_fraction)}: land now"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"
