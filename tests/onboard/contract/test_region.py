"""The Region of Influence of one obstacle, held against brute force.

Every formula is compared with a search that knows only the double integrator: it tries starts,
inputs and switching times, and uses none of the closed forms.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.region import (
    Dimensions,
    Encounter,
    RegionOfInfluence,
    boundary_depth_at,
    dimensions,
    least_advance,
    recovery_distance,
    time_to_clear,
)
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.ideal_encounter import ideal_encounter

ACCELERATIONS_MPS2 = st.floats(0.4, 8.0)
LIMITS = st.builds(AccelerationLimits, *[ACCELERATIONS_MPS2] * 4)
SPEEDS_MPS = st.floats(0.2, 12.0)
SIZES_M = st.floats(0.1, 8.0)
DRIFTS_MPS = st.one_of(st.just(0.0), st.floats(0.0, 3.0))
LAGS_S = st.one_of(st.just(0.0), st.floats(0.0, 0.6))


@st.composite
def encounters(draw: st.DrawFn) -> Encounter[float]:
    ideal = ideal_encounter(draw(LIMITS), draw(SPEEDS_MPS), (draw(SIZES_M), draw(SIZES_M)))
    return ideal._replace(
        lateral_speed_mps=draw(DRIFTS_MPS),
        attitude_lag_s=draw(LAGS_S),
        reaction_time_s=draw(LAGS_S),
        run_on_m=draw(st.floats(0.0, 5.0)),
        coast_time_s=draw(LAGS_S),
    )


def symmetric(
    x_mps2: float, y_mps2: float, speed_mps: float, size_m: tuple[float, float]
) -> Encounter[float]:
    limits = AccelerationLimits(x_mps2, x_mps2, y_mps2, y_mps2)
    return ideal_encounter(limits, speed_mps, size_m)


def paper_box_15_deg() -> AccelerationLimits:
    """Eq. 7 at 15° with the theory's g = 9.81 m/s²."""
    tangent = math.tan(math.radians(15.0))
    y_mps2 = 9.81 * tangent / math.cos(math.radians(15.0))
    return AccelerationLimits(9.81 * tangent, 9.81 * tangent, y_mps2, y_mps2)


def crossing_times_s(distance_m: FloatArray, speed_mps: float, limit_mps2: float) -> FloatArray:
    """Time until a face ``distance_m`` away is passed for good, at full input towards it.

    Negative distances lie beyond the face; ``speed_mps`` counts towards it.  Zero where a start
    beyond the face never comes back inside.
    """
    square = speed_mps * speed_mps + 2.0 * limit_mps2 * distance_m
    times_s = (np.sqrt(np.maximum(square, 0.0)) - speed_mps) / limit_mps2
    return np.where(square > 0.0, np.maximum(times_s, 0.0), 0.0)


# --- collision set boundary


def test_checked_numbers() -> None:
    """The worked example of the theory: 15°, 2.8 m/s, a square of 4 m."""
    size = dimensions(ideal_encounter(paper_box_15_deg(), 2.8, (4.0, 4.0)), SCALAR)
    assert size.collision_set_depth_m == pytest.approx(1.4913, abs=5e-5)
    assert size.overhang_left_m == pytest.approx(1.5439, abs=5e-5)
    assert size.overhang_right_m == pytest.approx(1.5439, abs=5e-5)
    assert size.flat
    assert size.front_m == size.collision_set_depth_m
    assert size.pob_depth_m == 4.0


@given(SPEEDS_MPS, ACCELERATIONS_MPS2, st.floats(0.0, 20.0))
def test_least_advance_is_that_of_braking_and_standing(
    speed_mps: float, brake_mps2: float, time_s: float
) -> None:
    instants_s = np.linspace(0.0, time_s, 4001)
    speeds_mps = np.maximum(speed_mps - brake_mps2 * instants_s, 0.0)
    way_m = float(np.trapezoid(speeds_mps, instants_s))
    assert least_advance(speed_mps, brake_mps2, time_s, SCALAR) == pytest.approx(way_m, abs=2e-4)


@given(LIMITS, SPEEDS_MPS, SIZES_M)
def test_depth_is_the_deepest_point_of_the_boundary(
    limits: AccelerationLimits, speed_mps: float, size_m: float
) -> None:
    obstacle = Box(3.0, 4.0, -1.0, size_m - 1.0)
    size = dimensions(ideal_encounter(limits, speed_mps, (1.0, size_m)), SCALAR)
    y_m = np.linspace(obstacle.y_min_m, obstacle.y_max_m, 2001)
    depths_m = [boundary_depth_at(float(y), obstacle, limits, speed_mps) for y in y_m]
    deepest_m = max(depths_m)
    assert deepest_m <= size.collision_set_depth_m + 1e-12
    assert deepest_m == pytest.approx(size.collision_set_depth_m, rel=1e-2)
    # Flat: even from the worst point of the face the vehicle stops before it could have cleared.
    right_s = crossing_times_s(obstacle.y_max_m - y_m, 0.0, limits.right_mps2)
    left_s = crossing_times_s(y_m - obstacle.y_min_m, 0.0, limits.left_mps2)
    clearing_s = float(np.minimum(right_s, left_s).max())
    stopping_s = speed_mps / limits.brake_mps2
    if abs(stopping_s / clearing_s - 1.0) > 1e-2:
        assert size.flat == (stopping_s < clearing_s)


