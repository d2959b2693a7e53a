"""What leaves a sensor, and on which way it reaches the daemon."""

from __future__ import annotations

from typing import Any, NamedTuple


class ZenohMessage(NamedTuple):
    """A sample on Zenoh.

    Attributes:
        source: the sensor.
        payload: of the sample.
        key: of ROS 2; None for detections as JSON, ``clearway/<vehicle>/obstacles``.
        attachment: of the sample.
    """

    source: str
    payload: bytes
    key: str | None = None
    attachment: bytes = b""


class LinkMessage(NamedTuple):
    """A message that the autopilot sends on its MAVLink links.

    Attributes:
        source: the sensor.
        message: of pymavlink.
    """

    source: str
    message: Any


SensorMessage = ZenohMessage | LinkMessage
