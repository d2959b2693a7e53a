"""The certifier accepts what is safe, rejects what is not, and says by how much."""

from __future__ import annotations

import dataclasses
import itertools
import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.geometry.box import Box
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import State, Trajectory
from onboard.planning.certifier import certify_avoidance, certify_clear
from onboard.planning.closed_form import brake_to_hover, vertex_manoeuvre
from onboard.planning.problem import AvoidanceProblem, Envelope
from tests.onboard.planning.avoidance_cases import Variety, draw

VARIETY = Variety(passive_safety=True)


def certified(seed: int) -> tuple[AvoidanceProblem, Trajectory]:
    """A problem and a plan that certifies."""
    problem = draw(Random(seed), VARIETY)
    for side in ("left", "right"):
        trajectory = vertex_manoeuvre(problem, side)
        if trajectory is not None and certify_avoidance(trajectory, problem).valid:
            return problem, trajectory
    pytest.fail("the closed form should exist")


PLANS = st.integers(0, 10**6).map(certified)


def altered(trajectory: Trajectory, **changes: object) -> Trajectory:
    return dataclasses.replace(trajectory, **changes)  # type: ignore[arg-type]  # array fields


@given(PLANS, st.sampled_from([0, 1, 2]), st.floats(1e-4, 5.0), st.booleans())
def test_rejects_a_shifted_plan(
    plan: tuple[AvoidanceProblem, Trajectory], axis: int, shift_m: float, back: bool
) -> None:
    problem, trajectory = plan
    position = trajectory.position_leg_m.copy()
    position[:, axis] += -shift_m if back else shift_m
    assert not certify_avoidance(altered(trajectory, position_leg_m=position), problem).valid


@given(PLANS, st.floats(0.5, 2.0).filter(lambda factor: abs(factor - 1.0) > 1e-3))
def test_rejects_a_scaled_plan(plan: tuple[AvoidanceProblem, Trajectory], factor: float) -> None:
    problem, trajectory = plan
    scaled = Trajectory(
        trajectory.start_s,
        trajectory.durations_s,
        *(array * factor for array in trajectory.motion),
    )
    assert not certify_avoidance(scaled, problem).valid


@given(PLANS, st.floats(0.5, 2.0).filter(lambda factor: abs(factor - 1.0) > 1e-3))
def test_rejects_a_plan_flown_faster_or_slower(
    plan: tuple[AvoidanceProblem, Trajectory], factor: float
) -> None:
    """Time-warped consistently, so that every piece still joins the next."""
    problem, trajectory = plan
    warped = Trajectory(
        trajectory.start_s,
        trajectory.durations_s * factor,
        *(array / factor**order for order, array in enumerate(trajectory.motion)),
    )
    assert not certify_avoidance(warped, problem).valid


@given(PLANS)
def test_rejects_swapped_axes(plan: tuple[AvoidanceProblem, Trajectory]) -> None:
    problem, trajectory = plan
    swapped = (array[:, [1, 0, 2]] for array in trajectory.motion)
    mirrored = Trajectory(trajectory.start_s, trajectory.durations_s, *swapped)
    assert not certify_avoidance(mirrored, problem).valid


@given(PLANS, st.data())
def test_rejects_a_flipped_jerk(
    plan: tuple[AvoidanceProblem, Trajectory], data: st.DataObject
) -> None:
    problem, trajectory = plan
    changes = np.abs(trajectory.jerk_leg_mps3) * trajectory.durations_s[:, None]
    pieces, axes = np.nonzero(changes > 1e-3)
    pick = data.draw(st.integers(0, len(pieces) - 1))
    jerk = trajectory.jerk_leg_mps3.copy()
    jerk[pieces[pick], axes[pick]] *= -1.0
    assert not certify_avoidance(altered(trajectory, jerk_leg_mps3=jerk), problem).valid