@given(LIMITS, SPEEDS_MPS, SIZES_M, st.floats(0.001, 0.999))
def test_boundary_is_where_the_better_vertex_just_clears(
    limits: AccelerationLimits, speed_mps: float, size_m: float, share: float
) -> None:
    obstacle = Box(3.0, 4.0, -1.0, size_m - 1.0)
    y_m = obstacle.y_min_m + share * size_m
    way_m = np.array([obstacle.y_max_m - y_m, y_m - obstacle.y_min_m])
    right_s = crossing_times_s(way_m[:1], 0.0, limits.right_mps2)
    left_s = crossing_times_s(way_m[1:], 0.0, limits.left_mps2)
    depth_m = boundary_depth_at(y_m, obstacle, limits, speed_mps)
    stopped_s = speed_mps / limits.brake_mps2
    clear_s = min(float(right_s[0]), float(left_s[0]), stopped_s)
    assert depth_m == pytest.approx((speed_mps - limits.brake_mps2 * clear_s / 2.0) * clear_s)


def test_boundary_of_the_worked_example() -> None:
    obstacle = Box(20.0, 24.0, 0.0, 4.0)
    limits = AccelerationLimits(2.0, 2.0, 1.0, 3.0)
    # y‴ = (d y_max + u y_min)/(u + d) = 1 m; t* = √(2·4/4) s.
    depth_m = boundary_depth_at(1.0, obstacle, limits, 10.0)
    assert depth_m == pytest.approx(10.0 * math.sqrt(2.0) - 2.0)
    assert boundary_depth_at(2.5, obstacle, limits, 10.0) == pytest.approx(10.0 - 1.0)
    assert boundary_depth_at(0.5, obstacle, limits, 10.0) == pytest.approx(10.0 - 1.0)
    assert boundary_depth_at(1.0, obstacle, limits, 2.0) == pytest.approx(1.0)


@pytest.mark.parametrize("y_m", [-1.0, 0.0, 4.0, 5.0])
def test_there_is_no_collision_set_beside_the_face(y_m: float) -> None:
    limits = AccelerationLimits(1.0, 1.0, 1.0, 1.0)
    assert boundary_depth_at(y_m, Box(20.0, 24.0, 0.0, 4.0), limits, 3.0) == 0.0


def test_printed_eq_9_is_unsafe() -> None:
    """Between the printed and the right threshold the printed boundary is inside the collision set.

    Printed, 2.8 m/s makes the boundary pointed and puts it 1.4628 m before the face.  A start
    between that and the right 1.4913 m collides whatever the vehicle does.
    """
    limits, speed_mps, half_m = paper_box_15_deg(), 2.8, 2.0
    lateral_mps2 = limits.right_mps2
    printed_threshold_mps = limits.brake_mps2 * math.sqrt(4.0 / (2.0 * lateral_mps2))
    right_threshold_mps = limits.brake_mps2 * math.sqrt(2.0 * 4.0 / (2.0 * lateral_mps2))
    assert printed_threshold_mps == pytest.approx(2.253, abs=5e-4)
    assert right_threshold_mps == pytest.approx(3.187, abs=5e-4)
    clear_s = math.sqrt(2.0 * half_m / lateral_mps2)
    printed_m = speed_mps * clear_s - limits.brake_mps2 * clear_s * clear_s / 2.0
    assert printed_m == pytest.approx(1.4628, abs=5e-5)

    right_m = boundary_depth_at(0.0, Box(0.0, 4.0, -half_m, half_m), limits, speed_mps)
    start_x_m = -(printed_m + right_m) / 2.0
    random = np.random.default_rng(9)
    share = random.uniform(-1.0, 1.0, (2000, 40, 2))
    share[:1000] = np.sign(share[:1000])  # half of them bang-bang
    share[0], share[1] = (-1.0, 1.0), (-1.0, -1.0)  # the vertices of Theorem 1
    assert collides(share, limits, start_x_m, speed_mps, half_m).all()


