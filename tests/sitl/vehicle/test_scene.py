from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.config import SitlConfig, StartConfig, load_sitl_config
from sitl.environment.sensor import SensorConfig
from sitl.environment.truth_log import TruthLog
from sitl.plant.wind import WindConfig
from sitl.vehicle.scene import Scene

FIELD = ObstacleField.of([Obstacle(id="oak", center_ned_m=(6.0, 0.0), size_m=(1.0, 1.0))])
HOVER = StartConfig(position_ned_m=(0.0, 0.0, -3.0))
REPOSITORY = Path(__file__).parents[3]


def scene(**config: Any) -> Scene:
    return Scene(SitlConfig(start=HOVER, realism="ideal", **config), FIELD, start_unix_s=1000.0)


def test_vehicle_world_and_sensors_advance_together() -> None:
    together = scene(
        sensors=(SensorConfig(latency_s=0.0), SensorConfig(source="rear", yaw_deg=180.0))
    )
    together.advance(1.004)
    assert together.vehicle.truth.time_s == pytest.approx(1.0)
    detections = together.take_detections()
    by_source = {
        name: [json.loads(d.payload) for d in detections if d.source == name]
        for name in ("front", "rear")
    }
    assert len(by_source["front"]) == 21  # 20 Hz, both ends included
    assert {o["id"] for frame in by_source["front"] for o in frame["obstacles"]} == {"oak"}
    assert not any(frame["obstacles"] for frame in by_source["rear"])
    assert together.take_detections() == []
    record = together.truth_record()
    assert record.time_unix_s == pytest.approx(1001.0)
    assert record.clearance_m == pytest.approx(5.2, abs=0.01)


# The last two are due a few nanoseconds after a tick, or before one.
@pytest.mark.parametrize("rate_hz", [19.0, 20.0, 33.33333, 14.2857143])
def test_a_sensor_measures_on_time_between_two_decisions_of_the_autopilot(rate_hz: float) -> None:
    config = SitlConfig(start=HOVER, realism="ideal", sensors=(SensorConfig(rate_hz=rate_hz),))
    seldom = Scene(config, FIELD, ticks_per_decision=4)
    seldom.advance(1.5)
    assert seldom.vehicle.truth.time_s == pytest.approx(1.5)
    stamps_s = [json.loads(d.payload)["stamp_unix_s"] for d in seldom.take_detections()]
    # In the first tick of 10 ms from each instant on.
    due_s = [math.ceil(100.0 * number / rate_hz - 1e-7) / 100.0 for number in range(20)]
    assert stamps_s[:20] == pytest.approx(due_s)


def test_time_passes_whatever_the_rate_of_a_sensor() -> None:
    # In a tick at 3.03 s this one is due at once again, if it were not for round-off.
    config = SitlConfig(start=HOVER, realism="ideal", sensors=(SensorConfig(rate_hz=133.333333),))
    endless = Scene(config, FIELD)
    endless.advance(3.2)
    assert endless.vehicle.truth.time_s == pytest.approx(3.2)


def test_same_seed_same_flight_to_the_byte(tmp_path: Path) -> None:
    def flown(seed: int) -> tuple[bytes, list[bytes]]:
        windy = scene(
            seed=seed,
            wind=WindConfig(mean_ned_mps=(2.0, 1.0, 0.0), turbulence_mps=1.0),
            sensors=(SensorConfig(noise_m=0.1),),
        )
        path = tmp_path / "truth.mcap"
        with TruthLog(path, windy.start_unix_s) as log:
            for tick in range(100):
                windy.advance(0.02 * tick)
                log.write(windy.vehicle.truth, windy.world)
        return path.read_bytes(), [d.payload for d in windy.take_detections()]

    first, again, other = flown(1), flown(1), flown(2)
    assert first == again
    assert first[0] != other[0]
    assert first[1] != other[1]


def test_turbulent_air_is_held_against() -> None:
    windy = scene(wind=WindConfig(mean_ned_mps=(6.0, -4.0, 0.0), turbulence_mps=1.5))
    worst_m = 0.0
    for tick in range(1500):
        windy.advance(0.02 * tick)
        north, east, down = windy.vehicle.truth.position_ned_m
        if tick > 250:
            worst_m = max(worst_m, abs(north), abs(east), abs(down + 3.0))
    assert 0.005 < worst_m < 0.25


def test_paths_are_relative_to_the_configuration_file(tmp_path: Path) -> None:
    (tmp_path / "sitl.yaml").write_text("{field: a/field.yaml, truth_log: t.mcap}")
    config = load_sitl_config(tmp_path / "sitl.yaml")
    assert config.field == tmp_path / "a" / "field.yaml"
    assert config.truth_log == tmp_path / "t.mcap"


def test_an_almost_empty_file_works_and_the_example_too(tmp_path: Path) -> None:
    (tmp_path / "sitl.yaml").write_text("vehicle: kite\n")
    assert load_sitl_config(tmp_path / "sitl.yaml") == SitlConfig(vehicle="kite")
    example = load_sitl_config(REPOSITORY / "config" / "sitl.yaml")
    assert example.parameters["COM_OF_LOSS_T"] == 0.3
