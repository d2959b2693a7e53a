"""The typed detection: heights, free range, and where boxes are."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from onboard.perception.detection import (
    MAX_BEARING_BINS,
    corners_ned,
    down_range_ned,
    shifted_corners,
)
from onboard.vehicle_state import Pose
from tests.onboard.perception.messages import detection, detection_frame, obstacle

POSE = Pose(0.0, (10.0, 20.0, -4.0), (0.0, 0.0, 0.0), 0.2, -0.2, math.pi / 2)


def test_box_turns_with_its_yaw() -> None:
    corners = corners_ned(detection(center_m=(0.0, 0.0), size_m=(2.0, 0.0), yaw_deg=90.0), None)
    assert max(east_m for _, east_m in corners) == pytest.approx(1.0)
    assert max(north_m for north_m, _ in corners) == pytest.approx(0.0, abs=1e-12)


def test_body_box_is_placed_by_the_pose() -> None:
    corners = corners_ned(detection(center_m=(5.0, 1.0), size_m=(0.0, 0.0)), POSE)
    # 5 m ahead of a nose to the east, 1 m to its right (south).
    assert corners[0] == pytest.approx((9.0, 25.0))


def test_corners_move_together() -> None:
    assert shifted_corners([(1.0, 2.0), (3.0, 4.0)], (10.0, -1.0)) == [(11.0, 1.0), (13.0, 3.0)]


def test_tracks_of_two_sources_have_two_names() -> None:
    seen = obstacle()
    names = {
        frame.track_id(frame.obstacles[0])
        for frame in (detection_frame(seen), detection_frame(seen, source="rear"))
    }
    assert names == {"front/7", "rear/7"}


# ------------------------------------------------------------------ heights


def test_without_optional_fields_nothing_is_known_of_height_or_free_space() -> None:
    seen = detection_frame(obstacle())
    assert seen.free_range_m is None
    assert seen.obstacles[0].down_m is None
    assert seen.obstacles[0].partial is False
    assert down_range_ned(seen.obstacles[0], None) is None


@pytest.mark.parametrize("down_m", [[-3.0, 0.0], [-2, -2], [0, 1.5], [None, 0.0], [-3.0, None]])
def test_top_and_bottom_are_read(down_m: list[float]) -> None:
    assert detection(down_m=down_m).down_m == tuple(down_m)


@pytest.mark.parametrize(
    "down_m",
    [
        [0.0, -3.0],  # bottom first
        [-3.0],
        [-3.0, 0.0, 1.0],
        [],
        [math.nan, 0.0],
        [-3.0, math.nan],
        [-math.inf, 0.0],
        [-1e9, 0.0],
        ["-3.0", "0.0"],
        [True, False],
        "tall",
        -3.0,
        {"top": -3.0, "bottom": 0.0},
    ],
)
def test_what_is_not_a_range_of_heights_is_refused(down_m: Any) -> None:
    with pytest.raises(ValidationError, match="down_m"):
        detection(down_m=down_m)


def test_reversed_heights_are_refused_with_both_numbers() -> None:
    with pytest.raises(ValidationError, match=r"top 1 m is below bottom -2\.5 m"):
        detection(down_m=[1.0, -2.5])


@pytest.mark.parametrize("partial", [1, 0, "true", None, 0.0])
def test_partial_is_a_boolean(partial: Any) -> None:
    with pytest.raises(ValidationError, match="partial"):
        detection(partial=partial)


def test_heights_in_the_local_frame_are_as_they_are() -> None:
    assert down_range_ned(detection(down_m=[-3.0, 0.0]), None) == (-3.0, 0.0)


@given(st.floats(-100.0, 100.0), st.floats(-50.0, 50.0), st.floats(0.0, 30.0))
def test_heights_from_the_body_are_relative_to_it_however_it_tilts(
    body_m: float, top_m: float, tall_m: float
) -> None:
    pose = POSE._replace(position_ned_m=(1.0, 2.0, body_m), roll_rad=0.4, pitch_rad=-0.3)
    found = down_range_ned(detection(down_m=[top_m, top_m + tall_m]), pose)
    assert found == pytest.approx((body_m + top_m, body_m + top_m + tall_m))


def test_a_part_does_not_say_where_the_obstacle_ends() -> None:
    seen = detection(down_m=[-3.0, 0.0], partial=True)
    assert seen.down_m == (-3.0, 0.0)
    assert down_range_ned(seen, None) is None


# ------------------------------------------------------------------ free range


@pytest.mark.parametrize(
    "ranges_m", [[0.0], [12.0, 0, 3.5], [None, 2.0, None], [1.0] * MAX_BEARING_BINS]
)
def test_free_ranges_are_read(ranges_m: list[float | None]) -> None:
    assert detection_frame(free_range_m=ranges_m).free_range_m == tuple(ranges_m)


def test_a_bin_is_its_share_of_the_view() -> None:
    seen = detection_frame(free_range_m=[1.0] * 24, field_of_view_deg=120.0)
    assert math.degrees(seen.bin_rad) == pytest.approx(5.0)


@pytest.mark.parametrize(
    "ranges_m",
    [
        [],
        [-0.1],
        [math.nan],
        [1.0, math.inf],
        ["12"],
        [True],
        12.0,
        "12",
        [[1.0]],
        [1.0] * (MAX_BEARING_BINS + 1),
    ],
)
def test_what_is_not_a_list_of_ranges_is_refused(ranges_m: Any) -> None:
    with pytest.raises(ValidationError, match="free_range_m"):
        detection_frame(free_range_m=ranges_m)


def test_no_free_range_may_be_stated_as_null() -> None:
    seen = detection_frame(obstacle(down_m=None), free_range_m=None)
    assert seen.free_range_m is None
    assert seen.obstacles[0].down_m is None
