"""Simulated sensors that keep to what they declare contradict nothing; one that does not, does."""

import json
import math
import random

import pytest

from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.monitoring.detection_consistency import DetectionConsistencyMonitor, Sighting
from onboard.perception.detection import corners_ned
from onboard.perception.full_view import in_full_view
from onboard.perception.sources.json_v1 import parse_frame
from onboard.vehicle_state import Pose
from sitl.environment.lidar import ScannerConfig
from sitl.environment.sensor import ObstacleSensor, SensorConfig
from sitl.plant.truth import VehicleTruth

FLIGHTS = 6
STEP_S, SPEED_MPS, STEPS = 0.05, 2.8, 320
SCANNERS = [
    ScannerConfig(),
    ScannerConfig(range_noise_m=0.01, dropout=0.02),
    ScannerConfig(resolution_deg=0.2, range_noise_m=0.005),
]


def field_beside(draw: random.Random) -> ObstacleField:
    """Three boxes of any yaw, beside the way."""
    return ObstacleField.of(
        [
            Obstacle(
                id=str(number),
                center_ned_m=(
                    12.0 + 14.0 * number + draw.uniform(-2.0, 2.0),
                    draw.uniform(2.8, 6.0) * draw.choice((-1.0, 1.0)),
                ),
                size_m=(draw.uniform(0.3, 3.0), draw.uniform(0.3, 3.0)),
                yaw_deg=draw.uniform(-90.0, 90.0),
            )
            for number in range(3)
        ]
    )


def contradictions(config: SensorConfig, seed: int, heading_error_rad: float = 0.0) -> int:
    """Fly past and count contradicting sightings; the heading may be wrong by a slow swing."""
    sensor = ObstacleSensor(config, field_beside(random.Random(seed)), seed=seed)
    monitor, count = DetectionConsistencyMonitor(), 0
    still = (0.0, 0.0, 0.0)
    for step in range(STEPS):
        now_s = step * STEP_S
        here_m = (SPEED_MPS * now_s, math.sin(now_s / 3.0), -4.0)
        truth = VehicleTruth(now_s, here_m, still, still, (1.0, 0.0, 0.0, 0.0), still, (0.0,) * 4)
        yaw_rad = heading_error_rad * math.sin(now_s)
        pose = Pose(now_s, here_m, still, 0.0, 0.0, yaw_rad)
        for payload in sensor.sense(now_s, truth):
            frame = parse_frame(payload)
            placed_by = pose if frame.frame == "body_frd" else None
            boxes = [corners_ned(detection, placed_by) for detection in frame.obstacles]
            view_rad = math.radians(frame.field_of_view_deg)
            seen = in_full_view(boxes, pose, view_rad, frame.range_m)
            for detection, corners, in_full in zip(frame.obstacles, boxes, seen, strict=True):
                sighting = Sighting.of(corners, detection.uncertainty_m, 0.0)
                taken = monitor.take(detection.id, sighting if in_full else None, now_s)
                count += taken.violation is not None
    return count


@pytest.mark.parametrize("scanner", SCANNERS, ids=str)
@pytest.mark.parametrize("view_deg", [90.0, 120.0])
def test_a_scanner_that_sees_parts_contradicts_nothing(
    scanner: ScannerConfig, view_deg: float
) -> None:
    config = SensorConfig(
        scanner=scanner, latency_s=0.0, field_of_view_deg=view_deg, uncertainty_m=0.06
    )
    assert sum(contradictions(config, seed) for seed in range(FLIGHTS)) == 0


def test_a_detector_with_noise_within_its_uncertainty_contradicts_nothing() -> None:
    config = SensorConfig(noise_m=0.05, uncertainty_m=0.05, latency_s=0.0)
    assert sum(contradictions(config, seed) for seed in range(FLIGHTS)) == 0


def test_a_detector_with_twice_the_noise_is_found_out() -> None:
    config = SensorConfig(noise_m=0.10, uncertainty_m=0.05, latency_s=0.0)
    assert all(contradictions(config, seed) > 0 for seed in range(FLIGHTS))


@pytest.mark.parametrize("scanner", [None, SCANNERS[0]], ids=str)
def test_a_heading_that_wanders_is_found_out(scanner: ScannerConfig | None) -> None:
    config = SensorConfig(scanner=scanner, frame="body_frd", latency_s=0.0, uncertainty_m=0.06)
    found = [contradictions(config, seed, math.radians(3.5)) for seed in range(FLIGHTS)]
    assert all(found)


def test_the_flights_see_every_box() -> None:
    sensor = ObstacleSensor(SensorConfig(latency_s=0.0), field_beside(random.Random(0)), seed=0)
    still = (0.0, 0.0, 0.0)
    names = set()
    for step in range(STEPS):
        here_m = (SPEED_MPS * step * STEP_S, 0.0, -4.0)
        truth = VehicleTruth(0.0, here_m, still, still, (1.0, 0.0, 0.0, 0.0), still, (0.0,) * 4)
        for payload in sensor.sense(step * STEP_S, truth):
            names |= {obstacle["id"] for obstacle in json.loads(payload)["obstacles"]}
    assert names == {"0", "1", "2"}
