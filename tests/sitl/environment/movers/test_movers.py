"""Movers of the simulated world: paths, speeds, contacts, and what a detector reports of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.perception.movers.moving_detection import MovingFrame, is_mover, is_whole, kind_of
from onboard.perception.sources.json_v1 import parse_frame
from sitl.environment.movers.config import MoverConfig
from sitl.environment.movers.movers import REST_MPS, Movers
from sitl.environment.movers.occlusion import are_hidden
from sitl.environment.sensor import ObstacleSensor, SensorConfig
from sitl.plant.truth import VehicleTruth

STEP_S = 0.02


def mover(path: dict[str, Any], **keys: Any) -> MoverConfig:
    return MoverConfig.model_validate(
        {"id": "1", "class": "person", "size_m": 0.6, "speed_mps": 1.5, "path": path, **keys}
    )


PATHS: dict[str, dict[str, Any]] = {
    "waypoints": {"kind": "waypoints", "places_ned_m": [[5.0, -3.0], [5.0, 3.0]]},
    "trefoil": {"kind": "trefoil", "center_ned_m": [5.0, 0.0], "radius_m": 3.0},
    "pursuit": {"kind": "pursuit", "start_ned_m": [8.0, 0.0], "lead_s": 1.0},
    "knot": {
        "kind": "knot",
        "center_ned_m": [5.0, 0.0],
        "scale_m": [3.0, 2.0],
        "period_s": 12.0,
    },
    "dash": {"kind": "dash", "start_ned_m": [1.0, 5.0], "meets_ned_m": [1.0, 0.0]},
    "hostile": {"kind": "hostile", "start_ned_m": [8.0, 0.0]},
}


@pytest.mark.parametrize("kind", PATHS)
def test_a_mover_goes_no_faster_than_it_may_and_the_same_for_the_same_seed(kind: str) -> None:
    trails = []
    for _ in range(2):
        movers = Movers([mover(PATHS[kind])], 0.3, seed=3)
        trail = [movers.all[0].position_ned_m]
        for step in range(1, 800):
            movers.advance(step * STEP_S, (0.0, 0.0), (0.5, 0.0), airborne=True)
            trail.append(movers.all[0].position_ned_m)
            assert math.dist(trail[-1], trail[-2]) <= 1.5 * STEP_S + 1e-9
            assert math.hypot(*movers.all[0].velocity_ned_mps) <= 1.5 + 1e-9
        trails.append(trail)
    assert trails[0] == trails[1]
    assert max(math.dist(trails[0][0], place) for place in trails[0]) > 0.1


def test_a_pursuer_touches_a_vehicle_at_rest_and_retreats() -> None:
    movers = Movers([mover(PATHS["pursuit"])], 0.3, seed=1)
    for step in range(1, 600):
        movers.advance(step * STEP_S, (0.0, 0.0), (0.0, 0.0), airborne=True)
    assert movers.contacts_at_rest == 1
    assert movers.contacts_moving == 0
    assert movers.clearance_min_m < 0.0
    assert math.dist(movers.all[0].position_ned_m, (0.0, 0.0)) > 3.0


def test_a_contact_in_motion_counts_once_also_where_it_began_at_rest() -> None:
    movers = Movers([mover(PATHS["waypoints"], speed_mps=0.0)], 0.3, seed=1)
    speeds = [0.0] * 5 + [REST_MPS + 0.01] * 5 + [0.0] * 5
    for step, speed_mps in enumerate(speeds, start=1):
        movers.advance(step * STEP_S, (5.0, -3.0), (speed_mps, 0.0), airborne=True)
    assert movers.contacts_at_rest == 1
    assert movers.contacts_moving == 1
    assert movers.speed_at_contact_mps == pytest.approx(REST_MPS + 0.01)


def test_on_the_ground_nothing_counts() -> None:
    movers = Movers([mover(PATHS["waypoints"])], 0.3, seed=1)
    movers.advance(STEP_S, (5.0, -3.0), (1.0, 0.0), airborne=False)
    assert movers.contacts_moving == movers.contacts_at_rest == 0


def test_the_nearest_mover_has_a_direction() -> None:
    movers = Movers([mover(PATHS["pursuit"])], 0.3, seed=1)
    assert movers.toward_nearest((0.0, 0.0)) == pytest.approx((1.0, 0.0))
    assert Movers([], 0.3, seed=1).toward_nearest((0.0, 0.0)) == (0.0, 0.0)


HERE = VehicleTruth(
    time_s=0.0,
    position_ned_m=(0.0, 0.0, -3.0),
    velocity_ned_mps=(0.0, 0.0, 0.0),
    acceleration_ned_mps2=(0.0, 0.0, 0.0),
    attitude_quaternion=(1.0, 0.0, 0.0, 0.0),
    body_rates_radps=(0.0, 0.0, 0.0),
    rotor_speeds_rpm=(0.0, 0.0, 0.0, 0.0),
)


def frame(movers: Movers, count: int = 1, **config: Any) -> MovingFrame:
    """Return the last of some frames of a sensor at the origin that looks north."""
    keys = {"message_version": 2, "latency_s": 0.0, **config}
    sensor = ObstacleSensor(
        SensorConfig.model_validate(keys), ObstacleField.of([]), seed=1, movers=movers.all
    )
    payloads: tuple[bytes, ...] = ()
    for index in range(count):
        payloads = sensor.sense(index * 0.05, HERE)
    read = parse_frame(payloads[-1])
    assert isinstance(read, MovingFrame)
    assert read.frame_complete
    return read


def at(*places: tuple[float, float], size_m: float = 0.6) -> Movers:
    return Movers(
        [
            mover(
                {"kind": "waypoints", "places_ned_m": [place]},
                id=str(number),
                size_m=size_m,
                speed_mps=0.0,
            )
            for number, place in enumerate(places)
        ],
        0.3,
        seed=1,
    )


def test_a_frame_of_version_2_reports_movers_whole() -> None:
    (seen,) = frame(at((5.0, 1.0))).obstacles
    assert is_mover(seen)
    assert kind_of(seen) == "person"
    assert is_whole(seen)
    assert seen.center_m == pytest.approx((5.0, 1.0))
    assert seen.size_m == pytest.approx((0.6, 0.6))


def test_who_is_out_of_view_or_range_is_not_reported() -> None:
    assert frame(at((-5.0, 0.0), (13.0, 0.0))).obstacles == ()
    ring = frame(at((-5.0, 0.0)), field_of_view_deg=360.0)
    assert len(ring.obstacles) == 1


def test_at_the_edge_of_the_view_a_part_is_reported_that_holds_what_is_seen() -> None:
    (seen,) = frame(at((12.0, 0.0), size_m=1.0)).obstacles
    assert not is_whole(seen)
    near_m, far_m = (seen.center_m[0] + side * seen.size_m[0] / 2.0 for side in (-1, 1))
    assert near_m == pytest.approx(11.5)
    assert 12.0 <= far_m < 12.5


def test_names_are_exchanged_and_faces_err_within_their_bound() -> None:
    movers = at((5.0, -2.0), (5.0, 2.0))
    names = set()
    for count in range(1, 12):
        read = frame(movers, count, mover_swap_share=0.5, face_noise_m=0.1, uncertainty_m=0.1)
        for seen in read.obstacles:
            side = -1.0 if seen.center_m[1] < 0.0 else 1.0
            names.add((side, seen.id))
            assert abs(seen.center_m[1] - 2.0 * side) <= 0.1 + 1e-9
            assert abs(seen.size_m[0] - 0.6) <= 0.2 + 1e-9
    assert len(names) == 4


def test_a_mover_is_reported_once_it_is_confirmed() -> None:
    errors = {"confirm_frames": 3}
    assert frame(at((5.0, 0.0)), 2, errors=errors).obstacles == ()
    assert len(frame(at((5.0, 0.0)), 3, errors=errors).obstacles) == 1


def test_version_1_reports_no_movers() -> None:
    config = SensorConfig(latency_s=0.0)
    sensor = ObstacleSensor(config, ObstacleField.of([]), seed=1, movers=at((5.0, 0.0)).all)
    (payload,) = sensor.sense(0.0, HERE)
    assert parse_frame(payload).obstacles == ()


def test_a_knot_is_where_its_formula_says_at_each_time() -> None:
    path = {
        "kind": "knot", "center_ned_m": [85.0, 3.0], "scale_m": [2.5, 3.0],
        "period_s": 2.0 * math.pi * 4.6, "phase_deg": math.degrees(2.35),
    }  # fmt: skip
    movers = Movers([mover(path, speed_mps=2.0)], 0.3, seed=1)
    for step in range(1, 1500):
        movers.advance(step * STEP_S, (0.0, 0.0), (0.0, 0.0), airborne=True)
        s = step * STEP_S / 4.6 + 2.35
        expected = (
            85.0 + 2.5 / 6.0 * (math.sin(s) + 2.0 * math.sin(2.0 * s)),
            3.0 + 3.0 / 5.0 * (math.cos(s) - 2.0 * math.cos(2.0 * s)),
        )
        assert movers.all[0].position_ned_m == pytest.approx(expected, abs=1e-6)


def test_a_dash_meets_a_vehicle_that_keeps_its_speed() -> None:
    movers = Movers([mover(PATHS["dash"], speed_mps=1.0)], 0.3, seed=1)
    begun_s = None
    for step in range(1, 2000):
        now_s = step * STEP_S
        movers.advance(now_s, (-20.0 + 2.0 * now_s, 0.0), (2.0, 0.0), airborne=True)
        if begun_s is None and movers.all[0].velocity_ned_mps != (0.0, 0.0):
            begun_s = now_s
    assert begun_s == pytest.approx(10.5 - 4.7, abs=2.0 * STEP_S)  # 5 m less half its edge, 21 m
    assert movers.contacts_moving == 1
    north_m, east_m = movers.all[0].position_ned_m
    assert north_m == pytest.approx(1.0)
    assert east_m < -20.0


def test_who_waits_sets_off_once_the_vehicle_is_near() -> None:
    path = {**PATHS["waypoints"], "begins_within_m": 4.0}
    movers = Movers([mover(path)], 0.3, seed=1)
    movers.advance(5.0, (0.0, 0.0), (0.0, 0.0), airborne=True)
    assert movers.all[0].position_ned_m == (5.0, -3.0)
    movers.advance(6.0, (2.0, -3.0), (0.0, 0.0), airborne=True)
    assert movers.all[0].position_ned_m == pytest.approx((5.0, -1.5))
    movers.advance(6.5, (-50.0, 0.0), (0.0, 0.0), airborne=True)
    assert movers.all[0].position_ned_m == pytest.approx((5.0, -0.75))


# A wall 2 m wide at 3 m north, turned by 30 degrees about its middle.
WALL = np.array(((3.0, 0.0, 0.1, 1.0, math.radians(30.0)),))


@pytest.mark.parametrize(
    ("place", "hidden"),
    [
        ((6.0, 0.0), True),
        ((2.0, 0.0), False),
        ((-6.0, 0.0), False),
        ((6.0, 2.5), False),  # past the nearer end
        ((6.0, -1.5), True),
        ((6.0, -2.6), False),
        ((2.88, 0.0), False),  # on the face that is seen
    ],
)
def test_a_box_hides_what_is_behind_it(place: tuple[float, float], hidden: bool) -> None:
    found = are_hidden(np.array((place,)), (0.0, 0.0), WALL)
    assert found.tolist() == [hidden]
    assert are_hidden(np.array((place,)), (0.0, 0.0), WALL[:0]).tolist() == [False]


def hiding_frame(movers: Movers, *walls: Obstacle, movers_hidden: bool = True) -> MovingFrame:
    config = SensorConfig(message_version=2, latency_s=0.0, movers_hidden=movers_hidden)
    sensor = ObstacleSensor(config, ObstacleField.of(walls), seed=1, movers=movers.all)
    (payload,) = sensor.sense(0.0, HERE)
    read = parse_frame(payload)
    assert isinstance(read, MovingFrame)
    return read


def movers_in(read: MovingFrame) -> list[Any]:
    return [seen for seen in read.obstacles if is_mover(seen)]


def test_no_mover_is_seen_behind_a_wall_or_behind_another_unless_it_is_looked_through() -> None:
    wall = Obstacle(id="wall", center_ned_m=(3.0, 0.0), size_m=(0.2, 2.0), yaw_deg=0.0)
    behind = at((5.0, 0.0))
    assert movers_in(hiding_frame(behind, wall)) == []
    assert len(movers_in(hiding_frame(behind, wall, movers_hidden=False))) == 1
    (first,) = movers_in(hiding_frame(at((5.0, 0.0), (8.0, 0.0))))
    assert first.center_m == pytest.approx((5.0, 0.0))
    assert is_whole(first)


def test_of_who_is_half_behind_a_wall_a_part_is_seen() -> None:
    wall = Obstacle(id="wall", center_ned_m=(3.0, 0.0), size_m=(0.2, 2.0), yaw_deg=0.0)
    (seen,) = movers_in(hiding_frame(at((6.0, 2.0), size_m=1.0), wall))
    assert not is_whole(seen)
    assert seen.center_m[1] + seen.size_m[1] / 2.0 == pytest.approx(2.5)
    assert seen.center_m[1] - seen.size_m[1] / 2.0 > 1.5
