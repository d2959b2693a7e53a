"""Keys and attachments of ROS 2 over Zenoh: what to subscribe to, and which samples to believe.

`rmw_zenoh` publishes under ``<domain>/<topic>/<type>/<hash>``, where the hash names the definition
of the type (REP 2016; Humble has none), with an attachment that names the publisher.
`zenoh-bridge-ros2dds` publishes under the topic alone.  The layouts of the attachment are those of
rmw_zenoh since 0.2.4 and before (`attachment_helpers.cpp`).
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from onboard.perception.ros2.cdr import DecodeError

# By type: the hashes of the definitions that are decoded, over Humble, Jazzy and Kilted.
TYPE_HASHES: Final = {
    "sensor_msgs/LaserScan": ("64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",),
    "sensor_msgs/PointCloud2": (
        "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    ),
    "sensor_msgs/Range": (
        "9430b1915b94d4268ff903679e8ecd09b6a67d331bd028738ec1eeb592891ebd",  # Humble
        "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    ),
    "vision_msgs/Detection3DArray": (
        "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    ),
    "autoware_perception_msgs/TrackedObjects": (
        "3559bd4e62ce8a4d96e32720c02bbe656cc090bb2b3f3f91f52a7c3ab095417a",
    ),
    "nav_msgs/OccupancyGrid": ("8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",),
    "tf2_msgs/TFMessage": ("e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",),
}
_NO_HASH: Final = "TypeHashNotSupported"
_GID_BYTES: Final = 16
# A publisher that has been silent for this long may have been replaced by another.
REPLACED_AFTER_S: Final = 1.0


class Attachment(NamedTuple):
    """What rmw_zenoh attaches to a sample: its number, when it was sent, and by whom."""

    sequence: int
    sent_unix_s: float
    publisher: bytes


def key_expression(topic: str, type_name: str, *, bridged: bool, domain: int) -> str:
    """Return the Zenoh key expression to subscribe to.

    Args:
        topic: of ROS, such as ``/scan``.
        type_name: such as ``sensor_msgs/LaserScan``.
        bridged: by zenoh-bridge-ros2dds instead of rmw_zenoh.
        domain: ROS_DOMAIN_ID, for rmw_zenoh.
    """
    name = topic.strip("/")
    return name if bridged else f"{domain}/{name}/{_dds_type(type_name)}/**"


def published_key(topic: str, type_name: str, type_hash: str, *, bridged: bool, domain: int) -> str:
    """Return the Zenoh key to publish under.

    Args:
        topic: of ROS.
        type_name: such as ``visualization_msgs/MarkerArray``.
        type_hash: of its definition, with its scheme.
        bridged: by zenoh-bridge-ros2dds instead of rmw_zenoh.
        domain: ROS_DOMAIN_ID, for rmw_zenoh.
    """
    name = topic.strip("/")
    return name if bridged else f"{domain}/{name}/{_dds_type(type_name)}/{type_hash}"


def decode_attachment(data: bytes) -> Attachment:
    """Decode an attachment of rmw_zenoh, with or without the names of its fields.

    Raises:
        DecodeError: it is neither.
    """
    sequence, data = _number(data, b"sequence_number")
    sent_ns, data = _number(data, b"source_timestamp")
    data = _after_name(data, b"source_gid")
    if len(data) != 1 + _GID_BYTES or data[0] != _GID_BYTES:
        raise DecodeError("attachment")
    return Attachment(sequence, sent_ns * 1e-9, data[1:])


def check_key(key: str, type_name: str) -> None:
    """Check type and hash at the end of a key of rmw_zenoh.

    Raises:
        DecodeError: the key names another type, or a definition of it that is not decoded.
    """
    parts = key.split("/")
    if len(parts) < 2 or parts[-2] != _dds_type(type_name):
        raise DecodeError("another type")
    known = {f"RIHS01_{each}" for each in TYPE_HASHES[type_name]}
    if parts[-1] != _NO_HASH and parts[-1] not in known:
        raise DecodeError("unknown hash of the type")


class OnePublisher:
    """Lets through the samples of one publisher at a time: two of them are two sensors."""

    def __init__(self) -> None:
        self._publisher: bytes | None = None
        self._heard_s = float("-inf")

    def check(self, attachment: bytes, now_s: float) -> None:
        """Check who sent a sample; one without an attachment came from a bridge.

        Raises:
            DecodeError: the attachment is malformed, or another publisher is still heard.
        """
        publisher = decode_attachment(attachment).publisher if attachment else b""
        silent = now_s - self._heard_s > REPLACED_AFTER_S
        if self._publisher not in (None, publisher) and not silent:
            raise DecodeError("two publishers")
        self._publisher, self._heard_s = publisher, now_s


def _dds_type(type_name: str) -> str:
    package, _, name = type_name.partition("/")
    return f"{package}::msg::dds_::{name}_"


def _number(data: bytes, name: bytes) -> tuple[int, bytes]:
    data = _after_name(data, name)
    if len(data) < 8:
        raise DecodeError("attachment")
    return struct.unpack("<q", data[:8])[0], data[8:]


def _after_name(data: bytes, name: bytes) -> bytes:
    """Return what follows the name of a field, if the name is there: its length, then itself."""
    return data.removeprefix(bytes((len(name),)) + name)
