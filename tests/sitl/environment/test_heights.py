"""Obstacles with a top and a bottom: collisions in three dimensions, and what a sensor sees."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from onboard.files.obstacle_field import Obstacle, ObstacleField, load_field
from onboard.files.yaml_file import FileError
from sitl.config import SitlConfig
from sitl.environment.sensor import ObstacleSensor, SensorConfig
from sitl.environment.vertical_view import VerticalView
from sitl.environment.world import World
from sitl.plant.truth import VehicleTruth
from sitl.vehicle.scene import Scene

HEDGE = Obstacle(id="hedge", center_ned_m=(10.0, 0.0), size_m=(1.0, 20.0), down_m=(-1.5, 0.0))
CEILING = Obstacle(id="roof", center_ned_m=(10.0, 0.0), size_m=(4.0, 4.0), down_m=(None, -6.0))
TREE = Obstacle(id="tree", center_ned_m=(16.0, 0.0), size_m=(1.0, 1.0))


def at(
    north_m: float = 0.0, down_m: float = -5.0, roll_rad: float = 0.0, pitch_rad: float = 0.0
) -> VehicleTruth:
    x, y, z, w = Rotation.from_euler("ZYX", (0.0, pitch_rad, roll_rad)).as_quat()
    return VehicleTruth(
        time_s=0.0,
        position_ned_m=(north_m, 0.0, down_m),
        velocity_ned_mps=(0.0, 0.0, 0.0),
        acceleration_ned_mps2=(0.0, 0.0, 0.0),
        attitude_quaternion=(w, x, y, z),
        body_rates_radps=(0.0, 0.0, 0.0),
        rotor_speeds_rpm=(0.0, 0.0, 0.0, 0.0),
    )


# ------------------------------------------------------------------ fields


def test_heights_are_read_and_pillars_need_none(tmp_path: Path) -> None:
    path = tmp_path / "field.yaml"
    path.write_text(
        "- {id: a, center_ned_m: [1, 2], size_m: [1, 1], down_m: [-1.5, 0.0]}\n"
        "- {id: b, center_ned_m: [9, 2], size_m: [1, 1], down_m: [null, -4.0]}\n"
        "- {id: c, center_ned_m: [5, 2], size_m: [1, 1]}\n"
    )
    field = load_field(path)
    assert field.down_m is not None
    assert field.down_m.tolist() == [[-1.5, 0.0], [-math.inf, -4.0], [-math.inf, math.inf]]
    assert field.reaching_into(-6.0, -4.5).ids == ("b", "c")
    assert ObstacleField.of([TREE]).down_m is None


@pytest.mark.parametrize("down_m", ["[0.0, -1.5]", "[-1.0, -1.0]"])
def test_a_bottom_above_the_top_is_refused(tmp_path: Path, down_m: str) -> None:
    path = tmp_path / "field.yaml"
    path.write_text(f"- {{id: a, center_ned_m: [1, 2], size_m: [1, 1], down_m: {down_m}}}\n")
    with pytest.raises(FileError, match=r"field\.yaml.*down_m = .* m: the top is not above"):
        load_field(path)


# ------------------------------------------------------------------ collisions


def test_over_a_hedge_the_clearance_is_that_to_its_top() -> None:
    world = World(ObstacleField.of([HEDGE]), 0.3, 0.1)
    assert world.clearance_at_m((10.0, 0.0), -5.0) == pytest.approx(3.4)
    assert world.clearance_at_m((5.0, 0.0), -1.0) == pytest.approx(4.2)
    assert world.clearance_at_m((8.0, 0.0), -4.0) == pytest.approx(math.hypot(1.2, 2.4))
    assert world.clearance_at_m((10.0, 0.0), -1.5) == pytest.approx(-0.1)
    roof = World(ObstacleField.of([CEILING]), 0.3, 0.1)
    assert roof.clearance_at_m((10.0, 0.0), -5.0) == pytest.approx(0.9)


@pytest.mark.parametrize(("down_m", "tilt_rad", "collisions"), [
    (-1.7, 0.0, 0), (-1.7, 0.5, 1), (-1.5, 0.0, 1), (-5.0, 0.5, 0),
])  # fmt: skip
def test_a_flight_low_over_a_hedge_collides_with_it(
    down_m: float, tilt_rad: float, collisions: int
) -> None:
    world = World(ObstacleField.of([HEDGE]), 0.3, 0.1)
    for tenth in range(200):
        world.observe((tenth / 10.0, 0.0, down_m), tilt_rad)
    assert world.collisions == collisions
    assert (world.clearance_min_m < 0.0) is bool(collisions)


def test_a_tree_behind_a_hedge_far_below_is_not_overlooked() -> None:
    """The nearest from above is not the nearest."""
    world = World(ObstacleField.of([HEDGE, TREE]), 0.3, 0.1)
    for tenth in range(160):
        world.observe((tenth / 10.0, 0.0, -40.0))
    assert world.collisions == 1


@given(st.floats(0.0, 25.0), st.floats(-8.0, 0.0))
def test_clearances_on_the_way_are_those_of_every_place(north_m: float, down_m: float) -> None:
    field = ObstacleField.of([HEDGE, CEILING, TREE])
    world, fresh = World(field, 0.3, 0.1), World(field, 0.3, 0.1)
    world.observe((0.0, 0.0, -3.0))
    world.observe((north_m, 0.0, down_m))
    assert world.clearance_m == pytest.approx(fresh.clearance_at_m((north_m, 0.0), down_m))


# ------------------------------------------------------------------ sensors


def sensor(*obstacles: Obstacle, **config: Any) -> ObstacleSensor:
    stated: dict[str, Any] = {
        "latency_s": 0.0,
        "vertical_field_of_view_deg": (30.0, 30.0),
        "range_m": 20.0,
    }
    return ObstacleSensor(SensorConfig(**stated | config), ObstacleField.of(obstacles), 1)


def seen(device: ObstacleSensor, truth: VehicleTruth, estimate: VehicleTruth | None = None) -> Any:
    (payload,) = device.sense(0.0, truth, estimate)
    frame = json.loads(payload)
    return frame["obstacles"]


def test_a_sensor_reports_top_and_bottom_of_what_it_sees() -> None:
    (found,) = seen(sensor(HEDGE), at())
    # Its foot, 5 m below at 9.5 m, is in view.
    assert found["down_m"] == pytest.approx([-1.5, 0.0])
    assert found["down_uncertainty_m"] == 0.3
    (found,) = seen(sensor(HEDGE, frame="body_frd"), at())
    assert found["down_m"] == pytest.approx([3.5, 5.0])


def test_what_reaches_out_of_view_seems_to_end_at_its_edge() -> None:
    (found,) = seen(sensor(TREE), at())
    reach_m = math.hypot(16.5, 0.5) * math.tan(math.radians(30.0))
    assert found["down_m"] == pytest.approx([-5.0 - reach_m, -5.0 + reach_m])
    (found,) = seen(sensor(TREE), at(pitch_rad=math.radians(10.0)))
    assert found["down_m"][1] == pytest.approx(
        -5.0 + math.hypot(16.5, 0.5) * math.tan(math.radians(20.0))
    )


def test_below_the_view_nothing_is_seen() -> None:
    car = HEDGE.model_copy(update={"size_m": (2.0, 2.0)})
    assert seen(sensor(car), at(6.0)) == []
    assert seen(sensor(car), at(pitch_rad=0.4)) == []
    assert len(seen(sensor(car), at())) == 1
    # The ends of a hedge are far enough away to be seen.
    assert len(seen(sensor(HEDGE), at(8.0))) == 1


def test_without_a_vertical_view_heights_are_not_reported() -> None:
    (found,) = seen(sensor(HEDGE, vertical_field_of_view_deg=None), at(8.0))
    assert "down_m" not in found


def test_heights_are_off_by_no_more_than_their_noise_and_by_the_estimate() -> None:
    device = sensor(HEDGE, height_noise_m=0.3, frame="local_ned")
    (found,) = seen(device, at(), at(down_m=-5.5))
    top_m, bottom_m = found["down_m"]
    assert abs(top_m + 2.0) <= 0.3
    assert abs(bottom_m + 0.5) <= 0.3
    assert top_m != -2.0
    pinned = sensor(HEDGE, height_noise_m=0.3, errors={"faces": "shrink"})
    (found,) = seen(pinned, at())
    assert found["down_m"] == pytest.approx([-1.2, -0.3])


@given(
    roll=st.floats(-0.3, 0.3), pitch=st.floats(-0.3, 0.3), bearing=st.floats(-1.0, 1.0),
    up=st.booleans(),
)  # fmt: skip
def test_the_edges_of_the_view_tilt_with_the_body(
    roll: float, pitch: float, bearing: float, up: bool
) -> None:
    view = VerticalView.of((30.0, 30.0), at(roll_rad=roll, pitch_rad=pitch), bearing)
    edge_rad = view.up_rad if up else view.low_rad
    ray = (math.cos(bearing), math.sin(bearing), -math.tan(edge_rad))
    x, y, z = Rotation.from_euler("ZYX", (0.0, pitch, roll)).as_matrix().T @ ray
    # To the first order of the tilt.
    assert abs(abs(math.atan2(-z, math.hypot(x, y))) - math.radians(30.0)) < math.radians(3.5)


def test_rays_are_refused_among_what_they_take_for_pillars() -> None:
    config = SitlConfig.model_validate({"sensors": [{"source": "scan", "publishes": "laserscan"}]})
    with pytest.raises(FileError, match=r"scan is a laserscan of rays.*expected publishes: json"):
        Scene(config, ObstacleField.of([HEDGE]))


def test_a_vertical_view_is_for_the_ideal_detector() -> None:
    with pytest.raises(ValueError, match="expected publishes: json, without scanner"):
        SensorConfig(publishes="laserscan", vertical_field_of_view_deg=(30.0, 30.0))
