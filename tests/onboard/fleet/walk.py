"""Whole members of a fleet that cross, hostile in all that no rule forbids.

Any payload ever sent may arrive at any later time, often, or cut off; clocks are apart; daemons die
in flight and start again; ticks are late.  What is flown is a way to rest that was in the tube when
it was taken up, to its end, with nothing looked at on the way.  Each body is off by all of its
errors, in directions that are drawn.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np

from onboard.fleet.area import Place, around, holds, meet
from onboard.fleet.course import Course, FlightTerms
from onboard.fleet.member import FleetMember
from onboard.fleet.membership import FleetMembership
from onboard.geometry.frames import FloatArray
from onboard.geometry.local_frame import GeographicPoint, LocalFrame

FRAME = LocalFrame(GeographicPoint(47.397742, 8.545594), "px4")
RADIUS_M, TRACKING_M, ERROR_M = 0.3, 0.3, 0.4
BODY_M = RADIUS_M + TRACKING_M
STEP_S, PACE_M = 0.5, 1.2
SETTLE_S = 0.4
TERMS = FlightTerms(
    body_m=BODY_M,
    cruise_mps=PACE_M / STEP_S,
    brake_mps2=2.0,
    lag_s=0.3,
    settle_s=SETTLE_S,
    run_on_s=0.5,
)
# Two that cross, and one whose way both cross at an end.
LEGS: dict[str, tuple[Place, Place]] = {
    "north": ((-9.0, 0.0), (9.0, 0.0)),
    "east": ((0.0, -9.0), (0.0, 9.0)),
    "slant": ((-9.0, 7.0), (7.0, -9.0)),
}
# So much that each has to ask each, and tubes are disjoint at all times.
SPEED_MAX_MPS = 200.0


@dataclass
class Flier:
    """A vehicle.

    Attributes:
        member: of the present run.
        leg: that it flies; back again once it is at its end.
        at_m: along it, of its reference.
        clock_s: how far its clock is ahead.
        aside_m: where it really is, beside where it takes itself to be.
        way_m: places along the leg that it will be at, one each step, come what may.
        runs: of its daemon.
    """

    member: FleetMember
    leg: tuple[Place, Place]
    at_m: float
    clock_s: float
    aside_m: Place
    way_m: list[float] = field(default_factory=list)
    runs: int = 1

    def place_m(self, at_m: float | None = None) -> Place:
        """Return a place on the leg; by default where the reference is."""
        (n0, e0), (n1, e1) = self.leg
        share = (self.at_m if at_m is None else at_m) / math.dist(*self.leg)
        return n0 + share * (n1 - n0), e0 + share * (e1 - e0)

    def course(self, now_s: float) -> Course:
        """Return what it does at a time of its own clock."""
        held = [self.at_m, *self.way_m] if self.way_m else []
        held_m = [_swept(self.place_m(a), self.place_m(b)) for a, b in pairwise(held)]
        return Course(
            self.place_m(),
            now_s,
            now_s + STEP_S * len(self.way_m) + SETTLE_S,
            not self.way_m,
            np.concatenate(held_m) if held_m else np.zeros((0, 4)),
            self.leg,
            TERMS,
        )

    def decide(self, now_s: float, pieces: int) -> None:
        """Take up a longer way if the tube has room for it, and it ends in time."""
        begin_m = self.way_m[-1] if self.way_m else self.at_m
        length_m = math.dist(*self.leg)
        onward_m = [min(begin_m + PACE_M * (n + 1), length_m) for n in range(pieces)]
        rests_s = now_s + STEP_S * (len(self.way_m) + pieces) + SETTLE_S
        if rests_s >= self.member.expires_s or begin_m >= length_m:
            return
        boxes_m = [
            _swept(self.place_m(a), self.place_m(b))
            for a, b in zip([begin_m, *onward_m], onward_m, strict=False)
        ]
        if all(holds(self.member.tube_m, box_m) for box_m in boxes_m):
            self.way_m += onward_m


def _swept(one_m: Place, other_m: Place) -> FloatArray:
    """Return the box around a body that flies from one place to another, (1, 4)."""
    both_m = np.concatenate((around(one_m, BODY_M), around(other_m, BODY_M)))
    low_m, high_m = both_m.min(axis=0), both_m.max(axis=0)
    return np.array([[low_m[0], high_m[1], low_m[2], high_m[3]]])


class Walk:
    """Some members, driven by a seed.

    Args:
        count: of vehicles.
        draw: all that is random.

    Attributes:
        fliers: by name.
        fault: what should never be; None if it was not.
        flown_m: by all.
        arrived: how often one was at the end of a leg.
        restarts: of daemons, in flight or at rest.
    """

    def __init__(self, count: int, draw: random.Random) -> None:
        self._draw = draw
        self._legs = dict(list(LEGS.items())[:count])
        self._now_s = 0.0
        self._sent: list[tuple[str, str, bytes]] = []
        self.fault: str | None = None
        self.flown_m, self.arrived, self.restarts = 0.0, 0, 0
        self.fliers: dict[str, Flier] = {}
        self._bodies_m: dict[str, Place] = {}
        for name, leg in self._legs.items():
            at_m = draw.choice((0.0, 2.0, 15.0 if name == "north" else 1.0))
            clock_s, away_rad = draw.choice((0.0, 1e3, -1e3)), draw.uniform(-math.pi, math.pi)
            aside_m = (ERROR_M * math.cos(away_rad), ERROR_M * math.sin(away_rad))
            self.fliers[name] = Flier(self._run(name, 1), leg, at_m, clock_s, aside_m)
            self._bodies_m[name] = self._body(self.fliers[name])

    def _run(self, name: str, run: int) -> FleetMember:
        contracts = dict.fromkeys(self._legs, "c" * 64)
        lane_m = self._draw.choice((0.3, 1.0))
        membership = FleetMembership(name, contracts, FRAME, ERROR_M, SPEED_MAX_MPS, lane_m)
        started = FleetMember(membership, f"{ord(name[0]):08x}{run:08x}", lambda _: None)
        started.place_by(FRAME)
        return started

    def run(self, actions: int) -> None:
        """Do so many things that may happen, or until what should never be."""
        draw = self._draw
        restarts = draw.choice((0.0, 0.005, 0.02))
        for _ in range(actions):
            name = draw.choice(tuple(self.fliers))
            flier, what = self.fliers[name], draw.random()
            if draw.random() < restarts:
                self._restart(name, flier)
            elif what < 0.3:
                self._deliver(name, flier)
            elif what < 0.5:
                self._talk()
            elif what < 0.65:
                self._tick(name, flier)
            else:
                self._fly()
            self.fault = self.fault or self._wrong_tube()
            if self.fault is not None:
                return

    def _restart(self, name: str, flier: Flier) -> None:
        """Start another run; the way that is held is flown to its end all the same."""
        flier.runs += 1
        self.restarts += 1
        flier.member = self._run(name, flier.runs)

    def _tick(self, name: str, flier: Flier) -> None:
        now_s = self._now_s + flier.clock_s
        if not flier.way_m and flier.at_m >= math.dist(*flier.leg):
            flier.leg, flier.at_m = flier.leg[::-1], 0.0
            self.arrived += 1
        flier.member.advance(flier.course(now_s), now_s)
        self._sent += [(name, *each) for each in flier.member.take_to_send()]
        if self._draw.random() < 0.9:
            flier.decide(now_s, self._draw.randint(1, 4))

    def _talk(self) -> None:
        """Let most hear most of what most now say."""
        draw, before = self._draw, len(self._sent)
        for name, flier in self.fliers.items():
            if draw.random() < 0.9:
                self._tick(name, flier)
        for sender, key, payload in self._sent[before:]:
            for name, flier in self.fliers.items():
                if name != sender and draw.random() < 0.9:
                    flier.member.receive(key, payload)

    def _deliver(self, name: str, flier: Flier) -> None:
        """Deliver one of the newest payloads, or any; sometimes cut off."""
        draw = self._draw
        if not self._sent:
            return
        newest = self._sent[-8:] if draw.random() < 0.6 else self._sent
        sender, key, payload = draw.choice(newest)
        if sender == name:
            return
        if draw.random() < 0.03:
            payload = payload[: draw.randrange(len(payload))]
        flier.member.receive(key, payload)

    def _fly(self) -> None:
        """Let a step pass, and look for contact."""
        self._now_s += STEP_S
        before, moved = self._bodies_m, set()
        for name, flier in self.fliers.items():
            if flier.way_m:
                to_m = flier.way_m.pop(0)
                self.flown_m += to_m - flier.at_m
                flier.at_m = to_m
                moved.add(name)
        self._bodies_m = {name: self._body(flier) for name, flier in self.fliers.items()}
        for one, other in combinations(self.fliers, 2):
            if {one, other} & moved:
                begin_m = _less(before[one], before[other])
                end_m = _less(self._bodies_m[one], self._bodies_m[other])
                if _nearest_m(begin_m, end_m) < 2.0 * RADIUS_M:
                    self.fault = f"{one} and {other} touch"
        for name, flier in self.fliers.items():
            if self._draw.random() < 0.9:
                self._tick(name, flier)

    def _body(self, flier: Flier) -> Place:
        """Return where a body is: off by its errors."""
        away_rad = self._draw.uniform(-math.pi, math.pi)
        north_m, east_m = flier.place_m()
        off_m = flier.aside_m
        return (
            north_m + off_m[0] + TRACKING_M * math.cos(away_rad),
            east_m + off_m[1] + TRACKING_M * math.sin(away_rad),
        )

    def _wrong_tube(self) -> str | None:
        """Return whose tubes overlap, or who flies outside of its own."""
        tubes_m = {
            name: flier.member.reservation.active.boxes_m
            for name, flier in self.fliers.items()
            if flier.member.reservation is not None
        }
        for name, tube_m in tubes_m.items():
            if not holds(tube_m, around(self.fliers[name].place_m(), BODY_M + ERROR_M)):
                return f"{name} is outside of its tube"
        for one, other in combinations(tubes_m, 2):
            if meet(tubes_m[one], tubes_m[other]):
                return f"the tubes of {one} and {other} overlap"
        return None


def _less(one_m: Place, other_m: Place) -> Place:
    return one_m[0] - other_m[0], one_m[1] - other_m[1]


def _nearest_m(begin_m: Place, end_m: Place) -> float:
    """Return how near a straight relative motion comes to 0."""
    north_m, east_m = _less(end_m, begin_m)
    share = -(begin_m[0] * north_m + begin_m[1] * east_m) / max(north_m**2 + east_m**2, 1e-12)
    share = min(max(share, 0.0), 1.0)
    return math.hypot(begin_m[0] + share * north_m, begin_m[1] + share * east_m)