def collides(
    share: FloatArray,
    limits: AccelerationLimits,
    start_x_m: float,
    speed_mps: float,
    half_width_m: float,
) -> FloatArray:
    """Whether inputs (runs, steps, 2), as shares of the limits, hit a face at x = 0, |y| < half.

    The inputs last 1.5 s; the path between is sampled at half a millisecond or so.
    """
    steps = 50
    accelerations_mps2 = np.where(
        share < 0.0,
        share * (limits.brake_mps2, limits.left_mps2),
        share * (limits.forward_mps2, limits.right_mps2),
    )
    fine_mps2 = np.repeat(accelerations_mps2, steps, axis=1)
    step_s = 1.5 / fine_mps2.shape[1]
    velocity_mps = np.cumsum(fine_mps2, axis=1) * step_s + (speed_mps, 0.0)
    before_mps = np.concatenate(
        (np.broadcast_to((speed_mps, 0.0), (len(share), 1, 2)), velocity_mps[:, :-1]), axis=1
    )
    path_m = np.array((start_x_m, 0.0)) + np.cumsum((before_mps + velocity_mps) / 2.0 * step_s, 1)
    hit: FloatArray = ((path_m[..., 0] >= 0.0) & (np.abs(path_m[..., 1]) < half_width_m)).any(1)
    return hit


def test_printed_signs_are_reversed() -> None:
    """Eq. 20 forgets x_min, and Eq. 22 is positive inside the collision set, not outside."""
    obstacle, speed_mps = Box(20.0, 24.0, -2.0, 2.0), 2.8
    limits = paper_box_15_deg()

    def printed_g1(x_m: float) -> float:
        return x_m - speed_mps**2 / (2.0 * limits.brake_mps2)

    def printed_g1_with_x_min(x_m: float) -> float:
        return x_m - (obstacle.x_min_m - speed_mps**2 / (2.0 * limits.brake_mps2))

    # In mid-face, 10 m away: braking alone is safe.  10 cm away: collision is certain.
    depth_m = boundary_depth_at(0.0, obstacle, limits, speed_mps)
    safe_x_m, unsafe_x_m = 10.0, 19.9
    assert obstacle.x_min_m - safe_x_m > depth_m > obstacle.x_min_m - unsafe_x_m
    # As printed (safe iff g > 0), the safe and the certain collision are told apart by neither.
    assert printed_g1(safe_x_m) > 0.0
    assert printed_g1(unsafe_x_m) > 0.0
    assert printed_g1_with_x_min(safe_x_m) < 0.0
    assert printed_g1_with_x_min(unsafe_x_m) > 0.0


# --- lateral speed at entry (theory A)


@settings(max_examples=200)
@given(encounters())
def test_time_to_clear_is_that_of_the_worst_start(e: Encounter[float]) -> None:
    """Try every lateral start, also outside the face, with the drift either way."""
    size_m, w = e.size_across_m, e.lateral_speed_mps
    reach_m = w * w / (2.0 * min(e.left_mps2, e.right_mps2))
    from_left_m = np.linspace(-reach_m, size_m + reach_m, 20001)
    worst_s = 0.0
    for drift_mps in (w, -w):
        right_s = crossing_times_s(size_m - from_left_m, drift_mps, e.right_mps2)
        left_s = crossing_times_s(from_left_m, -drift_mps, e.left_mps2)
        worst_s = max(worst_s, float(np.minimum(right_s, left_s).max()))
    t_s = time_to_clear(e, SCALAR)
    assert worst_s <= t_s + 1e-9
    # The search has a grid, and near the outrun case the worst start is a cusp on it.
    assert worst_s == pytest.approx(t_s, rel=2e-2, abs=1e-3)


def test_slow_drift_costs_no_time_and_fast_drift_must_be_outrun() -> None:
    still = symmetric(2.0, 2.0, 5.0, (4.0, 4.0))
    t_s = math.sqrt(2.0)
    assert time_to_clear(still, SCALAR) == pytest.approx(t_s)
    assert time_to_clear(still._replace(lateral_speed_mps=2.0 * t_s), SCALAR) == pytest.approx(t_s)
    assert time_to_clear(still._replace(lateral_speed_mps=2.4), SCALAR) == pytest.approx(t_s)
    # Outrun: 3 t + t² = 4 + 9/4 m.
    outrun_s = (math.sqrt(9.0 + 25.0) - 3.0) / 2.0
    assert time_to_clear(still._replace(lateral_speed_mps=3.0), SCALAR) == pytest.approx(outrun_s)
    # A drift that only the weak side cannot turn back, whichever side that is: 1.5 t + 2 t² =
    # 2 + 1.125 m.
    outrun_s = (math.sqrt(2.25 + 25.0) - 1.5) / 4.0
    for left_mps2, right_mps2 in ((1.0, 4.0), (4.0, 1.0)):
        limits = AccelerationLimits(2.0, 2.0, left_mps2, right_mps2)
        e = ideal_encounter(limits, 5.0, (2.0, 2.0))._replace(lateral_speed_mps=1.5)
        assert time_to_clear(e, SCALAR) == pytest.approx(outrun_s)


# --- lane


def test_the_lane_covers_an_entry_beside_the_face_that_drifts_on() -> None:
    """Next to no obstacle: 0.5 m/s are stopped within 1/16 m by 2 m/s² and 1/32 m by 4 m/s²."""
    for left_mps2, right_mps2 in ((4.0, 2.0), (2.0, 4.0)):
        limits = AccelerationLimits(2.0, 2.0, left_mps2, right_mps2)
        e = ideal_encounter(limits, 5.0, (1e-9, 1e-9))._replace(lateral_speed_mps=0.5)
        region = dimensions(e, SCALAR)
        # Towards the side that is pushed to the harder, outrunning the drift needs more.
        narrower_m = min(region.overhang_left_m, region.overhang_right_m)
        assert narrower_m == pytest.approx(3.0 / 32.0, abs=1e-6)


