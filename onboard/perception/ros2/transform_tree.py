"""Static transforms of ROS 2 as a tree of frames, and the pose of one frame in another.

Rotations are (x, y, z, w); positions in metres (REP 103, REP 105).  A frame has one parent.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import PoseInFrame, Transform

# A robot has tens; beyond this the topic is not one of transforms.
FRAMES_MAX: Final = 1000


class TransformTree:
    """Remembers the newest pose of each frame in its parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, PoseInFrame]] = {}

    @property
    def frames(self) -> frozenset[str]:
        """Names of all frames that were heard of."""
        return frozenset(self._parents) | {parent for parent, _ in self._parents.values()}

    def add(self, transforms: Iterable[Transform]) -> None:
        """Take the transforms of a message; a full tree still takes those of frames that it has.

        Raises:
            DecodeError: there are too many frames.
        """
        is_full = False
        for each in transforms:
            if each.child_frame_id not in self._parents and len(self._parents) >= FRAMES_MAX:
                is_full = True
                continue
            self._parents[each.child_frame_id] = (each.header.frame_id, each.pose)
        if is_full:
            raise DecodeError("too many frames")

    def root_of(self, frame: str) -> str:
        """Return the last frame on the way up from a frame; itself if it has no parent."""
        for _ in range(len(self._parents)):
            if frame not in self._parents:
                break
            frame = self._parents[frame][0]
        return frame

    def pose(self, frame: str, base: str) -> FloatArray | None:
        """Return the pose of a frame in another one: (4, 4), turns its points into the other's.

        Either may be above the other, or both below a third.

        Returns:
            None where no way of known transforms leads from one to the other.
        """
        up_from_frame, up_from_base = self._way_up(frame), self._way_up(base)
        for name, matrix in up_from_frame.items():
            if name in up_from_base:
                found: FloatArray = np.linalg.inv(up_from_base[name]) @ matrix
                return found
        return None

    def _way_up(self, frame: str) -> dict[str, FloatArray]:
        """Return the pose of a frame in each frame above it, itself first."""
        found = {frame: np.eye(4)}
        while frame in self._parents:
            parent, pose = self._parents[frame]
            if parent in found:  # a circle
                break
            found[parent] = matrix_of(pose) @ found[frame]
            frame = parent
        return found


def matrix_of(pose: PoseInFrame) -> FloatArray:
    """Return a pose as (4, 4), which turns points of its frame into the frame that it is in."""
    x, y, z, w = pose.rotation
    matrix = np.eye(4)
    matrix[:3, :3] = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    matrix[:3, 3] = pose.position_m
    return matrix
