"""The result of a benchmark, and the limits that it has to keep."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Measurement:
    """One number, its limit, and that of a peer measured in the same run.

    Attributes:
        value: what was measured, in ``unit``.
        unit: of ``value`` and ``peer``.
        peer: the same, measured on other software; None where there is none.
        peer_name: who that is.
        more_is_better: whether a larger value is the better one.
        limit: the worst value that passes; None where none is set.
        ratio_min: the least `ratio` that passes; None where none is set.
    """

    value: float
    unit: str
    peer: float | None = None
    peer_name: str = ""
    more_is_better: bool = False
    limit: float | None = None
    ratio_min: float | None = None

    @property
    def ratio(self) -> float | None:
        """How many times better than the peer; below 1 is worse."""
        if self.peer is None:
            return None
        return self.value / self.peer if self.more_is_better else self.peer / self.value

    @property
    def passes(self) -> bool | None:
        """Whether value and ratio keep their limits; None where neither is limited."""
        kept = []
        if self.limit is not None:
            kept.append(
                self.value >= self.limit if self.more_is_better else self.value <= self.limit
            )
        if self.ratio_min is not None:
            kept.append(self.ratio is not None and self.ratio >= self.ratio_min)
        return all(kept) if kept else None

    def document(self) -> dict[str, float | str | bool | None]:
        """Return the measurement with the published keys."""
        return {
            "value": self.value,
            "unit": self.unit,
            "limit": self.limit,
            "peer": self.peer,
            "ratio": self.ratio,
            "ratio_min": self.ratio_min,
            "passes": self.passes,
        }


class Scale:
    """How much a benchmark does: all of it, or just enough to show that it runs."""

    small = False


def sized(full: int, small: int) -> int:
    """Return ``full``, or ``small`` where only the benchmark itself is tested."""
    return small if Scale.small else full


def seconds_of(work: Callable[[], object], repeat: int = 5) -> float:
    """Return the median processor time of some work, after one run to warm up."""
    if Scale.small:
        repeat = 1
    else:
        work()
    times_s = []
    for _ in range(repeat):
        began_s = time.process_time()
        work()
        times_s.append(time.process_time() - began_s)
    return median(times_s)
