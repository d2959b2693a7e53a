import math
import random
from dataclasses import astuple
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from onboard.perception import obstacle_map as obstacle_map_module
from onboard.perception.detection import DownRange
from onboard.perception.obstacle_map import Obstacle, ObstacleMap
from tests.onboard.contract.ideal_encounter import ideal_encounter
from tests.onboard.perception.messages import square

NORTH_LEG = LegFrame((0.0, 0.0, -4.0), 0.0)
LIMITS = AccelerationLimits(*[GRAVITY_MPS2 * math.tan(math.radians(15.0))] * 4)


def region_around(box: Box, position_error_m: float) -> RegionOfInfluence:
    inflated = box.inflated(position_error_m)
    return RegionOfInfluence.around(inflated, ideal_encounter(LIMITS, 2.8, inflated.size_m))


@pytest.fixture
def obstacle_map() -> ObstacleMap:
    return ObstacleMap(NORTH_LEG, region_around, merged_size_max_m=0.0)


FAR_M, ALLOWED_M, NEAR_M = 3.0, 0.7, 0.4


def bounds_m(known: ObstacleMap) -> tuple[float, ...]:
    (obstacle,) = known
    return (*astuple(obstacle.measured), obstacle.position_error_m)


def test_what_was_seen_in_full_within_the_error_replaces_what_was_seen_from_afar(
    obstacle_map: ObstacleMap,
) -> None:
    add = partial(obstacle_map.add, error_max_m=ALLOWED_M)
    add("a", square((20.0, 2.5)), FAR_M, in_full=True)
    # Seen in part: what was not seen is not free.
    add("a", square((20.0, 0.0), 0.2), NEAR_M, in_full=False)
    assert bounds_m(obstacle_map) == pytest.approx((19.5, 20.5, -0.1, 3.0, FAR_M))
    assert add("a", square((20.0, 0.0)), NEAR_M, in_full=True)
    assert bounds_m(obstacle_map) == pytest.approx((19.5, 20.5, -0.5, 0.5, NEAR_M))
    # From afar again, it says nothing new; beyond both errors it does.
    assert not add("a", square((21.0, 3.0)), FAR_M, in_full=True)
    assert add("a", square((20.0, 4.0)), FAR_M, in_full=True)
    assert bounds_m(obstacle_map) == pytest.approx((19.5, 20.5, -0.5, 4.5, FAR_M))


def test_within_the_error_a_box_only_ever_grows(obstacle_map: ObstacleMap) -> None:
    for east_m in (0.0, 0.3, -0.2):
        obstacle_map.add("a", square((20.0, east_m)), NEAR_M, error_max_m=ALLOWED_M, in_full=True)
    assert bounds_m(obstacle_map) == pytest.approx((19.5, 20.5, -0.7, 0.8, NEAR_M))


def test_obstacle_is_remembered_and_only_grows(obstacle_map: ObstacleMap) -> None:
    assert obstacle_map.add("a", square((10.0, 0.0)), 0.05)
    assert not obstacle_map.add("a", square((10.0, 0.0), side_m=0.8), 0.05)
    assert obstacle_map.add("a", square((10.2, 0.0)), 0.05)
    known = obstacle_map.of_track("a")
    assert known is not None
    assert known.measured == Box(9.5, 10.7, -0.5, 0.5)


def test_a_face_farther_out_by_no_more_than_both_errors_confirms_the_earlier_one(
    obstacle_map: ObstacleMap,
) -> None:
    def known() -> Obstacle:
        found = obstacle_map.of_track("a")
        assert found is not None
        return found

    obstacle_map.add("a", square((10.0, 0.0)), 0.05)
    earlier = known()
    obstacle_map.add("a", square((10.0, 0.12)), 0.08)
    assert known().confirms(earlier, 0.0)
    obstacle_map.add("a", square((10.0, 0.14)), 0.08)
    assert not known().confirms(earlier, 0.0)
    assert known().confirms(earlier, 0.07)  # the contract's error where a sensor claims less
    obstacle_map.add("b", square((10.0, 0.0)), 0.05)
    other = obstacle_map.of_track("b")
    assert other is not None
    assert not other.confirms(earlier, 1.0)


def test_obstacle_of_interest_is_met_within_the_horizon(obstacle_map: ObstacleMap) -> None:
    obstacle_map.add("beside", square((10.0, 5.0)), 0.0)
    obstacle_map.add("ahead", square((12.0, 0.0)), 0.0)
    obstacle_map.add("behind it", square((20.0, 0.0)), 0.0)
    ahead = obstacle_map.of_track("ahead")
    assert ahead is not None
    front_m = ahead.region.approach_x_m
    assert obstacle_map.obstacle_of_interest(front_m - 0.2, 0.0, horizon_m=0.1) is None
    found = obstacle_map.obstacle_of_interest(front_m - 0.2, 0.0, horizon_m=0.3)
    assert found is ahead
    assert obstacle_map.obstacle_of_interest(front_m, 2.0, horizon_m=0.3) is None


