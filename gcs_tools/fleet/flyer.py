"""A vehicle of the fleet simulation: a point mass on a polyline that flies by the protocol.

The protocol is `onboard.fleet.reservation`.  What is simple here is the flight: no planner, no
obstacles, no attitude; the vehicle keeps to straight lines, speeds up and brakes at one rate, and
turns at rest.  Its true place is off by as much as its errors allow.
"""

from __future__ import annotations

import math
import random
from bisect import bisect_left
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from onboard.fleet.area import Place, along
from onboard.fleet.reservation import OwnVehicle, Reservation
from onboard.geometry.frames import FloatArray

# A tube's boxes are no longer than this.
_PIECE_M: Final = 3.0
# Kept for waiting for leave in the duration that is proposed.
_WAITING_S: Final = 4.0
_RETRY_S: Final = (0.5, 2.0)
_ROUND_OFF_M: Final = 1e-6
# At rest so near to the end of a leg, it has arrived there.
_ARRIVED_M: Final = 0.01
# Slower than this, it rests.
_REST_MPS: Final = 1e-3

MakeReservation = Callable[[OwnVehicle, Iterable[str], Place, float], Reservation]


@dataclass(frozen=True)
class FlyerTerms:
    """A vehicle of the simulation.

    Attributes:
        own: what it says of itself; the run is filled in at each start.
        radius_m: of its body.
        cruise_mps, accel_mps2: how it flies.
        settle_s: from the reference at rest to the vehicle at rest.
        ahead_m: how much of its way it proposes at a time.
    """

    own: OwnVehicle
    radius_m: float
    cruise_mps: float
    accel_mps2: float
    settle_s: float
    ahead_m: float


