"""Episodes of a fleet: seeded flights over a bad network, with restarts, watched by their truth."""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Final

from gcs_tools.fleet.flyer import Flyer
from gcs_tools.fleet.network import Network, NetworkTerms
from onboard.fleet.area import Place
from onboard.fleet.messages import Message

STEP_S: Final = 0.2
# A daemon is away for up to this long, from a crash on.
_AWAY_MAX_S: Final = 10.0

Carry = Callable[[Message], Message | None]
NewWay = Callable[[Flyer], list[Place] | None]


@dataclass(frozen=True)
class EpisodeTerms:
    """What happens in an episode.

    Attributes:
        duration_s: how long it is.
        restart_period_s: mean time between crashes of a daemon; infinite for none.
        blocked_after_s: at rest for so long with its way ahead, a vehicle is blocked
            (`yield_max_s`).
        network: how bad it is.
    """

    duration_s: float = 60.0
    restart_period_s: float = 120.0
    blocked_after_s: float = 15.0
    network: NetworkTerms = field(default_factory=NetworkTerms)


@dataclass
class Outcome:
    """How an episode went.

    Attributes:
        contacts: pairs that touched while one of them moved; the episode ends with the first.
        legs_flown: of all vehicles.
        arrived: vehicles that rest at the end of their way.
        blocked: times that a vehicle was blocked.
        restarts: of daemons.
        ended_s: when the episode ended.
        counts: of the protocol, of all vehicles and runs.
    """

    contacts: list[tuple[str, str]]
    legs_flown: int
    arrived: int
    blocked: int
    restarts: int
    ended_s: float
    counts: Counter[str]


class Episode:
    """One episode.

    Args:
        flyers: the vehicles, by name.
        terms: what happens.
        draw: all that is random.
        carry: what the wire makes of a message; None of one that is dropped.
        new_way: where a vehicle flies that has arrived, or is blocked; None if it stays there.
    """

    def __init__(
        self,
        flyers: dict[str, Flyer],
        terms: EpisodeTerms,
        draw: random.Random,
        carry: Carry = lambda message: message,
        new_way: NewWay = lambda _: None,
    ) -> None:
        self._flyers, self._terms, self._draw = flyers, terms, draw
        self._carry, self._new_way = carry, new_way
        self._network = Network[Message](terms.network, tuple(flyers), draw)
        self._blocked: set[str] = set()
        self._places_m = _true_places(flyers)
        self.outcome = Outcome([], 0, 0, 0, 0, 0.0, Counter())

    def run(self) -> Outcome:
        """Fly it to its end, or to the first contact."""
        outcome, steps = self.outcome, math.ceil(self._terms.duration_s / STEP_S)
        for number in range(steps):
            now_s = number * STEP_S
            self._step(now_s)
            outcome.ended_s = now_s + STEP_S
            if outcome.contacts or all(each.has_arrived for each in self._flyers.values()):
                break
        for flyer in self._flyers.values():
            self._count(flyer)
            outcome.legs_flown += flyer.legs_flown
            outcome.arrived += flyer.has_arrived
        return outcome

    def _step(self, now_s: float) -> None:
        flyers, draw = self._flyers, self._draw
        for name, message in self._network.arrived(now_s):
            core = flyers[name].reservation
            if core is not None:
                core.receive(message, now_s)
        for name, flyer in flyers.items():
            if draw.random() < STEP_S / self._terms.restart_period_s and flyer.reservation:
                self._count(flyer)
                flyer.crash(now_s + draw.uniform(0.0, _AWAY_MAX_S))
                self.outcome.restarts += 1
            self._redirect(name, flyer, now_s)
            flyer.step(now_s, STEP_S)
            if flyer.reservation is not None:
                for message in flyer.reservation.messages_to_send():
                    carried = self._carry(message)
                    if carried is not None:
                        self._network.send(name, carried, now_s)
        before, self._places_m = self._places_m, _true_places(flyers)
        self.outcome.contacts += self._touching(before)

    def _redirect(self, name: str, flyer: Flyer, now_s: float) -> None:
        """Count a vehicle that is blocked; give one that rests for good another way."""
        blocked = now_s - flyer.rested_s >= self._terms.blocked_after_s
        if blocked and name not in self._blocked:
            self.outcome.blocked += 1
        self._blocked = self._blocked | {name} if blocked else self._blocked - {name}
        core = flyer.reservation
        if core is None or core.outstanding is not None or not (blocked or flyer.has_arrived):
            return
        if (way := self._new_way(flyer)) is not None:
            core.settle()
            flyer.fly(way)

    def _count(self, flyer: Flyer) -> None:
        if flyer.reservation is not None:
            self.outcome.counts += flyer.reservation.counts

    def _touching(self, before: dict[str, Place]) -> Iterator[tuple[str, str]]:
        """Yield the pairs that touched in the last step while one of both moved."""
        after = self._places_m
        moved = {name for name, place_m in after.items() if place_m != before[name]}
        for one, other in combinations(after, 2):
            if not {one, other} & moved:
                continue
            radii_m = self._flyers[one].terms.radius_m + self._flyers[other].terms.radius_m
            begin, end = _apart(before[one], before[other]), _apart(after[one], after[other])
            if _nearest_m(begin, end) < radii_m:
                yield one, other


def _true_places(flyers: dict[str, Flyer]) -> dict[str, Place]:
    return {name: flyer.true_place_m for name, flyer in flyers.items()}


def _apart(one_m: Place, other_m: Place) -> Place:
    return one_m[0] - other_m[0], one_m[1] - other_m[1]


def _nearest_m(begin_m: Place, end_m: Place) -> float:
    """Return how near a straight relative motion comes to 0."""
    dn, de = _apart(end_m, begin_m)
    share = -(begin_m[0] * dn + begin_m[1] * de) / max(dn * dn + de * de, 1e-12)
    share = min(max(share, 0.0), 1.0)
    return math.hypot(begin_m[0] + share * dn, begin_m[1] + share * de)