@given(
    st.lists(
        st.tuples(st.floats(-50, 50), st.floats(-20, 20), st.floats(0.1, 6.0)),
        min_size=1,
        max_size=40,
    ),
    st.floats(-60, 60),
    st.floats(0, 30),
)
def test_search_agrees_with_looking_at_every_obstacle(
    squares: list[tuple[float, float, float]], x_m: float, length_m: float
) -> None:
    obstacle_map = ObstacleMap(NORTH_LEG, region_around, merged_size_max_m=0.0)
    for number, (north_m, east_m, side_m) in enumerate(squares):
        obstacle_map.add(str(number), square((north_m, east_m), side_m), 0.0)

    def reaches(obstacle: Obstacle) -> bool:
        region = obstacle.region
        return region.approach_x_m <= x_m + length_m and region.departure_x_m >= x_m

    found = {obstacle.id for obstacle in obstacle_map.between(x_m, x_m + length_m)}
    assert found == {obstacle.id for obstacle in obstacle_map if reaches(obstacle)}
    for y_m in (-3.0, 0.0, 0.4, 7.25):
        met = [o for o in obstacle_map if reaches(o) and o.region.on_collision_course(x_m, y_m)]
        nearest = min(met, key=lambda o: o.region.keep_out.x_min_m, default=None)
        of_interest = obstacle_map.obstacle_of_interest(x_m, y_m, horizon_m=length_m)
        assert (of_interest is None) == (nearest is None)
        if of_interest is not None and nearest is not None:
            assert of_interest.region.keep_out.x_min_m == nearest.region.keep_out.x_min_m


def test_conflict_is_seen_from_both_sides(obstacle_map: ObstacleMap) -> None:
    for name, north_m in (("a", 10.0), ("b", 12.0), ("far", 60.0)):
        obstacle_map.add(name, square((north_m, 0.0)), 0.0)
    conflicts = {o.id: [c.id for c in obstacle_map.conflicts(o)] for o in obstacle_map}
    assert conflicts == {"a": ["b"], "b": ["a"], "far": []}


def test_new_leg_sees_what_was_remembered(obstacle_map: ObstacleMap) -> None:
    obstacle_map.add("a", square((10.0, 3.0)), 0.05)
    obstacle_map.rebuild(LegFrame((10.0, 0.0, -4.0), math.pi / 2), region_around, 0.0)
    known = obstacle_map.of_track("a")
    assert known is not None
    box = known.measured
    assert (box.x_min_m, box.x_max_m) == pytest.approx((2.5, 3.5))
    assert (box.y_min_m, box.y_max_m) == pytest.approx((-0.5, 0.5))
    assert obstacle_map.obstacle_of_interest(0.0, 0.0, horizon_m=5.0) is known


def test_boxes_of_tracks_are_not_those_of_what_they_merge_into() -> None:
    known = merging_map(6.0)
    known.add("front/1", square((20.0, 0.0), side_m=1.0), 0.1)
    known.add("front/2", square((22.0, 0.5), side_m=1.0), 0.1)
    known.add("front/3", square((90.0, 0.0), side_m=1.0), 0.1)
    assert len(known) == 2
    boxes = sorted(known.boxes_between(0.0, 40.0), key=lambda box: box.x_min_m)
    assert boxes == [Box(19.5, 20.5, -0.5, 0.5), Box(21.5, 22.5, 0.0, 1.0)]


def merging_map(merged_size_max_m: float) -> ObstacleMap:
    return ObstacleMap(NORTH_LEG, region_around, merged_size_max_m)


def test_obstacles_whose_regions_intersect_become_one() -> None:
    obstacle_map = merging_map(merged_size_max_m=4.0)
    obstacle_map.add("a", square((10.0, 0.0)), 0.02)
    obstacle_map.add("b", square((12.0, 1.0)), 0.05)
    (merged,) = obstacle_map
    assert merged.members == ("a", "b")
    assert merged.measured == Box(9.5, 12.5, -0.5, 1.5)
    assert merged.position_error_m == 0.05
    assert obstacle_map.of_track("a") is obstacle_map.of_track("b") is merged


def test_several_obstacles_are_those_of_which_two_were_seen_as_a_whole() -> None:
    obstacle_map = merging_map(merged_size_max_m=4.0)
    for name, is_part, several in (("a", True, False), ("b", False, False), ("c", True, False)):
        obstacle_map.add(name, square((10.0, 0.0)), 0.0, partial=is_part)
        obstacle_map.shift(0.0, 0.0, 0.0)  # it is rebuilt
        (merged,) = obstacle_map
        assert obstacle_map.is_several(merged) is several
    # A later measurement says it, although the box is known.
    assert not obstacle_map.add("c", square((10.0, 0.0)), 0.0)
    (merged,) = obstacle_map
    assert obstacle_map.is_several(merged)


