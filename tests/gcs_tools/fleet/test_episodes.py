"""C1 in seeded episodes: no contact while moving, and what is left out of the protocol collides.

True places are watched; they are off by all of E and A.  Messages are lost, late by up to 8 s,
repeated and overtaken, the network falls apart, daemons die and start again in flight.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Sequence

import pytest

from gcs_tools.fleet.episode import Episode, EpisodeTerms, Outcome
from gcs_tools.fleet.flyer import Flyer, FlyerTerms
from gcs_tools.fleet.network import Network, NetworkTerms
from onboard.fleet.area import Place
from onboard.fleet.messages import Commit, Head, Message
from onboard.fleet.reservation import OwnVehicle, Proposal, Reservation
from onboard.fleet.wire import FleetWire
from onboard.geometry.frames import FloatArray
from onboard.geometry.local_frame import GeographicPoint, LocalFrame

NAMES = ("a", "b", "c", "d")
HALF_M, RADIUS_M, REACH_M = 30.0, 1.0, 1.5
# Where vehicles are slow, many are too far away to be asked.
CRUISES_MPS = (1.5, 4.0)


def random_way(start_m: Place, half_m: float, legs: int, draw: random.Random) -> list[Place]:
    """Return a polyline of some legs from a place, in a square about the origin."""
    ends = [(draw.uniform(-half_m, half_m), draw.uniform(-half_m, half_m)) for _ in range(legs)]
    return [start_m, *ends]


def starts(
    names: Sequence[str], half_m: float, apart_m: float, draw: random.Random
) -> dict[str, Place]:
    """Return places in a square about the origin that are apart along north or east."""
    found: dict[str, Place] = {}
    for name in names:
        while True:
            place = (draw.uniform(-half_m, half_m), draw.uniform(-half_m, half_m))
            north_m, east_m = place
            if all(
                max(abs(north_m - other[0]), abs(east_m - other[1])) > apart_m
                for other in found.values()
            ):
                found[name] = place
                break
    return found


def flown(
    seed: int,
    make: type[Reservation] = Reservation,
    terms: EpisodeTerms | None = None,
    carry: FleetWire | None = None,
) -> Outcome:
    """Fly four vehicles along ways that cross, for a minute."""
    draw = random.Random(seed)
    cruise_mps = draw.choice(CRUISES_MPS)
    places = starts(NAMES, HALF_M, 4.0, draw)
    flyers = {}
    for name in NAMES:
        own = OwnVehicle(name, "", REACH_M, 1.1 * cruise_mps)
        ahead_m = draw.choice((8.0, 20.0, 60.0))
        way = random_way(places[name], HALF_M, 3, draw)
        vehicle = FlyerTerms(own, RADIUS_M, cruise_mps, 2.5, 0.3, ahead_m)
        flyers[name] = Flyer(vehicle, NAMES, way, draw, make)

    def carried(message: Message) -> Message:
        if carry is None:
            return message
        return carry.decoded(message.head.sender, *carry.encoded(message))

    def onward(flyer: Flyer) -> list[tuple[float, float]]:
        return random_way(flyer.place_m, HALF_M, 3, draw)

    return Episode(flyers, terms or EpisodeTerms(), draw, carried, onward).run()


class Watched(Reservation):
    """Counts reports of motion after a tube has expired."""

    def report(self, position_m: Place, now_s: float, held_m: FloatArray | None = None) -> bool:
        moved = position_m != self._position_m
        self.counts["moved_late"] += moved and now_s > self.expires_s
        self.counts["moved_in_time"] += moved and now_s <= self.expires_s < math.inf
        return super().report(position_m, now_s, held_m)


def test_no_two_vehicles_touch_while_one_of_them_moves() -> None:
    outcomes = [flown(seed, Watched) for seed in range(80)]
    assert [seed for seed, each in enumerate(outcomes) if each.contacts] == []
    counts = sum((each.counts for each in outcomes), Counter[str]())
    # They did fly, and met: legs, restarts, leave given, refused and withdrawn.
    assert sum(each.legs_flown for each in outcomes) > 250
    assert sum(each.restarts for each in outcomes) > 100
    assert counts["committed"] > 1600
    assert counts["withdrawn"] > 1200
    assert counts["held"] > 50
    assert counts["outside"] == 0
    # Some flew without having asked all, and were at rest in time.
    assert counts["moved_in_time"] > 300
    assert counts["moved_late"] == 0


def test_in_bytes_the_same() -> None:
    """Over WGS84, sealed; boxes come back a little larger."""
    wire = FleetWire(
        LocalFrame(GeographicPoint(47.4, 8.5)), dict.fromkeys(NAMES, "0" * 64), b"k" * 32
    )
    outcomes = [flown(seed, carry=wire) for seed in range(3)]
    assert not any(each.contacts for each in outcomes)
    assert sum(each.legs_flown for each in outcomes) > 5


def test_on_a_good_network_more_is_flown() -> None:
    good = EpisodeTerms(
        restart_period_s=math.inf,
        network=NetworkTerms(loss=0.0, delay_max_s=0.2, partition_share=0.0),
    )
    outcomes = [flown(seed, terms=good) for seed in range(8)]
    assert not any(each.contacts for each in outcomes)
    bad = [flown(seed) for seed in range(8)]
    legs = [sum(each.legs_flown for each in group) for group in (outcomes, bad)]
    assert legs[0] > 1.5 * legs[1]


# ------------------------------------------------------------------------ what must collide


class AsksNone(Reservation):
    """Looks at its own records only."""

    def _need(self, _boxes_m: FloatArray, _until_s: float) -> frozenset[str]:
        return frozenset()


class AsksNoStranger(Reservation):
    """Takes a peer that it has not heard since its start for far away."""

    def _need(self, boxes_m: FloatArray, until_s: float) -> frozenset[str]:
        known = {name for name, peer in self.peers.items() if peer.is_known}
        return super()._need(boxes_m, until_s) & known


class ForgetsTheWayItIsOn(Reservation):
    """Proposes what comes after its tube, and holds only that once it has leave (tube := p)."""

    def _still_occupied(self) -> FloatArray:
        return self.active.boxes_m[:0]


class WaitsAWhile(Reservation):
    """Takes a second of silence for leave."""

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        self._commit_if_all_agree(now_s)

    def _may_commit(self, proposal: Proposal, now_s: float) -> bool:
        return super()._may_commit(proposal, now_s) or now_s >= proposal.stamp_s + 1.0


BROKEN = (AsksNone, AsksNoStranger, ForgetsTheWayItIsOn, WaitsAWhile)


@pytest.mark.parametrize("make", BROKEN, ids=lambda make: make.__name__)
def test_what_leaves_out_a_rule_collides(make: type[Reservation]) -> None:
    assert any(flown(seed, make).contacts for seed in range(30))


# ------------------------------------------------------------------------ the network


def test_the_network_is_as_bad_as_it_is_said_to_be() -> None:
    terms = NetworkTerms(loss=0.3, delay_max_s=8.0, partition_share=0.0)
    network = Network[Commit](terms, NAMES, random.Random(1))
    sent = 2000
    for number in range(sent):
        network.send("a", Commit(Head("a", "", number), 1, committed=True), number * 0.01)
    arrivals = [
        (receiver, message.head.number, step * 0.1 - message.head.number * 0.01)
        for step in range(400)
        for receiver, message in network.arrived(step * 0.1)
    ]
    each_once = {(receiver, number) for receiver, number, _ in arrivals}
    assert "a" not in {receiver for receiver, *_ in arrivals}
    assert len(each_once) == pytest.approx(3 * 0.7 * sent, rel=0.05)
    assert len(arrivals) > 1.05 * len(each_once)
    numbers = [number for receiver, number, _ in arrivals if receiver == "b"]
    assert numbers != sorted(numbers)
    assert max(late_s for *_, late_s in arrivals) > 7.0


def test_a_partition_lets_nothing_across() -> None:
    terms = NetworkTerms(loss=0.0, partition_share=1.0, partition_s=1e9)
    network = Network[Commit](terms, NAMES, random.Random(3))
    for name in NAMES:
        network.send(name, Commit(Head(name, "", 1), 1, committed=True), 0.0)
    heard = {(message.head.sender, receiver) for receiver, message in network.arrived(100.0)}
    assert heard == {(b, a) for a, b in heard}
    assert len(heard) < len(NAMES) * (len(NAMES) - 1)
