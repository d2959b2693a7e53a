"""The seam for obstacle sensors: bytes and time in, boxes and free space out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from onboard.perception.detection import DetectionFrame


class DetectionSource(Protocol):
    """Decodes the messages of one kind of sensor.

    An implementation may keep state over messages: a scan that comes in several parts yields its
    frame with the last of them.  Its constructor takes what else it needs, such as how the sensor
    is mounted or past poses.

    Attributes:
        malformed: messages dropped so far.
    """

    malformed: int

    def read(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message.

        Never raises for what a payload contains: a malformed one is counted, logged and dropped.

        Args:
            payload: as it arrived.
            now_unix_s: Unix time of the reading, by the clock that stamps are compared with; for
                messages that carry no usable stamp.

        Returns:
            The frames that the message completes, the oldest first; often one.
        """
        ...
