"""The problem as planner and certifier get it: limits, sides, exit speeds and cost."""

from __future__ import annotations

import dataclasses
import math
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.motion.trajectory import State
from onboard.planning.closed_form import cruise, vertex_manoeuvre
from onboard.planning.problem import (
    DELAY_COST_M2PS4,
    AvoidanceProblem,
    Envelope,
    cost,
    exit_speeds_mps,
)
from tests.onboard.planning.avoidance_cases import Variety, draw

LIMITS = AccelerationLimits(2.0, 1.5, 2.5, 2.2)
ENVELOPE = Envelope(LIMITS, 16.0, (8.0, 9.0, 6.0), 4.0)


def envelope(**changes: Any) -> Envelope:
    return dataclasses.replace(ENVELOPE, **changes)


def test_limits_of_the_axes_are_those_of_the_box() -> None:
    assert ENVELOPE.along == (-2.0, 1.5, 8.0)
    assert ENVELOPE.across == (-2.5, 2.2, 9.0)
    assert ENVELOPE.vertical.jerk_max_mps3 == 6.0
    assert ENVELOPE.jerk_is_limited
    assert not envelope(jerk_max_mps3=(math.inf,) * 3).jerk_is_limited


@pytest.mark.parametrize("trim_mps2", [0.0, 0.4])
def test_climbing_leaves_thrust_for_every_corner_of_the_box(trim_mps2: float) -> None:
    climber = envelope(trim_mps2=trim_mps2)
    climb_mps2 = climber.climb_acceleration_mps2
    assert climb_mps2 > 0.0
    lift = 1.0 + climb_mps2 / GRAVITY_MPS2
    # The box grows with the lift; so does what the trim may take of it.
    corner = (lift * (2.0 + trim_mps2), lift * (2.5 + trim_mps2), GRAVITY_MPS2 + climb_mps2)
    assert math.hypot(*corner) == pytest.approx(16.0)
    assert climber.vertical.acceleration_min_mps2 == -climb_mps2
    assert 0.0 < climber.vertical.acceleration_max_mps2 <= 0.1 * GRAVITY_MPS2


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"thrust_max_mps2": 10.0}, "thrust_max_mps2 = 10.0 m/s² cannot hold height"),
        ({"jerk_max_mps3": (8.0, 0.0, 6.0)}, "all must be above zero"),
        ({"jerk_max_mps3": (8.0, math.nan, 6.0)}, "all must be above zero"),
        ({"speed_max_mps": 0.0}, "all must be above zero"),
        ({"speed_max_mps": -4.0}, "all must be above zero"),
    ],
)
def test_an_envelope_that_cannot_be_flown_is_refused(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        envelope(**changes)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"exit_speed_mps": 0.0}, "exit_speed_mps = 0.0 m/s"),
        ({"exit_speed_mps": 99.0}, "exit_speed_mps = 99.0 m/s"),
        ({"exit_speed_mps": math.nan}, "exit_speed_mps = nan m/s"),
        ({"climb_m": -0.1}, "climb_m"),
        ({"climb_m": math.nan}, "climb_m"),
        ({"coast_time_s": -1.0}, "coast_time_s"),
    ],
)
def test_a_problem_without_a_meaning_is_refused(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        dataclasses.replace(draw(Random(1), Variety()), **changes)


def mirrored(problem: AvoidanceProblem) -> AvoidanceProblem:
    """The same with left and right exchanged."""
    (x_m, y_m, z_m), (vx_mps, vy_mps, vz_mps), (ax, ay, az) = problem.start
    region, w = problem.region, problem.envelope.limits

    def flipped(box: Any) -> Any:
        return dataclasses.replace(box, y_min_m=-box.y_max_m, y_max_m=-box.y_min_m)

    return dataclasses.replace(
        problem,
        start=State((x_m, -y_m, z_m), (vx_mps, -vy_mps, vz_mps), (ax, -ay, az)),
        region=dataclasses.replace(
            region,
            obstacle=flipped(region.obstacle),
            keep_out=flipped(region.keep_out),
            extent=flipped(region.extent),
            manoeuvre=flipped(region.manoeuvre),
            lane_left_m=-region.lane_right_m,
            lane_right_m=-region.lane_left_m,
        ),
        envelope=dataclasses.replace(
            problem.envelope,
            limits=AccelerationLimits(w.brake_mps2, w.forward_mps2, w.right_mps2, w.left_mps2),
        ),
    )


@given(st.integers(0, 10_000))
def test_the_left_side_is_the_right_side_in_a_mirror(seed: int) -> None:
    problem = draw(Random(seed), Variety(lopsided=True, passive_safety=True))
    assert problem.sidestep("left") == mirrored(problem).sidestep("right")
    assert problem.sidestep("right") == mirrored(problem).sidestep("left")


def test_a_coast_limits_the_lateral_speed() -> None:
    problem = draw(Random(7), Variety(passive_safety=True))
    sidestep = problem.sidestep("right")
    beyond_m = problem.region.extent.y_max_m - problem.region.lane_right_m
    assert sidestep.speed_max_mps * problem.coast_time_s == pytest.approx(beyond_m)
    without = dataclasses.replace(problem, coast_time_s=0.0)
    assert without.sidestep("right").speed_max_mps == math.inf


@pytest.mark.parametrize(
    ("beyond_m", "speed_mps", "clear"),
    [(0.1, 0.0, True), (0.0, 0.3, True), (0.1, -1e-9, False), (-0.1, 1.0, False)],
)
def test_clear_is_who_is_beyond_and_not_on_the_way_back(
    beyond_m: float, speed_mps: float, *, clear: bool
) -> None:
    sidestep = draw(Random(7), Variety()).sidestep("right")
    start = sidestep.start._replace(position_m=sidestep.face_m + beyond_m, velocity_mps=speed_mps)
    assert dataclasses.replace(sidestep, start=start).is_clear is clear


@pytest.mark.parametrize(
    ("entry_mps", "expected_mps"),
    [
        (-1e-12, (2.0, 1.0)),
        (0.0, (2.0, 1.0)),
        (1e-6, (2.0, 1.0)),
        (0.99, (2.0, 1.0)),
        (1.0, (1.0,)),
        (1.7, (1.7,)),
        (2.0 + 1e-12, (2.0,)),
    ],
)
def test_the_speed_to_leave_with_is_that_of_entry_unless_it_was_slow(
    entry_mps: float, expected_mps: tuple[float, ...]
) -> None:
    assert exit_speeds_mps(entry_mps, 2.0) == expected_mps


@given(st.floats(-0.1, 5.0), st.floats(0.1, 4.0))
def test_exit_speeds_are_above_zero_and_no_faster_than_the_cruise(
    entry_mps: float, cruise_mps: float
) -> None:
    speeds_mps = exit_speeds_mps(entry_mps, cruise_mps)
    assert speeds_mps
    assert all(0.0 < speed_mps <= cruise_mps for speed_mps in speeds_mps)
    assert list(speeds_mps) == sorted(speeds_mps, reverse=True)


def test_a_flight_at_exit_speed_costs_nothing() -> None:
    problem = draw(Random(3), Variety(drift=False))
    start = problem.start._replace(
        velocity_leg_mps=(problem.exit_speed_mps, 0.0, 0.0), acceleration_leg_mps2=(0.0, 0.0, 0.0)
    )
    problem = dataclasses.replace(problem, start=start)
    way_m = problem.region.x_pob_m - start.position_leg_m[0]
    straight = cruise(start, problem.start_s, problem.envelope, problem.exit_speed_mps)
    left_s = way_m / problem.exit_speed_mps - (straight.end_s - straight.start_s)
    assert cost(straight.coasting_for(left_s), problem) == pytest.approx(0.0, abs=1e-9)
    # A second of waiting there costs a second of delay.
    late = cost(straight.coasting_for(left_s + 1.0), problem)
    assert late == pytest.approx(DELAY_COST_M2PS4)


@given(st.integers(0, 5000))
def test_the_cost_is_effort_and_delay(seed: int) -> None:
    problem = draw(Random(seed), Variety())
    trajectory = vertex_manoeuvre(problem, "right")
    if trajectory is None:
        return
    times_s = np.linspace(trajectory.start_s, trajectory.end_s, 4001)
    samples = [trajectory.sample(t).acceleration_leg_mps2 for t in times_s.tolist()]
    effort = float(np.trapezoid((np.array(samples) ** 2).sum(axis=1), times_s))
    way_m = problem.region.x_pob_m - problem.start.position_leg_m[0]
    delay_s = trajectory.end_s - trajectory.start_s - way_m / problem.exit_speed_mps
    expected = effort + DELAY_COST_M2PS4 * delay_s
    assert cost(trajectory, problem) == pytest.approx(expected, rel=2e-2, abs=2e-2)
