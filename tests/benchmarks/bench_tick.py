"""Cost of a tick: the onboard service in cruise, with an empty and with a crowded map."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

from gcs_tools.scenario import load_scenario
from onboard.contract.assessment import TICK_S
from onboard.guidance.phases import Phase
from onboard.perception.obstacle_map import ObstacleMap
from sitl.virtual.simulation import SimulatedFlight, Simulation
from tests.benchmarks.measurement import Measurement, sized

TICKS = 200
CROWD = 5000


def bench_tick_without_planning() -> Measurement:
    """One tick in cruise, telemetry and detection frames included."""
    (tick_s,) = _ticks_s(_cruising())
    return Measurement(tick_s * 1e3, "ms")


def bench_tick_with_5000_obstacles() -> Measurement:
    """The same with thousands of remembered obstacles beside the leg; the peer has none."""
    empty, crowded = _cruising(), _cruising()
    _remember(crowded.autonomy.navigator.obstacles, sized(CROWD, 100))
    empty_s, crowded_s = _ticks_s(empty, crowded)
    return Measurement(crowded_s * 1e3, "ms", empty_s * 1e3, "empty map")


def _remember(obstacles: ObstacleMap, count: int) -> None:
    """Remember obstacles far beside the leg."""
    for number in range(count):
        north_m, east_m = 20.0 * (number // 50), 200.0 + 25.0 * (number % 50)
        opposite_m = ((north_m - 0.5, east_m - 0.5), (north_m + 0.5, east_m + 0.5))
        obstacles.add(f"far/{number}", opposite_m, 0.0)


def _cruising() -> Simulation:
    """Fly an empty field until the vehicle cruises."""
    scenario = load_scenario(Path(__file__).parents[2] / "config" / "default.yaml")
    flight = SimulatedFlight(
        scenario.contract, scenario.mission, scenario.sitl_config(seed=1), scenario.obstacles
    )
    simulation = Simulation(flight)
    while simulation.autonomy.navigator.phase is not Phase.CRUISE or simulation.now_s < 9.0:
        simulation.advance()
    return simulation


def _ticks_s(*simulations: Simulation) -> list[float]:
    """Median time of a tick of each flight; tick by tick in turn, so that noise hits all alike."""
    times_s: list[list[float]] = [[] for _ in simulations]
    for _ in range(sized(TICKS, 20)):
        for simulation, spent_s in zip(simulations, times_s, strict=True):
            spent_s.append(_tick_s(simulation))
    assert all(each.autonomy.navigator.phase is Phase.CRUISE for each in simulations)
    return [statistics.median(spent_s) for spent_s in times_s]


def _tick_s(simulation: Simulation) -> float:
    """Return the time of the next tick in closed loop, its inputs included."""
    autonomy, scene = simulation.autonomy, simulation.scene
    now_s = scene.vehicle.truth.time_s + TICK_S
    scene.advance(now_s)
    frames = [detection.payload for detection in scene.take_detections()]
    telemetry = scene.vehicle.bytes_to_send(0)
    began_s = time.process_time()
    autonomy.receive_mavlink(telemetry, now_s)
    for frame in frames:
        autonomy.receive_detection(frame, now_s)
    autonomy.tick(now_s)
    commands = autonomy.mavlink_to_send()
    spent_s = time.process_time() - began_s
    scene.vehicle.receive(commands, 0)
    return spent_s
