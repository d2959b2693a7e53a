"""What all sensors of a daemon's file have in common: past poses, and counts of what is refused."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from onboard.perception.detection import DetectionFrame
from onboard.perception.pose_history import PoseHistory
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import Header
from onboard.vehicle_state import Pose

# While a daemon starts, the sensor is not to blame for this.
NO_POSE_YET: Final = "no telemetry yet"


class PastPoses(Protocol):
    """Where the body was, by Unix time."""

    @property
    def generation(self) -> int:
        """Changes whenever the local frame has moved."""
        ...

    def at(self, stamp_unix_s: float) -> Pose:
        """Return the pose at a time.

        Raises:
            DecodeError: it is unknown.
        """
        ...


class PosesByStamp:
    """Past poses by the stamps of messages.

    Args:
        poses: on the service's clock.
        epoch_unix_s: returns the Unix time at its zero.
    """

    def __init__(self, poses: PoseHistory, epoch_unix_s: Callable[[], float]) -> None:
        self._poses, self._epoch_unix_s = poses, epoch_unix_s

    @property
    def generation(self) -> int:
        """Changes whenever the local frame has moved."""
        return self._poses.generation

    def at(self, stamp_unix_s: float) -> Pose:
        """Return the pose at a time.

        Raises:
            DecodeError: it is unknown.
        """
        pose = self._poses.at(stamp_unix_s - self._epoch_unix_s())
        if pose is None:
            raise DecodeError(NO_POSE_YET if self._poses.is_empty else "no pose at its stamp")
        return pose


class SensorInput(ABC):
    """A `DetectionSource` that counts what it refuses, by reason.

    Attributes:
        malformed: messages dropped so far.
        refused: the same by reason.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self.refused: Counter[str] = Counter()

    def read(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message; one that cannot be used is counted and dropped."""
        try:
            return self.frames(payload, now_unix_s)
        except ValueError as error:
            # Any other error than these is of the frame's own rules: numbers out of bounds.
            named = isinstance(error, DecodeError)
            self.refuse(error.args[0] if named else "numbers out of bounds")
            return ()

    def refuse(self, reason: str) -> None:
        """Count a message that is dropped."""
        self.malformed += 1
        self.refused[reason] += 1

    @abstractmethod
    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message.

        Raises:
            ValueError: it cannot be used.
        """


class OneFrameId:
    """Lets through messages of one coordinate frame.

    Args:
        frame_id: which; that of the first message if None.
    """

    def __init__(self, frame_id: str | None) -> None:
        self._frame_id = frame_id

    def check(self, header: Header) -> None:
        """Check the frame of a message.

        Raises:
            DecodeError: it is another one.
        """
        if self._frame_id is None:
            self._frame_id = header.frame_id
        if header.frame_id != self._frame_id:
            raise DecodeError("another frame_id")
