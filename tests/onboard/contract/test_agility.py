"""Roll, pitch and thrust limits become accelerations that the vehicle can fly."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import (
    GRAVITY_MPS2,
    AccelerationLimits,
    Agility,
    AgilityError,
    attitude_from_acceleration,
)
from onboard.files.models import InputSet

ANGLES_RAD = st.floats(math.radians(1.0), math.radians(60.0))
SHARES = st.floats(-1.0, 1.0)
DEGREE = math.radians(1.0)


def corner_of(agility: Agility, input_set: InputSet) -> tuple[float, float, float]:
    limits = agility.acceleration_limits(input_set)
    return limits.forward_mps2, limits.right_mps2, 0.0


@given(SHARES, SHARES, st.floats(-5.0, 5.0))
def test_attitude_produces_the_acceleration(x: float, y: float, z_mps2: float) -> None:
    """Eq. 4 inverts Eq. 2 at zero yaw, the nose along the leg."""
    acceleration_mps2 = (20.0 * x, 20.0 * y, z_mps2)
    roll_rad, pitch_rad, thrust_mps2 = attitude_from_acceleration(acceleration_mps2)
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
    agility = Agility(roll_max_rad, pitch_max_rad, 10.0)
    limits = agility.acceleration_limits("inner")
    asked = (x * limits.forward_mps2, y * limits.right_mps2, 0.0)
    roll_rad, pitch_rad, thrust_mps2 = attitude_from_acceleration(asked)
    assert abs(roll_rad) <= roll_max_rad + 1e-12
    assert abs(pitch_rad) <= pitch_max_rad + 1e-12
    assert thrust_mps2 <= GRAVITY_MPS2 * agility.thrust_to_weight_required + 1e-9


@given(ANGLES_RAD, ANGLES_RAD)
def test_inner_box_uses_the_limits_up(roll_max_rad: float, pitch_max_rad: float) -> None:
    limits = Agility(roll_max_rad, pitch_max_rad, 10.0).acceleration_limits("inner")
    roll_rad, _, _ = attitude_from_acceleration((0.0, -limits.left_mps2, 0.0))
    _, pitch_rad, _ = attitude_from_acceleration((-limits.brake_mps2, 0.0, 0.0))
    assert roll_rad == pytest.approx(-roll_max_rad)
    assert pitch_rad == pytest.approx(pitch_max_rad)
    assert limits.left_mps2 == limits.right_mps2
    assert limits.brake_mps2 == limits.forward_mps2


@pytest.mark.parametrize(("limit_deg", "asked_deg"), [(15.0, 15.5), (30.0, 33.7)])
def test_paper_box_asks_for_too_much_roll(limit_deg: float, asked_deg: float) -> None:
    agility = Agility(limit_deg * DEGREE, limit_deg * DEGREE, 10.0)
    sideways_mps2 = agility.acceleration_limits("paper").right_mps2
    roll_rad, _, _ = attitude_from_acceleration((0.0, sideways_mps2, 0.0))
    assert roll_rad / DEGREE == pytest.approx(asked_deg, abs=0.05)
    assert roll_rad > agility.roll_max_rad


@given(ANGLES_RAD, ANGLES_RAD)
def test_paper_box_is_exact_at_its_corners(roll_max_rad: float, pitch_max_rad: float) -> None:
    agility = Agility(roll_max_rad, pitch_max_rad, 10.0)
    roll_rad, pitch_rad, _ = attitude_from_acceleration(corner_of(agility, "paper"))
    assert (roll_rad, pitch_rad) == pytest.approx((roll_max_rad, -pitch_max_rad))


@given(ANGLES_RAD, ANGLES_RAD)
def test_thrust_required_is_that_of_the_corner(roll_max_rad: float, pitch_max_rad: float) -> None:
    agility = Agility(roll_max_rad, pitch_max_rad, 10.0)
    required_mps2 = GRAVITY_MPS2 * agility.thrust_to_weight_required
    _, _, paper_mps2 = attitude_from_acceleration(corner_of(agility, "paper"))
    _, _, inner_mps2 = attitude_from_acceleration(corner_of(agility, "inner"))
    assert required_mps2 == pytest.approx(paper_mps2)
    assert inner_mps2 < paper_mps2
    slopes = math.tan(roll_max_rad), math.tan(pitch_max_rad)
    assert inner_mps2 == pytest.approx(GRAVITY_MPS2 * math.hypot(1.0, *slopes))


@pytest.mark.parametrize("angle_rad", [0.0, -0.1, math.pi / 2, 2.0, math.nan])
@pytest.mark.parametrize("name", ["roll_max_rad", "pitch_max_rad"])
def test_impossible_angles_are_refused(name: str, angle_rad: float) -> None:
    terms = {"roll_max_rad": 0.2, "pitch_max_rad": 0.2, "thrust_to_weight": 2.0}
    with pytest.raises(AgilityError, match=f"{name} = .* rad: must lie between 0 and 90°"):
        Agility(**(terms | {name: angle_rad}))


@pytest.mark.parametrize("thrust_to_weight", [1.0, 0.5, -2.0, math.nan])
def test_a_vehicle_that_cannot_hover_is_refused(thrust_to_weight: float) -> None:
    with pytest.raises(AgilityError, match="must exceed 1"):
        Agility(0.2, 0.2, thrust_to_weight)


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
@pytest.mark.parametrize("position", range(4))
def test_limits_are_positive_and_finite(position: int, value: float) -> None:
    numbers = [1.0, 1.0, 1.0, 1.0]
    numbers[position] = value
    with pytest.raises(AgilityError, match="must be finite and above zero"):
        AccelerationLimits(*numbers)


def test_mirroring_exchanges_left_and_right_only() -> None:
    limits = AccelerationLimits(1.0, 2.0, 3.0, 4.0)
    assert limits.mirrored() == AccelerationLimits(1.0, 2.0, 4.0, 3.0)
