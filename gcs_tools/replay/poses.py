"""Poses of a recording as the telemetry that the daemon reads: MAVLink of a disarmed vehicle.

Frames of ROS are x forward, y left, z up.  The x axis of the recording's fixed frame counts as
north: which way it really points does not matter to what is seen.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.geometry.frames import FloatArray
from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.messages import (
    Header,
    PoseInFrame,
    Transform,
    decode_transforms,
    read_header,
    read_pose,
)
from onboard.perception.ros2.transform_tree import TransformTree, matrix_of

ODOMETRY: Final = "nav_msgs/Odometry"
POSE: Final = "geometry_msgs/PoseStamped"
TRANSFORMS: Final = "tf2_msgs/TFMessage"
# In the order of preference: what flies or drives knows its own motion best.
POSE_TYPES: Final = (ODOMETRY, POSE, TRANSFORMS)
# Between poses that are farther apart nothing is known of the velocity.
_GAP_MAX_S: Final = 1.0
_STEP_MIN_S: Final = 1e-3
_COVARIANCE: Final = 36
# From forward, left, up to forward, right, down, and from x, y, z to north, east, down.
_FLIP: Final = np.diag([1.0, -1.0, -1.0])


class RecordedPose(NamedTuple):
    """Where the body was, in the recording's fixed frame.

    Attributes:
        header: of the message.
        matrix: (4, 4) from the body into the fixed frame.
        velocity_mps: (3,) in the body; None where the message does not say.
    """

    header: Header
    matrix: FloatArray
    velocity_mps: FloatArray | None = None


class PoseReader:
    """Reads messages of poses.

    Args:
        base_frame: whose pose is wanted, of transforms.
    """

    def __init__(self, base_frame: str = "base_link") -> None:
        self._base_frame, self._tree = base_frame, TransformTree()

    def read(self, type_name: str, payload: bytes) -> RecordedPose | None:
        """Read one message; None where transforms do not tell the pose of the base.

        Raises:
            DecodeError: it is not one of its type.
        """
        if type_name == TRANSFORMS:
            return self._of_transforms(decode_transforms(payload))
        reader = CdrReader(payload)
        header = read_header(reader)
        if type_name == POSE:
            found = RecordedPose(header, matrix_of(read_pose(reader)))
            reader.end()
            return found
        reader.text()  # the body's frame
        pose = read_pose(reader)
        reader.f64s(_COVARIANCE)
        velocity_mps = np.array(reader.f64s(3))
        reader.f64s(3 + _COVARIANCE)
        reader.end()
        if not np.isfinite(velocity_mps).all():
            raise DecodeError("not finite")
        return RecordedPose(header, matrix_of(pose), velocity_mps)

    def _of_transforms(self, transforms: tuple[Transform, ...]) -> RecordedPose | None:
        self._tree.add(transforms)
        root = self._tree.root_of(self._base_frame)
        matrix = self._tree.pose(self._base_frame, root)
        if matrix is None or root == self._base_frame:
            return None
        # What moves comes now; transforms that stand still were sent before.
        return RecordedPose(transforms[-1].header, matrix) if transforms else None


class Telemetry:
    """Makes the autopilot's messages of poses.

    Args:
        system_id: MAVLink id of the vehicle.
    """

    def __init__(self, system_id: int) -> None:
        self._codec = mavlink.MAVLink(None, system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._before: tuple[float, FloatArray] | None = None

    def heartbeat(self) -> bytes:
        """Return the heartbeat of an autopilot that is disarmed."""
        return self._packed(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_QUADROTOR,
                mavlink.MAV_AUTOPILOT_GENERIC,
                0,
                0,
                mavlink.MAV_STATE_STANDBY,
                3,
            )
        )

    def at_rest(self, now_s: float) -> bytes:
        """Return the messages of a body that stands level at the origin."""
        level = PoseInFrame((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        return self.of(RecordedPose(Header(0.0, ""), matrix_of(level), np.zeros(3)), now_s)

    def of(self, pose: RecordedPose, now_s: float) -> bytes:
        """Return attitude and position of a pose.

        Args:
            pose: of the body.
            now_s: when it arrived, from the begin of the recording.
        """
        turn = _FLIP @ pose.matrix[:3, :3] @ _FLIP
        position_m = _FLIP @ pose.matrix[:3, 3]
        velocity_mps = self._velocity_mps(pose, turn, position_m, now_s)
        self._before = (now_s, position_m)
        roll = math.atan2(turn[2, 1], turn[2, 2])
        pitch = math.asin(min(max(-turn[2, 0], -1.0), 1.0))
        yaw = math.atan2(turn[1, 0], turn[0, 0])
        boot_ms = int(now_s * 1000.0) & 0xFFFFFFFF
        attitude = mavlink.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, 0.0, 0.0, 0.0)
        local = mavlink.MAVLink_local_position_ned_message(boot_ms, *position_m, *velocity_mps)
        return self._packed(attitude) + self._packed(local)

    def _velocity_mps(
        self, pose: RecordedPose, turn: FloatArray, position_m: FloatArray, now_s: float
    ) -> FloatArray:
        """Return the velocity, north, east, down: as stated, else from the pose before."""
        if pose.velocity_mps is not None:
            stated: FloatArray = turn @ (_FLIP @ pose.velocity_mps)
            return stated
        if self._before is None:
            return np.zeros(3)
        before_s, before_m = self._before
        if not _STEP_MIN_S <= now_s - before_s <= _GAP_MAX_S:
            return np.zeros(3)
        derived: FloatArray = (position_m - before_m) / (now_s - before_s)
        return derived

    def _packed(self, message: mavlink.MAVLink_message) -> bytes:
        packed: bytes = message.pack(self._codec)
        return packed
