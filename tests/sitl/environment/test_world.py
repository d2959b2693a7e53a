from __future__ import annotations

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.environment.world import Neighbourhood, World

coordinates = st.floats(-50.0, 50.0)
points = st.tuples(coordinates, coordinates)
sizes = st.floats(0.1, 8.0)


@st.composite
def fields(draw: st.DrawFn) -> ObstacleField:
    count = draw(st.integers(1, 12))
    return ObstacleField.of(
        [
            Obstacle(
                id=str(number),
                center_ned_m=draw(points),
                size_m=(draw(sizes), draw(sizes)),
                yaw_deg=draw(st.floats(-180.0, 180.0)),
            )
            for number in range(count)
        ]
    )


def distance_by_sampling_m(field: ObstacleField, index: int, point: tuple[float, float]) -> float:
    """Distance to a box's outline, by walking along it; negative inside, by the crossing rule."""
    yaw_rad = field.yaw_rad[index]
    axes = np.array(
        [[math.cos(yaw_rad), math.sin(yaw_rad)], [-math.sin(yaw_rad), math.cos(yaw_rad)]]
    )
    corners = [
        field.center_ned_m[index] + (np.array(sign) * field.half_size_m[index]) @ axes
        for sign in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    nearest_m, inside = math.inf, True
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        outline = start + share * (end - start)
        nearest_m = min(nearest_m, float(np.linalg.norm(outline - point, axis=1).min()))
        edge, offset = end - start, np.array(point) - start
        inside &= bool(edge[0] * offset[1] - edge[1] * offset[0] > 0.0)
    return -nearest_m if inside else nearest_m


@given(fields(), points)
@settings(max_examples=60, deadline=None)
def test_clearance_agrees_with_walking_along_every_box(
    field: ObstacleField, point: tuple[float, float]
) -> None:
    expected_m = min(distance_by_sampling_m(field, i, point) for i in range(len(field))) - 0.3
    assert World(field, 0.3).clearance_at_m(point) == pytest.approx(expected_m, abs=5e-3)


def forest(count: int, seed: int) -> ObstacleField:
    chance = np.random.default_rng(seed)
    side_m = 3.0 * math.sqrt(count)
    return ObstacleField(
        ids=tuple(map(str, range(count))),
        center_ned_m=chance.uniform(-side_m, side_m, (count, 2)),
        half_size_m=chance.uniform(0.1, 1.0, (count, 2)),
        yaw_rad=chance.uniform(-3.0, 3.0, count),
    )


def test_clearance_along_a_path_equals_a_fresh_search_each_time() -> None:
    field = forest(2000, seed=3)
    travelling = World(field, 0.3)
    chance = random.Random(4)
    north_m = east_m = 0.0
    for _ in range(300):
        north_m += chance.uniform(-2.0, 3.0)
        east_m += chance.uniform(-2.0, 2.5)
        travelling.observe((north_m, east_m, -4.0))
        fresh = World(field, 0.3)
        assert travelling.clearance_m == fresh.clearance_at_m((north_m, east_m))


def test_neighbourhood_never_misses_what_is_within_reach() -> None:
    field = forest(2000, seed=5)
    neighbourhood = Neighbourhood(field)
    for step in range(200):
        point = (0.4 * step, 0.1 * step)
        near = set(neighbourhood.within(point, 12.0).tolist())
        distances_m = [World(_only(field, index), 0.0).clearance_at_m(point) for index in near]
        assert len(near) < 200
        assert min(distances_m) <= 12.0
        everything = np.flatnonzero(
            np.linalg.norm(field.center_ned_m - point, axis=1)
            - np.linalg.norm(field.half_size_m, axis=1)
            <= 12.0
        )
        within = {
            i
            for i in everything.tolist()
            if World(_only(field, i), 0.0).clearance_at_m(point) <= 12
        }
        assert within <= near


def _only(field: ObstacleField, index: int) -> ObstacleField:
    return ObstacleField(
        (field.ids[index],),
        field.center_ned_m[[index]],
        field.half_size_m[[index]],
        field.yaw_rad[[index]],
    )


def test_a_hundred_thousand_obstacles_are_searched_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(forest(100_000, seed=6), 0.3)
    searches: list[tuple[object, ...]] = []
    search = Neighbourhood._search

    def counted(self: Neighbourhood, point: tuple[float, float], reach_m: float | None) -> None:
        searches.append(point)
        search(self, point, reach_m)

    monkeypatch.setattr(Neighbourhood, "_search", counted)
    for tick in range(1000):
        world.observe((0.028 * tick, 0.0, -4.0))
    assert 5 <= len(searches) <= 7  # 28 m in margins of 5 m


def box(north_m: float) -> Obstacle:
    return Obstacle(id=str(north_m), center_ned_m=(north_m, 0.0), size_m=(2.0, 2.0))


def test_every_contact_counts_once() -> None:
    world = World(ObstacleField.of([box(5.0), box(15.0)]), 0.5)
    for tenth in range(200):
        world.observe((tenth / 10.0, 0.0, -4.0))
    assert world.collisions == 2
    assert world.clearance_min_m == pytest.approx(-1.5)  # deepest: the centre, less the radius
    world.observe((3.4, 0.0, -4.0))
    assert world.clearance_m == pytest.approx(0.1)


@given(st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)), min_size=1, max_size=60))
def test_looking_only_where_it_matters_finds_what_looking_always_finds(
    steps_m: list[tuple[float, float]],
) -> None:
    world = World(ObstacleField.of([box(1.5), box(-3.0)]), 0.5)
    here_ned_m = (0.0, 0.0)
    world.observe((*here_ned_m, -4.0))
    clearances_m = [world.clearance_at_m(here_ned_m)]
    for north_m, east_m in steps_m:
        half_way_ned_m = (here_ned_m[0] + 0.5 * north_m, here_ned_m[1] + 0.5 * east_m)
        here_ned_m = (here_ned_m[0] + north_m, here_ned_m[1] + east_m)
        world.observe((*here_ned_m, -4.0))
        clearances_m += map(world.clearance_at_m, (half_way_ned_m, here_ned_m))
        assert world.clearance_m == clearances_m[-1]
        assert (world.clearance_m < 0.0) is (clearances_m[-1] < 0.0)
    assert world.clearance_min_m == min(clearances_m)
    inside = [clearance_m < 0.0 for clearance_m in clearances_m]
    entries = sum(now and not before for before, now in pairwise([False, *inside]))
    assert world.collisions == entries


def test_open_space_has_unlimited_clearance() -> None:
    world = World(ObstacleField.of([]), 0.3)
    world.observe((1.0, 2.0, -3.0))
    assert world.clearance_m == math.inf
    assert world.collisions == 0
