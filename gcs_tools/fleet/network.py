"""A network that loses, delays, repeats and reorders messages, and falls into parts for a while."""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

Message = TypeVar("Message")

# Of the messages that are late, rather than on time.
_LATE_SHARE = 0.25
_ON_TIME_S = 0.1
_REPEATED_SHARE = 0.1


@dataclass(frozen=True)
class NetworkTerms:
    """How bad a network is.

    Attributes:
        loss: share of messages that never arrive.
        delay_max_s: a quarter of the others take up to that long.
        partition_share: share of the time in which the vehicles are split into two parts.
        partition_s: how long each such time is.
    """

    loss: float = 0.3
    delay_max_s: float = 8.0
    partition_share: float = 0.25
    partition_s: float = 10.0


class Network(Generic[Message]):
    """Carries messages, of whatever kind, from each vehicle to all others.

    Args:
        terms: how bad it is.
        names: of the vehicles.
        draw: all that is random.
    """

    def __init__(self, terms: NetworkTerms, names: Sequence[str], draw: random.Random) -> None:
        self._terms, self._names, self._draw = terms, names, draw
        self._under_way: list[tuple[float, int, str, Message]] = []
        self._count = 0
        self._part: frozenset[str] = frozenset()
        self._part_until_s = 0.0

    def send(self, sender: str, message: Message, now_s: float) -> None:
        """Take a message to all others."""
        if now_s >= self._part_until_s:
            self._split(now_s)
        draw = self._draw
        for name in self._names:
            apart = (name in self._part) != (sender in self._part)
            if name == sender or apart or draw.random() < self._terms.loss:
                continue
            for _ in range(2 if draw.random() < _REPEATED_SHARE else 1):
                late = draw.random() < _LATE_SHARE
                most_s = self._terms.delay_max_s if late else _ON_TIME_S
                self._count += 1
                arrives_s = now_s + draw.uniform(0.0, most_s)
                heapq.heappush(self._under_way, (arrives_s, self._count, name, message))

    def arrived(self, now_s: float) -> Iterator[tuple[str, Message]]:
        """Yield receiver and message of what has arrived."""
        while self._under_way and self._under_way[0][0] <= now_s:
            _, _, name, message = heapq.heappop(self._under_way)
            yield name, message

    def _split(self, now_s: float) -> None:
        draw = self._draw
        self._part_until_s = now_s + self._terms.partition_s
        if draw.random() < self._terms.partition_share:
            count = draw.randint(1, len(self._names) - 1)
            self._part = frozenset(draw.sample(list(self._names), count))
        else:
            self._part = frozenset()
