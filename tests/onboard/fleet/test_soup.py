"""C1 where any message ever sent may arrive at any later time: no contact while moving."""

from __future__ import annotations

import random

import pytest

from onboard.fleet.reservation import Reservation
from onboard.geometry.frames import FloatArray
from tests.onboard.fleet.soup import Soup


def walked(seed: int, make: type[Reservation] = Reservation) -> Soup:
    """Let two or three vehicles do 300 things that may happen."""
    draw = random.Random(seed)
    places_m = tuple(draw.sample(range(10), draw.randint(2, 3)))
    soup = Soup(places_m, make, draw)
    soup.run(300)
    return soup


def test_no_message_is_so_late_that_two_vehicles_touch() -> None:
    soups = [walked(seed) for seed in range(25)]
    assert [seed for seed, each in enumerate(soups) if each.touching] == []
    # They did fly, and their daemons were started again.
    assert sum(each.steps_flown for each in soups) > 200
    assert sum(each.restarts for each in soups) > 20


class AsksNone(Reservation):
    """Looks at its own records only."""

    def _need(self, _boxes_m: FloatArray, _until_s: float) -> frozenset[str]:
        return frozenset()


class AsksNoStranger(Reservation):
    """Takes a peer that it has not heard since its start for far away."""

    def _need(self, boxes_m: FloatArray, until_s: float) -> frozenset[str]:
        known = {name for name, peer in self.peers.items() if peer.is_known}
        return super()._need(boxes_m, until_s) & known


@pytest.mark.parametrize("make", [AsksNone, AsksNoStranger])
def test_who_asks_too_few_touches(make: type[Reservation]) -> None:
    assert any(walked(seed, make).touching for seed in range(6))
