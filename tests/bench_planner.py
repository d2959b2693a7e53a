"""Planner benchmark: ``python -m tests.bench_planner [--count N] [--seed S]``.

Random pre-conditions inside compliant contracts, both shapes of the collision set, planned one
after the other on one core.  Times are of `Planner.plan`, certification included.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass
from random import Random

import numpy as np

from onboard.planner import Plan, Planner
from tests.onboard.avoidance_cases import Variety, draw

VARIETIES = {
    "default": Variety(),
    "no drift": Variety(drift=False),
    "speeding up": Variety(speeding_up=True),
    "passive safety": Variety(passive_safety=True),
    "lopsided": Variety(lopsided=True),
    "no lag (no slack)": Variety(lag=False),
}


@dataclass(frozen=True)
class Measurement:
    """What one variety of problems gave.

    Attributes:
        kinds: plans by kind, ``"none"`` where nothing certified.
        p50_ms, p99_ms, max_ms: plan times.
    """

    kinds: Counter[str]
    p50_ms: float
    p99_ms: float
    max_ms: float


def measure(variety: Variety, count: int, seed: int) -> Measurement:
    """Plan ``count`` problems; the first few more, to warm up, are not counted."""
    planner, rng = Planner(), Random(seed)
    for _ in range(5):
        planner.plan(draw(rng, variety))
    kinds: Counter[str] = Counter()
    times_ms = []
    for _ in range(count):
        problem = draw(rng, variety)
        begin_s = time.perf_counter()
        plan = planner.plan(problem)
        times_ms.append(1e3 * (time.perf_counter() - begin_s))
        kinds[plan.kind if isinstance(plan, Plan) else "none"] += 1
    p50_ms, p99_ms = np.percentile(times_ms, [50, 99])
    return Measurement(kinds, float(p50_ms), float(p99_ms), max(times_ms))


def main() -> None:
    """Print one line for each variety."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="problems for each variety")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    print(f"{'problems':20} {'qp':>6} {'vertex':>6} {'brake':>6} {'none':>6}  ms p50   p99   max")
    for name, variety in VARIETIES.items():
        result = measure(variety, arguments.count, arguments.seed)
        counts = " ".join(f"{result.kinds[kind]:6}" for kind in ("qp", "vertex", "brake", "none"))
        times = f"{result.p50_ms:6.2f} {result.p99_ms:5.1f} {result.max_ms:5.1f}"
        print(f"{name:20} {counts}  {times}", flush=True)


if __name__ == "__main__":
    main()
