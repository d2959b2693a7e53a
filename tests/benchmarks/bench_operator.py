"""How fast the operator's commands are."""

from __future__ import annotations

import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np

from gcs_tools.preflight.field_check import check_field
from gcs_tools.preflight.field_merging import intersecting_pairs
from gcs_tools.scenario import load_scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.box import Box
from sitl.virtual.simulation import SimulatedFlight, fly
from tests.benchmarks.measurement import Measurement, Scale, seconds_of, sized
from tests.gcs_tools.running import CONFIG

PAPER_SPEED_MIN, FOREST_SPEED_MIN = 40.0, 8.0


def bench_virtual_flight() -> Measurement:
    """The paper's flight in virtual time, logs included, against the time that it takes live."""
    return _virtual_flight("paper.yaml", PAPER_SPEED_MIN)


def bench_virtual_flight_of_a_forest() -> Measurement:
    """The same of a flight through a forest with best effort."""
    return _virtual_flight("scenarios/uniform_forest.yaml", FOREST_SPEED_MIN)


def _virtual_flight(name: str, limit: float) -> Measurement:
    """Fly a scenario several times; the fastest was disturbed least."""
    scenario = load_scenario(CONFIG / name)
    flight = SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=1),
        obstacles=scenario.obstacles,
        seed=1,
        time_limit_s=600.0 if not Scale.small else 2.0,
    )
    speeds = []
    with tempfile.TemporaryDirectory() as directory:
        for _ in range(sized(4, 1)):  # the first loads what is loaded when it is needed
            report = fly(flight, Path(directory))
            speeds.append(report.virtual_s / report.wall_s)
    return Measurement(max(speeds), "x real time", more_is_better=True, limit=limit)


def bench_preflight_of_a_forest() -> Measurement:
    """Pre-flight check of 100,000 stems."""
    assessment = assess(load_contract(CONFIG / "paper_contract.yaml"))
    grid = np.arange(317) * 15.0
    stems = [
        Obstacle(id=f"{x}/{y}", center_ned_m=(x, y), size_m=(1.0, 1.0))
        for x in grid.tolist()
        for y in grid.tolist()
    ][: sized(100_000, 1000)]
    field = ObstacleField.of(stems)
    return Measurement(seconds_of(lambda: check_field(assessment, field, None), repeat=1), "s")


def bench_intersecting_regions() -> Measurement:
    """Pairs of 4,000 regions that intersect, against comparing all pairs."""
    random = np.random.default_rng(1)
    boxes = [
        Box(x, x + 10.0, y, y + 6.0)
        for x, y in random.uniform(0.0, 2_000.0, (sized(4_000, 100), 2)).tolist()
    ]
    edges_m = np.array([(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in boxes])
    ours_s = seconds_of(lambda: list(intersecting_pairs(edges_m)), repeat=3)
    all_pairs_s = seconds_of(
        lambda: [pair for pair in combinations(boxes, 2) if pair[0].intersects(pair[1])], repeat=1
    )
    return Measurement(ours_s * 1e3, "ms", all_pairs_s * 1e3, "all pairs, in Python")
