"""Where ROS 2 publishes on Zenoh: keys, what is attached to samples, and liveliness tokens.

rmw_zenoh: ``<domain>/<topic>/<type>/<hash of the type>`` (its docs/design.md), with an attachment
of 33 bytes; zenoh-bridge-ros2dds: the topic alone.
"""

from __future__ import annotations

import hashlib
import struct
from typing import Annotated, Final, Literal

from pydantic import Field

from onboard.files.yaml_file import FileModel

Ros2Kind = Literal["laserscan", "pointcloud2", "range"]

# Type, and the hash of its definition (REP 2016) since Jazzy.
_TYPES: Final[dict[Ros2Kind, tuple[str, str]]] = {
    "laserscan": (
        "sensor_msgs::msg::dds_::LaserScan_",
        "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    ),
    "pointcloud2": (
        "sensor_msgs::msg::dds_::PointCloud2_",
        "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    ),
    "range": (
        "sensor_msgs::msg::dds_::Range_",
        "RIHS01_b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    ),
}
_GID_BYTES: Final = 16
_DEFAULT_QOS: Final = "::,1:,:,:,,"


class Ros2Topic(FileModel):
    """Where a sensor publishes on ROS 2.

    Attributes:
        topic: null: its source name.
        middleware: how ROS 2 comes onto Zenoh.
        domain_id: of rmw_zenoh.
        frame_id: in the headers; null: its source name.
    """

    topic: Annotated[str, Field(pattern=r"^/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*$")] | None = None
    middleware: Literal["rmw_zenoh", "zenoh-bridge-ros2dds"] = "rmw_zenoh"
    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    frame_id: str | None = None


class Ros2Publisher:
    """One publisher of one topic.

    Args:
        config: where.
        kind: of its messages.
        source: name of the sensor, of which topic and frame are named by default.
    """

    def __init__(self, config: Ros2Topic, kind: Ros2Kind, source: str) -> None:
        self._config, self._source = config, source
        self._topic = (config.topic or source).strip("/")
        self._type, self._hash = _TYPES[kind]
        self._gid = hashlib.sha256(f"{source} {self._topic}".encode()).digest()[:_GID_BYTES]
        self._sequence = 0
        self.frame_id = source if config.frame_id is None else config.frame_id

    @property
    def key(self) -> str:
        """Zenoh key of its samples."""
        if self._config.middleware != "rmw_zenoh":
            return self._topic
        return f"{self._config.domain_id}/{self._topic}/{self._type}/{self._hash}"

    def token(self, session_id: str) -> str | None:
        """Return the key of the token by which `ros2 topic list` sees it; None for a bridge."""
        if self._config.middleware != "rmw_zenoh":
            return None
        topic = "%" + self._topic.replace("/", "%")
        place = f"{self._config.domain_id}/{session_id}/0/1/MP/%/%/{self._source}"
        return f"@ros2_lv/{place}/{topic}/{self._type}/{self._hash}/{_DEFAULT_QOS}"

    def attachment(self, sent_unix_s: float) -> bytes:
        """Return what goes with the next sample; nothing from a bridge."""
        if self._config.middleware != "rmw_zenoh":
            return b""
        self._sequence += 1
        sent_ns = round(sent_unix_s * 1e9)
        return struct.pack("<qqB", self._sequence, sent_ns, _GID_BYTES) + self._gid
