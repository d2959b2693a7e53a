"""The result of a benchmark."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Measurement:
    """One number, and that of a peer measured in the same run.

    Attributes:
        value: what was measured, in ``unit``.
        unit: of ``value`` and ``peer``.
        peer: the same, measured on other software; None where there is none.
        peer_name: who that is.
        more_is_better: whether a larger value is the better one.
    """

    value: float
    unit: str
    peer: float | None = None
    peer_name: str = ""
    more_is_better: bool = False

    @property
    def ratio(self) -> float | None:
        """How many times better than the peer; below 1 is worse."""
        if self.peer is None:
            return None
        return self.value / self.peer if self.more_is_better else self.peer / self.value

    def document(self) -> dict[str, float | str | None]:
        """Return the measurement with the published keys."""
        return {"value": self.value, "unit": self.unit, "peer": self.peer, "ratio": self.ratio}


class Scale:
    """How much a benchmark does: all of it, or just enough to show that it runs."""

    small = False


def sized(full: int, small: int) -> int:
    """Return ``full``, or ``small`` where only the benchmark itself is tested."""
    return small if Scale.small else full


def seconds_of(work: Callable[[], object], repeat: int = 5) -> float:
    """Return the median wall time of some work, after one run to warm up."""
    if Scale.small:
        repeat = 1
    else:
        work()
    times_s = []
    for _ in range(repeat):
        began_s = time.perf_counter()
        work()
        times_s.append(time.perf_counter() - began_s)
    return median(times_s)