def test_each_new_obstacle_is_told_by_itself_up_to_one_that_is_known() -> None:
    known = ObstacleMap(NORTH_LEG, region_around, merged_size_max_m=4.0)
    for name, north_m in (("a", 20.0), ("b", 21.5), ("c", 60.0)):
        known.add(name, square((north_m, 0.0)), 0.1)
    known.add("a", square((20.0, 0.1)), 0.1)  # grows, but is no newer
    assert len(known) == 2
    assert [each.members for each in known.each_new(())] == [("c",), ("b",), ("a",)]
    (b, c) = reversed(list(known.each_new({"a"})))
    assert (b.id, c.id) == ("b", "c")
    assert b.region == region_around(b.measured, 0.1)
    assert list(known.each_new({"a", "b", "c"})) == []


def test_what_does_not_fit_stays_apart_and_in_conflict() -> None:
    obstacle_map = merging_map(merged_size_max_m=2.9)
    obstacle_map.add("a", square((10.0, 0.0)), 0.0)
    obstacle_map.add("b", square((12.0, 0.0)), 0.0)
    assert [len(list(obstacle_map.conflicts(o))) for o in obstacle_map] == [1, 1]


def test_growth_can_bring_obstacles_together() -> None:
    obstacle_map = merging_map(merged_size_max_m=30.0)
    obstacle_map.add("a", square((10.0, 0.0)), 0.0)
    obstacle_map.add("b", square((25.0, 0.0)), 0.0)
    assert len(obstacle_map) == 2
    obstacle_map.add("b", square((12.0, 0.0)), 0.0)
    (merged,) = obstacle_map
    assert merged.measured == Box(9.5, 25.5, -0.5, 0.5)


@given(
    st.lists(
        st.tuples(st.floats(0, 60), st.floats(-15, 15), st.floats(0.1, 3.0)),
        min_size=2,
        max_size=12,
    ),
    st.randoms(use_true_random=False),
)
def test_merging_leaves_no_conflict_and_loses_nothing(
    squares: list[tuple[float, float, float]], shuffler: random.Random
) -> None:
    shuffler.shuffle(squares)
    obstacle_map = merging_map(merged_size_max_m=1e6)
    for number, (north_m, east_m, side_m) in enumerate(squares):
        obstacle_map.add(str(number), square((north_m, east_m), side_m), 0.0)
    assert not [o for o in obstacle_map if any(obstacle_map.conflicts(o))]
    for number, (north_m, east_m, side_m) in enumerate(squares):
        owner = obstacle_map.of_track(str(number))
        assert owner is not None
        alone = Box(
            north_m - side_m / 2, north_m + side_m / 2, east_m - side_m / 2, east_m + side_m / 2
        )
        merged = owner.measured.inflated(1e-9)
        assert merged.enclosing(alone) == merged


@given(
    st.floats(-math.pi, math.pi),
    st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    st.lists(st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0)), min_size=1, max_size=6),
)
def test_shifted_map_is_the_map_of_shifted_obstacles(
    heading_rad: float,
    offset_ned_m: tuple[float, float],
    centres_ned_m: list[tuple[float, float]],
) -> None:
    leg = LegFrame((1.0, 2.0, -4.0), heading_rad)
    shifted = ObstacleMap(leg, region_around, merged_size_max_m=0.0)
    expected = ObstacleMap(leg, region_around, merged_size_max_m=0.0)
    for index, (north_m, east_m) in enumerate(centres_ned_m):
        shifted.add(str(index), square((north_m, east_m)), 0.05)
        moved_ned_m = (north_m + offset_ned_m[0], east_m + offset_ned_m[1])
        expected.add(str(index), square(moved_ned_m), 0.05)
    revision = shifted.revision
    shifted.shift(*offset_ned_m, 0.0)
    assert shifted.revision > revision
    for index in range(len(centres_ned_m)):
        one, other = shifted.of_track(str(index)), expected.of_track(str(index))
        assert one is not None
        assert other is not None
        assert astuple(one.measured) == pytest.approx(astuple(other.measured))
        assert astuple(one.region.extent) == pytest.approx(astuple(other.region.extent))


# ------------------------------------------------------------------ heights


def heights_m(known: ObstacleMap, track_id: str = "a") -> DownRange | None:
    obstacle = known.of_track(track_id)
    assert obstacle is not None
    return obstacle.down_m


