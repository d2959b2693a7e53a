"""The closed forms exist wherever the contract holds, and certify."""

from __future__ import annotations

import dataclasses
import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.motion.trajectory import State, X
from onboard.planning.certifier import certify_avoidance, certify_clear
from onboard.planning.closed_form import brake_to_hover, cruise, stop_at, vertex_manoeuvre
from onboard.planning.problem import AvoidanceProblem, Envelope, Side
from tests.onboard.contract.ideal_encounter import ideal_encounter
from tests.onboard.planning.avoidance_cases import Variety, draw

VARIETIES = [
    Variety(),
    Variety(lag=False),
    Variety(drift=False),
    Variety(lopsided=True),
    Variety(lopsided=True, lag=False),
    Variety(speeding_up=True),
    Variety(passive_safety=True),
    Variety(lopsided=True, passive_safety=True, speeding_up=True),
]
CASES = 250

ENVELOPE = Envelope(AccelerationLimits(2.0, 1.5, 2.5, 2.2), 16.0, (8.0, 9.0, 6.0), 4.0)


@pytest.mark.parametrize("variety", VARIETIES, ids=str)
def test_exists_and_certifies_from_every_precondition(variety: Variety) -> None:
    rng = Random(17)
    for number in range(CASES):
        problem = draw(rng, variety)
        failures: list[str] = []
        for side in ("left", "right"):
            trajectory = vertex_manoeuvre(problem, side)
            if trajectory is None:
                failures.append(f"{side}: none")
                continue
            certificate = certify_avoidance(trajectory, problem)
            if certificate.valid:
                break
            failures += certificate.failures
        else:
            pytest.fail(f"case {number}: {failures}\n{problem}")


def test_never_reverses_from_any_speed() -> None:
    """The paper's policy, full braking until clear, would: erratum 10."""
    rng = Random(5)
    reversed_by_the_paper = 0
    for _ in range(CASES):
        problem = draw(rng, Variety(lag=False))
        for side in ("left", "right"):
            trajectory = vertex_manoeuvre(problem, side)
            if trajectory is None:
                continue
            assert trajectory.velocity_range_mps(X)[0] >= -1e-9
            sidestep = problem.sidestep(side)
            way_m = max(sidestep.face_m - sidestep.start.position_m, 0.0)
            u, v_mps = sidestep.limits.acceleration_max_mps2, sidestep.start.velocity_mps
            clear_s = (math.sqrt(v_mps * v_mps + 2.0 * u * way_m) - v_mps) / u
            braked_mps = problem.envelope.limits.brake_mps2 * clear_s
            reversed_by_the_paper += problem.start.velocity_leg_mps[X] < braked_mps
    assert reversed_by_the_paper > CASES // 10


def test_without_jerk_limit_and_slack_it_is_the_vertex_of_theorem_1() -> None:
    limits = AccelerationLimits(2.0, 2.0, 1.0, 1.0)
    encounter = ideal_encounter(limits, 4.0, (1.0, 2.0))
    region = RegionOfInfluence.around(Box(0.0, 1.0, -1.0, 1.0), encounter)
    start = State((region.approach_x_m, 0.0, 0.0), (4.0, 0.0, 0.0))
    envelope = Envelope(limits, 20.0, (math.inf,) * 3, 4.0)
    problem = AvoidanceProblem(start, 0.0, region, envelope, exit_speed_mps=4.0)
    trajectory = vertex_manoeuvre(problem, "right")
    assert trajectory is not None
    clear_s = math.sqrt(2.0)
    for time_s in (0.0, 0.5, clear_s - 1e-3):
        assert trajectory.sample(time_s).acceleration_leg_mps2 == pytest.approx((-2.0, 1.0, 0.0))
    clear = trajectory.sample(clear_s)
    assert clear.position_leg_m[:2] == pytest.approx((0.0, 1.0), abs=1e-5)


