"""What is flown now, and what takes over when."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import LegFrame
from onboard.guidance.reference import Reference
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import Trajectory


def moving(start_s: float, x_m: float, speed_mps: float) -> Trajectory:
    """Two seconds along x at constant speed, at a height of 1 m above the leg."""
    still = Profile(0.0, 0.0, (Segment(2.0, 0.0),))
    along = Profile(x_m, speed_mps, (Segment(2.0, 0.0),))
    above = Profile(-1.0, 0.0, (Segment(2.0, 0.0),))
    return Trajectory.from_profiles(start_s, along, still, above)


def x_of(reference: Reference, time_s: float) -> float:
    state = reference.sample(time_s)
    assert state is not None
    return state.position_leg_m[0]


def test_nothing_is_flown_at_first() -> None:
    reference = Reference()
    assert reference.sample(0.0) is None
    assert reference.setpoint(0.0, LegFrame((0.0, 0.0, 0.0), 0.0)) is None
    # Neither of these has anything to act on.
    reference.hand_over(1.0)
    reference.shift((1.0, 0.0, 0.0))
    assert reference.current is reference.upcoming is None


@given(st.floats(0.0, 4.0))
def test_the_upcoming_trajectory_takes_over_at_its_own_start(time_s: float) -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    expected_m = time_s if time_s < 1.5 else 100.0 + 2.0 * (time_s - 1.5)
    assert x_of(reference, time_s) == pytest.approx(expected_m)


@given(st.floats(0.0, 4.0), st.floats(0.0, 4.0))
def test_handing_over_changes_nothing_from_then_on(now_s: float, later_s: float) -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    before_m = x_of(reference, now_s + later_s)
    reference.hand_over(now_s)
    assert (reference.upcoming is None) is (now_s >= 1.5)
    assert x_of(reference, now_s + later_s) == before_m


def test_handing_over_waits_for_the_start() -> None:
    reference, first, second = Reference(), moving(0.0, 0.0, 1.0), moving(1.5, 5.0, 2.0)
    reference.fly(first)
    reference.schedule(second, 0.0)
    reference.hand_over(1.4999)
    assert (reference.current, reference.upcoming) == (first, second)
    reference.hand_over(1.5)
    assert (reference.current, reference.upcoming) == (second, None)


def test_another_trajectory_at_once_drops_what_was_to_take_over() -> None:
    reference, stop = Reference(), moving(1.0, 3.0, 0.0)
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    reference.fly(stop)
    assert reference.upcoming is None
    assert x_of(reference, 3.0) == 3.0


def test_what_was_to_take_over_can_be_replaced() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    reference.schedule(moving(1.0, 50.0, 2.0), 0.0)
    assert x_of(reference, 2.0) == pytest.approx(52.0)


def test_what_has_taken_over_is_flown_until_the_next_one_does() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.0, 50.0, 2.0), 0.9)
    reference.schedule(moving(1.1, 90.0, 2.0), 1.05)
    assert x_of(reference, 1.05) == pytest.approx(50.1)
    assert x_of(reference, 1.1) == pytest.approx(90.0)


def test_clearing_leaves_nothing() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    reference.clear()
    assert reference.sample(2.0) is None


@given(*[st.floats(-5.0, 5.0)] * 3)
def test_a_shift_moves_both(x_m: float, y_m: float, z_m: float) -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.5, 100.0, 2.0), 0.0)
    before = [reference.sample(time_s) for time_s in (1.0, 2.0)]
    reference.shift((x_m, y_m, z_m))
    for time_s, state in zip((1.0, 2.0), before, strict=True):
        moved = reference.sample(time_s)
        assert moved is not None
        assert state is not None
        expected_m = [a + b for a, b in zip(state.position_leg_m, (x_m, y_m, z_m), strict=True)]
        assert moved.position_leg_m == pytest.approx(expected_m)
        assert moved.velocity_leg_mps == state.velocity_leg_mps


def test_setpoints_are_in_ned_and_point_along_the_leg() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 2.0))
    eastwards = LegFrame((10.0, 20.0, -4.0), math.pi / 2.0)
    setpoint = reference.setpoint(1.0, eastwards)
    assert setpoint is not None
    assert setpoint.position_ned_m == pytest.approx((10.0, 22.0, -5.0))
    assert setpoint.velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0))
    assert setpoint.acceleration_ned_mps2 == pytest.approx((0.0, 0.0, 0.0))
    assert setpoint.yaw_ned_rad == math.pi / 2.0


def test_the_nose_is_turned_from_the_leg() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 2.0))
    reference.heading_rad = math.radians(150.0)
    setpoint = reference.setpoint(1.0, LegFrame((10.0, 20.0, -4.0), math.pi / 2.0))
    assert setpoint is not None
    assert setpoint.yaw_ned_rad == pytest.approx(math.radians(-120.0))
    reference.clear()
    assert reference.heading_rad == 0.0


# ------------------------------------------------------------------ the guard


def test_the_guard_is_what_is_flown_whatever_is_intended() -> None:
    reference = Reference()
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.guard = moving(0.0, 50.0, 1.0)
    reference.intend(moving(0.0, 200.0, 1.0))
    reference.schedule(moving(0.5, 100.0, 2.0), 0.0)
    reference.hand_over(1.0)
    assert x_of(reference, 1.0) == pytest.approx(51.0)
    assert reference.intended is not None
    assert reference.intended.start_s == 0.5
    reference.shift((3.0, 0.0, 0.0))
    assert x_of(reference, 1.0) == pytest.approx(54.0)


def test_the_guard_ends_where_something_else_is_flown() -> None:
    reference = Reference()
    reference.guard = moving(0.0, 50.0, 1.0)
    reference.fly_guard()
    assert reference.guard is None
    assert x_of(reference, 1.0) == pytest.approx(51.0)
    reference.guard = moving(0.0, 70.0, 1.0)
    reference.fly(moving(0.0, 10.0, 1.0))
    assert x_of(reference, 1.0) == pytest.approx(11.0)
    reference.guard = moving(0.0, 70.0, 1.0)
    reference.clear()
    assert reference.sample(1.0) is None


@pytest.mark.parametrize("now_s", [0.5, 1.0, 2.5])
def test_what_remains_is_what_will_be_flown(now_s: float) -> None:
    reference = Reference()
    assert reference.remaining(now_s) is None
    reference.fly(moving(0.0, 0.0, 1.0))
    reference.schedule(moving(1.0, 1.0, 3.0), 0.1)
    remaining = reference.remaining(now_s)
    assert remaining is not None
    for time_s in (now_s, 1.5, 2.9):
        if time_s >= now_s:
            assert remaining.sample(time_s).position_leg_m[0] == pytest.approx(
                x_of(reference, time_s)
            )
    assert reference.remaining(3.0) is None
    reference.guard = moving(0.0, 7.0, 0.0)
    guarded = reference.remaining(1.0)
    assert guarded is not None
    assert guarded.sample(1.0).position_leg_m[0] == pytest.approx(7.0)
