"""The way that was flown since control was taken, and the mission that leads back along it.

A leg back is a leg like any other: it is certified while it is flown, since what stood beside the
way may have moved, and since the vehicle sees it from the other side.  What the way that was flown
gives is where to try: each leg back leads along one that was flown, and where that has led aside,
its corridor encloses the way that was flown.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.files.mission_file import LEG_LENGTH_MIN_M, Leg, Mission

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

Place = tuple[float, float]

# Places of the way are this far apart.
_SPACING_M: Final = 0.5
# However narrow its corridor is, a leg back stands for a way that leads aside by this much.
_ASIDE_MIN_M: Final = 0.5


@dataclass
class _Stretch:
    """What was flown of one leg, from its start on.

    Attributes:
        leg: the leg.
        coordinates_ned_m: north and east of every place in turn; an hour's way in pairs of Python's
            numbers takes more than a megabyte, seven times as much.
    """

    leg: Leg
    coordinates_ned_m: array[float]

    def places_ned_m(self) -> list[Place]:
        """Return the places (north, east)."""
        numbers = iter(self.coordinates_ned_m)
        return list(zip(numbers, numbers, strict=True))

    def __len__(self) -> int:
        """Count the places."""
        return len(self.coordinates_ned_m) // 2


class FlownWay:
    """Remembers where the vehicle has flown, leg by leg."""

    def __init__(self) -> None:
        self._stretches: list[_Stretch] = []

    @property
    def length_m(self) -> float:
        """Length of the way."""
        return math.fsum(math.dist(*pair) for pair in pairwise(self._places()))

    def clear(self) -> None:
        """Forget the way: control has been given back."""
        self._stretches.clear()

    def begin_leg(self, leg: Leg, place_ned_m: Place) -> None:
        """Go on along a leg from a place (north, east)."""
        self._stretches.append(_Stretch(leg, array("d", place_ned_m)))

    def add(self, place_ned_m: Place) -> None:
        """Take note of where the vehicle is (north, east)."""
        if self._stretches:
            coordinates_ned_m = self._stretches[-1].coordinates_ned_m
            if math.dist(coordinates_ned_m[-2:], place_ned_m) >= _SPACING_M:
                coordinates_ned_m.extend(place_ned_m)

    def shift(self, north_m: float, east_m: float) -> None:
        """Move with the estimate."""
        for stretch in self._stretches:
            places = np.add(stretch.places_ned_m(), (north_m, east_m))
            stretch.coordinates_ned_m = array("d", places.ravel())

    def cut_at(self, place_ned_m: Place) -> None:
        """Forget what lies beyond the place of the way that is nearest to this one."""
        places = self._places()
        if not places:
            return
        nearest = min(range(len(places)), key=lambda index: math.dist(places[index], place_ned_m))
        left = nearest + 1
        for stretch in self._stretches:
            count = len(stretch)
            del stretch.coordinates_ned_m[2 * max(left, 0) :]
            left -= count
        self._stretches = [each for each in self._stretches if len(each)]

    def mission_back(self, here_ned_m: Place, mission: Mission, body_m: float) -> Mission | None:
        """Return the mission that leads back to where control was taken.

        Args:
            here_ned_m: where the vehicle is (north, east).
            mission: that it flies; its height stays.
            body_m: how far the body reaches, with the errors of the contract.

        Returns:
            None if the vehicle is there already.
        """
        legs, at = [], here_ned_m
        for stretch in reversed(self._stretches):
            flown = np.array([*stretch.places_ned_m(), at])
            aside_m = max(stretch.leg.threading_half_width_m - body_m, _ASIDE_MIN_M)
            for end in reversed(_corners(flown, aside_m)[:-1]):
                end_ned_m = (float(end[0]), float(end[1]))
                if math.dist(at, end_ned_m) >= LEG_LENGTH_MIN_M:
                    legs.append(stretch.leg.model_copy(update={"end_ned_m": end_ned_m}))
                    at = end_ned_m
        if not legs:
            return None
        unsaid = {"start_clear_m": None, "start_clear_of_movers_m": None}
        back = {"start_ned_m": here_ned_m, **unsaid, "on_end": "hover"}
        return mission.model_copy(update={**back, "legs": tuple(legs)})

    def _places(self) -> list[Place]:
        return [place for stretch in self._stretches for place in stretch.places_ned_m()]


def _corners(way_m: FloatArray, aside_m: float) -> FloatArray:
    """Return the places of a way, (n, 2), between which it keeps near to straight lines.

    That is the algorithm of Ramer, Douglas and Peucker.

    Args:
        way_m: (n, 2), two places at least.
        aside_m: how far from those lines the way may lead.
    """
    kept = {0, len(way_m) - 1}
    pending = [(0, len(way_m) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        begin_m, along_m = way_m[first], way_m[last] - way_m[first]
        apart_m = way_m[first + 1 : last] - begin_m
        length2_m2 = float(along_m @ along_m)
        # The distance to the segment, not to its line: a way may turn back beyond its end.
        share = np.clip(apart_m @ along_m / length2_m2, 0.0, 1.0) if length2_m2 > 0.0 else 0.0
        off_m = np.linalg.norm(apart_m - np.multiply.outer(share, along_m), axis=-1)
        worst = int(off_m.argmax())
        if off_m[worst] > aside_m:
            middle = first + 1 + worst
            kept.add(middle)
            pending += [(first, middle), (middle, last)]
    return way_m[sorted(kept)]
