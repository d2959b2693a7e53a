"""Errors that a detector makes on purpose, within what a contract allows."""

from __future__ import annotations

import json
import random

import pytest

from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.environment.detector_errors import (
    Confirmation,
    DetectorErrorConfig,
    FaceStrategy,
    face_errors,
)
from sitl.environment.sensor import ObstacleSensor, SensorConfig
from sitl.plant.truth import VehicleTruth

E_M = 0.1


def errors(faces: FaceStrategy, sequence: int = 0, distance_m: float = 9.0) -> tuple[float, ...]:
    config = DetectorErrorConfig(faces=faces, late_m=5.0)
    return face_errors(config, E_M, sequence, distance_m, random.Random(1))


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        ("shrink", (-E_M,) * 4),
        ("grow", (E_M,) * 4),
        ("shift", (E_M, -E_M, E_M, -E_M)),
        ("alternate", (-E_M,) * 4),
        ("late", (-E_M,) * 4),
    ],
)
def test_a_strategy_uses_the_whole_error_of_each_face(
    faces: FaceStrategy, expected: tuple[float, ...]
) -> None:
    assert errors(faces) == expected


def test_alternating_and_late_faces_change() -> None:
    assert errors("alternate", sequence=1) == (E_M,) * 4
    assert errors("late", distance_m=4.0) == (E_M,) * 4


def test_random_faces_stay_within_the_error_and_differ() -> None:
    found = errors("random")
    assert len(set(found)) == 4
    assert max(map(abs, found)) <= E_M


def test_an_obstacle_is_reported_in_the_frame_that_confirms_it() -> None:
    seen = Confirmation(DetectorErrorConfig(confirm_frames=3))
    assert [seen.reported([4], number) for number in range(4)] == [[], [], [4], [4]]
    assert seen.reported([], 4) == []
    assert seen.reported([4], 5) == []  # out of view, it has to be confirmed again
    assert seen.missed_max == 2


def test_frames_are_empty_now_and_then() -> None:
    seen = Confirmation(DetectorErrorConfig(empty_every=5, empty_frames=2))
    assert [bool(seen.reported([1], number)) for number in range(6)] == [
        True, True, True, False, False, True,
    ]  # fmt: skip
    assert seen.missed_max == 2


def test_the_detector_makes_them() -> None:
    box = Obstacle(id="a", center_ned_m=(5.0, 0.0), size_m=(2.0, 1.0))
    errors_made = DetectorErrorConfig(faces="grow", confirm_frames=2)
    config = SensorConfig(face_noise_m=E_M, errors=errors_made, latency_s=0.0, rate_hz=10.0)
    sensor = ObstacleSensor(config, ObstacleField.of([box]), seed=1)
    here = VehicleTruth(0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3,
                        (0.0,) * 4)  # fmt: skip
    (first,) = sensor.sense(0.0, here)
    (second,) = sensor.sense(0.1, here)
    assert b'"obstacles":[]' in first
    (seen,) = json.loads(second)["obstacles"]
    assert seen["size_m"] == pytest.approx([2.2, 1.2])
    assert sensor.face_error_max_m == E_M
