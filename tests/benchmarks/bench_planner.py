"""Planner: ``python -m tests.benchmarks.bench_planner [--count N] [--seed S] [--peer N]``.

Random pre-conditions inside compliant contracts, both shapes of the collision set, planned one
after the other on one core.  Times are of `Planner.plan`, certification included.  With ``--peer``,
and in ``make bench``, the first of each variety are planned by IPOPT too.
"""

from __future__ import annotations

import argparse
import functools
import math
import time
from collections import Counter
from dataclasses import dataclass
from random import Random

import numpy as np

from onboard.motion.trajectory import X
from onboard.planning.planner import Plan, Planner
from onboard.planning.problem import DELAY_COST_M2PS4, AvoidanceProblem
from onboard.planning.qp.bspline import TOTAL_PIECES
from tests.benchmarks.ipopt_peer import DIRECT_PIECES, Direct, TwoPhase
from tests.benchmarks.measurement import Measurement, sized
from tests.onboard.planning.avoidance_cases import Variety, draw

VARIETIES = {
    "default": Variety(),
    "no drift": Variety(drift=False),
    "speeding up": Variety(speeding_up=True),
    "passive safety": Variety(passive_safety=True),
    "lopsided": Variety(lopsided=True),
    "no lag (no slack)": Variety(lag=False),
}


# Compliant contracts allow for a lag; without it accelerations jump, which no vehicle can fly.
COMPLIANT = tuple(name for name, variety in VARIETIES.items() if variety.lag)
# Problems of each variety that IPOPT gets: 500 in all; the direct form only the first few.
PEER_PROBLEMS = 100
DIRECT_PROBLEMS = 6
# Problems of each variety of which the time is measured.
TIMED_PROBLEMS = 300
PLAN_P50_MAX_MS, PLAN_P99_MAX_MS, TIMES_FASTER_THAN_IPOPT_MIN = 1.5, 3.0, 15.0
# Costs below this have no meaningful ratio: hardly any manoeuvre was needed.
COST_MIN_M2PS3 = 0.1


@dataclass(frozen=True)
class Timing:
    """Results of the problems of one variety, or of several.

    Attributes:
        kinds: plans by kind, ``"none"`` where nothing certified.
        times_ms: processor times of plans.
    """

    kinds: Counter[str]
    times_ms: list[float]

    def __add__(self, other: Timing) -> Timing:
        """Return the results of both together."""
        return Timing(self.kinds + other.kinds, self.times_ms + other.times_ms)

    def __str__(self) -> str:
        """Counts of the kinds, and the times, as one line of the table."""
        counts = " ".join(f"{self.kinds[kind]:6}" for kind in ("qp", "vertex", "brake", "none"))
        p50_ms, p99_ms = np.percentile(self.times_ms, [50, 99])
        return f"{counts}  {p50_ms:6.2f} {p99_ms:5.1f} {max(self.times_ms):5.1f}"


def measure(variety: Variety, count: int, seed: int) -> Timing:
    """Plan ``count`` problems; the first few more, to warm up, are not counted."""
    planner, rng = Planner(), Random(seed)
    for _ in range(5):
        planner.plan(draw(rng, variety))
    kinds: Counter[str] = Counter()
    times_ms = []
    for _ in range(count):
        problem = draw(rng, variety)
        begin_s = time.process_time()
        plan = planner.plan(problem)
        times_ms.append(1e3 * (time.process_time() - begin_s))
        kinds[plan.kind if isinstance(plan, Plan) else "none"] += 1
    return Timing(kinds, times_ms)


@dataclass(frozen=True)
class Comparison:
    """Planner and IPOPT on the same problems.

    Attributes:
        gaps: how much more expensive the planner's plans are than the best that IPOPT finds, as a
            share of effort and time flown, which differ from the cost of Eq. 17 by a constant.
        gaps_of_cost: the same as a share of the cost, where that is worth a ratio.
        ours_ms, two_phase_ms: median times.
        direct_ms: median times by number of pieces.
        unsolved: problems that IPOPT does not solve.
    """

    gaps: list[float]
    gaps_of_cost: list[float]
    ours_ms: float
    two_phase_ms: float
    direct_ms: dict[int, float]
    unsolved: int


@functools.cache
def compare(
    count: int = PEER_PROBLEMS, seed: int = 1, direct_count: int = DIRECT_PROBLEMS
) -> Comparison:
    """Plan ``count`` problems of each variety by the planner and by IPOPT, some in direct form."""
    planner, two_phase = Planner(), TwoPhase()
    direct = {pieces: Direct(pieces) for pieces in (TOTAL_PIECES, DIRECT_PIECES)}
    gaps: list[float] = []
    gaps_of_cost: list[float] = []
    ours_s: list[float] = []
    theirs_s: list[float] = []
    direct_s: dict[int, list[float]] = {pieces: [] for pieces in direct}
    unsolved = 0
    for name in COMPLIANT[: sized(len(COMPLIANT), 1)]:
        rng = Random(seed)
        for number in range(count):
            problem = draw(rng, VARIETIES[name])
            begin_s = time.perf_counter()
            plan = planner.plan(problem)
            ours_s.append(time.perf_counter() - begin_s)
            best = two_phase.plan(problem)
            theirs_s.append(best.solve_s)
            for pieces, peer in direct.items() if number < direct_count else ():
                direct_s[pieces].append(peer.plan(problem).solve_s)
            if math.isinf(best.cost) or not isinstance(plan, Plan):
                unsolved += 1
                continue
            excess = plan.cost - best.cost
            gaps.append(excess / (best.cost + _cost_of_time(problem)))
            if best.cost > COST_MIN_M2PS3:
                gaps_of_cost.append(excess / best.cost)
    direct_ms = {pieces: _median_ms(times_s) for pieces, times_s in direct_s.items() if times_s}
    ours_ms, theirs_ms = _median_ms(ours_s), _median_ms(theirs_s)
    return Comparison(gaps, gaps_of_cost, ours_ms, theirs_ms, direct_ms, unsolved)


