"""The Region of Influence against brute force: nobody inside escapes, everybody outside is safe."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.contract.region import Encounter, RegionOfInfluence, boundary_depth_at
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.double_integrator import Flight, Loss, Start, fly, steps_of_notice
from tests.onboard.contract.ideal_encounter import ideal_encounter

ACCELERATIONS_MPS2 = st.floats(0.8, 6.0)
LIMITS = st.builds(AccelerationLimits, *[ACCELERATIONS_MPS2] * 4)

# Steps that a vehicle needs to stop or to clear the face; what a step moves is tolerated.
STEPS = 200

# Shrinking a failure would repeat a slow simulation a thousand times.
SIMULATED = settings(max_examples=8, phases=(Phase.explicit, Phase.reuse, Phase.generate))


def encounter(
    limits: AccelerationLimits, speed_mps: float, size_m: tuple[float, float]
) -> tuple[Box, Encounter[float], float]:
    """Return an obstacle, the ideal encounter with it, and a step for simulating it."""
    obstacle = Box(50.0, 50.0 + size_m[0], -0.3 * size_m[1], 0.7 * size_m[1])
    e = ideal_encounter(limits, speed_mps, size_m)
    clearing_s = math.sqrt(2.0 * size_m[1] / (limits.left_mps2 + limits.right_mps2))
    return obstacle, e, min(clearing_s, speed_mps / limits.brake_mps2) / STEPS


def starts(region: RegionOfInfluence, speed_mps: float, random: np.random.Generator) -> Start:
    """Vehicles at the front of the region: anywhere that lies ahead, any speed and drift."""
    obstacle, count = region.obstacle, 48
    # On the very edge, round-off decides whether a drifting vehicle meets the face at all.
    low_m = obstacle.y_min_m - region.drift_left_m + 1e-3
    high_m = obstacle.y_max_m + region.drift_right_m - 1e-3
    y_m = random.uniform(low_m, high_m, count)
    y_m[:3] = low_m, (low_m + high_m) / 2.0, high_m
    speeds_mps = speed_mps * np.where(
        np.arange(count) % 2 == 0, 1.0, random.uniform(0.2, 1.0, count)
    )
    drifts_mps = region.lateral_speed_mps * random.choice((-1.0, 0.0, 1.0), count)
    return Start(np.full(count, region.extent.x_min_m), y_m, speeds_mps, drifts_mps)


def assert_avoided(
    flight: Flight, region: RegionOfInfluence, e: Encounter[float], step_s: float
) -> None:
    """No contact, inside the lane, forwards, and recovered by the border, but for the steps."""
    ratio = max(e.left_mps2 / e.right_mps2, e.right_mps2 / e.left_mps2)
    both_mps2 = e.left_mps2 + e.right_mps2
    lateral_mps = 2.0 * (math.sqrt(2.0 * e.size_across_m * both_mps2) + e.lateral_speed_mps)
    slack_m = 4.0 * lateral_mps * step_s * (1.0 + ratio)
    assert not flight.touched.any()
    assert not flight.backwards.any()
    assert (flight.leftmost_m >= region.lane_left_m - slack_m).all()
    assert (flight.rightmost_m <= region.lane_right_m + slack_m).all()
    steps = 8.0 * (1.0 + ratio + e.brake_mps2 / e.forward_mps2)
    late_m = flight.recovered_x_m - region.x_pob_m
    assert (late_m <= steps * step_s * e.speed_mps).all()


@SIMULATED
@given(LIMITS, st.floats(0.8, 9.0), st.floats(0.3, 6.0), st.integers(0, 2**32))
def test_from_outside_a_safe_manoeuvre_exists(
    limits: AccelerationLimits, speed_mps: float, size_m: float, seed: int
) -> None:
    """Start at the front of the region, at any speed: Theorem 1's policy meets Eq. 14."""
    obstacle, e, step_s = encounter(limits, speed_mps, (0.5, size_m))
    e = e._replace(reaction_time_s=2.0 * steps_of_notice(limits) * step_s)
    region = RegionOfInfluence.around(obstacle, e)
    flight = fly(
        starts(region, speed_mps, np.random.default_rng(seed)), obstacle, limits, step_s=step_s
    )
    assert_avoided(flight, region, e, step_s)


