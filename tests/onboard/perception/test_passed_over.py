"""Which remembered obstacles are in the way of a flight at one height."""

from __future__ import annotations

import math

import pytest

from onboard.geometry.frames import LegFrame
from onboard.perception.detection import ANY_HEIGHT, Corners, DownRange
from onboard.perception.obstacle_map import ObstacleMap
from tests.onboard.perception.messages import square
from tests.onboard.perception.test_obstacle_map import region_around

HIGH_LEG = LegFrame((0.0, 0.0, -5.0), 0.0)
HALF_M = 1.2
LOW: DownRange = (-1.8, math.inf)
TALL: DownRange = (-4.0, math.inf)


@pytest.fixture
def known() -> ObstacleMap:
    return ObstacleMap(HIGH_LEG, region_around, 0.0, HALF_M)


def wide(north_m: float) -> Corners:
    return [(north_m, -8.0), (north_m + 0.5, -8.0), (north_m + 0.5, 8.0), (north_m, 8.0)]


def add(known: ObstacleMap, filled_m: DownRange, corners: Corners | None = None) -> bool:
    return known.add("hedge", corners or wide(20.0), 0.05, filled_m=filled_m)


def is_in_way(known: ObstacleMap) -> bool:
    found = known.of_track("hedge") is not None
    assert (len(known) == 1) is found
    assert bool(list(known.between(-math.inf, math.inf))) is found
    assert bool(list(known.boxes_between(-100.0, 100.0))) is found
    assert bool(list(known.each_new(()))) is found
    assert (known.obstacle_of_interest(0.0, 0.0, horizon_m=50.0) is not None) is found
    return found


def test_what_is_lower_than_the_flight_is_remembered_and_in_no_way(known: ObstacleMap) -> None:
    assert add(known, LOW)
    assert not is_in_way(known)
    assert known.remembers("hedge")
    (passed_over,) = known.out_of_way(0.0, 30.0)
    assert passed_over.filled_m == LOW
    assert not list(known.out_of_way(60.0, 80.0))


@pytest.mark.parametrize(
    ("filled_m", "in_way"),
    [
        (ANY_HEIGHT, True),
        (TALL, True),
        ((-9.0, -6.3), False),
        ((-9.0, -6.2), True),
        ((-math.inf, -6.5), False),
    ],
    ids=["unknown", "tall", "ceiling", "low ceiling", "open ceiling"],
)
def test_what_reaches_into_the_band_is_in_the_way(
    known: ObstacleMap, filled_m: DownRange, *, in_way: bool
) -> None:
    add(known, filled_m)
    assert is_in_way(known) is in_way


def test_without_a_band_every_obstacle_is_a_pillar() -> None:
    known = ObstacleMap(HIGH_LEG, region_around, 0.0)
    add(known, LOW)
    assert is_in_way(known)


def test_what_turns_out_taller_comes_into_the_way(known: ObstacleMap) -> None:
    add(known, LOW)
    revision = known.revision
    assert add(known, TALL)
    assert known.revision == revision + 1
    assert is_in_way(known)
    add(known, LOW)  # never back: which measurement is right is not known
    assert is_in_way(known)


def test_what_turns_out_taller_is_new_then(known: ObstacleMap) -> None:
    """Also behind one that came into the way before: its first sight in the way has to count."""
    add(known, LOW)
    known.add("post", square((60.0, 0.0)), 0.05)
    assert [each.id for each in known.each_new(())] == ["post"]
    add(known, TALL)
    assert [each.id for each in known.each_new({"post"})] == ["hedge"]


def test_on_a_lower_leg_it_is_in_the_way(known: ObstacleMap) -> None:
    add(known, LOW)
    known.rebuild(LegFrame((0.0, 0.0, -2.5), 0.3), region_around, 0.0)
    assert is_in_way(known)
    known.rebuild(HIGH_LEG, region_around, 0.0)
    assert not is_in_way(known)


def test_under_a_contract_with_larger_errors_it_is_in_the_way(known: ObstacleMap) -> None:
    add(known, LOW)
    known.rebuild(HIGH_LEG, region_around, 0.0, 3.5)
    assert is_in_way(known)


def test_it_moves_with_the_estimate(known: ObstacleMap) -> None:
    add(known, LOW)
    known.shift(0.0, 0.0, -2.5)
    assert is_in_way(known)


def test_a_top_out_of_view_is_where_it_was_measured_before(known: ObstacleMap) -> None:
    """While the vehicle brakes its nose is up: only what was known before counts."""
    add(known, LOW)
    assert not add(known, ANY_HEIGHT)
    assert not is_in_way(known)
    assert known.is_passed_over("hedge", wide(20.0), 0.05, ANY_HEIGHT)


@pytest.mark.parametrize("corners", [wide(21.0), square((30.0, 0.0))], ids=["deeper", "swapped"])
def test_a_top_out_of_view_of_what_was_not_measured_is_unknown(
    known: ObstacleMap, corners: Corners
) -> None:
    """As where a tracker gives the name of a hedge to a tree."""
    add(known, LOW)
    assert not known.is_passed_over("hedge", corners, 0.05, ANY_HEIGHT)
    add(known, ANY_HEIGHT, corners)
    assert is_in_way(known)


def test_one_measurement_that_says_low_does_not_contradict_the_map(known: ObstacleMap) -> None:
    assert known.is_passed_over("new", wide(20.0), 0.05, LOW)
    assert not known.is_passed_over("new", wide(20.0), 0.05, TALL)
    add(known, TALL)
    assert not known.is_passed_over("hedge", wide(20.0), 0.05, LOW)


def test_what_is_out_of_the_way_is_merged_with_nothing() -> None:
    known = ObstacleMap(HIGH_LEG, region_around, 10.0, HALF_M)
    known.add("post", square((20.0, 0.0)), 0.05)
    known.add("car", square((21.0, 0.5)), 0.05, filled_m=LOW)
    (post,) = known
    assert post.members == ("post",)