@given(PLANS, st.sampled_from([0, 1]), st.floats(1.02, 3.0))
def test_rejects_a_plan_for_a_stronger_vehicle(
    plan: tuple[AvoidanceProblem, Trajectory], axis: int, factor: float
) -> None:
    problem, trajectory = plan
    peak = np.abs(trajectory.acceleration_leg_mps2[:, axis]).max()
    w = problem.envelope.limits
    weak = float(peak) / factor
    if weak < 1e-3:
        return
    brake, forward, left, right = w.brake_mps2, w.forward_mps2, w.left_mps2, w.right_mps2
    limits = (
        AccelerationLimits(weak, weak, left, right)
        if axis == 0
        else AccelerationLimits(brake, forward, weak, weak)
    )
    envelope = dataclasses.replace(problem.envelope, limits=limits)
    certificate = certify_avoidance(trajectory, dataclasses.replace(problem, envelope=envelope))
    assert any("acceleration limit" in text or "braking" in text for text in certificate.failures)


@given(PLANS, st.floats(1e-3, 3.0))
def test_rejects_another_start(plan: tuple[AvoidanceProblem, Trajectory], later_s: float) -> None:
    problem, trajectory = plan
    certificate = certify_avoidance(altered(trajectory, start_s=problem.start_s + later_s), problem)
    assert [text for text in certificate.failures if text.startswith("start: late or early")]


def agrees_with_sampling(trajectory: Trajectory, box: Box) -> None:
    """The slow oracle: 4,000 points."""
    envelope = Envelope(AccelerationLimits(9.0, 9.0, 9.0, 9.0), 60.0, (99.0,) * 3, 99.0)
    start = trajectory.sample(trajectory.start_s)
    certificate = certify_clear(trajectory, start, trajectory.start_s, envelope, [box])
    entered = [text for text in certificate.failures if text.startswith("inside")]
    depths_m = []
    for time_s in np.linspace(trajectory.start_s, trajectory.end_s, 4000):
        x_m, y_m, _ = trajectory.sample(float(time_s)).position_leg_m
        depths_m.append(
            min(x_m - box.x_min_m, box.x_max_m - x_m, y_m - box.y_min_m, box.y_max_m - y_m)
        )
    if max(depths_m) > 2e-6:
        assert entered
    # Between samples the path moves on by millimetres; a dip deeper than that is seen.
    elif entered:
        assert max(depths_m) > -0.02


@given(PLANS, st.floats(-3.0, 9.0), st.floats(-4.0, 4.0), st.floats(0.05, 3.0))
def test_clearance_agrees_with_dense_sampling(
    plan: tuple[AvoidanceProblem, Trajectory], x_m: float, y_m: float, size_m: float
) -> None:
    agrees_with_sampling(plan[1], Box(x_m, x_m + size_m, y_m, y_m + size_m / 2.0))


def test_finds_a_box_between_nodes_that_sampling_of_nodes_misses() -> None:
    arc = Trajectory.from_profiles(
        0.0,
        Profile(0.0, 2.0, (Segment(2.0, 0.0),)),
        Profile(0.0, 2.0, (Segment(2.0, -2.0),)),
        Profile(0.0, 0.0),
    )
    envelope = Envelope(AccelerationLimits(9.0, 9.0, 9.0, 9.0), 60.0, (math.inf,) * 3, 9.0)
    start = arc.sample(0.0)
    pebble = Box(1.999, 2.001, 0.999, 1.001)
    certificate = certify_clear(arc, start, 0.0, envelope, [pebble])
    assert len(certificate.failures) == 1
    assert certificate.failures[0].startswith("inside the keep-out box 0")
    assert "at 1.000 s" in certificate.failures[0]
    above = Box(1.9, 2.1, 1.0, 1.2)
    assert certify_clear(arc, start, 0.0, envelope, [above]).valid


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    "quantity", ["position_leg_m", "velocity_leg_mps", "acceleration_leg_mps2"]
)
def test_every_jump_between_pieces_is_found(axis: int, quantity: str) -> None:
    problem, trajectory = certified(4)
    array = getattr(trajectory, quantity).copy()
    array[3, axis] += 1e-4
    certificate = certify_avoidance(altered(trajectory, **{quantity: array}), problem)
    name = quantity.partition("_")[0]
    clause = f"{name} jumps on {'xyz'[axis]} by 0.0001"
    assert any(text.startswith(clause) for text in certificate.failures)


