"""Messages about the autopilot itself that exist on request only."""

from __future__ import annotations

import struct
from typing import Final

from sitl.autopilot.packed_message import PackedMessage

PROTOCOL_VERSION_ID: Final = 300
COMPONENT_METADATA_ID: Final = 397
_MAVLINK_1, _MAVLINK_2 = 100, 200
_UNKNOWN_HASH = bytes(8)


class ProtocolVersion(PackedMessage):
    """PROTOCOL_VERSION: MAVLink 2 is spoken, 1 and 2 are understood."""

    layout = struct.Struct("<HHH8s8s")

    def __init__(self) -> None:
        versions = (_MAVLINK_2, _MAVLINK_1, _MAVLINK_2)
        hashes = (_UNKNOWN_HASH, _UNKNOWN_HASH)
        super().__init__(PROTOCOL_VERSION_ID, "PROTOCOL_VERSION", 217, *versions, *hashes)


class ComponentMetadata(PackedMessage):
    """COMPONENT_METADATA: where the general metadata are, and their checksum."""

    layout = struct.Struct("<II100s")

    def __init__(self, boot_ms: int, checksum: int, path: str) -> None:
        uri = f"mftp:///{path}".encode()
        super().__init__(COMPONENT_METADATA_ID, "COMPONENT_METADATA", 182, boot_ms, checksum, uri)