def furthest_beyond_face_m(
    e: Encounter[float], push_mps2: float, stop_mps2: float, lag_s: float
) -> float:
    """Greatest way beyond the face over all starts from which clearing it takes at most t_m.

    The vehicle pushes towards the face from the moment at which the input acts, sees that it has
    crossed, and counteracts; both inputs act ``lag_s`` late, the entry drift meanwhile goes on.
    """
    t_m = min(e.speed_mps / e.brake_mps2, time_to_clear(e, SCALAR))
    furthest_m = 0.0
    for drift_mps in (e.lateral_speed_mps, -e.lateral_speed_mps):
        farthest_start_m = max(drift_mps * t_m + push_mps2 * t_m * t_m / 2.0, 0.0)
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            ahead_m = share * farthest_start_m
            crossing_mps = math.sqrt(drift_mps * drift_mps + 2.0 * push_mps2 * ahead_m)
            late_mps = crossing_mps + push_mps2 * lag_s
            coasted_m = (crossing_mps + late_mps) / 2.0 * lag_s
            furthest_m = max(furthest_m, coasted_m + late_mps**2 / (2.0 * stop_mps2))
    return furthest_m


@given(encounters(), st.floats(0.0, 1.0))
def test_lane_with_drift_and_lag(e: Encounter[float], share_of_lag: float) -> None:
    size = dimensions(e, SCALAR)
    for overhang_m, push_mps2, stop_mps2 in (
        (size.overhang_right_m, e.right_mps2, e.left_mps2),
        (size.overhang_left_m, e.left_mps2, e.right_mps2),
    ):
        lag_s = share_of_lag * e.attitude_lag_s
        assert furthest_beyond_face_m(e, push_mps2, stop_mps2, lag_s) <= overhang_m + 1e-9
        # From the farthest point that still lies ahead, drifting outwards until stopped.
        w = e.lateral_speed_mps
        entry_m = sum(
            w * (e.attitude_lag_s + w / (2.0 * limit)) for limit in (push_mps2, stop_mps2)
        )
        assert entry_m <= overhang_m + 1e-12
        if e.lateral_speed_mps * e.attitude_lag_s == 0.0:
            furthest_m = furthest_beyond_face_m(e, push_mps2, stop_mps2, e.attitude_lag_s)
            assert max(furthest_m, entry_m) == pytest.approx(overhang_m)


def test_drift_and_lag_break_the_printed_lane() -> None:
    """Erratum 14: 0.2 m/s of drift alone adds 0.22 m a side at 15°, 4 m, 2.8 m/s."""
    ideal = ideal_encounter(paper_box_15_deg(), 2.8, (4.0, 4.0))
    drifting = ideal._replace(lateral_speed_mps=0.2)
    printed_m = dimensions(ideal, SCALAR).overhang_right_m
    assert dimensions(drifting, SCALAR).overhang_right_m - printed_m == pytest.approx(
        0.22, abs=0.01
    )
    for worse in (drifting, ideal._replace(attitude_lag_s=0.1)):
        went_m = furthest_beyond_face_m(worse, 2.7213, 2.7213, worse.attitude_lag_s)
        assert went_m > printed_m + 0.2


def test_lane_of_a_worked_example() -> None:
    """Numbers by hand: u = 3, d = 1, V/b = 1 s, w = 0.5 m/s, T = 0.2 s, coasting 0.4 s."""
    limits = AccelerationLimits(2.0, 4.0, 1.0, 3.0)
    e = ideal_encounter(limits, 2.0, (6.0, 8.0))._replace(
        lateral_speed_mps=0.5,
        attitude_lag_s=0.2,
        reaction_time_s=0.3,
        run_on_m=1.5,
        coast_time_s=0.4,
    )
    size = dimensions(e, SCALAR)
    crossing_mps = math.sqrt(3.5**2 + 0.6)
    peak_mps = crossing_mps + 0.6
    assert size.overhang_right_m == pytest.approx(0.2 * crossing_mps + 0.06 + peak_mps**2 / 2.0)
    assert size.coast_right_m == pytest.approx(0.4 * peak_mps)
    crossing_mps = math.sqrt(1.5**2 + 0.2)
    peak_mps = crossing_mps + 0.2
    assert size.overhang_left_m == pytest.approx(0.2 * crossing_mps + 0.02 + peak_mps**2 / 6.0)
    assert size.coast_left_m == pytest.approx(0.4 * peak_mps)
    assert size.drift_left_m == pytest.approx(0.1 + 0.125)
    assert size.drift_right_m == pytest.approx(0.1 + 0.25 / 6.0)
    assert size.collision_set_depth_m == pytest.approx(1.0)
    assert size.front_m == pytest.approx(1.5 + 1.0 + 2.0 * 0.5)
    assert size.avoidance_time_s == pytest.approx(1.0)
    assert size.pob_depth_m == 6.0