@SIMULATED
@given(
    LIMITS,
    st.floats(0.8, 9.0),
    st.floats(0.3, 6.0),
    st.floats(0.0, 2.5),
    st.floats(0.0, 1.0),
    st.integers(0, 2**32),
)
def test_from_outside_with_drift_and_lag(
    limits: AccelerationLimits,
    speed_mps: float,
    size_m: float,
    drift_mps: float,
    lag_share: float,
    seed: int,
) -> None:
    """Theory A and D, with asymmetric limits too: all inputs act late, all events are seen late."""
    obstacle, e, step_s = encounter(limits, speed_mps, (0.5, size_m))
    lag_s = round(lag_share * STEPS / 2) * step_s
    e = e._replace(
        lateral_speed_mps=drift_mps,
        attitude_lag_s=lag_s,
        reaction_time_s=2.0 * steps_of_notice(limits) * step_s,
    )
    region = RegionOfInfluence.around(obstacle, e)
    random = np.random.default_rng(seed)
    flight = fly(starts(region, speed_mps, random), obstacle, limits, step_s=step_s, lag_s=lag_s)
    assert_avoided(flight, region, e, step_s)


@SIMULATED
@given(
    LIMITS,
    st.floats(0.8, 6.0),
    st.floats(0.3, 4.0),
    st.floats(0.0, 0.5),
    st.floats(0.0, 1.5),
    st.integers(0, 2**32),
)
def test_a_dead_daemon_does_no_harm(
    limits: AccelerationLimits,
    speed_mps: float,
    size_m: float,
    drift_mps: float,
    coast_s: float,
    seed: int,
) -> None:
    """Theory H: the stream stops at any instant; nothing is touched, nobody leaves the region."""
    obstacle, e, step_s = encounter(limits, speed_mps, (0.5, size_m))
    e = e._replace(
        lateral_speed_mps=drift_mps,
        reaction_time_s=2.0 * steps_of_notice(limits) * step_s,
        run_on_m=speed_mps * (coast_s + speed_mps / (2.0 * limits.brake_mps2)),
        coast_time_s=coast_s,
    )
    region, random = RegionOfInfluence.around(obstacle, e), np.random.default_rng(seed)
    start = starts(region, speed_mps, random)
    # From the front of the region at entry speed it is at most this long to the obstacle.
    reach_s = (region.x_pob_m - region.extent.x_min_m) / start.speed_mps
    loss = Loss(random.uniform(0.0, 1.0, len(start.x_m)) * reach_s, coast_s)
    flight = fly(
        start,
        obstacle,
        limits,
        step_s=step_s,
        keep_clear_m=e.run_on_m,
        loss=loss,
    )
    assert not flight.touched.any()
    slack_m = steps_of_notice(limits) * 8.0 * step_s * e.speed_mps
    assert (flight.leftmost_m >= region.extent.y_min_m - slack_m).all()
    assert (flight.rightmost_m <= region.extent.y_max_m + slack_m).all()


def test_without_passive_safety_a_dead_daemon_collides() -> None:
    """The same plan against the bare obstacle: 1 s of coasting at 2.8 m/s covers the 1.5 m left."""
    limits = AccelerationLimits(2.6276, 2.6276, 2.6276, 2.6276)
    obstacle, e, step_s = encounter(limits, 2.8, (4.0, 4.0))
    region = RegionOfInfluence.around(obstacle, e)
    middle_m = np.full(50, (obstacle.y_min_m + obstacle.y_max_m) / 2.0)
    start = Start(
        np.full(50, region.extent.x_min_m - 0.2), middle_m, np.full(50, 2.8), np.zeros(50)
    )
    loss = Loss(np.linspace(0.0, 1.5, 50), 1.0)
    assert fly(start, obstacle, limits, step_s=step_s, loss=loss).touched.any()


# --- completeness: inside the collision set there is no escape


