"""Members of a fleet among hostile messages, ticks and deaths: no contact, no overlap."""

from __future__ import annotations

import random

from tests.onboard.fleet.walk import Walk


def walked(seed: int) -> Walk:
    """Let two or three members do 400 things that may happen."""
    draw = random.Random(seed)
    walk = Walk(draw.choice((2, 3)), draw)
    walk.run(400)
    return walk


def test_no_two_tubes_overlap_and_no_two_bodies_touch() -> None:
    walks = [walked(seed) for seed in range(25)]
    assert [(seed, each.fault) for seed, each in enumerate(walks) if each.fault] == []
    assert sum(each.flown_m for each in walks) > 300.0
    assert sum(each.arrived for each in walks) > 10
    assert sum(each.restarts for each in walks) > 50