def test_lane_of_an_entry_from_outside() -> None:
    """A strong drift near a narrow post: the entry lies farther out than the overshoot."""
    limits = AccelerationLimits(10.0, 10.0, 100.0, 1.0)
    e = ideal_encounter(limits, 1.0, (0.1, 0.1))._replace(lateral_speed_mps=2.0)
    assert dimensions(e, SCALAR).overhang_right_m == pytest.approx(2.0 + 0.02)


# --- post-obstacle border


def shortest_recovery_m(
    e: Encounter[float], braked_s: FloatArray, lateral_s: FloatArray
) -> FloatArray:
    """Least way from crossing until the entry speed is back and the lateral speed gone.

    Bisects for how long to brake on after the crossing: longer, and the entry speed is back later
    than the lateral speed is gone; shorter, and the rest of the time is spent at entry speed.
    """
    b, a, speed_mps = e.brake_mps2, e.forward_mps2, e.speed_mps
    crossing_mps = np.maximum(speed_mps - b * braked_s, 0.0)
    short_s, long_s = np.zeros_like(crossing_mps), crossing_mps / b
    for _ in range(60):
        on_s = (short_s + long_s) / 2.0
        early = on_s + (speed_mps - crossing_mps + b * on_s) / a < lateral_s
        short_s, long_s = np.where(early, on_s, short_s), np.where(early, long_s, on_s)
    # Where it never comes out, `long_s` is to the standstill: waiting costs time but no way.
    low_mps = np.maximum(crossing_mps - b * long_s, 0.0)
    way_m: FloatArray = (crossing_mps + low_mps) / 2.0 * long_s
    return way_m + (speed_mps**2 - low_mps**2) / (2.0 * a)


def worst_recovery_m(e: Encounter[float]) -> float:
    """Least sufficient border over all crossings, by search, for a vehicle without lag."""
    t_m = min(e.speed_mps / e.brake_mps2, time_to_clear(e, SCALAR))
    braked_s = np.linspace(0.0, t_m, 1001)
    return max(
        float(
            shortest_recovery_m(e, braked_s, (e.lateral_speed_mps + push * braked_s) / stop).max()
        )
        for push, stop in ((e.right_mps2, e.left_mps2), (e.left_mps2, e.right_mps2))
    )


@given(encounters())
def test_border_is_that_of_the_worst_crossing(e: Encounter[float]) -> None:
    e = e._replace(attitude_lag_s=0.0)
    t_m = min(e.speed_mps / e.brake_mps2, time_to_clear(e, SCALAR))
    # With a drift, the closed form takes the worse of each from both sides, and never assumes
    # the lateral speed to be gone before the entry speed is back: it may be more than needed.
    stopping_m = e.speed_mps**2 / (2.0 * e.forward_mps2)
    needed_m = max(worst_recovery_m(e), stopping_m)
    border_m = recovery_distance(e, t_m, SCALAR)
    assert needed_m <= border_m * (1.0 + 1e-9)
    if e.lateral_speed_mps == 0.0:
        assert needed_m == pytest.approx(border_m, rel=1e-4)


def test_printed_eq_15_is_too_short_for_lopsided_limits() -> None:
    lopsided = AccelerationLimits(2.0, 2.0, 1.0, 4.0)
    e = ideal_encounter(lopsided, 3.0, (0.0, 8.0))
    printed_m = 3.0**2 / (2.0 * 2.0)
    t_m = min(1.5, time_to_clear(e, SCALAR))
    assert worst_recovery_m(e) > 1.3 * printed_m
    assert recovery_distance(e, t_m, SCALAR) == pytest.approx(worst_recovery_m(e), rel=1e-3)
    # And it prints |w1x|, the braking limit, where the forward limit counts.
    weak = ideal_encounter(AccelerationLimits(2.0, 0.5, 2.0, 2.0), 3.0, (0.0, 8.0))
    assert recovery_distance(weak, 1.5, SCALAR) == pytest.approx(3.0**2 / (2.0 * 0.5))


def test_printed_eq_15_is_too_short_with_drift() -> None:
    """The faster the drift, the longer the lateral speed outlasts the speed deficit."""
    e = symmetric(2.0, 2.0, 3.0, (0.0, 8.0))._replace(lateral_speed_mps=1.0)
    printed_m = 3.0**2 / (2.0 * 2.0)
    assert worst_recovery_m(e) > printed_m + 0.1
    assert recovery_distance(e, 1.5, SCALAR) == pytest.approx(worst_recovery_m(e), rel=1e-3)


