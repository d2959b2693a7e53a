"""Motions from rest to rest, where they lead, and what has to be looked at before them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_tools.benchmark.run_on_models import coasting_run_on, frozen_run_on
from onboard.contract.run_on import NO_RUN_ON, RunOn
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.perception.seen_free import SeenFree
from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon
from onboard.planning.rest_certifier import RestLimits, certify_rest
from onboard.planning.sidestep import (
    Standstill,
    go_ahead,
    looks_aside_rad,
    rest_to_rest,
    sidesteps,
)

COASTING = coasting_run_on(
    0.5, lag_s=0.27, brake_mps2=2.6, speed_max_mps=2.8, acceleration_max_mps2=3.7
)
FROZEN = frozen_run_on(1.14, gain_per_s=0.95, velocity_gain_per_s=1.8)
LIMITS = RestLimits(0.5, 2.8, (2.6, 2.4, 2.2, 2.5), math.inf, 7.0, NO_RUN_ON)


def steps(jerks: FloatArray) -> FloatArray:
    """Integrate jerks in steps of a hundredth of a piece: (n, 3), position, velocity, pull."""
    states, (p, v, a), t = [(0.0, 0.0, 0.0)], (0.0, 0.0, 0.0), PIECE_S / 100.0
    for jerk in np.repeat(jerks, 100).tolist():
        p, v, a = (
            p + t * (v + t * (a / 2.0 + t * jerk / 6.0)),
            v + t * (a + t * jerk / 2.0),
            a + t * jerk,
        )
        states.append((p, v, a))
    return np.array(states)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.25, 12.0),
    st.sampled_from([0, 1]),
    st.sampled_from([NO_RUN_ON, COASTING, FROZEN]),
    st.floats(0.1, 1.0),
    st.floats(1.0, 20.0),
    st.sampled_from([math.inf, 1.8]),
)
def test_a_motion_keeps_every_limit_and_its_run_ends_within_the_overhang(
    distance_m: float, axis: int, run_on: RunOn, overhang_m: float, jerk_mps3: float, disc: float
) -> None:
    limits = replace(LIMITS, run_on=run_on, jerk_max_mps3=jerk_mps3, acceleration_disc_mps2=disc)
    jerks = rest_to_rest(distance_m, axis, limits, overhang_m)
    if jerks is None:  # so short a way runs on too far for so small an overhang
        assert run_on.gains
        assert overhang_m < 0.4
        return
    p, v, a = steps(jerks).T
    assert (p[-1], v[-1], a[-1]) == pytest.approx((distance_m, 0.0, 0.0), abs=1e-6)
    assert (v >= -1e-9).all()
    assert v.max() <= limits.speed_max_mps
    assert np.abs(a).max() <= min(2.4 if axis == 0 else 2.2, disc)
    assert np.abs(jerks).max() <= jerk_mps3
    for kappa_s, c_s2 in run_on.gains:
        assert (p + kappa_s * v + c_s2 * a).max() <= distance_m + overhang_m + 1e-6


def test_a_larger_overhang_is_quicker() -> None:
    limits = replace(LIMITS, run_on=COASTING)
    motions = [rest_to_rest(3.5, 1, limits, overhang_m) for overhang_m in (0.2, 0.5, 1.0)]
    pieces = [len(motion) for motion in motions if motion is not None]
    assert pieces == sorted(pieces, reverse=True)
    assert pieces[0] > pieces[-1]
    # Two to five seconds at half a metre (two-tier theory, A3).
    assert 2.0 <= pieces[1] * PIECE_S <= 6.0


# ------------------------------------------------------------------ where to


def standing(*boxes: Box, run_on: RunOn = NO_RUN_ON, free_m: float = 9.0) -> Standstill:
    seen = SeenFree()
    seen.confirm(0.0, 0.0, free_m)
    for box in boxes:
        grown = box.inflated(0.1)
        xs, ys = seen._centres(slice(None), slice(None))
        inside_x = (xs > grown.x_min_m - 0.05) & (xs < grown.x_max_m + 0.05)
        inside_y = (ys > grown.y_min_m - 0.05) & (ys < grown.y_max_m + 0.05)
        seen._free[np.ix_(inside_x, inside_y)] = False
    return Standstill(
        flown=Horizon.at_rest(0.0, 0.0, 0.0),
        grid=seen.grid(),
        boxes=boxes,
        limits=replace(LIMITS, run_on=run_on),
        margin_m=0.6,
        goal_leg_m=(30.0, 0.0),
    )


def end_of(motion: Horizon) -> tuple[float, float]:
    x_m, y_m = motion.nodes[-1, 0].tolist()
    return x_m, y_m


def certifies(motion: Horizon, at: Standstill) -> bool:
    trajectory = motion.trajectory(0.0)
    start = trajectory.sample(trajectory.start_s)
    return certify_rest(trajectory, start, trajectory.start_s, at.limits, at.grid).valid


@pytest.mark.parametrize("run_on", [NO_RUN_ON, COASTING, FROZEN])
def test_it_goes_as_far_as_is_free_and_leaves_room_before_an_obstacle(run_on: RunOn) -> None:
    at = standing(Box(5.0, 6.0, -1.0, 1.0), run_on=run_on)
    motion = next(go_ahead(at))
    assert certifies(motion, at)
    assert 3.0 < end_of(motion)[0] < 5.0 - at.margin_m - 0.25
    assert len(motion.jerk_mps3) >= PIECES
    without = standing(run_on=run_on)
    assert certifies(next(go_ahead(without)), without)


def test_it_goes_to_the_end_of_the_leg_and_no_farther() -> None:
    at = replace(standing(), goal_leg_m=(4.0, 0.0))
    assert end_of(next(go_ahead(at))) == pytest.approx((4.0, 0.0))
    assert not list(go_ahead(replace(standing(), goal_leg_m=(0.05, 0.0))))


def test_before_a_wall_it_does_not_go() -> None:
    assert not list(go_ahead(standing(Box(0.85, 2.0, -1.0, 1.0))))


@pytest.mark.parametrize("run_on", [NO_RUN_ON, COASTING, FROZEN])
def test_the_side_with_room_is_taken(run_on: RunOn) -> None:
    ahead = Box(1.2, 2.2, -0.4, 1.4)
    at = standing(ahead, run_on=run_on)
    motion = next(sidesteps(at))
    assert certifies(motion, at)
    assert end_of(motion)[1] < -0.4 - at.margin_m
    beside = Box(0.0, 2.0, -3.0, -1.7)  # no room on the nearer side
    at = standing(ahead, beside, run_on=run_on)
    motion = next(sidesteps(at))
    assert certifies(motion, at)
    assert end_of(motion)[1] > 1.4 + at.margin_m


def test_a_gap_between_two_is_taken_in_its_middle() -> None:
    at = standing(Box(1.2, 2.0, -0.8, 0.8), Box(1.4, 2.0, 2.4, 3.0), Box(1.3, 2.0, -7.0, -0.9))
    motion = next(sidesteps(at))
    assert end_of(motion)[1] == pytest.approx(1.6)
    assert certifies(motion, at)


def test_places_that_led_no_farther_are_left_out() -> None:
    at = standing(Box(1.2, 2.2, -0.4, 1.4))
    first = end_of(next(sidesteps(at)))
    other = end_of(next(sidesteps(replace(at, tried_leg_m=[first]))))
    assert math.dist(first, other) > 0.09


def test_where_a_face_is_too_near_it_draws_back_first() -> None:
    at = standing(Box(0.8, 2.0, -0.3, 0.3), Box(0.45, 2.0, 0.9, 1.3), Box(0.45, 2.0, -1.3, -0.9))
    motion = next(sidesteps(at))
    assert end_of(motion)[0] < -0.2
    assert certifies(motion, at)


def unseen(at: Standstill, *boxes: Box) -> Standstill:
    """Take some places, of which no obstacle is known, for unseen."""
    return replace(at, grid=standing(*boxes).grid)


@pytest.mark.parametrize("run_on", [NO_RUN_ON, COASTING, FROZEN])
def test_it_gets_away_from_where_only_the_disc_of_the_body_is_free(run_on: RunOn) -> None:
    """A way to rest is certified for the disc, so that it may end without any margin."""
    corners = [Box(x_m, x_m + 0.1, -0.65, -0.55) for x_m in (-0.65, 0.55)]
    at = unseen(standing(Box(1.2, 2.2, -0.4, 1.4), run_on=run_on), Box(1.2, 2.2, -0.4, 1.4))
    at = unseen(at, Box(1.2, 2.2, -0.4, 1.4), *corners)
    assert not at.grid.is_free(-0.5, 0.5, -0.5, 0.5)
    motion = next(sidesteps(at))
    assert certifies(motion, at)
    assert end_of(motion)[1] > 1.4 + at.margin_m


@pytest.mark.parametrize("goal_y_m", [0.0, -8.0])
def test_from_the_edge_of_what_was_seen_it_goes_back_to_where_the_way_ahead_was(
    goal_y_m: float,
) -> None:
    """An avoidance has led aside, and what is ahead there was not seen: no obstacle is known."""
    at = replace(unseen(standing(), Box(0.75, 9.0, -9.0, 0.4)), goal_leg_m=(30.0, goal_y_m))
    assert not list(go_ahead(at))
    motion = next(sidesteps(at))
    assert certifies(motion, at)
    x_m, y_m = end_of(motion)
    assert (x_m, y_m) == pytest.approx((0.0, 1.5))
    ahead = replace(at, flown=Horizon.at_rest(0.0, x_m, y_m))
    assert certifies(next(go_ahead(ahead)), ahead)


def test_at_the_end_of_the_leg_it_goes_aside_to_the_end() -> None:
    at = replace(standing(), goal_leg_m=(0.1, 2.0))
    assert end_of(next(sidesteps(at))) == pytest.approx((0.0, 2.0))
    assert not list(sidesteps(standing()))


# ------------------------------------------------------------------ looking


@pytest.mark.parametrize("view_deg", [90.0, 120.0, 200.0, 360.0])
@pytest.mark.parametrize(("radius_m", "error_m"), [(0.3, 0.35), (0.4, 0.8), (0.3, 0.05)])
def test_the_looks_show_every_bearing_that_a_sidestep_needs(
    view_deg: float, radius_m: float, error_m: float
) -> None:
    shown_rad = math.radians(view_deg) / 2.0 - math.radians(12.0)
    looks = looks_aside_rad(shown_rad, radius_m, error_m)
    body_m = radius_m + error_m
    widest_rad = math.pi / 2.0 + math.atan((body_m + error_m) / (body_m - error_m)) - math.pi / 4.0
    for bearing_rad in np.linspace(-widest_rad, widest_rad, 400).tolist():
        assert min(abs(bearing_rad - look) for look in looks) <= shown_rad + 1e-9
