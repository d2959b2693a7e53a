from __future__ import annotations

import random

import pytest

from sitl.autopilot.protocol.link import split_frames
from sitl.environment.imperfect_link import ImperfectLink, LinkConfig

MESSAGES = [bytes([number, 0, 255 - number]) for number in range(200)]


def through(config: LinkConfig, seed: int = 1) -> list[tuple[float, bytes]]:
    """Send one message each 10 ms; return arrivals with their times."""
    link = ImperfectLink(config, random.Random(seed))
    arrivals = []
    for tick in range(400):
        if tick < len(MESSAGES):
            link.send(MESSAGES[tick], tick / 100.0)
        arrivals += [(tick / 100.0, data) for data in link.receive(tick / 100.0)]
    return arrivals


def test_perfect_by_default() -> None:
    assert through(LinkConfig()) == [(tick / 100.0, data) for tick, data in enumerate(MESSAGES)]


def test_delay_and_jitter_keep_the_order() -> None:
    arrivals = through(LinkConfig(delay_s=0.1, jitter_s=0.05))
    assert [data for _, data in arrivals] == MESSAGES
    delays_s = [time_s - tick / 100.0 for tick, (time_s, _) in enumerate(arrivals)]
    assert min(delays_s) + 1e-9 >= 0.1
    assert 0.14 < max(delays_s) < 0.17


@pytest.mark.parametrize(
    ("config", "count"),
    [(LinkConfig(loss=0.3), 140), (LinkConfig(duplication=0.3), 260), (LinkConfig(loss=1.0), 0)],
)
def test_loss_and_duplication_have_their_shares(config: LinkConfig, count: int) -> None:
    assert len(through(config)) == pytest.approx(count, abs=20)


def test_reordering_lets_later_ones_overtake() -> None:
    order = [data for _, data in through(LinkConfig(reordering=0.3))]
    assert order != MESSAGES
    assert sorted(order) == sorted(MESSAGES)


def test_corruption_changes_one_byte() -> None:
    arrivals = [data for _, data in through(LinkConfig(corruption=1.0))]
    for sent, got in zip(MESSAGES, arrivals, strict=True):
        assert sum(a != b for a, b in zip(sent, got, strict=True)) == 1


def test_same_seed_same_link() -> None:
    config = LinkConfig(loss=0.2, jitter_s=0.1, corruption=0.2, duplication=0.1, reordering=0.1)
    assert through(config, 3) == through(config, 3) != through(config, 4)


def test_datagrams_end_between_frames() -> None:
    frame = bytes([0xFD, 8, 0, 0, *range(16)])  # 12 bytes around a payload of 8
    data = 10 * frame
    portions = split_frames(data, 45)
    assert portions == 5 * [2 * frame]
    assert split_frames(b"", 45) == []
    assert split_frames(data, 1) == 10 * [frame]
