"""The trajectory answers exactly what dense sampling answers nearly."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.motion import polynomial
from onboard.motion.axis_profile import AxisLimits, AxisState, Profile, Segment, speed_change
from onboard.motion.trajectory import CannotCoastError, State, Trajectory

NUMBERS = st.floats(-5.0, 5.0)
SEGMENTS = st.lists(
    st.builds(Segment, st.floats(0.01, 2.0), NUMBERS, NUMBERS), min_size=1, max_size=4
).map(tuple)
PROFILES = st.builds(Profile, NUMBERS, NUMBERS, SEGMENTS)
TRAJECTORIES = st.builds(
    Trajectory.from_profiles, st.floats(0.0, 100.0), PROFILES, PROFILES, PROFILES
)


def dense_times_s(trajectory: Trajectory, count: int = 400) -> list[float]:
    return [float(t) for t in np.linspace(trajectory.start_s, trajectory.end_s, count)]


@given(PROFILES, PROFILES, PROFILES)
def test_merged_profiles_are_the_profiles(x: Profile, y: Profile, z: Profile) -> None:
    trajectory = Trajectory.from_profiles(7.0, x, y, z)
    assert trajectory.end_s == pytest.approx(7.0 + max(p.duration_s for p in (x, y, z)))
    for time_s in dense_times_s(trajectory, 50)[:-1]:
        state = trajectory.sample(time_s)
        for axis, profile in enumerate((x, y, z)):
            position_m, velocity_mps, _ = profile.at(time_s - 7.0)
            assert state.position_leg_m[axis] == pytest.approx(position_m, abs=1e-6)
            assert state.velocity_leg_mps[axis] == pytest.approx(velocity_mps, abs=1e-6)


@given(TRAJECTORIES)
def test_pieces_join_in_position_and_velocity(trajectory: Trajectory) -> None:
    end_position, end_velocity, _ = trajectory.ends
    np.testing.assert_allclose(end_position[:-1], trajectory.position_leg_m[1:], atol=1e-9)
    np.testing.assert_allclose(end_velocity[:-1], trajectory.velocity_leg_mps[1:], atol=1e-9)


@given(TRAJECTORIES, st.sampled_from([0, 1, 2]))
def test_ranges_enclose_and_touch_the_samples(trajectory: Trajectory, axis: int) -> None:
    states = [trajectory.sample(time_s) for time_s in dense_times_s(trajectory)]
    positions_m = [state.position_leg_m[axis] for state in states]
    low_m, high_m = trajectory.position_range_m(axis)
    assert low_m - 1e-9 <= min(positions_m) <= low_m + 0.02
    assert high_m - 0.02 <= max(positions_m) <= high_m + 1e-9
    velocities_mps = [state.velocity_leg_mps[axis] for state in states]
    low_mps, high_mps = trajectory.velocity_range_mps(axis)
    assert low_mps - 1e-9 <= min(velocities_mps) <= low_mps + 0.3
    assert high_mps - 0.3 <= max(velocities_mps) <= high_mps + 1e-9


@given(TRAJECTORIES, st.sampled_from([0, 1, 2]), st.floats(0.05, 0.95))
def test_first_time_is_the_first(trajectory: Trajectory, axis: int, fraction: float) -> None:
    low_m, high_m = trajectory.position_range_m(axis)
    position_m = low_m + fraction * (high_m - low_m)
    time_s = trajectory.first_time_s(axis, position_m)
    assert time_s is not None
    assert trajectory.sample(time_s).position_leg_m[axis] == pytest.approx(position_m, abs=1e-6)
    started_below = trajectory.position_leg_m[0, axis] < position_m
    for earlier_s in np.linspace(trajectory.start_s, time_s, 100)[:-1]:
        below_m = position_m - trajectory.sample(float(earlier_s)).position_leg_m[axis]
        assert (below_m if started_below else -below_m) > -1e-6


@given(TRAJECTORIES, st.floats(0.0, 0.99), st.floats(0.0, 1.0))
def test_the_rest_is_the_same_motion(trajectory: Trajectory, cut: float, later: float) -> None:
    cut_s = trajectory.start_s + cut * (trajectory.end_s - trajectory.start_s)
    rest = trajectory.from_time(cut_s)
    assert rest.start_s == cut_s
    assert rest.end_s == pytest.approx(trajectory.end_s)
    time_s = cut_s + later * (trajectory.end_s - cut_s)
    np.testing.assert_allclose(
        rest.sample(time_s).position_leg_m, trajectory.sample(time_s).position_leg_m, atol=1e-6
    )


@given(TRAJECTORIES, TRAJECTORIES)
def test_joined_and_moved_in_time(first: Trajectory, second: Trajectory) -> None:
    joined = first.followed_by(second)
    assert joined.end_s == pytest.approx(first.end_s + second.end_s - second.start_s)
    moved = replace(second, start_s=first.end_s)
    time_s = moved.start_s + 0.37 * (moved.end_s - moved.start_s)
    np.testing.assert_allclose(
        joined.sample(time_s).position_leg_m, moved.sample(time_s).position_leg_m, atol=1e-6
    )


@pytest.mark.parametrize("time_s", [1.0, 12.1, 12.6])
def test_the_rest_leaves_pieces_out_that_last_for_nothing(time_s: float) -> None:
    """Found by a campaign (nominal --seed 1 --only 6136): the first piece was mere round-off."""
    at_rest = Profile(0.0, 0.0, (Segment(1.5, 0.0),))
    x = Profile(0.0, 1.0, (Segment(1e-17, -1.0), Segment(1.5, 1.0)))
    trajectory = Trajectory.from_profiles(12.1, x, at_rest, at_rest)
    assert trajectory.knots_s[1] == trajectory.start_s
    rest = trajectory.from_time(time_s)
    assert rest.start_s == max(time_s, 12.1)
    assert rest.end_s == trajectory.end_s
    np.testing.assert_allclose(rest.sample(13.0), trajectory.sample(13.0))


def test_accelerations_are_followed_by_a_coast_to_a_border() -> None:
    start = State((1.0, 0.0, 0.0), (2.0, 0.5, 0.0))
    durations_s, nodes_mps2 = np.array([1.0, 2.0]), np.zeros((3, 3))
    nodes_mps2[1] = (1.0, -0.5, 0.2)
    plain = Trajectory.from_accelerations(4.0, start, durations_s, nodes_mps2)
    end_m, end_mps = plain.final.position_leg_m[0], plain.final.velocity_leg_mps[0]
    coasting = Trajectory.from_accelerations(4.0, start, durations_s, nodes_mps2, end_m + 7.0)
    for time_s in dense_times_s(plain):
        for one, other in zip(coasting.sample(time_s), plain.sample(time_s), strict=True):
            assert one == pytest.approx(other, abs=1e-12)
    assert coasting.final.position_leg_m[0] == pytest.approx(end_m + 7.0, abs=1e-12)
    assert coasting.final.velocity_leg_mps == pytest.approx(plain.final.velocity_leg_mps)
    assert coasting.end_s - plain.end_s == pytest.approx(7.0 / end_mps)
    with pytest.raises(CannotCoastError, match="cannot coast over the last 0 m"):
        Trajectory.from_accelerations(4.0, start, durations_s, nodes_mps2, end_m)
    backwards = start._replace(velocity_leg_mps=(-9.0, 0.5, 0.0))
    with pytest.raises(CannotCoastError, match=r"at -7\.5 m/s"):
        Trajectory.from_accelerations(4.0, backwards, durations_s, nodes_mps2, end_m)


@given(TRAJECTORIES)
def test_positions_at_several_times_are_those_of_single_samples(trajectory: Trajectory) -> None:
    times_s = np.linspace(trajectory.start_s - 0.5, trajectory.end_s + 0.5, 23)
    times_s[3], times_s[20] = trajectory.start_s, trajectory.end_s
    singly_m = [trajectory.sample(time_s).position_leg_m for time_s in times_s.tolist()]
    assert trajectory.positions_leg_m(times_s).tolist() == [list(each) for each in singly_m]
    again_m = [trajectory.sample(time_s).position_leg_m for time_s in times_s.tolist() * 2]
    assert again_m == singly_m * 2


def test_waits_before_and_coasts_after() -> None:
    speeding_up = Profile(1.0, 2.0, (Segment(2.0, 0.0, 1.0),))
    trajectory = Trajectory.from_profiles(10.0, speeding_up, Profile(0.0, 0.0), Profile(0.0, 0.0))
    assert trajectory.sample(0.0) == State((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert trajectory.final.velocity_leg_mps == (4.0, 0.0, 0.0)
    assert trajectory.final.acceleration_leg_mps2 == (2.0, 0.0, 0.0)
    after = trajectory.sample(13.0)
    assert after.position_leg_m[0] == pytest.approx(1.0 + 4.0 + 8.0 / 6.0 + 4.0)
    assert after.acceleration_leg_mps2 == (0.0, 0.0, 0.0)
    assert trajectory.first_time_s(0, after.position_leg_m[0]) == pytest.approx(13.0)
    assert trajectory.first_time_s(0, 0.5) is None
    with pytest.raises(ValueError, match="the trajectory ends at"):
        trajectory.from_time(12.0)


def test_refuses_what_is_not_a_trajectory() -> None:
    nothing = Profile(0.0, 0.0)
    with pytest.raises(ValueError, match="expected at least one, all above zero"):
        Trajectory.from_profiles(0.0, nothing, nothing, nothing)
    zeros = np.zeros((1, 3))
    with pytest.raises(ValueError, match="finite"):
        Trajectory(0.0, np.ones(1), zeros * math.nan, zeros, zeros, zeros)
    with pytest.raises(ValueError, match="shape"):
        Trajectory(0.0, np.ones(2), zeros, zeros, zeros, zeros)


@given(
    st.builds(AxisState, NUMBERS, NUMBERS, st.floats(-3.0, 3.0)),
    NUMBERS,
    st.builds(AxisLimits, st.floats(-4.0, -0.5), st.floats(0.5, 4.0), st.floats(0.5, 40.0)),
)
def test_speed_change_arrives_within_limits(
    state: AxisState, target_mps: float, limits: AxisLimits
) -> None:
    segments = speed_change(state, target_mps, limits)
    profile = Profile(state.position_m, state.velocity_mps, segments)
    assert profile.final.velocity_mps == pytest.approx(target_mps, abs=1e-9)
    low_mps2 = min(limits.acceleration_min_mps2, state.acceleration_mps2)
    high_mps2 = max(limits.acceleration_max_mps2, state.acceleration_mps2)
    now_mps2 = state.acceleration_mps2
    for duration_s, acceleration_mps2, jerk_mps3 in segments:
        assert acceleration_mps2 == pytest.approx(now_mps2, abs=1e-9)
        assert abs(jerk_mps3) <= limits.jerk_max_mps3
        now_mps2 = acceleration_mps2 + jerk_mps3 * duration_s
        assert low_mps2 - 1e-9 <= now_mps2 <= high_mps2 + 1e-9
    if segments:
        assert now_mps2 == pytest.approx(0.0, abs=1e-9)


@given(st.builds(AxisState, NUMBERS, NUMBERS, st.just(0.0)), NUMBERS)
def test_speed_change_without_jerk_limit_is_one_push(state: AxisState, target_mps: float) -> None:
    segments = speed_change(state, target_mps, AxisLimits(-2.0, 4.0, math.inf))
    assert len(segments) == (target_mps != state.velocity_mps)
    for duration_s, acceleration_mps2, jerk_mps3 in segments:
        assert jerk_mps3 == 0.0
        assert acceleration_mps2 in {-2.0, 4.0}
        assert duration_s == pytest.approx((target_mps - state.velocity_mps) / acceleration_mps2)


@given(TRAJECTORIES)
def test_every_piece_lies_in_the_hull_of_its_control_points(trajectory: Trajectory) -> None:
    points_m = trajectory.control_points_m
    assert points_m.shape == (len(trajectory.durations_s), 4, 3)
    low_m, high_m = points_m.min(axis=1), points_m.max(axis=1)
    for piece, (begin_s, duration_s) in enumerate(
        zip(trajectory.knots_s[:-1], trajectory.durations_s.tolist(), strict=True)
    ):
        for share in (0.0, 0.25, 0.5, 0.75):
            time_s = begin_s + share * duration_s
            for axis in range(3):
                coefficients = trajectory.position_coefficients(piece, axis)
                value_m = polynomial.evaluate(coefficients, time_s - begin_s)
                assert low_m[piece, axis] - 1e-9 <= value_m <= high_m[piece, axis] + 1e-9


@given(TRAJECTORIES, st.sampled_from([0, 1, 2]))
def test_velocity_ranges_enclose_and_touch_the_samples(trajectory: Trajectory, axis: int) -> None:
    low_mps, high_mps = trajectory.velocity_range_mps(axis)
    # Just before the end: at it the coast begins, whose velocity is the same.
    speeds_mps = [
        trajectory.sample(time_s).velocity_leg_mps[axis] for time_s in dense_times_s(trajectory)
    ]
    assert low_mps - 1e-9 <= min(speeds_mps)
    assert max(speeds_mps) <= high_mps + 1e-9
    steepest_mps2 = np.abs(trajectory.acceleration_leg_mps2).max()
    steepest_mps2 += (np.abs(trajectory.jerk_leg_mps3).max() * trajectory.durations_s).max()
    step_mps = steepest_mps2 * (trajectory.end_s - trajectory.start_s) / 399.0 + 1e-9
    assert min(speeds_mps) <= low_mps + step_mps
    assert max(speeds_mps) >= high_mps - step_mps


@given(TRAJECTORIES, st.tuples(NUMBERS, NUMBERS, NUMBERS))
def test_a_shift_moves_positions_alone(
    trajectory: Trajectory, shift_m: tuple[float, float, float]
) -> None:
    moved = trajectory.shifted_by(shift_m)
    for time_s in dense_times_s(trajectory, 7):
        was, now = trajectory.sample(time_s), moved.sample(time_s)
        np.testing.assert_allclose(
            np.array(now.position_leg_m) - was.position_leg_m, shift_m, atol=1e-9
        )
        assert now[1:] == was[1:]


@given(TRAJECTORIES, st.floats(0.01, 9.0))
def test_an_explicit_coast_changes_the_end_alone(trajectory: Trajectory, duration_s: float) -> None:
    longer = trajectory.coasting_for(duration_s)
    assert longer.end_s == pytest.approx(trajectory.end_s + duration_s)
    for time_s in (*dense_times_s(trajectory, 5)[:-1], trajectory.end_s + duration_s / 2.0):
        np.testing.assert_allclose(
            longer.sample(time_s).position_leg_m,
            trajectory.sample(time_s).position_leg_m,
            atol=1e-6,
        )
    assert longer.final.velocity_leg_mps == pytest.approx(trajectory.final.velocity_leg_mps)
    assert longer.final.acceleration_leg_mps2 == (0.0, 0.0, 0.0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_accelerations_at_knots_are_integrated(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    durations_s = rng.uniform(0.05, 1.0, count)
    nodes_mps2 = rng.uniform(-3.0, 3.0, (count + 1, 3))
    start = State((1.0, -2.0, 0.5), (2.0, 0.1, -0.3), (0.0, 0.0, 0.0))
    trajectory = Trajectory.from_accelerations(7.0, start, durations_s, nodes_mps2)
    times_s = np.linspace(0.0, durations_s.sum(), 4001)
    knots_s = np.concatenate(([0.0], np.cumsum(durations_s)))
    for axis in range(3):
        acceleration = np.interp(times_s, knots_s, nodes_mps2[:, axis])
        velocity = start.velocity_leg_mps[axis] + np.concatenate(
            ([0.0], np.cumsum((acceleration[1:] + acceleration[:-1]) / 2.0 * np.diff(times_s)))
        )
        way_m = np.trapezoid(velocity, times_s)
        assert trajectory.final.velocity_leg_mps[axis] == pytest.approx(velocity[-1], abs=1e-3)
        moved_m = trajectory.final.position_leg_m[axis] - start.position_leg_m[axis]
        assert moved_m == pytest.approx(way_m, abs=1e-3)
    np.testing.assert_allclose(trajectory.ends[2][-1], nodes_mps2[-1], atol=1e-9)


def test_one_axis_of_a_state() -> None:
    state = State((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
    assert state.axis(1) == AxisState(2.0, 5.0, 8.0)
    assert State((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)).axis(2) == AxisState(3.0, 6.0, 0.0)


@pytest.mark.parametrize("change", [{"start_s": -3.0}, {"start_s": 1e9}])
def test_absolute_times_move_with_the_start(change: dict[str, float]) -> None:
    trajectory = Trajectory.from_profiles(
        0.0, Profile(0.0, 1.0, (Segment(2.0, 0.5),)), Profile(0.0, 0.0), Profile(0.0, 0.0)
    )
    moved = replace(trajectory, **change)  # type: ignore[arg-type]  # a number
    assert moved.end_s - moved.start_s == pytest.approx(2.0)
    assert moved.first_time_s(0, 1.5) == pytest.approx(
        moved.start_s + (trajectory.first_time_s(0, 1.5) or math.nan)
    )


@given(TRAJECTORIES, st.floats(0.01, 1.5))
def test_the_part_before_a_time_is_the_same_motion_and_ends_then(
    trajectory: Trajectory, share: float
) -> None:
    end_s = trajectory.start_s + share * (trajectory.end_s - trajectory.start_s)
    part = trajectory.until(end_s)
    assert part.end_s == pytest.approx(end_s)
    for time_s in np.linspace(part.start_s, part.end_s, 20)[:-1].tolist():
        for one, other in zip(part.sample(time_s), trajectory.sample(time_s), strict=True):
            assert one == pytest.approx(other, abs=1e-6)
