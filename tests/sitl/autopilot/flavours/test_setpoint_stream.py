"""The stream of setpoints: age, gaps, jerk, and the motion between two of them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.autopilot.flavours.setpoint_stream import OffboardStream
from sitl.plant.setpoint import Setpoint

LOSS_S = 1.0
RUNNING = Setpoint(0.0, 0.0, -4.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, yaw_rad=0.3)


def stream(*times_s: float, hold_s: float = 0.06, holds_yaw: bool = False) -> OffboardStream:
    made = OffboardStream(hold_s)
    for time_s in times_s:
        made.receive(RUNNING, time_s, LOSS_S, holds_yaw=holds_yaw)
    return made


def test_an_empty_stream_is_infinitely_old_and_has_no_setpoint() -> None:
    empty = OffboardStream(0.06)
    assert empty.age_s(10.0) == math.inf
    assert empty.unbroken_s(10.0) == 0.0
    with pytest.raises(RuntimeError, match="no offboard setpoint"):
        empty.setpoint(10.0, 0.0)


def test_a_stream_is_unbroken_since_its_first_setpoint() -> None:
    assert stream(1.0, 1.5, 2.0).unbroken_s(2.2) == pytest.approx(1.2)
    assert stream(1.0, 1.5).age_s(2.25) == 0.75


def test_a_gap_longer_than_the_timeout_breaks_the_stream() -> None:
    assert stream(1.0, 2.0, 3.1).unbroken_s(3.2) == pytest.approx(0.1)
    assert stream(1.0, 2.0).unbroken_s(2.2) == pytest.approx(1.2)


def test_the_setpoint_moves_along_its_velocity_and_acceleration() -> None:
    moved = stream(1.0).setpoint(1.04, 0.0)
    assert moved.north_m == pytest.approx(2.0 * 0.04 + 0.5 * 0.04**2)
    assert moved.velocity_north_mps == pytest.approx(2.04)


def test_beyond_the_hold_time_it_coasts_at_the_velocity_reached() -> None:
    moved = stream(1.0).setpoint(1.5, 0.0)
    assert moved.velocity_north_mps == pytest.approx(2.06)
    assert moved.acceleration_north_mps2 == 0.0
    reached_m = 2.0 * 0.06 + 0.5 * 0.06**2
    assert moved.north_m == pytest.approx(reached_m + 2.06 * 0.44)


def test_with_an_endless_hold_the_acceleration_acts_on() -> None:
    moved = stream(1.0, hold_s=math.inf).setpoint(2.0, 0.0)
    assert moved.velocity_north_mps == pytest.approx(3.0)


@pytest.mark.parametrize(("holds_yaw", "yaw_rad"), [(True, -1.0), (False, 0.3)])
def test_a_setpoint_without_a_heading_keeps_the_held_one(holds_yaw: bool, yaw_rad: float) -> None:
    assert stream(1.0, holds_yaw=holds_yaw).setpoint(1.0, -1.0).yaw_rad == yaw_rad


@given(first=st.floats(-20.0, 20.0), second=st.floats(-20.0, 20.0), period_s=st.floats(0.01, 0.25))
def test_the_jerk_is_the_change_of_acceleration_within_its_limit(
    first: float, second: float, period_s: float
) -> None:
    made = OffboardStream(0.06)
    made.receive(RUNNING._replace(acceleration_north_mps2=first), 1.0, LOSS_S, holds_yaw=False)
    later_s = 1.0 + period_s
    made.receive(RUNNING._replace(acceleration_north_mps2=second), later_s, LOSS_S, holds_yaw=False)
    jerk_mps3 = made.setpoint(later_s, 0.0).jerk_north_mps3
    expected = min(max((second - first) / (later_s - 1.0), -30.0), 30.0)
    assert jerk_mps3 == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("gap_s", [0.0, 0.3])
def test_setpoints_too_far_apart_or_at_once_show_no_jerk(gap_s: float) -> None:
    made = stream(1.0)
    made.receive(RUNNING._replace(acceleration_north_mps2=5.0), 1.0 + gap_s, 1.0, holds_yaw=False)
    assert made.setpoint(1.0 + gap_s, 0.0).jerk_north_mps3 == 0.0


def test_a_setpoint_without_position_stays_without() -> None:
    made = OffboardStream(0.06)
    made.receive(
        Setpoint(velocity_north_mps=1.0, velocity_east_mps=0.0, velocity_down_mps=0.0),
        0.0,
        LOSS_S,
        holds_yaw=True,
    )
    assert math.isnan(made.setpoint(0.5, 0.0).north_m)


def test_an_acceleration_alone_acts_until_the_loss() -> None:
    stream = OffboardStream(0.06)
    nothing = (math.nan, math.nan, math.nan)
    alone = Setpoint.of(nothing, nothing, (1.0, 0.0, -2.0), (0.0, 0.0, 0.0), 0.0, 0.0)
    stream.receive(alone, 1.0, 1.0, holds_yaw=False)
    assert stream.setpoint(1.8, 0.0)[6:9] == (1.0, 0.0, -2.0)