def test_an_obstacle_reaches_as_high_and_as_low_as_any_measurement_of_it(
    obstacle_map: ObstacleMap,
) -> None:
    assert obstacle_map.add("a", square((10.0, 0.0)), 0.05, down_m=(-3.0, -1.0))
    assert heights_m(obstacle_map) == (-3.0, -1.0)
    revision = obstacle_map.revision
    assert obstacle_map.add("a", square((10.0, 0.0)), 0.05, down_m=(-2.0, 0.0))
    assert heights_m(obstacle_map) == (-3.0, 0.0)
    assert obstacle_map.revision == revision + 1
    assert not obstacle_map.add("a", square((10.0, 0.0)), 0.05, down_m=(-2.5, -0.5))
    assert obstacle_map.revision == revision + 1


@pytest.mark.parametrize("unknown_first", [True, False])
def test_a_measurement_without_height_is_of_any_height_for_good(
    obstacle_map: ObstacleMap, *, unknown_first: bool
) -> None:
    for down_m in (None, (-3.0, 0.0)) if unknown_first else ((-3.0, 0.0), None):
        obstacle_map.add("a", square((10.0, 0.0)), 0.05, down_m=down_m)
    assert heights_m(obstacle_map) is None
    obstacle_map.add("a", square((10.5, 0.0)), 0.05, down_m=(-3.0, 0.0))
    assert heights_m(obstacle_map) is None


def test_height_counts_even_where_the_box_says_nothing_new(obstacle_map: ObstacleMap) -> None:
    add = partial(obstacle_map.add, error_max_m=ALLOWED_M, in_full=True)
    add("a", square((20.0, 0.0)), NEAR_M, down_m=(-3.0, -1.0))
    assert add("a", square((21.0, 0.5)), FAR_M, down_m=(-8.0, -1.0))
    assert heights_m(obstacle_map) == (-8.0, -1.0)
    assert bounds_m(obstacle_map) == pytest.approx((19.5, 20.5, -0.5, 0.5, NEAR_M))


def test_a_box_that_replaces_one_from_afar_keeps_its_heights(obstacle_map: ObstacleMap) -> None:
    add = partial(obstacle_map.add, error_max_m=ALLOWED_M, in_full=True)
    add("a", square((20.0, 2.5)), FAR_M, down_m=(-8.0, -1.0))
    add("a", square((20.0, 0.0)), NEAR_M, down_m=(-3.0, 0.0))
    assert bounds_m(obstacle_map)[-1] == NEAR_M
    assert heights_m(obstacle_map) == (-8.0, 0.0)


@pytest.mark.parametrize(
    ("other_m", "merged_m"),
    [((-2.0, 0.5), (-3.0, 0.5)), (None, None), ((-3.0, -1.0), (-3.0, -1.0))],
)
def test_a_merged_obstacle_reaches_over_its_members(
    other_m: DownRange | None, merged_m: DownRange | None
) -> None:
    known = merging_map(merged_size_max_m=4.0)
    known.add("a", square((10.0, 0.0)), 0.02, down_m=(-3.0, -1.0))
    known.add("b", square((12.0, 1.0)), 0.05, down_m=other_m)
    (merged,) = known
    assert merged.down_m == merged_m


def test_heights_survive_another_leg_and_follow_a_reset(obstacle_map: ObstacleMap) -> None:
    obstacle_map.add("a", square((10.0, 3.0)), 0.05, down_m=(-3.0, 0.0))
    obstacle_map.add("any", square((30.0, 3.0)), 0.05)
    obstacle_map.rebuild(LegFrame((10.0, 0.0, -4.0), math.pi / 2), region_around, 0.0)
    assert heights_m(obstacle_map) == (-3.0, 0.0)
    obstacle_map.shift(1.0, 2.0, -0.5)
    assert heights_m(obstacle_map) == (-3.5, -0.5)
    assert heights_m(obstacle_map, "any") is None


def test_heights_do_not_change_what_is_planned_against() -> None:
    """A pillar of any height: whether it is low enough to fly over is not asked yet."""
    plain, tall = (ObstacleMap(NORTH_LEG, region_around, merged_size_max_m=0.0) for _ in range(2))
    plain.add("a", square((10.0, 0.0)), 0.05)
    tall.add("a", square((10.0, 0.0)), 0.05, down_m=(-0.1, 0.0))
    (one,), (other,) = plain, tall
    assert one.region == other.region
    assert tall.obstacle_of_interest(0.0, 0.0, horizon_m=20.0) is other


def test_more_tracks_than_a_sensor_could_see_are_refused(
    obstacle_map: ObstacleMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(obstacle_map_module, "MAX_TRACKS", 2)
    for name in ("a", "b"):
        obstacle_map.add(name, square((10.0, 0.0)), 0.05)
    with pytest.raises(OverflowError, match="2 obstacles remembered, limit 2"):
        obstacle_map.add("c", square((10.0, 0.0)), 0.05)
    assert obstacle_map.add("a", square((11.0, 0.0)), 0.05)