def test_no_manoeuvre_from_inside_the_collision_set() -> None:
    rng = Random(3)
    for _ in range(CASES):
        problem = draw(rng, Variety(lag=False, drift=False))
        problem = dataclasses.replace(problem, exit_speed_mps=problem.envelope.speed_max_mps)
        region, envelope = problem.region, problem.envelope
        # Half the depth of the worst point of the face, at full speed.
        w = envelope.limits
        face = region.obstacle
        worst_y_m = (w.left_mps2 * face.y_max_m + w.right_mps2 * face.y_min_m) / (
            w.left_mps2 + w.right_mps2
        )
        x_m = region.keep_out.x_min_m - region.collision_set_depth_m / 2.0
        inside = State((x_m, worst_y_m, 0.0), (envelope.speed_max_mps, 0.0, 0.0))
        doomed = dataclasses.replace(problem, start=inside)
        assert vertex_manoeuvre(doomed, "left") is None
        assert vertex_manoeuvre(doomed, "right") is None


def states() -> st.SearchStrategy[State]:
    """Anything a plan may be in the middle of, level."""
    return st.builds(
        lambda vx, vy, ax, ay: State((3.0, -1.0, -0.5), (vx, vy, 0.0), (ax, ay, 0.0)),
        st.floats(0.5, 3.5),
        st.floats(-2.0, 2.0),
        st.floats(-1.0, 1.0),
        st.floats(-2.0, 2.0),
    )


@given(states())
def test_brakes_to_hover_and_stays(start: State) -> None:
    trajectory = brake_to_hover(start, 5.0, ENVELOPE)
    assert certify_clear(trajectory, start, 5.0, ENVELOPE).valid
    assert trajectory.final.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    long_after = trajectory.sample(trajectory.end_s + 100.0)
    assert long_after.position_leg_m == pytest.approx(trajectory.final.position_leg_m, abs=1e-6)


@given(st.floats(0.0, 4.0))
def test_braking_distance_is_that_of_theory_e(speed_mps: float) -> None:
    start = State((0.0, 0.0, 0.0), (speed_mps, 0.0, 0.0))
    stopped_m = brake_to_hover(start, 0.0, ENVELOPE).final.position_leg_m[X]
    lag_s = ENVELOPE.limits.brake_mps2 / ENVELOPE.jerk_max_mps3[X]
    ideal_m = speed_mps * speed_mps / (2.0 * ENVELOPE.limits.brake_mps2)
    assert ideal_m - 1e-9 <= stopped_m <= ideal_m + speed_mps * lag_s + 1e-9


@given(states(), st.floats(0.2, 3.5), st.floats(-3.0, 0.0))
def test_cruise_takes_up_speed_and_height(start: State, speed_mps: float, z_m: float) -> None:
    trajectory = cruise(start, 5.0, ENVELOPE, speed_mps, z_m=z_m)
    final = trajectory.final
    assert final.velocity_leg_mps == pytest.approx((speed_mps, 0.0, 0.0), abs=1e-9)
    assert final.position_leg_m[2] == pytest.approx(z_m, abs=1e-6)
    level = cruise(start, 5.0, ENVELOPE, speed_mps)
    assert certify_clear(level, start, 5.0, ENVELOPE).valid


@given(states(), st.floats(0.0, 60.0))
def test_stops_at_the_goal_or_says_it_cannot(start: State, ahead_m: float) -> None:
    goal_m = start.position_leg_m[X] + ahead_m
    trajectory = stop_at(start, 5.0, ENVELOPE, goal_m, 3.8)
    braked_m = brake_to_hover(start, 5.0, ENVELOPE).final.position_leg_m[X]
    if trajectory is None:
        assert goal_m < braked_m
        return
    assert goal_m >= braked_m - 1e-6
    assert certify_clear(trajectory, start, 5.0, ENVELOPE).valid
    assert trajectory.final.position_leg_m[X] == pytest.approx(goal_m, abs=1e-6)
    assert trajectory.final.velocity_leg_mps[X] == pytest.approx(0.0, abs=1e-9)


