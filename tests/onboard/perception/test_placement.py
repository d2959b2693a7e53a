"""Where the boxes of a frame are, and how exactly that is known."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import heading_displacement_m
from onboard.mavlink.endpoint import TELEMETRY_RATE_HZ
from onboard.perception.placement import POSE_TIMING_S, PlacedBox, blurs_m, place
from onboard.vehicle_state import Pose
from tests.onboard.perception.messages import detection_frame, obstacle

POSE = Pose(1.0, (10.0, 20.0, -4.0), (0.0, 0.0, 0.0), 0.0, 0.0, math.pi / 2)


def body(*ahead_m: float) -> list[dict[str, object]]:
    return [
        obstacle(id=str(number), center_m=[range_m, 0.0], size_m=[1.0, 1.0])
        for number, range_m in enumerate(ahead_m)
    ]


def middle(box: PlacedBox) -> tuple[float, float]:
    north_m, east_m = zip(*box.corners_ned_m, strict=True)
    return sum(north_m) / 4.0, sum(east_m) / 4.0


# ------------------------------------------------------------------ placing


def test_boxes_in_local_ned_stay_where_they_are_and_move_with_a_reset() -> None:
    (placed,) = place(detection_frame(obstacle(down_m=[-3.0, 0.0])), POSE, None)
    assert middle(placed) == pytest.approx((14.2, 0.6))
    assert placed.track_id == "front/7"
    assert placed.moves
    assert placed.blur_m == 0.0
    assert placed.down_m == (-3.0, 0.0)


def test_boxes_from_the_body_are_placed_by_the_pose_and_do_not_move() -> None:
    frame = detection_frame(*body(5.0), frame="body_frd")
    (placed,) = place(frame, POSE, {"front/0": 0.02})
    assert middle(placed) == pytest.approx((10.0, 25.0))  # 5 m ahead of a nose to the east
    assert not placed.moves
    assert placed.blur_m == 0.02


def test_heights_from_the_body_are_placed_too() -> None:
    seen = obstacle(down_m=[-1.0, 4.0])
    (placed,) = place(detection_frame(seen, frame="body_frd"), POSE, {"front/7": 0.0})
    assert placed.down_m == (-5.0, 0.0)


def test_of_a_blurred_frame_only_the_boxes_that_are_asked_for_are_taken() -> None:
    frame = detection_frame(*body(3.0, 6.0, 9.0), frame="body_frd")
    placed = place(frame, POSE, {"front/0": 0.0, "front/2": 0.1})
    assert [(box.track_id, box.blur_m) for box in placed] == [("front/0", 0.0), ("front/2", 0.1)]


def test_without_a_pose_nothing_is_known_to_be_seen_in_full() -> None:
    boxes = place(detection_frame(*body(4.0, 8.0)), None, None)
    assert len(boxes) == 2
    for placed in boxes:
        assert placed.pose is None
        assert not placed.in_full
        assert placed.displacement_m(math.radians(5.0)) == 0.0


@pytest.mark.parametrize("partial", [True, False])
def test_a_box_in_full_view_counts_unless_the_sensor_says_that_it_is_a_part(
    *, partial: bool
) -> None:
    seen = obstacle(center_m=[6.0, 0.0], size_m=[1.0, 1.0], partial=partial)
    (placed,) = place(detection_frame(seen, frame="body_frd"), POSE, {"front/7": 0.0})
    assert placed.in_full is not partial


def test_a_box_behind_another_is_not_seen_in_full() -> None:
    frame = detection_frame(*body(4.0, 8.0), frame="body_frd")
    placed = place(frame, POSE, {"front/0": 0.0, "front/1": 0.0})
    assert [box.in_full for box in placed] == [True, False]


@given(st.floats(0.0, 0.2), st.floats(1.0, 11.0))
def test_a_wrong_heading_displaces_by_the_distance_of_the_farthest_corner(
    error_rad: float, range_m: float
) -> None:
    frame = detection_frame(*body(range_m), frame="body_frd")
    (placed,) = place(frame, POSE, {"front/0": 0.0})
    farthest_m = math.hypot(range_m + 0.5, 0.5)
    expected_m = heading_displacement_m(farthest_m, error_rad)
    assert placed.displacement_m(error_rad) == pytest.approx(expected_m)


def test_a_shifted_box_is_elsewhere_and_otherwise_the_same() -> None:
    (placed,) = place(detection_frame(obstacle()), POSE, None)
    moved = placed.shifted_by((1.0, -2.0))
    assert middle(moved) == pytest.approx((15.2, -1.4))
    assert moved._replace(corners_ned_m=placed.corners_ned_m) == placed
    assert placed.shifted_by((0.0, 0.0)) is placed


# ------------------------------------------------------------------ blur


def test_a_frame_and_the_poses_around_it_are_half_a_telemetry_period_apart() -> None:
    assert pytest.approx(0.5 / TELEMETRY_RATE_HZ) == POSE_TIMING_S


def test_what_is_hardly_blurred_is_sharp_and_needs_no_asking() -> None:
    frame = detection_frame(*body(2.0, 10.0), frame="body_frd")

    def never(track_id: str, _: object) -> bool:
        raise AssertionError(track_id)

    assert blurs_m(frame, 0.0, 0.0, never) == {"front/0": 0.0, "front/1": 0.0}
    assert blurs_m(frame, 0.1, 1.0, never) == {"front/0": 0.0, "front/1": 0.0}


@pytest.mark.parametrize("yaw_rate_radps", [1.0, -1.0])
def test_the_farther_a_box_the_more_a_turn_blurs_it(yaw_rate_radps: float) -> None:
    frame = detection_frame(*body(2.0, 10.0), frame="body_frd")
    found = blurs_m(frame, yaw_rate_radps, 3.0 * POSE_TIMING_S, lambda *_: True)
    assert found == {"front/0": 0.0, "front/1": pytest.approx(10.0 * POSE_TIMING_S)}


def test_what_is_blurred_and_not_needed_is_left_out() -> None:
    frame = detection_frame(*body(2.0, 10.0, 11.0), frame="body_frd")
    needed = blurs_m(frame, 1.0, 0.0, lambda track_id, _: track_id == "front/2")
    assert list(needed) == ["front/2"]