@given(encounters())
def test_border_with_lag_covers_inputs_that_act_late(e: Encounter[float]) -> None:
    """Everything acts T late after the crossing, so braking and swerving both go on for T."""
    t_m = min(e.speed_mps / e.brake_mps2, time_to_clear(e, SCALAR))
    lag_s = e.attitude_lag_s
    border_m = recovery_distance(e, t_m, SCALAR)

    def advance_m(times_s: FloatArray) -> FloatArray:
        moving_s = np.minimum(times_s, e.speed_mps / e.brake_mps2)
        way_m: FloatArray = e.speed_mps * moving_s - e.brake_mps2 * moving_s**2 / 2.0
        return way_m

    for push_mps2, stop_mps2 in ((e.right_mps2, e.left_mps2), (e.left_mps2, e.right_mps2)):
        braked_s = np.linspace(0.0, t_m, 101)
        longer_s = braked_s + lag_s
        lateral_s = (e.lateral_speed_mps + push_mps2 * longer_s) / stop_mps2
        late_m = advance_m(longer_s) - advance_m(braked_s)
        needed_m = late_m + shortest_recovery_m(e, longer_s, lateral_s)
        assert needed_m.max() <= border_m * (1.0 + 1e-9)


@given(encounters())
def test_border_with_drift_is_exact_for_equal_sides(e: Encounter[float]) -> None:
    brake_mps2 = min(e.brake_mps2, e.forward_mps2)
    e = e._replace(attitude_lag_s=0.0, left_mps2=e.right_mps2, brake_mps2=brake_mps2)
    t_m = min(e.speed_mps / e.brake_mps2, time_to_clear(e, SCALAR))
    needed_m = max(worst_recovery_m(e), e.speed_mps**2 / (2.0 * e.forward_mps2))
    assert needed_m == pytest.approx(recovery_distance(e, t_m, SCALAR), rel=1e-4)


def test_border_with_drift_by_hand() -> None:
    """b = 4a: k = 4, m_1 = 0, m_0 = 0.1 s, C = 16 m/s², worst t = 0.875 s, q = 0.975 s."""
    limits = AccelerationLimits(4.0, 1.0, 2.0, 2.0)
    e = ideal_encounter(limits, 4.0, (1.0, 8.0))._replace(lateral_speed_mps=1.0)
    assert recovery_distance(e, 1.0, SCALAR) == pytest.approx(5.0 * 1.99875 - 1.96875)
    # A drift that outlasts everything: the worst crossing is at once, m_0 = 0.75 s.
    fast = symmetric(2.0, 1.0, 2.0, (1.0, 8.0))._replace(lateral_speed_mps=1.5)
    assert recovery_distance(fast, 1.0, SCALAR) == pytest.approx(2.0 * 0.9375)


def test_border_with_lag_by_hand() -> None:
    e = symmetric(2.0, 2.0, 3.0, (0.0, 8.0))._replace(attitude_lag_s=0.2)
    assert recovery_distance(e, 1.5, SCALAR) == pytest.approx(3.0**2 / 4.0 + 3.0 * 2.0 * 0.2)
    strong = e._replace(brake_mps2=4.0)
    assert recovery_distance(strong, 0.75, SCALAR) == pytest.approx(3.0**2 / 4.0 + 3.0 * 3.0 * 0.2)


def test_border_of_lopsided_sides_with_lag_by_hand() -> None:
    limits = AccelerationLimits(brake_mps2=1.0, forward_mps2=1.0, left_mps2=1.0, right_mps2=4.0)
    e = ideal_encounter(limits, 10.0, (1.0, 1.0))._replace(attitude_lag_s=0.5)
    # The sides differ fourfold: braking goes on for 1.5 t.  The lag lets the crossing last 0.5 s
    # longer, t = 2 s: 2 Φ(2.5 t) - Φ(t), with Φ(t) = 10 t - t²/2; and 10 (1 + 1) 0.5 for the lag.
    assert recovery_distance(e, 1.5, SCALAR) == pytest.approx(2.0 * 37.5 - 18.0 + 10.0)


@given(st.floats(0.02, 0.5), SPEEDS_MPS, SIZES_M)
def test_weak_forward_acceleration_still_meets_the_post_condition(
    weakness: float, speed_mps: float, size_m: float
) -> None:
    """Erratum 9 asks to refuse a < b/2: that is the printed border; the right one needs no rule.

    Stop before the face, sidestep, speed up: at the border the entry speed is back.
    """
    limits = AccelerationLimits(4.0, 4.0 * weakness, 4.0, 4.0)
    e = ideal_encounter(limits, speed_mps, (0.1, size_m))
    border_m = dimensions(e, SCALAR).pob_depth_m
    stopping_m = speed_mps**2 / (2.0 * limits.brake_mps2)
    speeding_up_m = speed_mps**2 / (2.0 * limits.forward_mps2)
    assert border_m >= speeding_up_m
    # The whole printed region, front to border, is too short to speed up in.
    assert speeding_up_m >= 2.0 * stopping_m * 0.999


# --- the region as a whole


