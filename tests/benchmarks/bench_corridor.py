"""Speed of the planner for dense fields: CPU time of plans, of the guide, and of their slices."""

from __future__ import annotations

import numpy as np

from gcs_tools.benchmark.planner_flight import Flight, Outcome
from gcs_tools.benchmark.scenes import Selection
from gcs_tools.benchmark.suites import benchmark_named
from gcs_tools.benchmark.vehicles import vehicles
from tests.benchmarks.measurement import Measurement, sized

# What one core of the reference machine may take.
_PLAN_MS, _SLICE_MS = 10.0, 3.0
_FLOWN: dict[str, list[Outcome]] = {}


def _outcomes(vehicle: str = "default") -> list[Outcome]:
    """Legs through a forest of 1000 stems/ha, flown once by each vehicle."""
    if vehicle not in _FLOWN:
        forest = Selection(("1000",), data=None, legs=sized(4, 1), seed=1)
        legs = enumerate(benchmark_named("forest").scenes(forest))
        flights = [Flight(scene, vehicles()[vehicle], number) for number, scene in legs]
        _FLOWN[vehicle] = [flight.fly(sized(300, 2)) for flight in flights]
    return _FLOWN[vehicle]


def _percentile_ms(seconds: list[float], percentile: float) -> float:
    return float(np.percentile(seconds, percentile)) * 1e3


def bench_corridor_plan() -> Measurement:
    """The 99th percentile of one plan, all its slices together."""
    used_s = [one for outcome in _outcomes() for one in outcome.plan_s]
    return Measurement(_percentile_ms(used_s, 99), "ms", limit=_PLAN_MS)


def bench_corridor_passive_plan() -> Measurement:
    """The same with the run after a loss of the stream (ArduPilot) in every plan."""
    used_s = [one for outcome in _outcomes("ardupilot") for one in outcome.plan_s]
    return Measurement(_percentile_ms(used_s, 99), "ms", limit=_PLAN_MS)


def bench_corridor_slice() -> Measurement:
    """The 99th percentile of one slice of a plan."""
    used_s = [one for outcome in _outcomes() for one in outcome.slice_s]
    return Measurement(_percentile_ms(used_s, 99), "ms", limit=_SLICE_MS)


def bench_corridor_guide_slice() -> Measurement:
    """The 99th percentile of one slice of the guide."""
    used_s = [one for outcome in _outcomes() for one in outcome.guide_s]
    return Measurement(_percentile_ms(used_s, 99), "ms", limit=_SLICE_MS)
