"""Poses of ROS 2 as telemetry: axes, velocity, and a vehicle that is disarmed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_tools.replay.poses import ODOMETRY, POSE, TRANSFORMS, PoseReader, Telemetry
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.perception.ros2.cdr import DecodeError
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import STAMP, CdrWriter, odometry, transforms

LEVEL = (0.0, 0.0, 0.0, 1.0)
HALF = math.sqrt(0.5)
LEFT = (0.0, 0.0, HALF, HALF)


def received(data: bytes, now_s: float = 1.0, endpoint: MavlinkEndpoint | None = None) -> Pose:
    endpoint = endpoint or MavlinkEndpoint(1)
    endpoint.receive(data, now_s)
    assert endpoint.pose is not None
    return endpoint.pose


def test_odometry_becomes_a_pose_in_ned() -> None:
    payload = odometry((1.0, 2.0, 3.0), LEFT, stamp_unix_s=5.0, velocity_mps=(0.5, 0.1, 0.2))
    pose = PoseReader().read(ODOMETRY, payload)
    assert pose is not None
    assert pose.header.stamp_unix_s == 5.0
    found = received(Telemetry(1).of(pose, 1.0))
    assert found.position_ned_m == pytest.approx((1.0, -2.0, -3.0))
    assert found.yaw_rad == pytest.approx(-math.pi / 2.0)  # left is anticlockwise
    # Forward is west now, left is south.
    assert found.velocity_ned_mps == pytest.approx((-0.1, -0.5, -0.2), abs=1e-6)


@pytest.mark.parametrize(
    ("rotation", "roll_rad", "pitch_rad"),
    [
        ((math.sin(0.1), 0.0, 0.0, math.cos(0.1)), 0.2, 0.0),
        ((0.0, math.sin(0.1), 0.0, math.cos(0.1)), 0.0, -0.2),  # about y to the left: nose down
    ],
)
def test_tilts_have_the_signs_of_the_vehicle(
    rotation: tuple[float, float, float, float], roll_rad: float, pitch_rad: float
) -> None:
    pose = PoseReader().read(ODOMETRY, odometry(rotation=rotation, stamp_unix_s=5.0))
    assert pose is not None
    found = received(Telemetry(1).of(pose, 1.0))
    assert (found.roll_rad, found.pitch_rad) == pytest.approx((roll_rad, pitch_rad), abs=1e-6)


def stamped(x_m: float) -> bytes:
    return CdrWriter().header(STAMP, "map").add("ddddddd", x_m, 0.0, 0.0, *LEVEL).payload()


def test_a_velocity_that_is_not_stated_follows_from_the_pose_before() -> None:
    reader, telemetry, endpoint = PoseReader(), Telemetry(1), MavlinkEndpoint(1)
    speeds = []
    # Twice at once, and after a gap, nothing follows.
    for now_s, x_m in ((1.0, 0.0), (1.5, 1.0), (1.5, 2.0), (4.0, 3.0), (4.5, 4.0)):
        pose = reader.read(POSE, stamped(x_m))
        assert pose is not None
        found = received(telemetry.of(pose, now_s), now_s, endpoint)
        speeds.append(found.velocity_ned_mps[0])
    assert speeds == pytest.approx([0.0, 2.0, 0.0, 0.0, 2.0])


def test_transforms_tell_where_the_base_is_once_it_hangs_on_something() -> None:
    reader = PoseReader()
    assert reader.read(TRANSFORMS, transforms(("base_link", "laser", (1, 0, 0), LEVEL))) is None
    moved = transforms(
        ("odom", "base_link", (2.0, 0.0, 0.0), LEVEL), ("map", "odom", (1.0, 0.0, 0.0), LEVEL)
    )
    pose = reader.read(TRANSFORMS, moved)
    assert pose is not None
    assert pose.matrix[:3, 3] == pytest.approx([3.0, 0.0, 0.0])
    assert reader.read(TRANSFORMS, transforms()) is None


@pytest.mark.parametrize("kind", [ODOMETRY, POSE, TRANSFORMS])
def test_damaged_poses_are_refused(kind: str) -> None:
    for payload in (b"", odometry(stamp_unix_s=5.0)[:90], b"\x00\x01\x00\x00" + bytes(20)):
        with pytest.raises(DecodeError):
            PoseReader().read(kind, payload + b"\xff" * 7)
    endless = odometry(stamp_unix_s=5.0, velocity_mps=(math.nan, 0.0, 0.0))
    with pytest.raises(DecodeError):
        PoseReader().read(ODOMETRY, endless)


def test_the_vehicle_is_disarmed_and_at_rest_without_poses() -> None:
    endpoint, telemetry = MavlinkEndpoint(7), Telemetry(7)
    endpoint.receive(telemetry.heartbeat(), 0.5)
    assert endpoint.status.heard_s == 0.5
    assert not endpoint.status.armed
    found = received(telemetry.at_rest(1.0), 1.0, endpoint)
    assert np.allclose((*found.position_ned_m, *found.velocity_ned_mps, found.yaw_rad), 0.0)
