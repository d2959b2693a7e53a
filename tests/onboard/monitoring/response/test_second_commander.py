"""Echoes as the two autopilots send them: ArduPilot's set-point, PX4's controller output."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import Vector
from onboard.mavlink.profiles.registry import profile_named
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.response.second_commander import (
    ECHO_PATIENCE_S,
    MEMORY_S,
    SPAN_MIN_S,
    SecondCommanderMonitor,
)
from onboard.vehicle_state import Pose, Target

HERE: Vector = (0.0, 0.0, -4.0)
STILL: Vector = (0.0, 0.0, 0.0)
NOTHING: Vector = (math.nan, math.nan, math.nan)
OURS: Target = (HERE, STILL)
ARDUPILOT, PX4 = (profile_named(key).target_gain_max_per_s for key in ("ardupilot", "px4"))
FLAVOURS = pytest.mark.parametrize("gain_max_per_s", [ARDUPILOT, PX4])


def at(position_ned_m: Vector) -> Pose:
    return Pose(0.0, position_ned_m, STILL, 0.0, 0.0, 0.0)


def hear(
    echoes: list[Target],
    *,
    gain_max_per_s: float = PX4,
    position_ned_m: Vector = HERE,
    period_s: float = 0.1,
    ours: Target = OURS,
) -> tuple[float, Violation] | None:
    """Hear echoes at a rate while we ask for one target; return the first violation and when."""
    monitor = SecondCommanderMonitor()
    for number, echo in enumerate(echoes):
        time_s = number * period_s
        pose = at(position_ned_m)
        found = monitor.check(time_s, echo, [ours], pose, gain_max_per_s=gain_max_per_s)
        if found is not None:
            return time_s, found
    return None


def controller_output(asked: Target, position_ned_m: Vector, gain_per_s: float) -> Target:
    """PX4: the velocity asked for, plus a gain times the error of position."""
    (x, y, z), (vx, vy, vz) = asked
    north_m, east_m, down_m = position_ned_m
    gains = (gain_per_s * (x - north_m), gain_per_s * (y - east_m), gain_per_s * (z - down_m))
    return (x, y, z), (vx + gains[0], vy + gains[1], vz + gains[2])


def beside(north_m: float = 0.0, east_m: float = 0.0, up_m: float = 0.0) -> Target:
    return (north_m, east_m, -4.0 - up_m), STILL


@FLAVOURS
def test_autopilot_that_goes_where_we_say_has_no_second_commander(gain_max_per_s: float) -> None:
    assert hear([beside(0.1)] * 100, gain_max_per_s=gain_max_per_s) is None


@given(
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0)),
    st.floats(0.0, PX4),
)
def test_what_px4s_controller_adds_is_not_foreign(error_m: Vector, gain_per_s: float) -> None:
    position_ned_m = (error_m[0], error_m[1], error_m[2] - 4.0)
    asked: Target = (HERE, (2.8, 0.0, 0.0))
    echo = controller_output(asked, position_ned_m, gain_per_s)
    assert hear([echo] * 60, position_ned_m=position_ned_m, ours=asked) is None


@pytest.mark.parametrize(
    "velocity_ned_mps",
    [
        (-0.6, 0.0, 0.0),  # away from where we asked it to be
        (0.0, 0.6, 0.0),  # across
        (3.0, 0.0, 0.0),  # more than any gain makes of 1 m
        (0.0, 0.0, 0.6),  # down, at the right height
        NOTHING,
    ],
)
def test_a_velocity_that_no_position_error_explains_is_foreign(velocity_ned_mps: Vector) -> None:
    found = hear([(HERE, velocity_ned_mps)] * 30, position_ned_m=(-1.0, 0.0, -4.0))
    assert found is not None


def test_ardupilots_echo_is_compared_as_it_is() -> None:
    echo = controller_output(OURS, (-1.0, 0.0, -4.0), 0.95)
    found = hear([echo] * 30, position_ned_m=(-1.0, 0.0, -4.0), gain_max_per_s=ARDUPILOT)
    assert found is not None


@FLAVOURS
def test_pilot_who_has_just_taken_over_is_no_second_commander(gain_max_per_s: float) -> None:
    echoes: list[Target] = [OURS] * 10 + [beside(5.0)] * 11
    assert hear(echoes, gain_max_per_s=gain_max_per_s) is None


@FLAVOURS
@pytest.mark.parametrize(
    "foreign",
    [
        beside(5.0),
        beside(0.0, -5.0),
        beside(up_m=1.0),
        beside(up_m=-0.2),
        (HERE, NOTHING),
        (NOTHING, STILL),
        ((0.0, 0.0, math.nan), STILL),
        (NOTHING, NOTHING),
    ],
)
@pytest.mark.parametrize(
    "pattern",
    [
        lambda _: True,
        lambda number: number % 2 == 1,
        lambda number: number % 4 == 3,
        lambda number: number % 12 == 5,
    ],
)
def test_target_that_keeps_being_anothers_is_a_second_commander(
    foreign: Target, pattern: Callable[[int], bool], gain_max_per_s: float
) -> None:
    echoes: list[Target] = [foreign if pattern(n) else OURS for n in range(60)]
    noticed = hear(echoes, gain_max_per_s=gain_max_per_s)
    assert noticed is not None
    time_s, violation = noticed
    assert violation.assumption is Assumption.SECOND_COMMANDER
    assert SPAN_MIN_S <= time_s <= 3.0
    assert math.isfinite(violation.measured)


@FLAVOURS
@pytest.mark.parametrize("period_s", [MEMORY_S / 2.0 + 0.1, 10.0])
def test_one_foreign_echo_now_and_then_is_none(period_s: float, gain_max_per_s: float) -> None:
    """ArduPilot reports one target of its own while it changes to GUIDED."""
    every = round(period_s / 0.1)
    echoes: list[Target] = [beside(5.0) if n % every == 0 else OURS for n in range(400)]
    assert hear(echoes, gain_max_per_s=gain_max_per_s) is None


def test_echoes_of_setpoints_sent_before_are_ours() -> None:
    monitor = SecondCommanderMonitor()
    ours = [beside(0.056 * number) for number in range(25, 0, -1)]
    for number in range(40):
        found = monitor.check(number * 0.1, beside(0.056), ours, at(HERE), gain_max_per_s=ARDUPILOT)
        assert found is None


def test_suspicion_begins_with_a_foreign_echo_or_with_silence() -> None:
    monitor = SecondCommanderMonitor()
    assert not monitor.suspects(0.0)  # an autopilot that never echoes says nothing
    monitor.check(1.0, OURS, [OURS], at(HERE), gain_max_per_s=PX4)
    assert not monitor.suspects(1.0 + ECHO_PATIENCE_S)
    assert monitor.suspects(1.0 + ECHO_PATIENCE_S + 0.01)
    assert not monitor.suspects(1.0 + SPAN_MIN_S)
    monitor.check(3.0, beside(5.0), [OURS], at(HERE), gain_max_per_s=PX4)
    assert monitor.suspects(3.0)
