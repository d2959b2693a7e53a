"""Cost of a sensor's message, from its bytes to a detection frame."""

from __future__ import annotations

import math
import random
import time
from pathlib import Path
from statistics import median

import numpy as np

from gcs_tools.scenario import load_scenario
from onboard.contract.assessment import TICK_S
from onboard.files.sensor_sources import LaserScanSource, PointCloudSource
from onboard.perception.sources.laser_scan import LaserScanInput
from onboard.perception.sources.point_cloud import PointCloudInput
from onboard.perception.sources.sensor_input import SensorInput
from sitl.virtual.simulation import (
    ONBOARD_LINK,
    SimulatedFlight,
    Simulation,
    deliver,
    without_cycle_collection,
)
from tests.benchmarks.measurement import Measurement, sized
from tests.onboard.perception.ros2.encoding import point_cloud, scan_all_round
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    Box,
    pose_at,
    poses_of,
    ranges_around,
)

SCAN_TIME_MAX_MS = 2.0
CLOUD_TIME_MAX_MS = 25.0
LIDAR_SHARE_MAX = 0.05
CONFIG = Path(__file__).parents[2] / "config"
KEYS = {"range_m": 12.0, "uncertainty_m": 0.05, "no_return_is_free_to_m": 12.0, "topic": "/t"}
# A sensor beside the centre of a vehicle in flight: nothing may be cut short.
MOUNTING = {"x_m": 0.15, "z_m": -0.1}


def bench_laser_scan() -> Measurement:
    """720 beams all round in a forest of 700 stems/ha, taken in 0.1 s at 2.8 m/s."""
    draw, stems = random.Random(1), list[Box]()
    while len(stems) < 40:
        north_m, east_m = draw.uniform(-12.0, 12.0), draw.uniform(-12.0, 12.0)
        side_m = draw.uniform(0.2, 0.5)
        if math.hypot(north_m, east_m) > 1.5:
            stems.append((north_m, east_m, side_m, side_m, 0.0))
    poses = [pose_at(0.02 * i - 0.5, (0.056 * i, 0.0, -4.0), (2.8, 0, 0), 3, 5) for i in range(60)]
    keys = {"kind": "laserscan", "name": "lidar", "mounting": MOUNTING} | KEYS
    source = LaserScanInput(LaserScanSource.model_validate(keys), poses_of(*poses))
    payload = scan_all_round(
        ranges_around(stems), stamp_unix_s=EPOCH_UNIX_S, time_increment_s=0.1 / 720
    )
    return Measurement(_read_ms(source, payload, sized(300, 3)), "ms", limit=SCAN_TIME_MAX_MS)


def bench_point_cloud() -> Measurement:
    """300,000 points, all of them at the vehicle's height."""
    draw, count = np.random.default_rng(1), sized(300_000, 3000)
    azimuth, elevation = draw.uniform(-0.75, 0.75, count), draw.uniform(-0.08, 0.08, count)
    away_m = draw.choice([4.0, 6.0, 9.0, 11.0], count) + draw.normal(0.0, 0.02, count)
    across, flat_m = np.sin(azimuth), away_m * np.cos(elevation)
    points_m = np.stack((flat_m * np.cos(azimuth), flat_m * across, away_m * np.sin(elevation)), 1)
    keys = {"kind": "pointcloud2", "name": "depth", "view_deg": [86.0, 57.0], "mounting": MOUNTING}
    source = PointCloudInput(
        PointCloudSource.model_validate(keys | KEYS), poses_of(pose_at(pitch_deg=2.0))
    )
    payload = point_cloud(points_m, stamp_unix_s=EPOCH_UNIX_S)
    return Measurement(_read_ms(source, payload, sized(30, 2)), "ms", limit=CLOUD_TIME_MAX_MS)


def bench_service_with_lidar() -> Measurement:
    """Share of a core that the service takes in cruise, with 720 beams at 20 Hz instead of JSON."""
    by_lidar = _share_of_core("scenarios/sensors/laserscan_default_field.yaml")
    by_json = _share_of_core("default.yaml")
    limit = by_json + LIDAR_SHARE_MAX
    return Measurement(100.0 * by_lidar, "% of a core", 100.0 * limit, "JSON + 5 %")


@without_cycle_collection()
def _share_of_core(name: str) -> float:
    """Return time spent by the service over virtual time, in cruise with an obstacle in view."""
    scenario = load_scenario(CONFIG / name)
    flight = SimulatedFlight(
        scenario.contract,
        scenario.mission,
        scenario.sitl_config(seed=1),
        scenario.obstacles,
        sources=scenario.sources,
    )
    simulation = Simulation(flight)
    autonomy = simulation.autonomy
    while not autonomy.navigator.obstacles:
        simulation.advance()
    spent_s, count = 0.0, sized(150, 10)
    for _ in range(count):
        simulation.scene.advance(simulation.scene.vehicle.truth.time_s + TICK_S)
        now_s = simulation.scene.vehicle.truth.time_s
        telemetry = simulation.scene.vehicle.bytes_to_send(ONBOARD_LINK)
        samples = simulation.scene.take_detections()
        began_s = time.process_time()
        autonomy.receive_mavlink(telemetry, now_s)
        for sample in samples:
            deliver(sample, autonomy, now_s)
        autonomy.tick(now_s)
        commands = autonomy.mavlink_to_send()
        spent_s += time.process_time() - began_s
        simulation.scene.vehicle.receive(commands, ONBOARD_LINK)
    return spent_s / (count * TICK_S)


def _read_ms(source: SensorInput, payload: bytes, repeat: int) -> float:
    """Return the median time of reading a message that makes a frame with boxes."""
    spent_s = []
    for _ in range(repeat):
        began_s = time.process_time()
        (frame,) = source.read(payload, 0.0)
        spent_s.append(time.process_time() - began_s)
        assert frame.obstacles
    return median(spent_s) * 1e3