def test_thrust_counts_in_a_climb() -> None:
    climbing = Trajectory.from_profiles(
        0.0, Profile(0.0, 0.0), Profile(0.0, 0.0), Profile(0.0, 0.0, (Segment(1.0, -3.0),))
    )
    limits = AccelerationLimits(1.0, 1.0, 1.0, 1.0)
    weak = Envelope(limits, GRAVITY_MPS2 + 2.5, (math.inf,) * 3, 3.0)
    start = climbing.sample(0.0)
    failures = certify_clear(climbing, start, 0.0, weak).failures
    assert failures[0] == "thrust limit exceeded by 0.5 m/s² at 0.000 s"
    strong = dataclasses.replace(weak, thrust_max_mps2=GRAVITY_MPS2 + 3.0)
    assert certify_clear(climbing, start, 0.0, strong).valid


@given(st.floats(-4.0, 3.0), st.floats(0.9, 1.1).filter(lambda share: abs(share - 1.0) > 1e-5))
def test_climbing_buys_agility_and_descending_costs_it(z_mps2: float, share: float) -> None:
    limits = AccelerationLimits(2.0, 2.0, 1.5, 1.5)
    lift = 1.0 - z_mps2 / GRAVITY_MPS2
    pushing = Trajectory.from_profiles(
        0.0,
        Profile(0.0, 1.0),
        Profile(0.0, 0.0, (Segment(0.5, 1.5 * lift * share),)),
        Profile(0.0, 0.0, (Segment(0.5, z_mps2),)),
    )
    envelope = Envelope(limits, 40.0, (math.inf,) * 3, 3.0)
    valid = certify_clear(pushing, pushing.sample(0.0), 0.0, envelope).valid
    assert valid == (share < 1.0)


@pytest.mark.parametrize("trim_mps2", [0.0, 0.5])
@given(st.floats(-4.0, 3.0), st.floats(0.9, 1.1).filter(lambda share: abs(share - 1.0) > 1e-5))
def test_what_the_wind_takes_does_not_shrink_with_the_lift(
    trim_mps2: float, z_mps2: float, share: float
) -> None:
    """Plan and trim together stay within the tilt: the whole box, 2 m/s² in level flight."""
    limits = AccelerationLimits(*[2.0 - trim_mps2] * 4)
    allowed_mps2 = 2.0 * (1.0 - z_mps2 / GRAVITY_MPS2) - trim_mps2
    pushing = Trajectory.from_profiles(
        0.0,
        Profile(0.0, 1.0),
        Profile(0.0, 0.0, (Segment(0.5, allowed_mps2 * share),)),
        Profile(0.0, 0.0, (Segment(0.5, z_mps2),)),
    )
    envelope = Envelope(limits, 40.0, (math.inf,) * 3, 3.0, trim_mps2)
    valid = certify_clear(pushing, pushing.sample(0.0), 0.0, envelope).valid
    assert valid == (share < 1.0)


def test_thrust_carries_the_wind_as_well() -> None:
    """Climbing at 3 m/s² and pushing at 1.5 m/s², with 0.8 m/s² of trim in the same direction."""
    pushing = Trajectory.from_profiles(
        0.0,
        Profile(0.0, 0.0),
        Profile(0.0, 0.0, (Segment(0.5, 1.5),)),
        Profile(0.0, 0.0, (Segment(0.5, -3.0),)),
    )
    needed_mps2 = math.hypot(1.5 + 0.8, GRAVITY_MPS2 + 3.0)
    for thrust_mps2, valid in ((needed_mps2 + 0.01, True), (needed_mps2 - 0.01, False)):
        limits = AccelerationLimits(*[2.0] * 4)
        envelope = Envelope(limits, thrust_mps2, (math.inf,) * 3, 3.0, 0.8)
        failures = certify_clear(pushing, pushing.sample(0.0), 0.0, envelope).failures
        assert any(text.startswith("thrust limit exceeded") for text in failures) is not valid
        still = dataclasses.replace(envelope, trim_mps2=0.0)
        assert envelope.climb_acceleration_mps2 < still.climb_acceleration_mps2


