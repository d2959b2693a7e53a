"""What a setpoint message contains once its masks are applied."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.setpoint_message import (
    NOTHING,
    MotionTarget,
    is_given,
    is_whole,
    read_target,
    turned,
)
from sitl.config import HomeConfig
from sitl.plant.truth import Vector

ORIGIN = HomeConfig(latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0)
HOME_NED_M = (0.0, 0.0, -10.0)
YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
NAN = math.nan


def local(mask: int, yaw: float = 0.5, yaw_rate: float = 0.1) -> MotionTarget:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, mask, *map(float, range(1, 10)), yaw, yaw_rate
    )
    return read_target(message, ORIGIN, HOME_NED_M)


def whole_earth(frame: int, alt: float = 20.0) -> MotionTarget:
    message = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, 0x0DF8, 470_010_000, 80_000_000, alt, *(0.0,) * 8
    )
    return read_target(message, ORIGIN, HOME_NED_M)


def same(found: Vector, expected: Vector) -> bool:
    return found == pytest.approx(expected, nan_ok=True)


def test_without_a_mask_everything_is_given() -> None:
    target = local(0)
    assert target.position_m == (1.0, 2.0, 3.0)
    assert target.velocity_mps == (4.0, 5.0, 6.0)
    assert target.acceleration_mps2 == (7.0, 8.0, 9.0)
    assert (target.yaw_rad, target.yaw_rate_radps) == (0.5, 0.1)


@pytest.mark.parametrize(
    ("mask", "position", "velocity", "acceleration"),
    [
        (0b000_000_111, NOTHING, (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)),
        (0b000_111_000, (1.0, 2.0, 3.0), NOTHING, (7.0, 8.0, 9.0)),
        (0b111_000_000, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), NOTHING),
        (0b000_000_100, (1.0, 2.0, NAN), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)),
        (0b001_010_001, (NAN, 2.0, 3.0), (4.0, NAN, 6.0), (NAN, 8.0, 9.0)),
    ],
)
def test_masked_components_are_not_given(
    mask: int, position: Vector, velocity: Vector, acceleration: Vector
) -> None:
    target = local(mask)
    assert same(target.position_m, position)
    assert same(target.velocity_mps, velocity)
    assert same(target.acceleration_mps2, acceleration)


def test_masked_or_implausible_angles_are_none() -> None:
    assert local(YAW).yaw_rad is None
    assert local(YAW_RATE).yaw_rate_radps is None
    for value in (math.nan, math.inf, 1e9):
        assert local(0, yaw=value).yaw_rad is None
        assert local(0, yaw_rate=value).yaw_rate_radps is None


def test_the_force_bit_shows() -> None:
    assert local(mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET).uses_force
    assert not local(0).uses_force


@pytest.mark.parametrize(
    ("frame", "down_m"),
    [
        (mavlink.MAV_FRAME_GLOBAL_INT, 480.0),  # 20 m above the sea is 480 m below the origin
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, -30.0),  # home is 10 m above the origin
        (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT, -20.0),
    ],
)
def test_global_positions_become_local_ones(frame: int, down_m: float) -> None:
    target = whole_earth(frame)
    assert target.frame == mavlink.MAV_FRAME_LOCAL_NED
    assert target.position_m == pytest.approx((111.19, 0.0, down_m), abs=0.02)


def test_a_local_frame_in_a_global_message_has_no_position_and_no_frame() -> None:
    target = whole_earth(mavlink.MAV_FRAME_LOCAL_NED)
    assert target.frame == -1
    assert same(target.position_m, NOTHING)


@pytest.mark.parametrize(
    ("vector", "given", "whole"),
    [
        ((1.0, 2.0, 3.0), True, True),
        ((1.0, NAN, 3.0), True, False),
        (NOTHING, False, False),
        ((0.0, 0.0, 0.0), True, True),
    ],
)
def test_given_and_whole_vectors(vector: Vector, given: bool, whole: bool) -> None:
    assert is_given(vector) is given
    assert is_whole(vector) is whole


@given(
    st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50)),
    st.floats(-math.pi, math.pi),
)
def test_turning_keeps_length_and_height_and_turns_back(vector: Vector, yaw_rad: float) -> None:
    there = turned(vector, yaw_rad)
    assert math.hypot(*there) == pytest.approx(math.hypot(*vector), abs=1e-9)
    assert there[2] == vector[2]
    assert turned(there, -yaw_rad) == pytest.approx(vector, abs=1e-9)


def test_forward_is_east_for_a_nose_to_the_east() -> None:
    assert turned((1.0, 0.0, 0.0), math.pi / 2.0) == pytest.approx((0.0, 1.0, 0.0))


@pytest.mark.parametrize("value", [math.inf, -math.inf, 2e6])
def test_components_beyond_a_million_are_implausible(value: float) -> None:
    target: Any = local(0)
    assert target.plausible
    for name in ("position_m", "velocity_mps", "acceleration_mps2"):
        assert not target._replace(**{name: (0.0, value, 0.0)}).plausible


def test_a_masked_component_is_plausible() -> None:
    assert local(0b111_111_111).plausible


def test_the_setpoint_of_a_target_has_no_acceleration_where_none_is_given() -> None:
    setpoint = local(0b111_000_000 | YAW | YAW_RATE).setpoint()
    assert setpoint[:9] == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0)
    assert (setpoint.yaw_rad, setpoint.yaw_rate_radps) == (0.0, 0.0)
