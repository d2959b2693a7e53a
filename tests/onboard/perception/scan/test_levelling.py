"""Rotations of mounting and attitude against an independent implementation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from onboard.files.sensor_sources import Axes, Mounting
from onboard.geometry.frames import FloatArray
from onboard.perception.ros2.messages import PoseInFrame
from onboard.perception.ros2.transform_tree import matrix_of
from onboard.perception.scan.levelling import (
    FRD_FROM,
    BodyMotion,
    in_sectors,
    mounting_of,
    mounting_offset_m,
    mounting_rotation,
)
from tests.onboard.perception.sources.scenes import pose_at

angles_deg = st.floats(-180.0, 180.0)
VECTORS = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -0.2], [0.0, 0.5, 1.0]])


@given(angles_deg, st.floats(-90.0, 90.0), angles_deg)
def test_the_mounting_turns_by_yaw_then_pitch_then_roll(
    roll_deg: float, pitch_deg: float, yaw_deg: float
) -> None:
    mounting = Mounting(roll_deg=roll_deg, pitch_deg=pitch_deg, yaw_deg=yaw_deg)
    expected = Rotation.from_euler("ZYX", (yaw_deg, pitch_deg, roll_deg), degrees=True).as_matrix()
    np.testing.assert_allclose(mounting_rotation(mounting), expected, atol=1e-12)


def test_nose_up_is_a_positive_pitch_and_clockwise_a_positive_yaw() -> None:
    up = mounting_rotation(Mounting(pitch_deg=90.0)) @ (1.0, 0.0, 0.0)
    right = mounting_rotation(Mounting(yaw_deg=90.0)) @ (1.0, 0.0, 0.0)
    down_on_the_right = mounting_rotation(Mounting(roll_deg=90.0)) @ (0.0, 1.0, 0.0)
    np.testing.assert_allclose((up, right, down_on_the_right), [[0, 0, -1], [0, 1, 0], [0, 0, 1]],
                               atol=1e-12)  # fmt: skip


@given(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), angles_deg)
def test_the_levelled_body_keeps_the_heading_and_nothing_else(
    roll_deg: float, pitch_deg: float, yaw_deg: float
) -> None:
    motion = BodyMotion.of([pose_at(roll_deg=roll_deg, pitch_deg=pitch_deg, yaw_deg=yaw_deg)], None)
    level = Rotation.from_euler("YX", (pitch_deg, roll_deg), degrees=True)
    np.testing.assert_allclose(motion.levelled(VECTORS), level.as_matrix() @ VECTORS, atol=1e-12)


def test_each_beam_is_placed_by_the_pose_of_its_time() -> None:
    poses = [
        pose_at(
            0.02 * step, (0.1 * step, 0.05 * step, -4.0 + 0.01 * step), yaw_deg=175.0 + 5 * step
        )
        for step in range(5)
    ]
    beam_s = np.array([0.0, 0.03, 0.08])
    motion = BodyMotion.of(poses, beam_s)
    np.testing.assert_allclose(np.degrees(motion.yaw_rad), [0.0, 7.5, 20.0], atol=1e-9)
    cosine, sine = math.cos(math.radians(175.0)), math.sin(math.radians(175.0))
    np.testing.assert_allclose(
        motion.place_m[0], np.array([0, 1.5, 4]) * (0.1 * cosine + 0.05 * sine)
    )
    np.testing.assert_allclose(
        motion.place_m[1], np.array([0, 1.5, 4]) * (0.05 * cosine - 0.1 * sine)
    )
    np.testing.assert_allclose(motion.place_m[2], [0.0, 0.015, 0.04], atol=1e-12)


def test_axes_of_messages() -> None:
    np.testing.assert_array_equal(FRD_FROM["flu"] @ (1.0, 2.0, 3.0), [1.0, -2.0, -3.0])
    np.testing.assert_array_equal(FRD_FROM["optical"] @ (1.0, 2.0, 3.0), [3.0, 1.0, 2.0])


def test_the_offset_is_in_the_body() -> None:
    assert mounting_offset_m(Mounting(x_m=0.1, y_m=-0.2, z_m=0.3)).tolist() == [
        [0.1],
        [-0.2],
        [0.3],
    ]


@pytest.mark.parametrize(
    ("bearing_deg", "sector", "inside"),
    [
        (65.0, (60.0, 70.0), True),
        (75.0, (60.0, 70.0), False),
        (180.0, (170.0, -170.0), True),
        (-175.0, (170.0, -170.0), True),
        (0.0, (170.0, -170.0), False),
        (0.0, (-10.0, 10.0), True),
    ],
)
def test_sectors_run_clockwise(
    bearing_deg: float, sector: tuple[float, float], inside: bool
) -> None:
    found = in_sectors(np.radians([bearing_deg]), [sector])
    assert found.tolist() == [inside]
    assert in_sectors(np.radians([bearing_deg]), []).tolist() == [False]


near_lock_deg = st.sampled_from((90.0, -90.0)).flatmap(
    lambda lock_deg: st.floats(-9.0, -3.0).map(
        lambda power: lock_deg - math.copysign(10.0**power, lock_deg)
    )
)
all_pitches_deg = st.sampled_from((90.0, -90.0)) | near_lock_deg | st.floats(-90.0, 90.0)


def pose_of(turn: FloatArray, axes: Axes) -> FloatArray:
    """Return the pose, as transforms state it, of a sensor that is turned in forward, right, down.

    By way of a quaternion, as it comes: that leaves noise where exact angles would leave none.
    """
    in_base = FRD_FROM["flu"] @ turn @ FRD_FROM[axes]
    x, y, z, w = Rotation.from_matrix(in_base).as_quat().tolist()
    return matrix_of(PoseInFrame((0.1, 0.2, -0.3), (x, y, z, w)))


@given(st.sampled_from(("flu", "optical")), angles_deg, all_pitches_deg, angles_deg)
def test_the_mounting_of_a_pose_turns_as_the_pose_does(
    axes: Axes, roll_deg: float, pitch_deg: float, yaw_deg: float
) -> None:
    turn = Rotation.from_euler("ZYX", (yaw_deg, pitch_deg, roll_deg), degrees=True).as_matrix()
    mounting = mounting_of(pose_of(turn, axes), axes)
    np.testing.assert_allclose(mounting_rotation(mounting), turn, atol=1e-6)
    assert (mounting.x_m, mounting.y_m, mounting.z_m) == pytest.approx((0.1, -0.2, 0.3))


@pytest.mark.parametrize("axes", ["flu", "optical"])
@pytest.mark.parametrize("pitch_deg", [90.0, -90.0])
@pytest.mark.parametrize("roll_deg", [0.0, 30.0, 180.0])
def test_a_sensor_that_looks_straight_up_or_down_is_turned_as_its_pose(
    axes: Axes, pitch_deg: float, roll_deg: float
) -> None:
    for yaw_deg in range(-180, 181, 5):
        turn = Rotation.from_euler("ZYX", (yaw_deg, pitch_deg, roll_deg), degrees=True).as_matrix()
        found = mounting_rotation(mounting_of(pose_of(turn, axes), axes))
        np.testing.assert_allclose(found, turn, atol=1e-6)


@pytest.mark.parametrize("turn", [np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3)])
def test_what_is_not_a_rotation_mounts_nothing(turn: FloatArray) -> None:
    pose = np.eye(4)
    pose[:3, :3] = turn
    with pytest.raises(ValueError, match="no rotation"):
        mounting_of(pose, "flu")


@pytest.mark.parametrize("axes", ["flu", "optical"])
def test_away_from_the_lock_the_angles_of_a_mounting_are_those_of_the_file(axes: Axes) -> None:
    mounting = Mounting(x_m=0.1, y_m=-0.2, z_m=0.3, roll_deg=20.0, pitch_deg=-35.0, yaw_deg=130.0)
    pose = pose_of(mounting_rotation(mounting), axes)
    assert mounting_of(pose, axes).model_dump() == pytest.approx(mounting.model_dump())