def _median_ms(times_s: list[float]) -> float:
    return 1e3 * float(np.median(times_s))


def _cost_of_time(problem: AvoidanceProblem) -> float:
    """What the flight to the border costs without an obstacle, at exit speed."""
    distance_m = problem.region.x_pob_m - problem.start.position_leg_m[X]
    return DELAY_COST_M2PS4 * distance_m / problem.exit_speed_mps


def _compared() -> Comparison:
    return compare(sized(PEER_PROBLEMS, 1), direct_count=sized(DIRECT_PROBLEMS, 1))


def bench_plan_time() -> Measurement:
    """Median time of a plan against IPOPT's two-phase form from four starts."""
    found = _compared()
    return Measurement(
        found.ours_ms,
        "ms",
        peer=found.two_phase_ms,
        peer_name="IPOPT, two-phase",
        ratio_min=TIMES_FASTER_THAN_IPOPT_MIN,
    )


@functools.cache
def _times_ms() -> list[float]:
    """Plan times of all varieties whose contracts comply."""
    names = COMPLIANT[: sized(len(COMPLIANT), 1)]
    timings = [measure(VARIETIES[name], sized(TIMED_PROBLEMS, 3), seed=1) for name in names]
    return [time_ms for timing in timings for time_ms in timing.times_ms]


def bench_plan_time_p50() -> Measurement:
    """The median over the varieties of contracts that comply."""
    return Measurement(float(np.percentile(_times_ms(), 50)), "ms", limit=PLAN_P50_MAX_MS)


def bench_plan_time_p99() -> Measurement:
    """The 99th percentile of the same."""
    return Measurement(float(np.percentile(_times_ms(), 99)), "ms", limit=PLAN_P99_MAX_MS)


def bench_plan_time_direct_coarse() -> Measurement:
    """The same against Eq. 17 as printed, with as few nodes as ours, which cuts corners."""
    found = _compared()
    name = f"IPOPT, direct, {TOTAL_PIECES} pieces"
    return Measurement(found.ours_ms, "ms", peer=found.direct_ms[TOTAL_PIECES], peer_name=name)


def bench_plan_time_direct() -> Measurement:
    """The same with nodes so close that almost nothing is cut between them."""
    found = _compared()
    name = f"IPOPT, direct, {DIRECT_PIECES} pieces"
    return Measurement(found.ours_ms, "ms", peer=found.direct_ms[DIRECT_PIECES], peer_name=name)


def bench_plan_cost_gap() -> Measurement:
    """Mean excess over the best of IPOPT, in effort and time."""
    return Measurement(100.0 * float(np.mean(_compared().gaps)), "%", limit=4.0)


def bench_plan_cost_gap_p95() -> Measurement:
    """The excess that one plan in twenty is above."""
    gap = float(np.percentile(_compared().gaps, 95))
    return Measurement(100.0 * gap, "%", limit=12.0)


def main() -> None:
    """Print one line for each variety, and one for those together whose contracts comply."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="problems for each variety")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--peer", type=int, default=0, help="problems for IPOPT, of each variety")
    arguments = parser.parse_args()
    print(f"{'problems':20} {'qp':>6} {'vertex':>6} {'brake':>6} {'none':>6}  ms p50   p99   max")
    compliant = Timing(Counter(), [])
    for name, variety in VARIETIES.items():
        result = measure(variety, arguments.count, arguments.seed)
        print(f"{name:20} {result}", flush=True)
        if name in COMPLIANT:
            compliant += result
    print(f"{'all that comply':20} {compliant}")
    if arguments.peer:
        _print_comparison(compare(arguments.peer, arguments.seed))


def _print_comparison(found: Comparison) -> None:
    for name, gaps in (("effort and time", found.gaps), ("cost", found.gaps_of_cost)):
        mean, p95 = np.mean(gaps), np.percentile(gaps, 95)
        print(f"above the best of IPOPT, share of {name}: mean {mean:.1%}, p95 {p95:.1%}", end="")
        print(f", max {max(gaps):.1%} ({len(gaps)} problems)")
    direct = {f"direct, {pieces} pieces": each for pieces, each in found.direct_ms.items()}
    for name, theirs_ms in ({"two-phase": found.two_phase_ms} | direct).items():
        ratio = theirs_ms / found.ours_ms
        print(f"IPOPT, {name}: {theirs_ms:.1f} ms, {ratio:.0f} times our {found.ours_ms:.2f} ms")
    print(f"not solved by IPOPT: {found.unsolved}")


if __name__ == "__main__":
    main()