def as_arrays(e: Encounter[float], count: int = 3) -> Encounter[FloatArray]:
    return Encounter(**{name: np.full(count, value) for name, value in e._asdict().items()})


@given(encounters())
def test_arrays_and_floats_agree(e: Encounter[float]) -> None:
    scalar, array = dimensions(e, SCALAR), dimensions(as_arrays(e), ARRAY)
    for name, value in scalar._asdict().items():
        np.testing.assert_allclose(getattr(array, name), np.full(3, value), rtol=1e-14)


GROWING = ("collision_set_depth_m", "front_m", "overhang_left_m", "overhang_right_m")


def grown(e: Encounter[float], name: str, by: float) -> Encounter[float]:
    return e._replace(**{name: getattr(e, name) + by})


@given(
    encounters(),
    st.sampled_from(["speed_mps", "size_across_m", "lateral_speed_mps", "attitude_lag_s"]),
    st.floats(1e-6, 2.0),
)
def test_a_harder_encounter_never_has_a_smaller_region(
    e: Encounter[float], name: str, by: float
) -> None:
    small, large = dimensions(e, SCALAR), dimensions(grown(e, name, by), SCALAR)
    for quantity in (*GROWING, "coast_left_m", "coast_right_m", "recovery_m"):
        assert getattr(large, quantity) >= getattr(small, quantity) - 1e-9, quantity


@given(
    encounters(),
    st.sampled_from(["speed_mps", "size_across_m", "lateral_speed_mps", "attitude_lag_s"]),
)
def test_no_dimension_jumps(e: Encounter[float], name: str) -> None:
    """Printed, D jumps at Eq. 9; nothing here may, or bisection would be lost."""
    step = 1e-9
    before, after = dimensions(e, SCALAR), dimensions(grown(e, name, step), SCALAR)
    for quantity, value in before._asdict().items():
        if quantity != "flat":
            assert getattr(after, quantity) == pytest.approx(value, abs=2e-5), quantity


def test_no_dimension_jumps_at_the_branches() -> None:
    """Just either side of every threshold that the formulas have."""
    limits = AccelerationLimits(2.0, 3.0, 1.0, 2.5)
    e = ideal_encounter(limits, 3.0, (1.0, 4.0))
    t_s = time_to_clear(e, SCALAR)
    branches = [
        ("speed_mps", limits.brake_mps2 * t_s),
        ("lateral_speed_mps", limits.left_mps2 * t_s),
        ("lateral_speed_mps", limits.right_mps2 * t_s),
        ("forward_mps2", limits.brake_mps2 / 2.5),
    ]
    for name, threshold in branches:
        sides: list[Dimensions[float]] = [
            dimensions(e._replace(**{name: threshold * (1.0 + sign * 1e-9)}), SCALAR)
            for sign in (-1.0, 1.0)
        ]
        for quantity, value in sides[0]._asdict().items():
            if quantity != "flat":
                assert getattr(sides[1], quantity) == pytest.approx(value, rel=1e-6), quantity


def test_shape_follows_the_speed() -> None:
    e = symmetric(2.0, 1.0, 1.0, (4.0, 4.0))
    threshold_mps = 2.0 * math.sqrt(2.0 * 4.0 / 2.0)
    assert dimensions(e._replace(speed_mps=threshold_mps), SCALAR).flat
    assert dimensions(e._replace(speed_mps=0.99 * threshold_mps), SCALAR).flat
    assert not dimensions(e._replace(speed_mps=1.01 * threshold_mps), SCALAR).flat


def test_the_region_lies_around_its_obstacle() -> None:
    limits = AccelerationLimits(2.0, 4.0, 1.0, 3.0)
    obstacle = Box(10.0, 10.5, -3.0, 5.0)
    e = ideal_encounter(limits, 2.0, obstacle.size_m)._replace(
        lateral_speed_mps=0.5,
        attitude_lag_s=0.2,
        run_on_m=0.3,
        coast_time_s=0.4,
    )
    size = dimensions(e, SCALAR)
    region = RegionOfInfluence.around(obstacle, e)
    assert region.obstacle == obstacle
    assert region.keep_out == Box(9.7, 10.5, -3.0, 5.0)
    assert region.lane_left_m == pytest.approx(-3.0 - size.overhang_left_m)
    assert region.lane_right_m == pytest.approx(5.0 + size.overhang_right_m)
    corners_m = (
        10.0 - size.front_m,
        10.0 + size.pob_depth_m,
        region.lane_left_m - size.coast_left_m,
        region.lane_right_m + size.coast_right_m,
    )
    assert tuple(vars(region.extent).values()) == pytest.approx(corners_m)
    # The plan keeps out of a box that begins run_on earlier; its border is P behind that.
    assert size.pob_depth_m == pytest.approx(size.recovery_m - 0.3)
    assert size.pob_depth_m > 0.5
    assert region.x_pob_m == region.extent.x_max_m
    assert region.collision_set_depth_m == size.collision_set_depth_m
    assert region.lateral_speed_mps == 0.5
    assert (region.drift_left_m, region.drift_right_m) == (size.drift_left_m, size.drift_right_m)


