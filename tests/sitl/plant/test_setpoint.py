"""A setpoint moves along its own derivatives, and leaves open what it does not control."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.plant.setpoint import Setpoint, ahead

values = st.floats(-20.0, 20.0)
vectors = st.tuples(values, values, values)
ages_s = st.floats(0.0, 0.5)


def moving(position: tuple[float, float, float]) -> Setpoint:
    return Setpoint.of(position, (2.0, 0.0, -1.0), (1.0, -1.0, 0.0), (6.0, 0.0, 0.0), 0.5, 0.2)


def test_vectors_land_in_their_fields() -> None:
    setpoint = Setpoint.of((1, 2, 3), (4, 5, 6), (7, 8, 9), (10, 11, 12), 13.0, 14.0)
    assert tuple(setpoint) == tuple(range(1, 15))


def test_nothing_is_controlled_by_default() -> None:
    assert all(map(math.isnan, Setpoint()[:6]))
    assert Setpoint()[6:] == (0.0,) * 8


def test_it_moves_by_taylors_series() -> None:
    t = 0.2
    moved = ahead(moving((10.0, 20.0, -5.0)), t)
    assert moved.north_m == pytest.approx(10.0 + 2.0 * t + 0.5 * t**2 + t**3)
    assert moved.velocity_north_mps == pytest.approx(2.0 + t + 3.0 * t**2)
    assert moved.acceleration_north_mps2 == pytest.approx(1.0 + 6.0 * t)
    assert moved.east_m == pytest.approx(20.0 - 0.5 * t**2)
    assert moved.down_m == pytest.approx(-5.0 - t)
    assert moved.yaw_rad == pytest.approx(0.5 + 0.2 * t)


@given(vectors, vectors, vectors, vectors, ages_s, ages_s)
def test_two_steps_are_one(
    position: tuple[float, float, float],
    velocity: tuple[float, float, float],
    acceleration: tuple[float, float, float],
    jerk: tuple[float, float, float],
    first_s: float,
    second_s: float,
) -> None:
    setpoint = Setpoint.of(position, velocity, acceleration, jerk, 0.0, 0.1)
    twice, once = ahead(ahead(setpoint, first_s), second_s), ahead(setpoint, first_s + second_s)
    assert tuple(twice) == pytest.approx(tuple(once), abs=1e-9)


def test_no_time_changes_nothing() -> None:
    setpoint = moving((1.0, 2.0, 3.0))
    assert ahead(setpoint, 0.0) == setpoint


def test_a_position_without_velocity_stays_and_a_missing_position_stays_missing() -> None:
    moved = ahead(Setpoint(1.0, 2.0, math.nan, math.nan, math.nan, 3.0), 1.0)
    assert (moved.north_m, moved.east_m) == (1.0, 2.0)
    assert math.isnan(moved.down_m)
    assert math.isnan(moved.velocity_north_mps)
    assert moved.velocity_down_mps == 3.0
