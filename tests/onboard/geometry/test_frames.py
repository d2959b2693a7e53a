"""Frames change as their names say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import (
    LegFrame,
    heading_displacement_m,
    rotation_about_down,
    wrap_angle,
)

METRES = st.floats(-1e3, 1e3)
POINTS_M = st.tuples(METRES, METRES, METRES)
ANGLES_RAD = st.floats(-10.0, 10.0)
LEGS = st.builds(LegFrame, POINTS_M, ANGLES_RAD)


def test_x_points_along_the_leg_and_y_to_its_right() -> None:
    eastward = LegFrame.between((10.0, 20.0, -4.0), (10.0, 50.0, -9.0))
    assert eastward.heading_rad == pytest.approx(math.pi / 2)
    position_leg_m = eastward.position_leg_from_ned(np.array([7.0, 25.0, -5.0]))
    np.testing.assert_allclose(position_leg_m, [5.0, 3.0, -1.0], atol=1e-12)
    velocity_ned_mps = eastward.vector_ned_from_leg(np.array([2.0, 1.0, -0.5]))
    np.testing.assert_allclose(velocity_ned_mps, [-1.0, 2.0, -0.5], atol=1e-12)


@given(LEGS, POINTS_M)
def test_there_and_back_is_nothing(leg: LegFrame, point_m: tuple[float, float, float]) -> None:
    position_ned_m = np.array(point_m)
    there = leg.position_leg_from_ned(position_ned_m)
    np.testing.assert_allclose(leg.position_ned_from_leg(there), position_ned_m, atol=1e-9)
    turned = leg.vector_leg_from_ned(position_ned_m)
    np.testing.assert_allclose(leg.vector_ned_from_leg(turned), position_ned_m, atol=1e-9)


@given(LEGS, POINTS_M)
def test_a_position_is_its_origin_plus_a_vector(
    leg: LegFrame, point_m: tuple[float, float, float]
) -> None:
    vector_m = np.array(point_m) - np.array(leg.origin_ned_m)
    np.testing.assert_allclose(
        leg.position_leg_from_ned(np.array(point_m)), leg.vector_leg_from_ned(vector_m), atol=1e-9
    )


def test_many_vectors_turn_like_one() -> None:
    leg = LegFrame((1.0, 2.0, 3.0), 0.7)
    vectors_m = np.arange(12.0).reshape(2, 2, 3)
    turned = leg.vector_leg_from_ned(vectors_m)
    np.testing.assert_allclose(turned[1, 0], leg.vector_leg_from_ned(vectors_m[1, 0]))
    moved = leg.position_ned_from_leg(vectors_m)
    np.testing.assert_allclose(moved[0, 1], leg.position_ned_from_leg(vectors_m[0, 1]))


@given(LEGS, st.tuples(*(st.floats(-1e3, 1e3),) * 3))
def test_one_vector_is_moved_like_many(leg: LegFrame, vector: tuple[float, float, float]) -> None:
    pairs = [
        (leg.position_ned, leg.position_ned_from_leg),
        (leg.position_leg, leg.position_leg_from_ned),
        (leg.vector_ned, leg.vector_ned_from_leg),
        (leg.vector_leg, leg.vector_leg_from_ned),
    ]
    for of_one, of_many in pairs:
        np.testing.assert_allclose(of_one(vector), of_many(np.array(vector)), atol=1e-9)


def test_a_leg_without_length_has_no_frame() -> None:
    with pytest.raises(ValueError, match="leg start and end are less than 1 cm apart"):
        LegFrame.between((1.0, 1.0, 0.0), (1.0, 1.005, -30.0))


@given(ANGLES_RAD)
def test_a_rotation_about_down_turns_north_towards_east(angle_rad: float) -> None:
    rotation = rotation_about_down(angle_rad)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    nose_ned = rotation @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(nose_ned, [math.cos(angle_rad), math.sin(angle_rad), 0.0])
    np.testing.assert_allclose(rotation @ np.array([0.0, 0.0, 1.0]), [0.0, 0.0, 1.0])


@given(
    st.floats(0.0, 100.0), ANGLES_RAD, st.floats(0.0, math.pi / 4.0), st.sampled_from([-1.0, 1.0])
)
def test_heading_displacement_is_the_chord(
    distance_m: float, bearing_rad: float, error_rad: float, side: float
) -> None:
    places = [
        distance_m * np.array((math.cos(angle_rad), math.sin(angle_rad)))
        for angle_rad in (bearing_rad, bearing_rad + side * error_rad)
    ]
    moved_m = float(np.linalg.norm(places[1] - places[0]))
    displaced_m = heading_displacement_m(distance_m, error_rad)
    assert displaced_m == pytest.approx(moved_m, abs=1e-9)
    assert displaced_m >= distance_m * math.sin(error_rad) - 1e-9
    array = heading_displacement_m(np.array([distance_m]), np.array([error_rad]), np.sin)
    assert array[0] == pytest.approx(displaced_m)


@given(st.floats(-100.0, 100.0))
def test_a_wrapped_angle_is_the_same_direction(angle_rad: float) -> None:
    wrapped_rad = wrap_angle(angle_rad)
    assert -math.pi <= wrapped_rad < math.pi
    assert math.cos(wrapped_rad) == pytest.approx(math.cos(angle_rad), abs=1e-9)
    assert math.sin(wrapped_rad) == pytest.approx(math.sin(angle_rad), abs=1e-9)
