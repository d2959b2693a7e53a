"""The evaluation of the planner for dense fields, on small fields."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from onboard.contract.run_on import RunOn
from onboard.planning.corridor.horizon import Horizon
from tests.tools.dense_fields.flight import Flight
from tests.tools.dense_fields.obstacles import Floats, Obstacles
from tests.tools.dense_fields.scenes import Scene, drawn, scenes_of
from tests.tools.dense_fields.service import field_of, fly_by_service
from tests.tools.dense_fields.vehicles import Vehicle, vehicles

TWO = Obstacles.stems(np.array(((5.0, 0.2), (8.0, 0.3))), np.array((0.3, 0.2)))


def scene(*stems: tuple[float, float], length_m: float = 14.0) -> Scene:
    centres = np.array(stems)
    return Scene("small", Obstacles.stems(centres, np.full(len(stems), 0.15)), length_m, 9.0)


def test_distances_to_stems_and_turned_boxes() -> None:
    box = Obstacles(
        np.array(((0.0, 0.0),)), np.array(((2.0, 1.0),)), np.array((math.pi / 2,)), np.zeros(1)
    )
    points = np.array(((3.0, 0.0), (0.0, 3.0), (0.0, 0.0)))
    assert box.distance_m(points) == pytest.approx((2.0, 1.0, -1.0))
    assert TWO.distance_m(np.array(((5.0, 3.2),))) == pytest.approx(2.7)


def test_the_worst_error_leads_toward_the_nearest_obstacle() -> None:
    points = np.array(((3.0, 0.2), (5.0, 2.2)))
    moved = TWO.toward_nearest(points, 0.35)
    assert moved == pytest.approx(np.array(((3.35, 0.2), (5.0, 1.85))))
    turned = TWO.along_leg(np.array((1.0, 1.0)), 0.7)
    assert turned.distance_m(turned.toward_nearest(np.zeros((1, 2)), 0.35)) == pytest.approx(
        turned.distance_m(np.zeros((1, 2))) - 0.35
    )


def test_what_stands_behind_another_is_hidden() -> None:
    assert TWO.visible((0.0, 0.0), 0.0, math.radians(45.0), 12.0).tolist() == [0]
    assert TWO.visible((0.0, 6.0), -0.5, math.radians(45.0), 12.0).tolist() == [0, 1]
    assert not TWO.visible((0.0, 0.0), math.pi, math.radians(45.0), 12.0).size
    assert not TWO.visible((-9.0, 0.0), 0.0, math.radians(45.0), 12.0).size


def test_reported_faces_are_wrong_by_no_more_than_declared() -> None:
    for report, exact in zip(
        TWO.reports(np.random.default_rng(1), 0.1),
        TWO.reports(np.random.default_rng(1), 0.0),
        strict=True,
    ):
        assert report != exact
        assert abs(report.x_min_m - exact.x_min_m) <= 0.1
        assert abs(report.y_max_m - exact.y_max_m) <= 0.1


def test_surface_points_lie_in_the_obstacles() -> None:
    for obstacles in (TWO, drawn("trap").obstacles):
        distance_m = obstacles.distance_m(obstacles.surface_points_m())
        assert distance_m.max() < 0.0


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_loss_stays_within_the_run_on_that_is_certified(name: str) -> None:
    vehicle = vehicles()[name]
    assert vehicle.after_loss is not None
    rng = np.random.default_rng(3)
    for _ in range(200):
        state = rng.normal(size=(3, 2))
        state[1] *= 2.8 / max(2.8, float(np.hypot(*state[1])))
        state[2] *= 2.63 / max(2.63, float(np.hypot(*state[2])))
        low, high = hull(state, vehicle.run_on)
        run = vehicle.after_loss(state)
        assert (run >= low - 0.02).all()
        assert (run <= high + 0.02).all()


def hull(state: Floats, run_on: RunOn) -> tuple[Floats, Floats]:
    points = [state[0]] + [state[0] + k * state[1] + c * state[2] for k, c in run_on.gains]
    return np.min(points, axis=0), np.max(points, axis=0)


def test_a_field_is_passable_where_the_margin_leaves_a_gap() -> None:
    door = drawn("door:1.8")
    assert door.passable(0.75)
    assert not door.passable(0.95)


def test_legs_of_a_file_have_clear_ends(tmp_path: Path) -> None:
    path = tmp_path / "stems.csv"
    rng = np.random.default_rng(4)
    rows = "\n".join(f"{x},{y},25" for x, y in rng.uniform(0.0, 110.0, (80, 2)))
    path.write_text(f"x_m,y_m,dbh_cm\n{rows}\n", encoding="utf-8")
    legs = list(scenes_of(str(path), 3, 1))
    assert len(legs) == 3
    for leg in legs:
        ends = np.array(((0.0, 0.0), (leg.length_m, 0.0)))
        assert (leg.obstacles.distance_m(ends) >= 1.6).all()


def test_a_small_field_is_flown_and_nothing_is_touched() -> None:
    field = scene((5.0, 0.1), (7.0, -1.8), (8.5, 1.2))
    outcome = Flight(field, vehicles()["ardupilot"], 1).fly()
    assert outcome.end == "arrived"
    assert outcome.clearance_min_m > 0.0
    assert outcome.certified_min_m > 0.0
    assert outcome.false_cells == 0
    assert outcome.losses > 0
    assert outcome.losses_unsafe == 0
    assert outcome.speed_mps(field.length_m) > 1.0


def test_a_wish_for_clearance_is_kept_where_there_is_room() -> None:
    field = scene((6.0, 0.1))
    near, far = (Flight(field, Vehicle(), 1, wish_m=wish_m).fly() for wish_m in (0.0, 1.5))
    assert near.end == far.end == "arrived"
    assert near.clearance_min_m < 1.0
    assert far.clearance_min_m >= 1.5


def test_a_flight_of_one_seed_is_always_the_same() -> None:
    field = scene((5.0, 0.1), (7.0, -1.8))
    first, second = (Flight(field, Vehicle(), 1).fly(3.0).track for _ in range(2))
    assert first == second


@pytest.mark.parametrize(("error_m", "end"), [(0.35, ""), (0.70, "collision")])
def test_a_collision_is_found_out(error_m: float, end: str) -> None:
    flight = Flight(scene((5.0, 0.0)), Vehicle(tracking_error_m=error_m), 1)
    flight._horizon = Horizon.at_rest(0.0, 3.9, 0.0)
    assert flight._period(0.0) == end


def test_the_service_flies_the_same_field_wherever_the_leg_heads() -> None:
    obstacles = Obstacles(
        np.array(((5.0, 1.0), (9.0, -2.0))), np.array(((1.0, 0.4), (0.0, 0.0))),
        np.array((0.3, 0.0)), np.array((0.0, 0.2)),
    )  # fmt: skip
    heading_rad = 0.8
    field = field_of(obstacles, heading_rad)
    again = Obstacles(field.center_ned_m, field.half_size_m, field.yaw_rad, np.zeros(2))
    points = np.array(((4.0, 4.0), (7.0, 0.0), (9.0, -5.0)))
    back = again.along_leg(np.zeros(2), heading_rad)
    assert back.distance_m(points) == pytest.approx(obstacles.distance_m(points))
    assert field.center_ned_m[0] == pytest.approx(
        (5.0 * math.cos(0.8) - math.sin(0.8), 5.0 * math.sin(0.8) + math.cos(0.8))
    )


def test_a_small_field_is_flown_by_the_whole_service() -> None:
    served = fly_by_service(scene((5.0, 0.1), (8.0, -1.8)), 1)
    assert served.arrived
    assert served.result.clearance_min_m is not None
    assert 0.0 < served.result.clearance_min_m < 1.5
    assert 5.0 < served.first_look_s < 20.0
    assert served.speed_mps > 1.0
