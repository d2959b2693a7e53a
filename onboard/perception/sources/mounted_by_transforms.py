"""A sensor whose mounting comes from static transforms of ROS 2 instead of the daemon's file.

Before they are known, its messages are dropped: it has not been heard.  The mounting is taken once.
If the transforms say another one later, one of both is wrong, and so is where obstacles are put:
the messages are dropped for as long as they disagree, so that the flight comes to rest as with any
sensor that fell silent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from onboard.files.sensor_sources import Axes, Ros2Source
from onboard.geometry.frames import FloatArray
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.messages import decode_transforms, read_header
from onboard.perception.ros2.transform_tree import TransformTree
from onboard.perception.scan.levelling import mounting_of
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput

# Transforms that differ by less say the same: metres, and elements of the rotation, about half a
# degree.
_SAME: Final = 0.01


class MountedByTransforms(SensorInput):
    """Reads the messages of a sensor once its mounting is known.

    Args:
        config: of the sensor.
        poses: of the body.
        reader: makes the input of the sensor once it is mounted.
    """

    def __init__(
        self, config: Ros2Source, poses: PastPoses, reader: Callable[[Any, PastPoses], SensorInput]
    ) -> None:
        super().__init__()
        self._config, self._poses, self._reader = config, poses, reader
        self._tree, self._frame_id = TransformTree(), OneFrameId(config.frame_id)
        self._mounted: SensorInput | None = None
        self._frame: str | None = None
        self._taken: FloatArray | None = None
        self._agrees = True

    def take_transforms(self, payload: bytes) -> None:
        """Take one message of transforms; one that cannot be used is counted and dropped."""
        try:
            self._tree.add(decode_transforms(payload))
        except DecodeError as error:
            # A message that a full tree refuses in part may have changed the mounting before.
            self.refuse(f"transforms: {error.reason}")
        if self._taken is not None and self._frame is not None:
            now = self._tree.pose(self._frame, self._config.mounting.base_frame)
            self._agrees = now is not None and bool((np.abs(now - self._taken) <= _SAME).all())

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message.

        Raises:
            DecodeError: it cannot be used, or the mounting is not known, or has changed.
        """
        header = read_header(CdrReader(payload))
        self._frame_id.check(header)
        if self._mounted is None:
            self._mounted = self._mount(header.frame_id)
        if not self._agrees:
            raise DecodeError("mounting changed since the first transforms")
        return self._mounted.frames(payload, now_unix_s)

    def _mount(self, frame: str) -> SensorInput:
        config = self._config
        pose = self._tree.pose(frame, config.mounting.base_frame)
        if pose is None:
            raise DecodeError("mounting not known yet: no transforms from its frame to base_frame")
        axes: Axes = getattr(config, "axes", "flu")
        try:
            mounting = mounting_of(pose, axes)
        except ValidationError as error:
            raise DecodeError("mounting too far from base_frame") from error
        except ValueError as error:
            raise DecodeError("mounting not a rotation") from error
        self._frame, self._taken = frame, pose
        return self._reader(config.model_copy(update={"mounting": mounting}), self._poses)