def contacts(
    inputs: FloatArray, start_x_m: FloatArray, start_y_m: FloatArray, speed_mps: float, box: Box
) -> FloatArray:
    """Whether each of many vehicles is inside the face when it first gets to it.

    Args:
        inputs: accelerations, (vehicles, steps, 2), held for equal parts of the time in which
            full braking covers the way to the face or comes to rest.
        start_x_m, start_y_m: (vehicles,).
        speed_mps: of all, along x.
        box: the obstacle.
    """
    way_m = float((box.x_min_m - start_x_m).max())
    brake_mps2 = -float(inputs[..., 0].min())
    left = max(speed_mps**2 - 2.0 * brake_mps2 * way_m, 0.0)
    step_s = (speed_mps - math.sqrt(left)) / brake_mps2 / inputs.shape[1]
    x_m, y_m = start_x_m.copy(), start_y_m.copy()
    velocity_mps = np.array([np.full_like(x_m, speed_mps), np.zeros_like(x_m)])
    touched, passed = np.zeros(len(x_m), dtype=bool), np.zeros(len(x_m), dtype=bool)
    fine_s = step_s / 8.0
    for number in range(inputs.shape[1] * 8 + 8):
        acceleration = inputs[:, min(number // 8, inputs.shape[1] - 1)].T
        before_x_m, before_y_m = x_m, y_m
        x_m = x_m + velocity_mps[0] * fine_s + acceleration[0] * fine_s**2 / 2.0
        y_m = y_m + velocity_mps[1] * fine_s + acceleration[1] * fine_s**2 / 2.0
        velocity_mps = velocity_mps + acceleration * fine_s
        arrives = (x_m >= box.x_min_m) & ~passed
        share = (box.x_min_m - before_x_m) / np.where(x_m > before_x_m, x_m - before_x_m, 1.0)
        y_at_face_m = before_y_m + np.clip(share, 0.0, 1.0) * (y_m - before_y_m)
        touched |= arrives & (box.y_min_m < y_at_face_m) & (y_at_face_m < box.y_max_m)
        passed |= arrives
    return touched


def random_inputs(
    limits: AccelerationLimits, count: int, random: np.random.Generator
) -> FloatArray:
    """Admissible inputs: the vertices of Theorem 1, bang-bang, and anything in between."""
    shares = random.uniform(-1.0, 1.0, (count, 24, 2))
    shares[: count // 3] = np.sign(shares[: count // 3])
    shares[count // 3 : count // 2, :, 0] = -1.0
    vertices = np.array([(-1.0, 1.0), (-1.0, -1.0), (1.0, 1.0), (1.0, -1.0)])
    shares[:4] = vertices[:, np.newaxis]
    least = np.array([limits.brake_mps2, limits.left_mps2])
    most = np.array([limits.forward_mps2, limits.right_mps2])
    inputs: FloatArray = np.where(shares < 0.0, shares * least, shares * most)
    return inputs


def branch_points(limits: AccelerationLimits, speed_mps: float, box: Box) -> list[float]:
    """Lateral positions where the boundary changes its formula: y', y'', y''' and the corners."""
    stop_s = speed_mps / limits.brake_mps2
    both_mps2 = limits.left_mps2 + limits.right_mps2
    points_m = [
        box.y_max_m - limits.right_mps2 * stop_s**2 / 2.0,
        box.y_min_m + limits.left_mps2 * stop_s**2 / 2.0,
        (limits.left_mps2 * box.y_max_m + limits.right_mps2 * box.y_min_m) / both_mps2,
        box.y_min_m,
        box.y_max_m,
    ]
    width_m = box.y_max_m - box.y_min_m
    return [
        y_m + share * width_m
        for y_m in points_m
        for share in (-1e-2, -1e-4, 0.0, 1e-4, 1e-2)
        if box.y_min_m < y_m + share * width_m < box.y_max_m
    ]


@st.composite
def faces(draw: st.DrawFn) -> tuple[AccelerationLimits, float, Box]:
    """An obstacle met at any speed, the one where the boundary changes its shape among them."""
    limits, size_m = draw(LIMITS), draw(st.floats(0.3, 6.0))
    threshold_mps = limits.brake_mps2 * math.sqrt(
        2.0 * size_m / (limits.left_mps2 + limits.right_mps2)
    )
    near = st.sampled_from([0.999, 0.999999, 1.0, 1.000001, 1.001])
    ratio = draw(st.one_of(near, st.floats(0.2, 3.0)))
    return limits, ratio * threshold_mps, Box(20.0, 21.0, -0.4 * size_m, 0.6 * size_m)


@SIMULATED
@given(faces(), st.integers(0, 2**32))
def test_from_inside_no_input_escapes(
    face: tuple[AccelerationLimits, float, Box], seed: int
) -> None:
    """One per cent inside the boundary, dense at its branches: every input collides."""
    limits, speed_mps, box = face
    random, count = np.random.default_rng(seed), 200
    y_m = branch_points(limits, speed_mps, box)
    y_m += random.uniform(box.y_min_m, box.y_max_m, 8).tolist()
    for each_m in y_m:
        depth_m = boundary_depth_at(each_m, box, limits, speed_mps)
        start_x_m = np.full(count, box.x_min_m - 0.99 * depth_m)
        inputs = random_inputs(limits, count, random)
        assert contacts(inputs, start_x_m, np.full(count, each_m), speed_mps, box).all()


@SIMULATED
@given(faces())
def test_just_outside_the_better_vertex_escapes(
    face: tuple[AccelerationLimits, float, Box],
) -> None:
    """One per mille outside, dense at the branches, Theorem 1's inputs clear the face or stop."""
    limits, speed_mps, box = face
    vertices = random_inputs(limits, 4, np.random.default_rng(0))[:2]
    for y_m in branch_points(limits, speed_mps, box):
        depth_m = boundary_depth_at(y_m, box, limits, speed_mps)
        start_x_m = np.full(2, box.x_min_m - 1.001 * depth_m - 1e-9)
        assert not contacts(vertices, start_x_m, np.full(2, y_m), speed_mps, box).all()