def test_coasting_reach_agrees_with_dense_sampling() -> None:
    """Passive safety: exact, so the largest coast time that certifies is the sampled one."""
    for seed in range(20):
        problem, trajectory = certified(seed)
        w, room = problem.envelope.limits, problem.region.manoeuvre
        slack_m = math.inf
        coast_s = problem.coast_time_s
        for time_s in np.linspace(trajectory.start_s, trajectory.end_s, 4000):
            state = trajectory.sample(float(time_s))
            y_m, v_mps = state.position_leg_m[1], state.velocity_leg_mps[1]
            if v_mps >= 0.0:
                reach_m = y_m + v_mps * coast_s + v_mps * v_mps / (2.0 * w.left_mps2)
                slack_m = min(slack_m, room.y_max_m - reach_m)
            if v_mps <= 0.0:
                reach_m = y_m + v_mps * coast_s - v_mps * v_mps / (2.0 * w.right_mps2)
                slack_m = min(slack_m, reach_m - room.y_min_m)
        for change_m, valid in ((-1e-3, True), (+1e-3, False)):
            inset_m = slack_m + change_m
            tight = dataclasses.replace(
                problem.region,
                manoeuvre=Box(
                    room.x_min_m,
                    room.x_max_m,
                    room.y_min_m + inset_m,
                    room.y_max_m - inset_m,
                ),
            )
            certificate = certify_avoidance(trajectory, dataclasses.replace(problem, region=tight))
            coasts = [text for text in certificate.failures if "coasting" in text]
            assert (not coasts) == valid


def test_every_clause_of_the_region_is_checked() -> None:
    problem, trajectory = certified(8)
    region = problem.region
    y_low_m, y_high_m = trajectory.position_range_m(1)
    changes: list[tuple[dict[str, object], str]] = [
        ({"lane_left_m": y_low_m + 0.01}, "left of the lane by 0.01 m"),
        ({"lane_right_m": y_high_m - 0.01}, "right of the lane by 0.01 m"),
    ]
    for change, text in changes:
        narrowed = dataclasses.replace(region, **change)  # type: ignore[arg-type]  # one float
        certificate = certify_avoidance(trajectory, dataclasses.replace(problem, region=narrowed))
        assert certificate.failures == (text,)
    shorter = dataclasses.replace(
        region, manoeuvre=dataclasses.replace(region.manoeuvre, x_max_m=region.x_pob_m - 0.01)
    )
    failures = certify_avoidance(trajectory, dataclasses.replace(problem, region=shorter)).failures
    assert failures[0] == "beyond the post-obstacle border by 0.01 m"
    slower = dataclasses.replace(problem, exit_speed_mps=problem.exit_speed_mps - 0.1)
    failures = certify_avoidance(trajectory, slower).failures
    assert [text.partition(" by ")[0] for text in failures] == ["exit: speed differs"]


def test_a_hover_is_clear_of_boxes_beside_it() -> None:
    envelope = Envelope(AccelerationLimits(2.0, 2.0, 2.0, 2.0), 20.0, (9.0,) * 3, 3.0)
    start = State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    hover = brake_to_hover(start, 0.0, envelope)
    for x_sign, y_sign in itertools.product((-1, 1), repeat=2):
        corner = sorted((0.0, x_sign)), sorted((0.0, y_sign))
        box = Box(corner[0][0], corner[0][1], corner[1][0], corner[1][1])
        assert certify_clear(hover, start, 0.0, envelope, [box]).valid
        assert not certify_clear(hover, start, 0.0, envelope, [box.inflated(1e-4)]).valid
