"""Distances of obstacles by sector, against rays and against our own reader of the message."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.mavlink.transmitter import Transmitter
from onboard.obstacle_outputs.sectors import (
    OBSTACLES_MAX,
    SECTORS,
    UNKNOWN,
    WIDTH_RAD,
    sectors_cm,
)
from tests.onboard.perception.sources.scenes import pose_at
from tests.onboard.perception.sources.test_mavlink_ranges import read

Outline = list[tuple[float, float]]


def box(north_m: float, east_m: float, half_m: float = 0.5, yaw_deg: float = 0.0) -> Outline:
    cosine, sine = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return [(north_m + cosine * x - sine * y, east_m + sine * x + cosine * y) for x, y in corners]


def sampled_m(outline: Outline, yaw_rad: float) -> list[float]:
    """Return the nearest of many points of the sides in each sector."""
    nearest_m = [math.inf] * SECTORS
    for (n0, e0), (n1, e1) in zip(outline, [*outline[1:], outline[0]], strict=True):
        for step in range(401):
            north_m, east_m = n0 + (n1 - n0) * step / 400, e0 + (e1 - e0) * step / 400
            index = round((math.atan2(east_m, north_m) - yaw_rad) / WIDTH_RAD) % SECTORS
            nearest_m[index] = min(nearest_m[index], math.hypot(north_m, east_m))
    return nearest_m


@settings(max_examples=60)
@given(
    st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(0.1, 4.0), st.floats(-90.0, 90.0),
    st.floats(-math.pi, math.pi),
)  # fmt: skip
def test_the_nearest_point_in_each_sector(
    north_m: float, east_m: float, half_m: float, yaw_deg: float, yaw_rad: float
) -> None:
    outline = box(north_m, east_m, half_m, yaw_deg)
    if math.hypot(north_m, east_m) < 1.5 * half_m + 0.2:
        return  # the body is in it, or nearly
    found = sectors_cm([outline], (0.0, 0.0, -4.0), yaw_rad)
    for distance_cm, nearest_m in zip(found, sampled_m(outline, yaw_rad), strict=True):
        if math.isfinite(nearest_m):
            # Never farther than what is there; nearer by what the samples miss.
            assert distance_cm <= 100.0 * nearest_m + 1e-6
            assert distance_cm >= 100.0 * nearest_m - 12.0


def test_sectors_run_clockwise_from_the_nose() -> None:
    east = box(0.0, 10.0)
    assert sectors_cm([east], (0.0, 0.0, 0.0), 0.0)[18] == 950
    assert sectors_cm([east], (0.0, 0.0, 0.0), math.pi / 2.0)[0] == 950
    assert sectors_cm([east], (0.0, 20.0, 0.0), 0.0)[54] == 950


def test_without_an_obstacle_nothing_is_known() -> None:
    assert sectors_cm([], (0.0, 0.0, 0.0), 0.0) == [UNKNOWN] * SECTORS
    found = sectors_cm([box(70.0, 0.0)], (0.0, 0.0, 0.0), 0.0)
    assert found == [UNKNOWN] * SECTORS  # beyond what the message is sent for
    assert sectors_cm([[]], (0.0, 0.0, 0.0), 0.0) == [UNKNOWN] * SECTORS


def test_of_two_the_nearer_counts_and_a_body_within_one_is_at_it() -> None:
    found = sectors_cm([box(10.0, 0.0), box(5.0, 0.0)], (0.0, 0.0, 0.0), 0.0)
    assert found[0] == 450
    assert sectors_cm([box(0.1, 0.0)], (0.0, 0.0, 0.0), 0.0) == [10] * SECTORS


@pytest.mark.parametrize(
    "outline",
    [
        [(10.0, 0.0)],
        [(10.0, 0.0)] * 4,
        [(10.0, 0.0), (12.0, 0.0), (12.0, 0.0), (10.0, 0.0)],
        [(12.0, 0.0), (10.0, 0.0)],
    ],
    ids=["point", "point of four corners", "seen along itself", "line"],
)
def test_what_has_no_interior_is_in_its_own_sector_only(outline: Outline) -> None:
    found = sectors_cm([outline], (0.0, 0.0, 0.0), 0.0)
    assert found == [1000, *[UNKNOWN] * (SECTORS - 1)]


def test_a_wall_without_width_is_seen_across_and_shields_nothing_behind() -> None:
    wall = [(10.0, -1.0), (10.0, 1.0), (10.0, 1.0), (10.0, -1.0)]
    found = sectors_cm([wall], (0.0, 0.0, 0.0), 0.0)
    assert found[0] == 1000
    assert found[10:-10] == [UNKNOWN] * (SECTORS - 20)


@pytest.mark.parametrize("turned", [1, -1])
def test_a_body_within_an_outline_is_at_it_whichever_way_round_and_with_a_corner_twice(
    turned: int,
) -> None:
    corners = box(0.3, -0.2, 2.0, 30.0)[::turned]
    for outline in (corners, [corners[0], *corners]):
        assert sectors_cm([outline], (0.0, 0.0, 0.0), 1.0) == [10] * SECTORS


def test_of_very_many_the_nearest_are_sent() -> None:
    far = [box(50.0, 0.0)] * (2 * OBSTACLES_MAX)
    assert sectors_cm([*far, box(-3.0, 0.0)], (0.0, 0.0, 0.0), 0.0)[36] == 250


def test_a_sensor_would_read_the_message_as_it_is_meant() -> None:
    pose = pose_at(yaw_deg=20.0)
    pillar = box(5.0, 2.0)
    transmitter = Transmitter(1)
    cm = sectors_cm([pillar], pose.position_ned_m, pose.yaw_rad)
    transmitter.send_obstacle_distance(cm, 1.79e9)
    frame = read(transmitter.bytes_to_send(), pose)
    assert frame.obstacles
    bearing_rad = math.atan2(2.0, 5.0) - pose.yaw_rad
    nearest = min(frame.obstacles, key=lambda each: math.hypot(*each.center_m))
    assert math.atan2(nearest.center_m[1], nearest.center_m[0]) == pytest.approx(
        bearing_rad, abs=math.radians(8.0)
    )
    assert math.hypot(*nearest.center_m) == pytest.approx(5.0, abs=0.6)
