"""Angles and speeds of a state."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.plant.truth import VehicleTruth
from tests.sitl.autopilot.truths import truth_at

angles_rad = st.floats(-1.4, 1.4)


def turned(roll_rad: float, pitch_rad: float, yaw_rad: float) -> VehicleTruth:
    """Return a state with Z-Y-X Euler angles."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle / 2.0), math.sin(angle / 2.0)) for angle in (roll_rad, pitch_rad, yaw_rad)
    )
    quaternion = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return truth_at()._replace(attitude_quaternion=quaternion)


@given(angles_rad, angles_rad, st.floats(-3.1, 3.1))
def test_euler_angles_come_back(roll_rad: float, pitch_rad: float, yaw_rad: float) -> None:
    truth = turned(roll_rad, pitch_rad, yaw_rad)
    found = (truth.roll_rad, truth.pitch_rad, truth.yaw_rad)
    assert found == pytest.approx((roll_rad, pitch_rad, yaw_rad), abs=1e-9)


@given(angles_rad, angles_rad, st.floats(-3.1, 3.1))
def test_tilt_does_not_depend_on_the_heading(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> None:
    tilt_rad = math.acos(math.cos(roll_rad) * math.cos(pitch_rad))
    assert turned(roll_rad, pitch_rad, yaw_rad).tilt_rad == pytest.approx(tilt_rad, abs=1e-7)


@pytest.mark.parametrize("pitch_rad", [-math.pi / 2.0, math.pi / 2.0])
def test_a_vertical_nose_is_no_error(pitch_rad: float) -> None:
    assert turned(0.0, pitch_rad, 0.0).pitch_rad == pytest.approx(pitch_rad, abs=1e-6)


def test_ground_speed_is_horizontal() -> None:
    assert truth_at(velocity_ned_mps=(3.0, -4.0, 12.0)).ground_speed_mps == 5.0
