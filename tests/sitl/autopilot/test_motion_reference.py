"""The reference of the autonomous modes keeps its limits and comes to rest where it should."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.autopilot.motion_reference import MotionLimits, MotionReference
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector
from tests.sitl.autopilot.truths import truth_at

LIMITS = MotionLimits(5.0, 3.0, 30.0)
STEP_S = 0.02
speeds = st.floats(-8.0, 8.0)


def flown_to(target_ned_m: Vector, time_s: float = 30.0) -> list[Setpoint]:
    reference = MotionReference(truth_at())
    setpoints = []
    for _ in range(round(time_s / STEP_S)):
        reference.go_to(target_ned_m, 5.0, 2.0, LIMITS, STEP_S)
        setpoints.append(reference.setpoint())
    assert reference.is_at(target_ned_m)
    return setpoints


def test_it_starts_with_the_vehicles_motion() -> None:
    truth = truth_at(0.0, (1.0, 2.0, -3.0), (4.0, 5.0, 6.0), 0.5, (0.1, 0.2, 0.3))
    setpoint = MotionReference(truth).setpoint()
    assert setpoint[:9] == (1.0, 2.0, -3.0, 4.0, 5.0, 6.0, 0.1, 0.2, 0.3)
    assert setpoint.yaw_rad == pytest.approx(0.5)


@pytest.mark.parametrize(
    "target_ned_m",
    [(20.0, 0.0, 0.0), (0.0, -20.0, 0.0), (0.0, 0.0, -10.0), (5.0, 5.0, -5.0), (0.2, 0.0, 0.0)],
)
def test_it_comes_to_rest_at_the_target_within_the_limits(target_ned_m: Vector) -> None:
    setpoints = flown_to(target_ned_m)
    for setpoint in setpoints:
        horizontal_mps = math.hypot(setpoint.velocity_north_mps, setpoint.velocity_east_mps)
        assert horizontal_mps <= 5.0 + 0.2
        assert abs(setpoint.velocity_down_mps) <= 2.0 + 0.2
        push_mps2 = math.hypot(setpoint.acceleration_north_mps2, setpoint.acceleration_east_mps2)
        assert push_mps2 <= LIMITS.acceleration_horizontal_mps2 + 1e-6
        assert abs(setpoint.acceleration_down_mps2) <= LIMITS.acceleration_vertical_mps2 + 1e-6
        jerk = (setpoint.jerk_north_mps3, setpoint.jerk_east_mps3, setpoint.jerk_down_mps3)
        assert math.hypot(*jerk) <= LIMITS.jerk_mps3 + 1e-6


@pytest.mark.parametrize("target_ned_m", [(20.0, 0.0, 0.0), (0.0, 0.0, -10.0)])
def test_it_does_not_overshoot_by_more_than_a_hand(target_ned_m: Vector) -> None:
    farthest_m = max(math.hypot(*setpoint[:3]) for setpoint in flown_to(target_ned_m))
    assert farthest_m < math.hypot(*target_ned_m) + 0.1


def test_successive_setpoints_are_one_motion() -> None:
    for before, after in pairwise(flown_to((10.0, 4.0, -3.0), 20.0)):
        # Position after a period follows from the state before and the jerk applied in between.
        reached_m = (
            before.north_m
            + STEP_S * before.velocity_north_mps
            + STEP_S**2 / 2.0 * before.acceleration_north_mps2
            + STEP_S**3 / 6.0 * after.jerk_north_mps3
        )
        assert after.north_m == pytest.approx(reached_m, abs=1e-9)


@given(north_mps=speeds, east_mps=speeds, down_mps=speeds)
@settings(max_examples=40)
def test_it_reaches_any_velocity_it_is_steered_to(
    north_mps: float, east_mps: float, down_mps: float
) -> None:
    reference = MotionReference(truth_at())
    for _ in range(500):
        reference.steer((north_mps, east_mps, down_mps), LIMITS, STEP_S)
    setpoint = reference.setpoint()
    assert setpoint[3:6] == pytest.approx((north_mps, east_mps, down_mps), abs=0.02)


def test_braking_ends_at_rest_without_reversing() -> None:
    reference = MotionReference(truth_at(velocity_ned_mps=(5.0, 0.0, 0.0)))
    slowest_mps = math.inf
    for _ in range(500):
        reference.steer((0.0, 0.0, 0.0), LIMITS, STEP_S)
        slowest_mps = min(slowest_mps, reference.setpoint().velocity_north_mps)
    assert reference.speed_mps < 0.02
    assert slowest_mps > -0.15


def test_a_moving_reference_is_not_at_its_target() -> None:
    reference = MotionReference(truth_at(velocity_ned_mps=(1.0, 0.0, 0.0)))
    assert not reference.is_at((0.0, 0.0, 0.0))
    assert MotionReference(truth_at()).is_at((0.05, 0.0, 0.0))
    assert not MotionReference(truth_at()).is_at((0.2, 0.0, 0.0))
