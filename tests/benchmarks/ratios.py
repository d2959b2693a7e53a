"""Speed that CI keeps: each hot path against a peer in the same run, compared with what is stored.

``python -m tests.benchmarks.ratios [--store]`` prints the ratios and, if asked to, stores them in
``ratios.json``.  A ratio is the least processor time of ours over the least of the peer: they run
in turn, so that a busy computer disturbs both alike, and the least of several runs hardly at all.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

import numpy as np

from gcs_tools.benchmark.planner_flight import Flight
from gcs_tools.benchmark.scenes import Selection
from gcs_tools.benchmark.suites import benchmark_named
from gcs_tools.benchmark.vehicles import vehicles
from gcs_tools.scenario import load_scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.geometry.box import Box
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import SeenFree
from onboard.planning.planner import Planner
from sitl.plant.inner_loop import spin
from sitl.plant.multirotor import RotorSpeeds, Wind, hover_speed_rpm, quadrotor, standing_state
from sitl.vehicle.vehicle import warm_up
from sitl.virtual.simulation import SimulatedFlight, Simulation, without_cycle_collection
from tests.benchmarks.ipopt_peer import TwoPhase
from tests.benchmarks.rotorpy_peer import command, rotorpy_state, rotorpy_vehicle
from tests.gcs_tools.running import CONFIG
from tests.onboard.planning.avoidance_cases import Variety, draw

STORED: Final = Path(__file__).with_name("ratios.json")
WORSE_MAX: Final = 1.3
# So many pairs at least; more, up to the most, while the ratio is still above what passes easily.
PAIRS_MIN, PAIRS_MAX = 3, 20
_EASILY: Final = 1.1

Work = Callable[[], object]


@dataclass(frozen=True)
class Pair:
    """What is timed: ours and its peer, prepared."""

    ours: Work
    peer: Work


def measured(pair: Pair, stored: float = 0.0) -> float:
    """Return the least time of ours over that of its peer.

    Args:
        pair: the two.
        stored: the ratio expected; more pairs are run until it is about reached.
    """
    ours_s = peer_s = math.inf
    for number in range(PAIRS_MAX):
        ours_s, peer_s = min(ours_s, _time_s(pair.ours)), min(peer_s, _time_s(pair.peer))
        if number + 1 >= PAIRS_MIN and ours_s / peer_s <= _EASILY * stored:
            break
    return ours_s / peer_s


def _time_s(work: Work) -> float:
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


def pairs() -> dict[str, Callable[[], Pair]]:
    """Return what prepares each pair, by name."""
    return {
        "contract": _contract,
        "dense_plans": _dense_plans,
        "plan": _plan,
        "plant": _plant,
        "seen_free": _seen_free,
        "virtual_flight": _virtual_flight,
    }


def yardstick(times: int = 1) -> Work:
    """Return work like most of ours: calls, floats, small arrays; about 2 ms, that many times.

    It takes about as long as what it is the peer of, so that a moment of quiet helps both alike.
    """
    return lambda: [_like_ours() for _ in range(times)]


def _like_ours() -> float:
    total, points = 0.0, np.linspace(0.0, 1.0, 400)
    for number in range(150):
        box = Box(0.0, 1.0 + number, -1.0, math.hypot(number, 1.0))
        total += box.inflated(0.1).x_max_m + max(box.size_m)
        near = np.minimum(points * number, 3.0) <= 2.0
        total += float(np.hypot(points[near], 1.0).sum())
    return total


def _contract() -> Pair:
    contract = load_contract(CONFIG / "default_contract.yaml")
    return Pair(lambda: [assess(contract) for _ in range(30)], yardstick(2))


def _plan() -> Pair:
    """Plans of avoidance beside IPOPT's of the first of them."""
    planner, peer, rng = Planner(), TwoPhase(), Random(1)
    problems = [draw(rng, Variety()) for _ in range(5)]
    return Pair(
        lambda: [planner.plan(problem) for problem in problems], lambda: peer.plan(problems[0])
    )


def _dense_plans() -> Pair:
    """The first plans of a leg through a forest, guide and seen-free set included."""
    forest = Selection(("1000",), data=None, legs=1, seed=1)
    (scene,), vehicle = benchmark_named("forest").scenes(forest), vehicles()["default"]
    return Pair(lambda: Flight(scene, vehicle, 0).fly(2), yardstick(100))


def _plant() -> Pair:
    """Two seconds of the plant beside RotorPy's twentieth of a second."""
    warm_up()
    body, step_s = quadrotor(), 1.0 / 400.0
    rpm = hover_speed_rpm(body)
    start, rotors = standing_state(0.0, 0.0, -4.0, 0.0, rpm), RotorSpeeds(*(rpm,) * 4)
    vehicle, state, hover = rotorpy_vehicle(body), rotorpy_state(start), command(rotors)
    vehicle.integrator_kwargs = {"method": "RK45"}

    def peers() -> None:
        moved = state
        for _ in range(20):
            moved = vehicle.step(moved, hover, step_s)

    return Pair(lambda: spin(start, rotors, body, Wind(0.0, 0.0, 0.0), step_s, 800), peers)


def _seen_free() -> Pair:
    """Frames of 120 degrees with a few stems, each of which frees cells."""
    stems = [
        Box(3.0 * n, 3.0 * n + 0.4, side, side + 0.4) for n in range(9) for side in (-3.0, 2.6)
    ]

    def frames() -> None:
        space = SeenFree()
        for number in range(8):
            x_m = 0.14 * number
            space.centre_on(x_m, 0.0)
            space.see(View((x_m, 0.0), 0.0, math.radians(60.0), 12.0, stems, 0.05, 0.03))
            space.grid()

    return Pair(frames, yardstick(10))


def _virtual_flight() -> Pair:
    """The beginning of the paper's flight, until it cruises."""
    scenario = load_scenario(CONFIG / "paper.yaml")
    flight = SimulatedFlight(
        scenario.contract, scenario.mission, scenario.sitl_config(seed=1), scenario.obstacles
    )

    def ten_seconds() -> None:
        simulation = Simulation(flight)
        with without_cycle_collection():
            for _ in range(500):
                simulation.advance()

    return Pair(ten_seconds, yardstick(100))


def main() -> None:
    """Print every ratio beside the stored one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", action="store_true", help="store the ratios")
    options = parser.parse_args()
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    found = {name: float(f"{measured(prepare()):.3g}") for name, prepare in pairs().items()}
    for name, ratio in found.items():
        print(f"{name:15} {ratio:9.3g}, stored {stored.get(name, math.nan):.3g}")
    if options.store:
        STORED.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