class Flyer:
    """One vehicle.

    Args:
        terms: of the vehicle.
        roster: names of the fleet.
        way: places of a polyline, from where it rests.
        draw: all that is random.
        make: makes the protocol's core.

    Attributes:
        speed_mps: along its way.
        legs_flown: how many legs it has flown to their end.
        has_arrived: whether it rests at the end of its way.
        rested_s: since when it has been at rest, with more of its way ahead; infinite while it
            flies, or has arrived.
    """

    def __init__(
        self,
        terms: FlyerTerms,
        roster: Iterable[str],
        way: list[Place],
        draw: random.Random,
        make: MakeReservation = Reservation,
    ) -> None:
        self.terms, self._roster, self._draw, self._make = terms, tuple(roster), draw, make
        bearing_rad = draw.uniform(0.0, 2.0 * math.pi)
        off_m = max(terms.own.reach_m - terms.radius_m, 0.0)
        self._off_m = (off_m * math.cos(bearing_rad), off_m * math.sin(bearing_rad))
        self.speed_mps, self.legs_flown = 0.0, 0
        self.reservation: Reservation | None = None
        self._start_s = 0.0
        self.fly(way)

    # ------------------------------------------------------------------ its way

    def fly(self, way: list[Place]) -> None:
        """Follow another way, from rest where it begins."""
        self._way = way
        self._ends_m = [0.0, *accumulate(math.dist(*leg) for leg in pairwise(way))]
        self._at_m = self._granted_m = 0.0
        self._leg, self.has_arrived, self.rested_s = 0, False, math.inf
        self._asked_m, self._asked_from, self._retry_s = 0.0, -1, 0.0

    @property
    def place_m(self) -> Place:
        """Where its reference is."""
        return self._place(self._at_m)

    @property
    def true_place_m(self) -> Place:
        """Where the middle of its body is."""
        north_m, east_m = self.place_m
        return north_m + self._off_m[0], east_m + self._off_m[1]

    def _place(self, at_m: float) -> Place:
        leg = bisect_left(self._ends_m, at_m, 1, len(self._ends_m) - 1) - 1
        (n0, e0), (n1, e1) = self._way[leg], self._way[leg + 1]
        share = (at_m - self._ends_m[leg]) / max(self._ends_m[leg + 1] - self._ends_m[leg], 1e-9)
        return n0 + share * (n1 - n0), e0 + share * (e1 - e0)

    def _boxes(self, from_m: float, to_m: float) -> tuple[list[float], FloatArray]:
        """Return pieces of a part of its way, by their ends, and a box around each."""
        corners = [end for end in self._ends_m[1:-1] if from_m < end < to_m]
        ends_m, boxes = [from_m], []
        for begin_m, end_m in pairwise((from_m, *corners, to_m)):
            count = max(1, math.ceil((end_m - begin_m) / _PIECE_M))
            places = self._place(begin_m), self._place(end_m)
            boxes.append(along(*places, self.terms.own.reach_m, count))
            ends_m += np.linspace(begin_m, end_m, count + 1)[1:].tolist()
        return ends_m, np.concatenate(boxes)

    # ------------------------------------------------------------------ its daemon

    def crash(self, restart_s: float) -> None:
        """Lose all that the daemon knew; the autopilot brakes."""
        self.reservation, self._start_s = None, restart_s

    def _restart(self, now_s: float) -> None:
        boot = f"{self._draw.getrandbits(64):016x}"
        own = replace(self.terms.own, boot=boot)
        self.reservation = self._make(own, self._roster, self.place_m, now_s)
        self._granted_m, self._asked_from = self._at_m, -1

    def _ask(self, core: Reservation, now_s: float) -> None:
        """Propose more of its way where it will soon need it."""
        terms, end_m = self.terms, self._ends_m[-1]
        if now_s >= core.expires_s and self.speed_mps == 0.0 and core.outstanding is None:
            core.settle()
            self._granted_m = self._at_m
        stop_s = terms.cruise_mps / terms.accel_mps2
        soon_m = terms.cruise_mps * (stop_s / 2.0 + 2.0)
        left_s = (self._granted_m - self._at_m) / terms.cruise_mps + stop_s
        more = self._granted_m < end_m and self._granted_m - self._at_m < soon_m
        late = core.expires_s - now_s < left_s
        if core.outstanding is not None or now_s < self._retry_s or not (more or late):
            return
        self._asked_m, onward_m = self._onward(core)
        flown_s = (self._asked_m - self._at_m) / terms.cruise_mps + 2.0 * stop_s
        self._asked_from = core.active.number
        self._retry_s = now_s + self._draw.uniform(*_RETRY_S)
        core.propose(onward_m, flown_s + terms.settle_s + _WAITING_S, now_s)

    def _onward(self, core: Reservation) -> tuple[float, FloatArray]:
        """Return up to where its way is free of records, as far as it asks, and the boxes."""
        granted_m = self._granted_m
        to_m = min(granted_m + self.terms.ahead_m, self._ends_m[-1])
        if to_m <= granted_m:
            return granted_m, np.zeros((0, 4))
        ends_m, boxes_m = self._boxes(granted_m, to_m)
        free = core.free_of_records(boxes_m)
        return ends_m[free], boxes_m[:free]

    # ------------------------------------------------------------------ its flight

    def step(self, now_s: float, step_s: float) -> None:
        """Decide, then fly one step."""
        core = self.reservation
        if core is None and now_s >= self._start_s and self.speed_mps == 0.0:
            self._restart(now_s)
            core = self.reservation
        if core is not None:
            if self._asked_from >= 0 and core.active.number != self._asked_from:
                self._granted_m, self._asked_from = self._asked_m, -1
            if not self.has_arrived:
                self._ask(core, now_s)
            core.tick(now_s)
        self._move(core, now_s, step_s)
        if core is not None:
            core.report(self.place_m, now_s + step_s)

    def _move(self, core: Reservation | None, now_s: float, step_s: float) -> None:
        terms = self.terms
        slower_mps = max(self.speed_mps - terms.accel_mps2 * step_s, 0.0)
        speed_mps = slower_mps
        if core is not None:
            # From the end of this step on, it can brake to rest in its tube, in time.
            room_m = max(min(self._granted_m, self._ends_m[self._leg + 1]) - self._at_m, 0.0)
            reach_mps = terms.accel_mps2 * step_s
            stop_mps = math.sqrt(reach_mps**2 + 2.0 * terms.accel_mps2 * room_m) - reach_mps
            left_s = core.expires_s - now_s - terms.settle_s - step_s
            wish_mps = min(terms.cruise_mps, self.speed_mps + reach_mps, stop_mps)
            speed_mps = max(slower_mps, min(wish_mps, terms.accel_mps2 * left_s), 0.0)
            speed_mps = 0.0 if room_m < _ROUND_OFF_M else speed_mps
        self._at_m += speed_mps * step_s
        self.speed_mps = 0.0 if speed_mps < _REST_MPS else speed_mps
        if self.speed_mps == 0.0 and not self.has_arrived:
            self._end_leg()
        flying = self.speed_mps > 0.0 or self.has_arrived
        self.rested_s = math.inf if flying else min(self.rested_s, now_s)

    def _end_leg(self) -> None:
        """Go on to the next leg, at rest where one ends."""
        end_m = self._ends_m[self._leg + 1]
        if self._at_m < end_m - _ARRIVED_M:
            return
        self.legs_flown += 1
        self.has_arrived = self._leg == len(self._ends_m) - 2
        if not self.has_arrived:
            self._leg += 1