def test_what_is_on_a_collision_course() -> None:
    limits = AccelerationLimits(2.0, 4.0, 1.0, 3.0)
    e = ideal_encounter(limits, 2.0, (1.0, 8.0))._replace(lateral_speed_mps=0.6)
    region = RegionOfInfluence.around(Box(10.0, 11.0, -3.0, 5.0), e)
    # A drift of 0.6 m/s towards the face needs 18 cm on the left and 6 cm on the right to end.
    assert region.on_collision_course(0.0, -3.179)
    assert not region.on_collision_course(0.0, -3.181)
    assert region.on_collision_course(0.0, 5.059)
    assert not region.on_collision_course(0.0, 5.061)
    assert region.on_collision_course(11.0, 0.0)
    assert not region.on_collision_course(11.001, 0.0)


def stopping_encounter(obstacle: Box) -> Encounter[float]:
    return ideal_encounter(AccelerationLimits(2.0, 4.0, 1.0, 3.0), 2.0, obstacle.size_m)._replace(
        lateral_speed_mps=0.5,
        coast_time_s=0.4,
    )


def stopping_region(obstacle: Box) -> RegionOfInfluence:
    """A region of stopping and sidestepping that shares no figure with the published form."""
    stop = Dimensions(
        flat=True,
        collision_set_depth_m=1.0,
        front_m=7.0,
        overhang_left_m=0.6,
        overhang_right_m=0.8,
        coast_left_m=0.2,
        coast_right_m=0.4,
        drift_left_m=0.1,
        drift_right_m=0.1,
        recovery_m=3.0,
        pob_depth_m=9.0,
        avoidance_time_s=1.0,
    )
    return RegionOfInfluence.around(obstacle, stopping_encounter(obstacle), stop)


WALL = Box(10.0, 11.0, -3.0, 5.0)


def test_a_region_of_stopping_keeps_that_of_the_manoeuvre_too() -> None:
    region = stopping_region(WALL)
    published = RegionOfInfluence.around(WALL, stopping_encounter(WALL))
    assert tuple(vars(region.extent).values()) == pytest.approx((3.0, 19.0, -3.8, 6.2))
    # Half of what lies beside it, and all of what lies before and behind.
    assert tuple(vars(region.apart).values()) == pytest.approx((3.0, 19.0, -3.4, 5.6))
    assert region.manoeuvre == published.extent == published.apart == published.manoeuvre
    assert region.x_pob_m == published.extent.x_max_m < 19.0


def test_approach_and_departure_are_those_of_the_farther_form() -> None:
    region = stopping_region(WALL)
    farther = replace(region, manoeuvre=Box(2.0, 20.0, -3.0, 5.0))
    for one, front_m, border_m in ((region, 3.0, 19.0), (farther, 2.0, 20.0)):
        assert one.approach_x_m == pytest.approx(front_m)
        assert one.departure_x_m == pytest.approx(border_m)


def test_a_region_moves_with_all_that_it_has() -> None:
    region = stopping_region(WALL)
    moved = region.shifted_by(2.0, -1.0)
    for name in ("obstacle", "keep_out", "extent", "apart", "manoeuvre"):
        before, after = getattr(region, name), getattr(moved, name)
        shift_m = np.subtract(list(vars(after).values()), list(vars(before).values()))
        assert shift_m == pytest.approx([2.0, 2.0, -1.0, -1.0]), name
    assert moved.lane_left_m == pytest.approx(region.lane_left_m - 1.0)
    assert moved.lane_right_m == pytest.approx(region.lane_right_m - 1.0)
    assert (moved.drift_left_m, moved.drift_right_m) == (region.drift_left_m, region.drift_right_m)
    low_m, high_m = moved.conflict_band_y_m
    assert low_m == pytest.approx(WALL.y_min_m - 1.0 - region.drift_left_m)
    assert high_m == pytest.approx(WALL.y_max_m - 1.0 + region.drift_right_m)
    # Of two regions the halves must be disjoint: 8 m and twice a quarter of 2 m.
    assert region.conflicts_with(region.shifted_by(0.0, 8.9))
    assert not region.conflicts_with(region.shifted_by(0.0, 9.1))


def test_the_depth_of_the_boundary_ends_at_the_side_faces() -> None:
    limits, obstacle = AccelerationLimits(2.0, 4.0, 1.0, 4.0), Box(10.0, 11.0, -3.0, 5.0)

    def depth_m(y_m: float) -> float:
        return boundary_depth_at(y_m, obstacle, limits, 6.0)

    assert [depth_m(y_m) for y_m in (-4.0, -3.0, 5.0, 6.0)] == [0.0] * 4
    # To the left 0.5 m at 1 m/s² in a second, to the right 2 m at 4 m/s²: 6 m less 1 m braked.
    assert depth_m(-2.5) == pytest.approx(5.0)
    assert depth_m(3.0) == pytest.approx(5.0)
