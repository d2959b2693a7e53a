"""Vehicles on a line whose network is a soup: any message ever sent may arrive at any later time.

So it is lost, late, repeated and overtaken without bound, and every partition is among what may
happen.  Clocks are apart, runs end and begin at rest.  Bodies are watched, not tubes: two that did
not ask each other may hold one place for different times.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from itertools import combinations

from onboard.fleet.area import along
from onboard.fleet.messages import Message
from onboard.fleet.reservation import OwnVehicle, Reservation

REACH_M = 0.4
SPEED_MPS = 1.0
STEP_S = 1.0
FAR_S = 1e6


@dataclass
class Body:
    """A vehicle: where it is, and the places in a row that it may still fly to.

    Attributes:
        core: its protocol; of the present run.
        at_m: north, whole metres.
        way_m: where it flies, one place a step.
        clock_s: how far its clock is ahead.
        asked: the tube that it has proposed, and the places that follow if it gets leave.
        runs: how many it has had.
    """

    core: Reservation
    at_m: int
    clock_s: float
    way_m: list[int] = field(default_factory=list)
    asked: tuple[int, list[int]] | None = None
    runs: int = 1


class Soup:
    """Some vehicles, driven by a seed.

    Args:
        places_m: where each is at the beginning.
        make: makes the protocol's core.
        draw: all that is random.

    Attributes:
        bodies: the vehicles, by name.
        touching: who touched; None if no two did.
        steps_flown: metres, of all.
        restarts: of daemons.
    """

    def __init__(
        self, places_m: tuple[int, ...], make: type[Reservation], draw: random.Random
    ) -> None:
        self._draw, self._make, self._names = draw, make, "abcd"[: len(places_m)]
        self._now_s = 0.0
        self._sent: list[Message] = []
        self.bodies: dict[str, Body] = {}
        self.steps_flown = self.restarts = 0
        self.touching: tuple[str, str] | None = None
        for name, place_m in zip(self._names, places_m, strict=True):
            clock_s = draw.choice((0.0, 1e3, -1e3))
            self.bodies[name] = Body(self._core(name, place_m, 1, clock_s), place_m, clock_s)

    def run(self, actions: int) -> None:
        """Do so many things that may happen, or until two touch."""
        restarts, draw = self._draw.choice((0.0, 0.004, 0.02)), self._draw
        for _ in range(actions):
            name = draw.choice(self._names)
            body = self.bodies[name]
            what = draw.random()
            if draw.random() < restarts:
                self._restart(name, body)
            elif what < 0.3:
                self._deliver(name, body)
            elif what < 0.45:
                self._talk()
            elif what < 0.55:
                body.core.tick(self._clock_s(body))
            elif what < 0.78:
                self._propose(body)
            elif what < 0.79:
                body.core.withdraw()
            else:
                self.touching = self._fly()
                if self.touching is not None:
                    return
            self._collect()

    def _talk(self) -> None:
        """Let some hear all that some now say."""
        for sender in self._names:
            body = self.bodies[sender]
            if self._draw.random() < 0.8:
                body.core.tick(self._clock_s(body))
            said = list(body.core.messages_to_send())
            self._sent += said
            for name, other in self.bodies.items():
                if name != sender and self._draw.random() < 0.8:
                    for message in said:
                        other.core.receive(message, self._clock_s(other))

    def _core(self, name: str, at_m: int, run: int, clock_s: float) -> Reservation:
        own = OwnVehicle(name, f"{ord(name):08x}{run:08x}", REACH_M, SPEED_MPS, 0.0, 0.0, FAR_S)
        return self._make(own, self._names, (float(at_m), 0.0), self._now_s + clock_s)

    def _clock_s(self, body: Body) -> float:
        return self._now_s + body.clock_s

    def _collect(self) -> None:
        for body in self.bodies.values():
            self._sent += body.core.messages_to_send()
            self._follow(body)

    def _follow(self, body: Body) -> None:
        """Fly on where leave has come."""
        if body.asked is not None and body.core.active.number == body.asked[0]:
            body.way_m += body.asked[1]
            body.asked = None
        elif body.asked is not None and body.core.outstanding is None:
            body.asked = None

    def _deliver(self, name: str, body: Body) -> None:
        """Deliver one of the newest, or any, to one vehicle."""
        if not self._sent:
            return
        newest = self._sent[-6:] if self._draw.random() < 0.7 else self._sent
        message = self._draw.choice(newest)
        if message.head.sender != name:
            body.core.receive(message, self._clock_s(body))

    def _propose(self, body: Body) -> None:
        core, draw = body.core, self._draw
        if core.outstanding is not None:
            return
        if not body.way_m and draw.random() < 0.7:
            core.settle()
        ahead_m = [body.at_m, *body.way_m]
        end_m, sign, count = ahead_m[-1], draw.choice((-1, 1)), draw.randint(1, 4)
        if len(ahead_m) > 1 and sign != ahead_m[-1] - ahead_m[-2]:
            return  # it never flies back
        onward = [end_m + sign * (number + 1) for number in range(count)]
        boxes_m = along((float(end_m), 0.0), (float(onward[-1]), 0.0), REACH_M, count)
        duration_s = draw.choice((2.0, 4.0, 8.0, 30.0))
        if core.propose(boxes_m, duration_s, self._clock_s(body)):
            number = (
                core.active.number if core.outstanding is None else core.outstanding.tube.number
            )
            body.asked = number, onward

    def _restart(self, name: str, body: Body) -> None:
        body.runs += 1
        self.restarts += 1
        body.way_m, body.asked = [], None
        body.core = self._core(name, body.at_m, body.runs, body.clock_s)

    def _fly(self) -> tuple[str, str] | None:
        """Let a second pass, in which some fly a metre; return who touched."""
        before = {name: body.at_m for name, body in self.bodies.items()}
        self._now_s += STEP_S
        for body in self.bodies.values():
            in_time = self._clock_s(body) <= body.core.expires_s
            if body.way_m and in_time and self._draw.random() < 0.8:
                body.at_m = body.way_m.pop(0)
                self.steps_flown += 1
            elif not in_time:
                body.way_m = []
            if self._draw.random() < 0.8:
                body.core.report((float(body.at_m), 0.0), self._clock_s(body))
        for one, other in combinations(self._names, 2):
            places_m = before[one], before[other], self.bodies[one].at_m, self.bodies[other].at_m
            if self._touch(*places_m):
                return one, other
        return None

    @staticmethod
    def _touch(one_m: int, other_m: int, one_then_m: int, other_then_m: int) -> bool:
        """Tell whether two bodies come as near as both reaches in a straight step."""
        if (one_m, other_m) == (one_then_m, other_then_m):
            return False
        begin_m, end_m = one_m - other_m, one_then_m - other_then_m
        return begin_m * end_m <= 0 or min(abs(begin_m), abs(end_m)) < 2.0 * REACH_M