@given(states(), st.floats(0.0, 4.0))
def test_cruising_speeds_up_with_half_the_limit_and_brakes_with_all(
    start: State, speed_mps: float
) -> None:
    start = start._replace(
        velocity_leg_mps=(*start.velocity_leg_mps[:2], 0.0), acceleration_leg_mps2=(0.0, 0.0, 0.0)
    )
    trajectory = cruise(start, 3.0, ENVELOPE, speed_mps)
    along_mps2 = np.concatenate((trajectory.acceleration_leg_mps2, trajectory.ends[2]))[:, X]
    assert along_mps2.max() <= ENVELOPE.limits.forward_mps2 / 2.0 + 1e-9
    assert along_mps2.min() >= -ENVELOPE.limits.brake_mps2 - 1e-9
    assert trajectory.final.velocity_leg_mps == pytest.approx((speed_mps, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("y_m", [-3.0, -0.2, 0.2, 3.0])
def test_a_drift_ends_on_the_line_at_no_more_than_its_speed(y_m: float) -> None:
    start = State((0.0, y_m, 0.0), (2.0, 0.0, 0.0))
    trajectory = stop_at(start, 0.0, ENVELOPE, 80.0, 2.0, recentring_mps=0.4)
    assert trajectory is not None
    low_mps, high_mps = trajectory.velocity_range_mps(1)
    assert max(-low_mps, high_mps) <= 0.4 + 1e-6
    assert trajectory.final.position_leg_m[1] == pytest.approx(0.0, abs=1e-3)
    assert trajectory.final.position_leg_m[X] == pytest.approx(80.0, abs=1e-3)
    across_mps2 = np.abs(trajectory.acceleration_leg_mps2[:, 1]).max()
    assert across_mps2 <= 0.4 + 1e-9  # the speed, in a second


def test_without_a_drift_it_comes_to_rest_beside_the_line() -> None:
    start = State((0.0, 1.0, 0.0), (2.0, 0.5, 0.0))
    trajectory = stop_at(start, 0.0, ENVELOPE, 80.0, 2.0)
    assert trajectory is not None
    assert trajectory.final.position_leg_m[1] > 1.0
    assert trajectory.final.velocity_leg_mps[1] == pytest.approx(0.0, abs=1e-9)


def test_stopping_is_refused_where_there_is_no_room() -> None:
    start = State((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))
    least_m = brake_to_hover(start, 0.0, ENVELOPE).final.position_leg_m[X]
    assert stop_at(start, 0.0, ENVELOPE, least_m - 1e-3, 4.0) is None
    assert stop_at(start, 0.0, ENVELOPE, least_m + 1e-3, 4.0) is not None


def test_settling_in_height_takes_its_part_of_the_box() -> None:
    """While it accelerates downwards, less horizontal acceleration is left."""
    start = State((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))
    level = cruise(start, 0.0, ENVELOPE, 0.0)
    sinking = cruise(start, 0.0, ENVELOPE, 0.0, z_m=2.0)
    assert sinking.final.position_leg_m[2] == pytest.approx(2.0, abs=1e-3)
    weakest = sinking.acceleration_leg_mps2[:, X].min()
    assert level.acceleration_leg_mps2[:, X].min() < weakest < 0.0
    assert certify_clear(sinking, start, 0.0, ENVELOPE).valid


@given(st.integers(0, 3000), st.sampled_from(["left", "right"]))
def test_a_manoeuvre_passes_on_its_side(seed: int, side: Side) -> None:
    problem = draw(Random(seed), Variety(drift=False))
    trajectory = vertex_manoeuvre(problem, side)
    if trajectory is None:
        return
    face = problem.region.keep_out
    for time_s in np.linspace(trajectory.start_s, trajectory.end_s, 200).tolist():
        x_m, y_m, _ = trajectory.sample(time_s).position_leg_m
        if face.x_min_m + 1e-6 < x_m < face.x_max_m - 1e-6:
            beyond_m = face.y_min_m - y_m if side == "left" else y_m - face.y_max_m
            assert beyond_m >= -1e-6
