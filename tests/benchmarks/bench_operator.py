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
from tests.benchmarks.measurement import Measurement, seconds_of, sized
from tests.gcs_tools.running import CONFIG


def bench_virtual_flight() -> Measurement:
    """The paper's flight in virtual time, against the time that it takes in real time."""
    scenario = load_scenario(CONFIG / "paper.yaml")
    flight = SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=1),
        obstacles=scenario.obstacles,
        seed=1,
    )
    with tempfile.TemporaryDirectory() as directory:
        fly(flight, Path(directory))  # compiles the plant
        report = fly(flight, Path(directory))
    speed = report.virtual_s / report.wall_s
    return Measurement(speed, "s/s", 1.0, "real time", more_is_better=True)


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
    """Pairs of 2,000 regions that intersect, against comparing all pairs."""
    random = np.random.default_rng(1)
    boxes = [
        Box(x, x + 10.0, y, y + 6.0)
        for x, y in random.uniform(0.0, 2_000.0, (sized(2_000, 100), 2)).tolist()
    ]
    edges_m = np.array([(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in boxes])
    ours_s = seconds_of(lambda: list(intersecting_pairs(edges_m)), repeat=3)
    all_pairs_s = seconds_of(
        lambda: [pair for pair in combinations(boxes, 2) if pair[0].intersects(pair[1])], repeat=1
    )
    return Measurement(ours_s * 1e3, "ms", all_pairs_s * 1e3, "all pairs, in Python")
