"""Roll, pitch and thrust limits become accelerations that the vehicle can fly."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import (
    GRAVITY_MPS2,
    AccelerationLimits,
    available_limits,
    reserved_trim_mps2,
    thrust_to_weight_at_corner,
    tilt_limits,
)
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.terms import Terms
from onboard.files.contract_file import InputSet
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.example_terms import TERMS

ANGLES_RAD = st.floats(math.radians(1.0), math.radians(60.0))
SHARES = st.floats(-1.0, 1.0)
DEGREE = math.radians(1.0)


def tilted(
    roll_max_rad: float, pitch_max_rad: float, input_set: InputSet = "inner"
) -> Terms[float]:
    return replace(
        TERMS, roll_max_rad=roll_max_rad, pitch_max_rad=pitch_max_rad, input_set=input_set
    )


def windy(wind_max_mps: float) -> Terms[float]:
    return replace(TERMS, wind_max_mps=wind_max_mps)


def attitude_for(acceleration_leg_mps2: tuple[float, float, float]) -> tuple[float, float, float]:
    """Roll [rad], pitch [rad] and specific thrust [m/s²] for an acceleration (Eq. 4)."""
    x_mps2, y_mps2, z_mps2 = acceleration_leg_mps2
    lift_mps2 = GRAVITY_MPS2 - z_mps2
    roll_rad = math.atan2(y_mps2, math.hypot(x_mps2, lift_mps2))
    pitch_rad = math.atan2(-x_mps2, lift_mps2)
    return roll_rad, pitch_rad, math.hypot(x_mps2, y_mps2, lift_mps2)


@given(SHARES, SHARES, st.floats(-5.0, 5.0))
def test_attitude_produces_the_acceleration(x: float, y: float, z_mps2: float) -> None:
    """The reference of this file: Eq. 4 inverts Eq. 2 at zero yaw, the nose along the leg."""
    acceleration_mps2 = (20.0 * x, 20.0 * y, z_mps2)
    roll_rad, pitch_rad, thrust_mps2 = attitude_for(acceleration_mps2)
    produced_mps2 = (
        -thrust_mps2 * math.cos(roll_rad) * math.sin(pitch_rad),
        thrust_mps2 * math.sin(roll_rad),
        GRAVITY_MPS2 - thrust_mps2 * math.cos(roll_rad) * math.cos(pitch_rad),
    )
    assert produced_mps2 == pytest.approx(acceleration_mps2, abs=1e-9)


@given(ANGLES_RAD, ANGLES_RAD, SHARES, SHARES)
def test_inner_box_never_asks_for_more_than_the_limits(
    roll_max_rad: float, pitch_max_rad: float, x: float, y: float
) -> None:
    terms = tilted(roll_max_rad, pitch_max_rad)
    x_mps2, y_mps2 = tilt_limits(terms, SCALAR)
    roll_rad, pitch_rad, thrust_mps2 = attitude_for((x * x_mps2, y * y_mps2, 0.0))
    assert abs(roll_rad) <= roll_max_rad + 1e-12
    assert abs(pitch_rad) <= pitch_max_rad + 1e-12
    assert thrust_mps2 <= GRAVITY_MPS2 * thrust_to_weight_at_corner(terms, SCALAR) + 1e-9


@given(ANGLES_RAD, ANGLES_RAD)
def test_inner_box_uses_the_limits_up(roll_max_rad: float, pitch_max_rad: float) -> None:
    x_mps2, y_mps2 = tilt_limits(tilted(roll_max_rad, pitch_max_rad), SCALAR)
    roll_rad, _, _ = attitude_for((0.0, -y_mps2, 0.0))
    _, pitch_rad, _ = attitude_for((-x_mps2, 0.0, 0.0))
    assert roll_rad == pytest.approx(-roll_max_rad)
    assert pitch_rad == pytest.approx(pitch_max_rad)


@pytest.mark.parametrize(("limit_deg", "asked_deg"), [(15.0, 15.5), (30.0, 33.7)])
def test_paper_box_asks_for_too_much_roll(limit_deg: float, asked_deg: float) -> None:
    terms = tilted(limit_deg * DEGREE, limit_deg * DEGREE, "paper")
    _, sideways_mps2 = tilt_limits(terms, SCALAR)
    roll_rad, _, _ = attitude_for((0.0, sideways_mps2, 0.0))
    assert roll_rad / DEGREE == pytest.approx(asked_deg, abs=0.05)
    assert roll_rad > terms.roll_max_rad


@given(ANGLES_RAD, ANGLES_RAD)
def test_paper_box_is_exact_at_its_corners(roll_max_rad: float, pitch_max_rad: float) -> None:
    x_mps2, y_mps2 = tilt_limits(tilted(roll_max_rad, pitch_max_rad, "paper"), SCALAR)
    roll_rad, pitch_rad, _ = attitude_for((x_mps2, y_mps2, 0.0))
    assert (roll_rad, pitch_rad) == pytest.approx((roll_max_rad, -pitch_max_rad))


@given(ANGLES_RAD, ANGLES_RAD)
def test_thrust_required_is_that_of_the_corner(roll_max_rad: float, pitch_max_rad: float) -> None:
    inner = tilted(roll_max_rad, pitch_max_rad)
    paper = tilted(roll_max_rad, pitch_max_rad, "paper")
    required_mps2 = GRAVITY_MPS2 * thrust_to_weight_at_corner(inner, SCALAR)
    assert thrust_to_weight_at_corner(paper, SCALAR) == thrust_to_weight_at_corner(inner, SCALAR)
    _, _, paper_mps2 = attitude_for((*tilt_limits(paper, SCALAR), 0.0))
    _, _, inner_mps2 = attitude_for((*tilt_limits(inner, SCALAR), 0.0))
    assert required_mps2 == pytest.approx(paper_mps2)
    assert inner_mps2 < paper_mps2
    slopes = math.tan(roll_max_rad), math.tan(pitch_max_rad)
    assert inner_mps2 == pytest.approx(GRAVITY_MPS2 * math.hypot(1.0, *slopes))


def test_thrust_required_by_hand() -> None:
    terms = tilted(60.0 * DEGREE, 60.0 * DEGREE)
    assert thrust_to_weight_at_corner(terms, SCALAR) == pytest.approx(4.0)


def test_wind_takes_the_same_from_both_limits() -> None:
    terms = windy(2.0)
    trim_mps2 = 2.0 * TERMS.drag_per_s
    assert reserved_trim_mps2(terms, SCALAR) == pytest.approx(trim_mps2)
    for still_mps2, left_mps2 in zip(
        tilt_limits(terms, SCALAR), available_limits(terms, SCALAR), strict=True
    ):
        assert left_mps2 == pytest.approx(still_mps2 - trim_mps2)


def test_without_wind_all_of_the_tilt_is_available() -> None:
    assert reserved_trim_mps2(TERMS, SCALAR) == 0.0
    assert available_limits(TERMS, SCALAR) == tilt_limits(TERMS, SCALAR)


def test_a_storm_that_leaves_nothing_is_read_as_still_air() -> None:
    terms = windy(100.0)
    assert reserved_trim_mps2(terms, SCALAR) == 0.0
    assert available_limits(terms, SCALAR) == tilt_limits(terms, SCALAR)


@pytest.mark.parametrize("input_set", ["inner", "paper"])
def test_arrays_and_floats_agree(input_set: InputSet) -> None:
    angles_rad = np.linspace(0.05, 1.0, 7)
    winds_mps = np.linspace(0.0, 9.0, 7)
    numbers: dict[str, Any] = {
        name: np.full(7, value) for name, value in vars(TERMS).items() if isinstance(value, float)
    }
    numbers |= {"roll_max_rad": angles_rad, "pitch_max_rad": angles_rad / 2.0}
    arrays: Terms[FloatArray] = Terms(**numbers, wind_max_mps=winds_mps, input_set=input_set)
    x_mps2, y_mps2 = available_limits(arrays, ARRAY)
    corner = thrust_to_weight_at_corner(arrays, ARRAY)
    for i in range(7):
        terms = replace(
            tilted(float(angles_rad[i]), float(angles_rad[i]) / 2.0, input_set),
            wind_max_mps=float(winds_mps[i]),
        )
        expected = (*available_limits(terms, SCALAR), thrust_to_weight_at_corner(terms, SCALAR))
        assert (x_mps2[i], y_mps2[i], corner[i]) == pytest.approx(expected)


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
@pytest.mark.parametrize("position", range(4))
def test_limits_are_positive_and_finite(position: int, value: float) -> None:
    numbers = [1.0, 1.0, 1.0, 1.0]
    numbers[position] = value
    name = ("brake_mps2", "forward_mps2", "left_mps2", "right_mps2")[position]
    with pytest.raises(ValueError, match=f"{name} = .* m/s²: must be finite and above zero"):
        AccelerationLimits(*numbers)
