"""Legs through fields."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.benchmark.formats import BoxScene, Way
from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.scenes import (
    blocked_legs,
    drawn_walls,
    forest_legs,
    pillar_legs,
    random_forest,
)
from gcs_tools.console.errors import CommandError


def boxes(*centres: tuple[float, float]) -> BoxScene:
    count = len(centres)
    half = np.full((count, 2), 1.0)
    return BoxScene(3, Obstacles(np.array(centres), half, np.zeros(count), np.zeros(count)), 1.1)


def test_a_field_is_passable_where_the_margin_leaves_a_gap() -> None:
    door = drawn_walls("door:1.8")
    assert door.passable(0.75)
    assert not door.passable(0.95)


def test_legs_of_a_forest_have_clear_ends() -> None:
    stems = np.random.default_rng(4).uniform(0.0, 110.0, (80, 2))
    forest = Obstacles.stems(stems, np.full(80, 0.125))
    legs = list(forest_legs("pines", forest, 60.0, 3, 1))
    assert [leg.name for leg in legs] == ["leg 0", "leg 1", "leg 2"]
    for leg in legs:
        ends = np.array(((0.0, 0.0), (leg.length_m, 0.0)))
        assert (leg.obstacles.distance_m(ends) >= 1.6).all()


@pytest.mark.parametrize(("side_m", "found"), [(30.0, 0), (0.0, 0)])
def test_a_forest_without_room_is_refused(side_m: float, found: int) -> None:
    stems = np.array(((0.0, 0.0), (side_m, side_m)))
    forest = Obstacles.stems(stems, np.full(2, 0.1))
    with pytest.raises(CommandError, match=f"pines: has room for {found} of 2 legs of 60 m"):
        list(forest_legs("pines", forest, 60.0, 2, 1))


def test_a_density_is_that_of_its_stems() -> None:
    forest = random_forest(500.0, 1)
    assert len(forest.radius_m) == pytest.approx(720, rel=0.1)
    assert (random_forest(500.0, 1).centre_m == forest.centre_m).all()
    assert len(random_forest(500.0, 2).radius_m) != len(forest.radius_m)


def test_only_legs_that_a_scene_blocks_are_flown() -> None:
    blocked, beside, short = Way((0.0, 0.0), (30.0, 0.0)), Way((0.0, 9.0), (30.0, 9.0)), Way(
        (13.0, 0.0), (30.0, 0.0)
    )  # fmt: skip
    legs = list(blocked_legs("two", [boxes((15.0, 0.5))], [beside, short, blocked], 9))
    (leg,) = legs
    assert (leg.name, leg.length_m, leg.peer_distance_m) == ("scene 3 way 2", 30.0, 1.1)
    assert leg.obstacles.centre_m.tolist() == [[15.0, 0.5]]
    assert list(blocked_legs("two", [boxes((15.0, 0.5))], [blocked], 0)) == []


def test_a_box_to_the_east_of_a_leg_north_is_to_its_right() -> None:
    (leg,) = blocked_legs("two", [boxes((15.0, 0.5))], [Way((0.0, 0.0), (30.0, 0.0))], 1)
    assert leg.obstacles.centre_m[0, 1] == 0.5
    back = Way((30.0, 0.0), (0.0, 0.0))
    (leg,) = blocked_legs("two", [boxes((15.0, 0.5))], [back], 1)
    assert leg.obstacles.centre_m[0].tolist() == pytest.approx([15.0, -0.5])


@pytest.mark.parametrize(("x_m", "what"), [(0.5, "start at 0"), (20.0, "end at 20")])
def test_an_end_that_is_not_clear_is_refused(x_m: float, what: str) -> None:
    pillars = Obstacles.stems(np.array(((x_m, 0.0),)), np.array((1.0,)))
    with pytest.raises(CommandError, match=f"sando: the leg's {what}"):
        list(pillar_legs("sando", pillars, 20.0, 1, 9.0))


@pytest.mark.parametrize("name", ["slalom", "slalom-tight", "s:2.4", "door:2", "trap"])
def test_walls_leave_the_ends_of_their_leg_free(name: str) -> None:
    scene = drawn_walls(name)
    ends = np.array(((0.0, 0.0), (scene.length_m, 0.0)))
    assert scene.obstacles.distance_m(ends).min() > 2.0
    assert not math.isinf(scene.obstacles.distance_m(ends).max())


@pytest.mark.parametrize("name", ["door", "door:", "door:wide", "door:nan", "trap:2", "s:99", ""])
def test_walls_that_do_not_exist_are_refused(name: str) -> None:
    with pytest.raises(CommandError, match="walls: "):
        drawn_walls(name)
