import math

import pytest

from onboard.geometry.frames import wrap_angle
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose


def flown(span_s: float = 2.0) -> PoseHistory:
    """Return 2 s of a flight north at 50 m/s, one pose every 20 ms."""
    history = PoseHistory(span_s)
    for step in range(100):
        history.add(Pose(step * 0.02, (step * 1.0, 0.0, 0.0), (50.0, 0.0, 0.0), 0.0, 0.0, 0.0))
    return history


def test_pose_history_moves_the_nearest_pose_to_the_time() -> None:
    history = PoseHistory()
    for step in range(100):
        history.add(Pose(step * 0.02, (step * 1.0, 0.0, 0.0), (50.0, 0.0, 0.0), 0.0, 0.0, 0.0))
    found = history.at(1.005)
    assert found is not None
    assert found.position_ned_m[0] == pytest.approx(50.25)
    assert history.at(3.0) is None


def test_a_turning_body_is_placed_with_the_heading_of_that_instant() -> None:
    history = PoseHistory()
    for step in range(50):
        yaw_rad = math.remainder(3.0 + 0.02 * step, 2.0 * math.pi)  # 1 rad/s, past the half turn
        history.add(Pose(step * 0.02, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad))
    for time_s in (0.005, 0.13, 0.151, 0.97, 0.99, 1.02):  # between poses, and after the last
        found = history.at(time_s)
        assert found is not None
        assert wrap_angle(found.yaw_rad - (3.0 + time_s)) == pytest.approx(0.0, abs=1e-9)


def test_without_poses_there_is_none_and_no_turn() -> None:
    history = PoseHistory()
    assert history.at(0.0) is None
    assert history.yaw_rate_radps(0.0) == 0.0
    history.add(Pose(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, 1.0))
    assert history.yaw_rate_radps(0.0) == 0.0


def test_poses_older_than_the_span_are_forgotten() -> None:
    history = flown(span_s=0.5)
    assert history.at(1.4, tolerance_s=0.05) is None
    assert history.at(1.6, tolerance_s=0.05) is not None


def test_two_poses_of_one_instant_do_not_turn() -> None:
    history = PoseHistory()
    for yaw_rad in (0.0, 1.0):
        history.add(Pose(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad))
    assert history.yaw_rate_radps(1.0) == 0.0


def test_a_reset_moves_every_pose() -> None:
    history = flown()
    history.shift((1.0, -2.0, 0.5))
    for time_s in (0.4, 1.0, 1.9):
        found = history.at(time_s)
        assert found is not None
        assert found.position_ned_m == pytest.approx((50.0 * time_s + 1.0, -2.0, 0.5))


def turning(*yaws_rad: float, period_s: float = 0.02) -> PoseHistory:
    history = PoseHistory()
    for step, yaw_rad in enumerate(yaws_rad):
        history.add(Pose(step * period_s, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad))
    return history


def test_the_fastest_turn_around_a_time_is_found_in_either_direction() -> None:
    history = turning(0.0, 0.0, 0.0, -0.01, -0.01, -0.01, -0.01, -0.01, -0.01, -0.01)
    assert history.fastest_turn_radps(0.05, 0.02) == pytest.approx(0.5)
    assert history.fastest_turn_radps(0.13, 0.02) == 0.0
    assert history.fastest_turn_radps(0.13, 0.1) == pytest.approx(0.5)
    past_half_turn = turning(math.pi - 0.001, -math.pi + 0.001)
    assert past_half_turn.fastest_turn_radps(0.01, 0.1) == pytest.approx(0.1)


@pytest.mark.parametrize("time_s", [-0.05, 0.5])
def test_a_turn_that_no_poses_tell_of_may_be_of_any_speed(time_s: float) -> None:
    assert turning(0.0, 0.0, 0.0).fastest_turn_radps(time_s, 0.1) == math.inf
    assert PoseHistory().fastest_turn_radps(time_s, 0.1) == math.inf


def test_a_heading_that_jumps_within_one_instant_turns_infinitely_fast() -> None:
    assert turning(0.0, 1.0, period_s=0.0).fastest_turn_radps(0.0, 0.1) == math.inf
    assert turning(1.0, 1.0, period_s=0.0).fastest_turn_radps(0.0, 0.1) == 0.0
