"""What one frame shows to be free, and that it never shows a place of an obstacle."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.perception import line_of_sight
from onboard.perception.line_of_sight import BOXES_MAX, View, seen_free
from tests.tools.seen_space_adversary import Adversary

CELL_M = 0.1
AHEAD = View((0.0, 0.0), 0.0, math.radians(45.0), 10.0, (), 0.1)
ALL_ROUND = replace(AHEAD, half_view_rad=math.pi)


def shows(view: View, x_m: float, y_m: float) -> bool:
    """Tell whether the view shows the cell around a point."""
    return bool(seen_free(view, np.array([x_m]), np.array([y_m]), CELL_M)[0])


def test_no_cell_that_holds_a_point_of_an_obstacle_is_seen_free_by_a_hostile_sensor() -> None:
    adversary = Adversary(seed=5)
    assert sum(adversary.false_cells() for _ in range(200)) == 0
    # It attacks frames that say something, and what it reports agrees with the truth.
    assert adversary.freed > 200 * 3000
    assert adversary.contradictions == 0


def test_range_and_view_end_where_errors_may_end_them() -> None:
    assert shows(AHEAD, 9.8, 0.0)
    assert not shows(AHEAD, 9.9, 0.0)
    assert not shows(replace(AHEAD, placing_error_m=0.3), 9.8, 0.0)
    assert not shows(replace(AHEAD, pose_error_m=0.3), 9.8, 0.0)
    assert not shows(replace(AHEAD, heading_error_rad=0.05), 9.8, 0.0)
    assert shows(AHEAD, 5.0, 4.8)
    assert not shows(AHEAD, 5.0, 4.95)
    assert not shows(AHEAD, -5.0, 0.0)
    assert not shows(replace(AHEAD, placing_error_m=0.3), 5.0, 4.8)
    assert not shows(replace(AHEAD, pose_error_m=0.2), 5.0, 4.8)
    assert not shows(replace(AHEAD, heading_error_rad=0.05), 5.0, 4.8)


def test_behind_a_box_and_beside_it_within_the_error_nothing_is_free() -> None:
    view = replace(AHEAD, boxes=(Box(4.0, 5.0, -0.5, 0.5),))
    assert shows(view, 3.8, 0.0)
    assert not shows(view, 3.88, 0.0)  # within the face's error
    assert not shows(view, 8.0, 0.9)  # in its shadow
    assert shows(view, 8.0, 1.6)
    assert shows(view, 4.5, 0.9)
    assert not shows(replace(view, pose_error_m=0.3), 4.5, 0.9)
    assert not shows(replace(view, heading_error_rad=0.1), 4.5, 0.9)


def test_a_view_all_round_has_no_edge_behind() -> None:
    assert shows(ALL_ROUND, -5.0, 0.0)
    astride = replace(ALL_ROUND, boxes=(Box(-5.0, -4.0, -0.5, 0.5),))
    for y_m in (-0.4, -0.05, 0.0, 0.05, 0.4):
        assert not shows(astride, -8.0, y_m)
        assert shows(astride, -3.5, y_m)
    assert shows(astride, -8.0, 2.0)


@pytest.mark.parametrize("view_deg", [350.0, 356.0, 359.9])
def test_a_box_astride_the_gap_of_a_wide_view_shades_both_sides(view_deg: float) -> None:
    half_rad = math.radians(view_deg) / 2.0
    astride = replace(ALL_ROUND, half_view_rad=half_rad, boxes=(Box(-3.0, -2.0, -1.0, 1.0),))
    for y_m in (-2.5, -1.0, -0.3, 0.0, 0.3, 1.0, 2.5):
        assert not shows(astride, -8.0, y_m)
    assert not shows(replace(astride, boxes=()), -8.0, 0.0)  # the gap itself


@pytest.mark.parametrize("place_m", [(0.0, 0.0), (0.55, 0.0), (0.59, 0.59)])
def test_from_within_a_box_or_its_error_nothing_is_seen(place_m: tuple[float, float]) -> None:
    box = Box(-0.5, 0.5, -0.5, 0.5)
    inside = replace(ALL_ROUND, position_leg_m=place_m, boxes=(box,))
    for turn in np.linspace(0.0, 2.0 * math.pi, 12).tolist():
        assert not shows(inside, 4.0 * math.cos(turn), 4.0 * math.sin(turn))


def test_in_a_crowd_nothing_is_seen() -> None:
    crowd = [Box(2.0, 2.1, 2.0, 2.1)] * BOXES_MAX
    assert shows(replace(AHEAD, boxes=crowd), 5.0, 0.0)
    assert not shows(replace(AHEAD, boxes=[*crowd, *crowd]), 5.0, 0.0)
    # What is out of range is not in the crowd.
    far = [Box(20.0, 21.0, 2.0, 2.1)] * BOXES_MAX
    assert shows(replace(AHEAD, boxes=[*crowd, *far]), 5.0, 0.0)


def test_a_scan_says_free_only_as_far_as_it_reaches_and_where_it_knows() -> None:
    scan = replace(AHEAD, free_range_m=(8.0, 0.0, 4.0, 9.0), scan_half_view_rad=AHEAD.half_view_rad)
    left, beside, right = math.radians(-34.0), math.radians(-11.0), math.radians(11.0)
    for turn, free_to_m in ((left, 8.0), (beside, 0.0), (right, 4.0)):
        for distance_m in (2.0, 3.7, 4.3, 7.6, 8.3):
            x_m, y_m = distance_m * math.cos(turn), distance_m * math.sin(turn)
            assert shows(scan, x_m, y_m) == (distance_m < free_to_m - 0.2)
    # Bins divide the sensor's whole view, although the contract counts on a part only.
    narrow = replace(scan, half_view_rad=math.radians(20.0))
    assert not shows(narrow, 2.0 * math.cos(beside), 2.0 * math.sin(beside))
    assert shows(narrow, 3.5 * math.cos(right), 3.5 * math.sin(right))
    # And a box ends it, too.
    boxed = replace(scan, boxes=(Box(2.9, 3.1, 0.3, 0.9),))
    assert not shows(boxed, 3.7 * math.cos(right), 3.7 * math.sin(right))


def test_the_place_of_the_sensor_itself_is_not_seen() -> None:
    assert not shows(ALL_ROUND, 0.0, 0.0)
    assert not shows(replace(ALL_ROUND, pose_error_m=0.3), 0.3, 0.0)


# --- the limits of each error by hand, and the parts against slow ones

ERRORS: list[dict[str, Any]] = [
    {},
    {"pose_error_m": 0.2},
    {"placing_error_m": 0.3},
    {"heading_error_rad": 0.03},
    {
        "pose_error_m": 0.1,
        "placing_error_m": 0.05,
        "heading_error_rad": 0.02,
        "face_error_m": 0.2,
    },
]
# A place, and a heading, of which no part is zero.
PLACED = replace(AHEAD, position_leg_m=(3.0, -2.0), heading_leg_rad=0.7)


def radius_of(view: View, distance_m: float) -> float:
    """Radius of the disc around a cell, grown by what it may be misplaced by at its far corner."""
    far_m = distance_m + math.sqrt(0.5) * CELL_M
    grown_m = CELL_M / 2.0 + view.pose_error_m + view.heading_error_rad * far_m
    return math.sqrt(2.0) * grown_m + 1e-4


def at(view: View, bearing_rad: float, distance_m: float) -> tuple[float, float]:
    """A place at a bearing from the axis of the sensor."""
    (x_m, y_m), turn_rad = view.position_leg_m, view.heading_leg_rad + bearing_rad
    return x_m + distance_m * math.cos(turn_rad), y_m + distance_m * math.sin(turn_rad)


@pytest.mark.parametrize("errors", ERRORS)
def test_the_range_ends_by_a_disc_around_the_cell(errors: dict[str, Any]) -> None:
    view = replace(PLACED, **errors)
    to_m = view.range_m - max(view.face_error_m, view.placing_error_m)
    low_m, high_m = 0.0, to_m
    for _ in range(50):
        middle_m = (low_m + high_m) / 2.0
        inside = middle_m + radius_of(view, middle_m) <= to_m
        low_m, high_m = (middle_m, high_m) if inside else (low_m, middle_m)
    assert shows(view, *at(view, 0.1, low_m - 1e-3))
    assert not shows(view, *at(view, 0.1, low_m + 1e-3))


@pytest.mark.parametrize("errors", ERRORS)
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("distance_m", [1.5, 6.0])
def test_the_view_ends_by_a_disc_around_the_cell(
    errors: dict[str, Any], side: float, distance_m: float
) -> None:
    view = replace(PLACED, **errors)
    radius_m, astray_m = radius_of(view, distance_m), view.pose_error_m + view.placing_error_m
    nearest_m = distance_m - radius_m
    width_rad = radius_m / math.sqrt(distance_m**2 - radius_m**2)
    shy_rad = astray_m / math.sqrt((nearest_m - astray_m) * nearest_m)
    limit_rad = view.half_view_rad - view.heading_error_rad - shy_rad - width_rad
    assert shows(view, *at(view, side * (limit_rad - 1e-3), distance_m))
    assert not shows(view, *at(view, side * (limit_rad + 1e-3), distance_m))


@pytest.mark.parametrize("errors", ERRORS)
def test_what_may_be_where_the_sensor_is_has_not_been_seen(errors: dict[str, Any]) -> None:
    view = replace(PLACED, half_view_rad=math.pi, **errors)
    astray_m = view.pose_error_m + view.placing_error_m + 1e-4
    # Nearer than the square root of two radii the disc takes more than 90 degrees to each side.
    near_m = next(
        step / 1e3
        for step in range(1, 5000)
        if step / 1e3 - radius_of(view, step / 1e3) > astray_m
        and (step / 1e3) ** 2 > radius_of(view, step / 1e3) ** 2 * (1.0 + 4.0 / math.pi**2)
    )
    assert shows(view, *at(view, 2.0, near_m + 3e-3))
    assert not shows(view, *at(view, 2.0, near_m - 3e-3))


@pytest.mark.parametrize("errors", ERRORS)
def test_a_box_ends_the_line_of_sight_at_its_grown_face(errors: dict[str, Any]) -> None:
    view = replace(AHEAD, position_leg_m=(3.0, -2.0), boxes=(Box(9.0, 9.5, -3.0, -1.0),), **errors)
    to_m = 6.0 - view.face_error_m
    far_m = next(d for d in np.arange(6.0, 0.0, -1e-3) if d + radius_of(view, d) <= to_m)
    assert shows(view, *at(view, 0.0, far_m - 1e-3))
    assert not shows(view, *at(view, 0.0, far_m + 2e-3))
    # Beside the shadow: its edge is the corner of the grown face, up to two bins of half a degree.
    edge_rad = math.atan2(1.0 + view.face_error_m, to_m)
    distance_m = 8.0
    width_rad = math.asin(radius_of(view, distance_m) / distance_m)
    for side in (-1.0, 1.0):
        beside_rad = edge_rad + width_rad + math.radians(2.0)
        assert shows(view, *at(view, side * beside_rad, distance_m))
        within_rad = edge_rad + width_rad - math.radians(0.2)
        assert not shows(view, *at(view, side * within_rad, distance_m))


def test_one_box_more_than_a_crowd_may_have_hides_everything() -> None:
    crowd = [Box(2.0, 2.1, 2.0, 2.1)] * (BOXES_MAX + 1)
    assert not shows(replace(AHEAD, boxes=crowd), 5.0, 0.0)
    assert shows(replace(AHEAD, boxes=crowd[1:]), 5.0, 0.0)
    # At the very end of the range a box counts.
    last = [*crowd[1:], Box(AHEAD.range_m + AHEAD.face_error_m, 12.0, -1.0, 1.0)]
    assert not shows(replace(AHEAD, boxes=last), 5.0, 0.0)


def test_a_profile_gives_the_least_of_every_bin_of_an_interval() -> None:
    random = np.random.default_rng(2)
    for count in (7, 720):
        depth_m = random.uniform(1.0, 9.0, count)
        profile = line_of_sight._Profile(depth_m)
        from_rad = random.uniform(-math.pi, math.pi, 200)
        to_rad = from_rad + random.uniform(0.0, 3.0, 200) * random.choice((0.01, 0.2, 1.0), 200)
        for begin, end, found in zip(
            from_rad, to_rad, profile.least(from_rad, to_rad), strict=True
        ):
            bin_rad = 2.0 * math.pi / count
            first = math.floor((begin + math.pi) / bin_rad)
            last = math.floor((end + math.pi) / bin_rad)
            assert found == min(depth_m[i % count] for i in range(first, last + 1))


def test_rays_end_at_boxes_where_points_on_them_do() -> None:
    random = np.random.default_rng(3)
    low = random.uniform(-4.0, 3.0, (40, 2))
    high = low + random.uniform(0.1, 2.0, (40, 2))
    rays_rad = np.concatenate((random.uniform(-math.pi, math.pi, 30), [0.0, math.pi / 2.0]))
    found = line_of_sight._ray_distance(rays_rad, low, high)
    along_m = np.arange(0.0, 8.0, 2e-3)
    for k, turn in enumerate(rays_rad):
        points = along_m[:, None] * (math.cos(turn), math.sin(turn))
        for box in range(40):
            held = np.all((points >= low[box]) & (points <= high[box]), axis=1)
            if held.any():
                assert found[box, k] == pytest.approx(along_m[np.argmax(held)], abs=4e-3)
            elif math.isfinite(found[box, k]):
                # A ray that only grazes a corner, between two of the points.
                x_m, y_m = found[box, k] * math.cos(turn), found[box, k] * math.sin(turn)
                assert np.all((x_m, y_m) >= low[box] - 1e-6)
                assert np.all((x_m, y_m) <= high[box] + 1e-6)


@pytest.mark.parametrize(("count", "half_deg"), [(4, 45.0), (72, 60.0), (1440, 180.0), (3, 180.0)])
def test_a_bin_is_open_as_far_as_every_ray_of_the_scan_in_it(count: int, half_deg: float) -> None:
    random, half_rad = np.random.default_rng(4), math.radians(half_deg)
    ranges_m = tuple(random.choice((0.0, 0.05, 3.0, 5.0), count).tolist())
    view = replace(AHEAD, free_range_m=ranges_m, scan_half_view_rad=half_rad)
    edges_rad = np.linspace(-math.pi, math.pi, 721)
    depth_m = np.full(720, 4.0)
    line_of_sight._limit_to_scan(depth_m, edges_rad, view)
    width_rad = 2.0 * half_rad / count
    for number in range(720):
        begin, end = edges_rad[number] + 1e-6, edges_rad[number + 1] - 1e-6
        first = math.floor((begin + half_rad) / width_rad)
        last = math.floor((end + half_rad) / width_rad)
        least_m = 4.0
        for ray in range(first, last + 1):
            known = 0 <= ray < count
            least_m = min(least_m, max(ranges_m[ray] - 0.1, 0.0) if known else 0.0)
        assert depth_m[number] == pytest.approx(least_m), number
