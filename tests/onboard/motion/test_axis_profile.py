"""Motion along one axis: every formula against integration, and against what it promises."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onboard.motion.axis_profile import (
    AxisLimits,
    AxisState,
    Profile,
    Segment,
    coasting_speed,
    cut,
    displacement,
    largest,
    speed_change,
)

NUMBERS = st.floats(-5.0, 5.0)
DURATIONS_S = st.floats(0.01, 3.0)
SEGMENTS = st.lists(st.builds(Segment, DURATIONS_S, NUMBERS, NUMBERS), max_size=4).map(tuple)
PROFILES = st.builds(Profile, NUMBERS, NUMBERS, SEGMENTS)
LIMITS = st.builds(
    AxisLimits, st.floats(-6.0, -0.3), st.floats(0.3, 6.0), st.floats(0.5, 40.0) | st.just(math.inf)
)
STATES = st.builds(AxisState, NUMBERS, st.floats(-8.0, 8.0), st.floats(-3.0, 3.0))


def duration_s(segments: tuple[Segment, ...]) -> float:
    return sum(segment.duration_s for segment in segments)


def stepped(state: AxisState, segments: tuple[Segment, ...], steps: int = 400) -> AxisState:
    """The slow oracle: many small steps of constant acceleration."""
    position_m, velocity_mps, acceleration_mps2 = state
    for duration, at_start_mps2, jerk_mps3 in segments:
        step_s = duration / steps
        for i in range(steps):
            acceleration_mps2 = at_start_mps2 + jerk_mps3 * (i + 0.5) * step_s
            position_m += step_s * (velocity_mps + acceleration_mps2 * step_s / 2.0)
            velocity_mps += step_s * acceleration_mps2
        acceleration_mps2 = at_start_mps2 + jerk_mps3 * duration
    return AxisState(position_m, velocity_mps, acceleration_mps2)


@given(STATES, SEGMENTS)
def test_segments_are_integrated(state: AxisState, segments: tuple[Segment, ...]) -> None:
    assert state.after(segments) == pytest.approx(stepped(state, segments), abs=1e-3)


@given(STATES, DURATIONS_S, DURATIONS_S, NUMBERS)
def test_advancing_twice_is_advancing_by_the_sum(
    state: AxisState, first_s: float, second_s: float, jerk_mps3: float
) -> None:
    twice = state.advanced(first_s, jerk_mps3).advanced(second_s, jerk_mps3)
    assert twice == pytest.approx(state.advanced(first_s + second_s, jerk_mps3), abs=1e-6)


@given(SEGMENTS, st.floats(0.0, 15.0))
def test_what_is_cut_lasts_as_long_as_asked(segments: tuple[Segment, ...], wanted_s: float) -> None:
    kept = cut(segments, wanted_s)
    assert duration_s(kept) == pytest.approx(wanted_s, abs=1e-9)
    start = AxisState(0.0, 1.0, 0.0)
    whole = Profile(0.0, 1.0, segments)
    if wanted_s < duration_s(segments):
        assert start.after(kept)[:2] == pytest.approx(whole.at(wanted_s)[:2], abs=1e-9)
    else:
        assert kept[: len(segments)] == segments
        assert all(segment.acceleration_mps2 == 0.0 for segment in kept[len(segments) :])


@given(PROFILES, st.floats(0.0, 1.0))
def test_a_profile_is_its_segments_then_a_coast(profile: Profile, share: float) -> None:
    end_s = duration_s(profile.segments)
    assert profile.duration_s == pytest.approx(end_s)
    start = AxisState(profile.position_m, profile.velocity_mps, 0.0)
    assert profile.final[:2] == pytest.approx(start.after(profile.segments)[:2], abs=1e-9)
    assert profile.final.acceleration_mps2 == 0.0
    later = profile.at(end_s + 2.0)
    expected_m = profile.final.position_m + 2.0 * profile.final.velocity_mps
    assert later.position_m == pytest.approx(expected_m, abs=1e-6)
    time_s = share * end_s
    assert profile.at(time_s)[:2] == pytest.approx(
        start.after(cut(profile.segments, time_s))[:2], abs=1e-6
    )


@given(PROFILES, SEGMENTS)
def test_more_segments_take_the_place_of_the_coast(
    profile: Profile, more: tuple[Segment, ...]
) -> None:
    longer = profile.then(*more)
    assert longer.final[:2] == pytest.approx(profile.final.after(more)[:2], abs=1e-9)


@given(PROFILES, NUMBERS)
def test_the_last_crossing_is_the_last(profile: Profile, position_m: float) -> None:
    crossing_s = profile.last_time_at_s(position_m)
    end_s = profile.duration_s
    if crossing_s is not None:
        assert 0.0 <= crossing_s <= end_s
        assert profile.at(crossing_s).position_m == pytest.approx(position_m, abs=1e-6)
    from_s = (crossing_s or 0.0) + 1e-6
    signs = {
        math.copysign(1.0, offset_m)
        for i in range(200)
        if abs(
            offset_m := profile.at(from_s + (end_s - from_s) * i / 200.0).position_m - position_m
        )
        > 1e-6
        and from_s < end_s
    }
    assert len(signs) <= 1


@given(LIMITS, st.floats(0.1, 3.0))
def test_scaled_limits_keep_their_jerk(limits: AxisLimits, factor: float) -> None:
    scaled = limits.scaled(factor)
    assert scaled.jerk_max_mps3 == limits.jerk_max_mps3
    assert scaled.largest_mps2 == pytest.approx(factor * limits.largest_mps2)
    assert limits.mirrored().mirrored() == limits
    assert limits.mirrored().largest_mps2 == limits.largest_mps2
    assert limits.mirrored().acceleration_max_mps2 == -limits.acceleration_min_mps2


@given(STATES, st.floats(0.5, 40.0))
def test_the_coasting_speed_is_where_the_acceleration_ends(
    state: AxisState, jerk_mps3: float
) -> None:
    taken_off_s = abs(state.acceleration_mps2) / jerk_mps3
    towards_zero = -math.copysign(jerk_mps3, state.acceleration_mps2)
    ended = state.advanced(taken_off_s, towards_zero)
    assert ended.acceleration_mps2 == pytest.approx(0.0, abs=1e-9)
    assert coasting_speed(state, jerk_mps3) == pytest.approx(ended.velocity_mps, abs=1e-9)


@given(STATES, st.floats(-8.0, 8.0), LIMITS)
def test_a_speed_change_arrives_within_its_limits(
    state: AxisState, target_mps: float, limits: AxisLimits
) -> None:
    segments = speed_change(state, target_mps, limits)
    assert len(segments) <= 3
    ended = state.after(segments)
    assert ended.velocity_mps == pytest.approx(target_mps, abs=1e-6)
    low = min(limits.acceleration_min_mps2, state.acceleration_mps2)
    high = max(limits.acceleration_max_mps2, state.acceleration_mps2)
    for segment in segments:
        assert segment.duration_s > 0.0
        assert abs(segment.jerk_mps3) <= limits.jerk_max_mps3
        at_end = segment.acceleration_mps2 + segment.jerk_mps3 * segment.duration_s
        for value in (segment.acceleration_mps2, at_end):
            assert low - 1e-6 <= value <= high + 1e-6
    if segments and not math.isinf(limits.jerk_max_mps3):
        last = segments[-1]
        assert last.acceleration_mps2 + last.jerk_mps3 * last.duration_s == pytest.approx(
            0.0, abs=1e-6
        )


def test_speed_changes_by_hand() -> None:
    limits = AxisLimits(-2.0, 4.0, math.inf)
    rest = AxisState(0.0, 0.0, 0.0)
    assert speed_change(rest, 2.0, limits) == (Segment(0.5, 4.0),)
    assert speed_change(rest, -2.0, limits) == (Segment(1.0, -2.0),)
    assert speed_change(rest, 0.0, limits) == ()
    gradual = AxisLimits(-2.0, 2.0, 2.0)
    # Up to 2 m/s² in 1 s, held for 1 s, and off in 1 s: 4 m/s.
    held = (Segment(1.0, 0.0, 2.0), Segment(1.0, 2.0), Segment(1.0, 2.0, -2.0))
    assert speed_change(rest, 4.0, gradual) == held
    assert speed_change(rest, 2.0, gradual) == (held[0], held[2])


def test_an_acceleration_beyond_its_limit_is_brought_back() -> None:
    limits = AxisLimits(-1.0, 1.0, 2.0)
    first = speed_change(AxisState(0.0, 0.0, 2.0), 5.0, limits)[0]
    assert first == Segment(0.5, 2.0, -2.0)


@given(STATES, NUMBERS, st.floats(0.1, 6.0), LIMITS)
def test_a_displacement_ends_at_rest_where_it_should(
    state: AxisState, target_m: float, speed_mps: float, limits: AxisLimits
) -> None:
    assume(abs(state.velocity_mps) <= 8.0)
    segments = displacement(state, target_m, speed_mps, limits)
    assert len(segments) <= 7
    ended = state.after(segments)
    assert ended.velocity_mps == pytest.approx(0.0, abs=1e-6)
    assert ended.position_m == pytest.approx(target_m, abs=1e-3)


def test_a_long_displacement_cruises_at_the_speed() -> None:
    segments = displacement(AxisState(0.0, 0.0, 0.0), 20.0, 2.0, AxisLimits(-1.0, 1.0, math.inf))
    assert [segment.acceleration_mps2 for segment in segments] == [1.0, 0.0, -1.0]
    assert [segment.duration_s for segment in segments] == pytest.approx([2.0, 8.0, 2.0])


def test_a_displacement_that_cannot_stop_before_the_target_turns_back() -> None:
    fast = AxisState(0.0, 4.0, 0.0)
    segments = displacement(fast, 2.0, 3.0, AxisLimits(-2.0, 2.0, math.inf))
    # Braking for 2 s it stops at 4 m; it goes on with the same acceleration, and comes back.
    assert segments[0].acceleration_mps2 == -2.0
    assert segments[0].duration_s > 2.0
    assert fast.after((segments[0]._replace(duration_s=2.0),)).position_m == pytest.approx(4.0)
    assert fast.after(segments).position_m == pytest.approx(2.0, abs=1e-6)


@given(st.floats(-4.0, 4.0), st.floats(0.1, 3.0), st.floats(0.0, 2.0))
def test_the_largest_argument_of_a_rising_function(
    root: float, scale: float, curvature: float
) -> None:
    def excess(x: float) -> float:
        return scale * (x - root) * (1.0 + curvature * abs(x - root))

    found = largest(excess, -3.0, 3.0)
    if root < -3.0:
        assert found is None
    elif root >= 3.0:
        assert found == 3.0
    else:
        assert found is not None
        assert excess(found) <= 0.0
        assert abs(excess(found)) < 1e-6


def test_the_largest_argument_counts_evaluations() -> None:
    calls = 0

    def excess(x: float) -> float:
        nonlocal calls
        calls += 1
        return x**3 + x - 1.0

    found = largest(excess, 0.0, 1.0)
    assert found == pytest.approx(0.6823278, abs=1e-6)
    assert calls < 40
