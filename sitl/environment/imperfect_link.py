"""An imperfect link: seeded delay, loss, duplication, reordering and corruption of datagrams."""

from __future__ import annotations

import heapq
import random
from typing import Annotated

from pydantic import Field

from onboard.files.yaml_file import FileModel

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Delay = Annotated[float, Field(ge=0.0)]


class LinkConfig(FileModel):
    """A perfect link by default.

    Attributes:
        delay_s: every datagram takes this long.
        jitter_s: additional delay of up to this (uniform), without overtaking.
        loss: share of datagrams that vanish.
        duplication: share that arrive twice.
        reordering: share that later ones may overtake.
        corruption: share of which one byte changes.
    """

    delay_s: Delay = 0.0
    jitter_s: Delay = 0.0
    loss: Probability = 0.0
    duplication: Probability = 0.0
    reordering: Probability = 0.0
    corruption: Probability = 0.0


_OVERTAKING_S = 0.05  # a reordered datagram is held back by up to this much


class ImperfectLink:
    """One direction of a link, which delays, changes or loses datagrams."""

    def __init__(self, config: LinkConfig, chance: random.Random) -> None:
        self._config = config
        self._chance = chance
        self._in_flight: list[tuple[float, int, bytes]] = []
        self._sent = 0
        self._latest_arrival_s = 0.0

    def send(self, datagram: bytes, now_s: float) -> None:
        """Put a datagram on the link; an empty one is ignored."""
        if not datagram or self._happens(self._config.loss):
            return
        copies = 2 if self._happens(self._config.duplication) else 1
        for _ in range(copies):
            data = self._corrupted(datagram) if self._happens(self._config.corruption) else datagram
            self._sent += 1  # breaks ties, so that equal times keep their order
            heapq.heappush(self._in_flight, (self._arrival_s(now_s), self._sent, data))

    def receive(self, now_s: float) -> list[bytes]:
        """Return the datagrams that have arrived by ``now_s``, in order of arrival."""
        arrived = []
        while self._in_flight and self._in_flight[0][0] <= now_s:
            arrived.append(heapq.heappop(self._in_flight)[2])
        return arrived

    def _arrival_s(self, now_s: float) -> float:
        arrival_s = now_s + self._config.delay_s
        if self._config.jitter_s > 0.0:
            arrival_s += self._chance.uniform(0.0, self._config.jitter_s)
        if self._happens(self._config.reordering):
            return arrival_s + self._chance.uniform(0.0, _OVERTAKING_S)
        self._latest_arrival_s = max(arrival_s, self._latest_arrival_s)
        return self._latest_arrival_s

    def _corrupted(self, datagram: bytes) -> bytes:
        data = bytearray(datagram)
        data[self._chance.randrange(len(data))] ^= self._chance.randrange(1, 256)
        return bytes(data)

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._chance.random() < probability
