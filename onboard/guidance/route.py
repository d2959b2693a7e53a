"""The legs that are flown, one after another, until another mission replaces those left.

A leg begins where the vehicle has come to rest, since an avoidance may have left it beside the end
of the leg before (erratum 16).  That is why a mission can be replaced in flight: the vehicle comes
to rest under the guarantee, wherever it is, and what follows is a leg like any other.
"""

from __future__ import annotations

import math

from onboard.files.mission_file import LEG_LENGTH_MIN_M, Leg, Mission
from onboard.geometry.frames import LegFrame
from onboard.guidance.returning.flown_way import FlownWay


class Route:
    """The legs of a mission, and the one that is flown.

    Args:
        mission: where to fly.

    Attributes:
        mission: what is flown.
        successor: the mission to fly next instead; None if there is none.
        way_back: the mission that returns along the way flown; None before one was made.
        flown: the way since control was taken.
        frame: of the leg that is flown.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.successor: Mission | None = None
        self.way_back: Mission | None = None
        self.flown = FlownWay()
        self._index = 0
        self.frame = self._frame_from(*mission.start_ned_m)

    @property
    def leg(self) -> Leg:
        """The leg that is flown."""
        return self.mission.legs[self._index]

    @property
    def index(self) -> int:
        """Number of that leg, counted from 0."""
        return self._index

    @property
    def length_m(self) -> float:
        """Length of that leg."""
        return math.dist(self.frame.origin_ned_m[:2], self.leg.end_ned_m)

    @property
    def returning(self) -> bool:
        """Whether the way back is flown, or is what is flown next."""
        coming = self.successor or self.mission
        return self.way_back is not None and coming is self.way_back

    @property
    def returns_next(self) -> bool:
        """Whether the leg that is flown is the last, and the vehicle returns after it."""
        last = self._index == len(self.mission.legs) - 1
        return last and self.successor is None and self.mission.on_end == "return"

    def restart(self) -> None:
        """Begin the successor, if there is one, at its own start."""
        if self.successor is not None:
            self.mission, self.successor, self._index = self.successor, None, 0
            self.frame = self._frame_from(*self.mission.start_ned_m)

    def begin_next(self, north_m: float, east_m: float) -> bool:
        """Begin the next leg, or the successor's first, from here; False if none is left."""
        following = self._index + 1
        if self.successor is not None:
            self.mission, self.successor, following = self.successor, None, 0
        while following < len(self.mission.legs):
            self._index = following
            # A leg that ends here has been flown.
            if math.dist((north_m, east_m), self.leg.end_ned_m) >= LEG_LENGTH_MIN_M:
                self.frame = self._frame_from(north_m, east_m)
                return True
            following += 1
        return False

    def _frame_from(self, north_m: float, east_m: float) -> LegFrame:
        down_m = -self.mission.altitude_m
        return LegFrame.between((north_m, east_m, down_m), (*self.leg.end_ned_m, down_m))
