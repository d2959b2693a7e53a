"""What a tick costs: the onboard service in cruise, with an empty and with a crowded map."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np

from gcs_tools.scenario import load_scenario
from onboard.contract import TICK_S
from onboard.guidance import Phase
from sitl.simulation import SimulatedFlight, Simulation
from tests.measurement import Measurement

TICKS = 60
CROWD = 5000


def bench_tick_without_planning() -> Measurement:
    """One tick in cruise, telemetry and detection frames included."""
    return Measurement(_tick_s(_cruising()) * 1e3, "ms")


def bench_tick_with_5000_obstacles() -> Measurement:
    """The same with thousands of remembered obstacles beside the leg; the peer has none."""
    empty, crowded = _cruising(), _cruising()
    corner = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    obstacle_map = crowded.autonomy.navigator.obstacles
    for number in range(CROWD):
        center_m = (20.0 * (number // 50), 200.0 + 25.0 * (number % 50))
        obstacle_map.add(f"far/{number}", corner + center_m, 0.0)
    return Measurement(_tick_s(crowded) * 1e3, "ms", _tick_s(empty) * 1e3, "empty map")


def _cruising() -> Simulation:
    """Fly an empty field until the vehicle cruises."""
    scenario = load_scenario(Path(__file__).parents[1] / "config" / "default.yaml")
    flight = SimulatedFlight(
        scenario.contract, scenario.mission, scenario.sitl_config(seed=1), scenario.obstacles
    )
    simulation = Simulation(flight)
    while simulation.autonomy.navigator.phase is not Phase.CRUISE or simulation.now_s < 9.0:
        simulation.advance()
    return simulation


def _tick_s(simulation: Simulation) -> float:
    """Median time of one tick in closed loop, with everything that the service hears in it."""
    autonomy, scene, times_s = simulation.autonomy, simulation.scene, []
    now_s = simulation.now_s
    for _ in range(TICKS):
        now_s += TICK_S
        scene.advance(now_s)
        frames = [detection.payload for detection in scene.take_detections()]
        telemetry = scene.vehicle.bytes_to_send(0)
        began_s = time.perf_counter()
        autonomy.receive_mavlink(telemetry, now_s)
        for frame in frames:
            autonomy.receive_detection(frame, now_s)
        autonomy.tick(now_s)
        commands = autonomy.mavlink_to_send()
        times_s.append(time.perf_counter() - began_s)
        scene.vehicle.receive(commands, 0)
    assert autonomy.navigator.phase is Phase.CRUISE
    return statistics.median(times_s)
