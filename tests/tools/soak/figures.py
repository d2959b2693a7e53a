"""What an hour's soak has shown: memory over time, the ticks, what happened; without any I/O."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.metrics.tick_times import LATE_TICK_S

# Before this the allocator and the caches have not settled; a shorter soak drops a third instead.
WARM_UP_S: Final = 600.0
# Memory is flat if it rises by less than this in an hour: at that pace a day takes 50 MB.
RISE_MAX_MB_PER_H: Final = 2.0
_MEGABYTE: Final = 1e6


class Sample(NamedTuple):
    """Both processes at one time.

    Attributes:
        time_s: since the soak began.
        daemon_bytes: its resident memory.
        daemon_anonymous_bytes: the part of it that no file backs, and that alone can leak; pages
            of libraries come and go as the kernel likes.
        simulator_bytes: its resident memory.
        daemon_cpu_s: processor time that the daemon has used, with all its threads.
        stolen_s: that the hypervisor has taken from this computer's processors.
    """

    time_s: float
    daemon_bytes: float
    daemon_anonymous_bytes: float
    simulator_bytes: float
    daemon_cpu_s: float
    stolen_s: float


class LateTick(NamedTuple):
    """A late tick, as the daemon has logged it.

    Attributes:
        time_unix_s: when.
        late_s: after it was due.
        own: whether the daemon itself took too long, as far as the kernel counts waits.
    """

    time_unix_s: float
    late_s: float
    own: bool


@dataclass
class Soak:
    """What was recorded.

    Attributes:
        began_unix_s: when the soak began.
        samples: one a second.
        late: ticks that began late.
        metrics: of the daemon at the end, by name and labels as Prometheus writes them.
        phases: seconds spent in each phase.
        holds: why the vehicle held.
        collisions: with obstacles, by ground truth.
        clearance_min_m: smallest distance of the body from a face.
        legs: that were flown.
    """

    began_unix_s: float
    samples: list[Sample] = field(default_factory=list)
    late: list[LateTick] = field(default_factory=list)
    metrics: Mapping[str, float] = field(default_factory=dict)
    phases: Counter[str] = field(default_factory=Counter)
    holds: list[str] = field(default_factory=list)
    collisions: int = 0
    clearance_min_m: float = math.nan
    legs: int = 0

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return self.samples[-1].time_s - self.samples[0].time_s if self.samples else 0.0


def late_ticks(lines: Iterable[str]) -> Iterator[LateTick]:
    """Yield the late ticks in the daemon's messages (``log_format: json``)."""
    for line in lines:
        try:
            message: Any = json.loads(line)
        except json.JSONDecodeError:
            continue
        words = str(message.get("message", "")).split()
        if words[:1] == ["tick"] and words[2:4] == ["ms", "late"]:
            own = "itself" in words
            yield LateTick(float(message["time_unix_s"]), float(words[1]) / 1e3, own)


def rise_mb_per_h(samples: Sequence[Sample], name: str) -> float:
    """Return the slope of a memory after the warm-up, by least squares.

    Args:
        samples: in order.
        name: of the memory, an attribute of `Sample`.
    """
    last_s = samples[-1].time_s
    settled = [each for each in samples if each.time_s >= min(WARM_UP_S, last_s / 3.0)]
    time_h = np.array([each.time_s for each in settled]) / 3600.0
    memory_mb = np.array([getattr(each, name) for each in settled]) / _MEGABYTE
    return float(np.polyfit(time_h, memory_mb, 1)[0])


def stolen_around_s(soak: Soak, tick: LateTick) -> float:
    """Return the processor time that the hypervisor took in the seconds around a late tick."""
    at_s = tick.time_unix_s - soak.began_unix_s
    near = [each.stolen_s for each in soak.samples if abs(each.time_s - at_s) <= 2.0]
    return max(near) - min(near) if near else 0.0


def own_late_ticks(soak: Soak) -> list[LateTick]:
    """Return the late ticks that neither other processes nor the hypervisor explain."""
    return [
        tick
        for tick in soak.late
        if tick.own and tick.late_s - stolen_around_s(soak, tick) > LATE_TICK_S
    ]


def failures(soak: Soak) -> Iterator[str]:
    """Yield why the soak has not passed."""
    rise = rise_mb_per_h(soak.samples, "daemon_anonymous_bytes")
    if rise > RISE_MAX_MB_PER_H:
        yield f"the daemon's memory rises by {rise:.2f} MB/h (limit {RISE_MAX_MB_PER_H:g})"
    for tick in own_late_ticks(soak):
        yield f"a tick was {tick.late_s * 1e3:.0f} ms late by the daemon's own doing"
    if soak.collisions:
        yield f"{soak.collisions} collisions"
    if soak.legs == 0:
        yield "no leg was flown"


def table(soak: Soak) -> Iterator[tuple[str, str]]:
    """Yield the figures, one a line: name and value."""
    first, last = soak.samples[0], soak.samples[-1]
    ticks = soak.metrics["clearway_tick_duration_seconds_count"]
    mean_ms = soak.metrics["clearway_tick_duration_seconds_sum"] / ticks * 1e3
    own, late = own_late_ticks(soak), soak.late
    starved = [tick for tick in late if tick not in own]
    yield "duration", f"{soak.duration_s / 60.0:.1f} min, {soak.legs} legs flown"
    for name, key in (
        ("daemon", "daemon_bytes"),
        ("its own", "daemon_anonymous_bytes"),
        ("simulator", "simulator_bytes"),
    ):
        sizes = [getattr(each, key) / _MEGABYTE for each in (first, last)]
        rise = rise_mb_per_h(soak.samples, key)
        text = f"{sizes[0]:.1f} MB at the start, {sizes[1]:.1f} MB at the end, {rise:+.2f} MB/h"
        yield f"memory, {name}", text
    yield "processor, daemon", f"{(last.daemon_cpu_s - first.daemon_cpu_s) / soak.duration_s:.1%}"
    longest_ms = soak.metrics["clearway_tick_duration_max_seconds"] * 1e3
    yield "ticks", f"{ticks:.0f}, mean {mean_ms:.2f} ms, longest {longest_ms:.0f} ms"
    yield "late ticks, our own", _latest(own)
    yield "late ticks, starved", _latest(starved)
    yield "processor stolen", f"{last.stolen_s - first.stolen_s:.1f} s by the hypervisor"
    total_s = sum(soak.phases.values())
    shares = ", ".join(f"{k} {n / total_s:.0%}" for k, n in soak.phases.most_common())
    yield "phases", shares
    yield "holds", f"{len(soak.holds)}" + "".join(f"; {why}" for why in soak.holds)
    yield "collisions", f"{soak.collisions}, least clearance {soak.clearance_min_m:.2f} m"


def _latest(ticks: Sequence[LateTick]) -> str:
    latest_s = max((tick.late_s for tick in ticks), default=0.0)
    return f"{len(ticks)}" + (f", the latest {latest_s * 1e3:.0f} ms" if ticks else "")
