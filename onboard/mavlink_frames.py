"""MAVLink frames out of a stream of bytes, so that garbage never takes an intact one with it.

pymavlink's own parser gives up the whole length that a damaged frame claims, and with it the intact
frames therein.  Here the search goes on at the very next byte; decoding stays pymavlink's.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

logger = logging.getLogger(__name__)

_HEADER_LENGTH: Final = 10
# What surrounds the payload: start byte, header, checksum.
_OVERHEAD: Final = {mavlink.PROTOCOL_MARKER_V1: 8, mavlink.PROTOCOL_MARKER_V2: 12}


class FrameReader:
    """Finds the messages on one link; bytes may arrive in any portions.

    Args:
        dialect: module of `pymavlink.dialects.v20`.
        wanted: ids of the messages to decode; all if None.  Of others only the checksum is looked
            at, which takes a tenth of the time.
        trusts_unknown: whether a frame whose id is outside the dialect, so that its checksum says
            nothing, is believed to be one.  An autopilot sends many of them, garbage looks like
            them.

    Attributes:
        bytes_dropped: bytes that were no part of a valid frame.
    """

    def __init__(
        self, dialect: Any, wanted: Collection[int] | None = None, *, trusts_unknown: bool
    ) -> None:
        self.bytes_dropped = 0
        self._kinds = dialect.mavlink_map
        self._crc = dialect.x25crc
        self._wanted = wanted
        self._codec = dialect.MAVLink(None)
        self._error = dialect.MAVError
        self._trusts_unknown = trusts_unknown
        self._pending = bytearray()

    def read(self, data: bytes) -> list[Any]:
        """Return the wanted messages that ``data`` completes."""
        self._pending += data
        pending, start = self._pending, 0
        messages = []
        while start < len(pending):
            length = frame_length(pending, start)
            if length is None:
                break  # incomplete
            frame = pending[start : start + length]
            if length and self._is_unwanted(frame):
                start += length
            elif length and (message := self._decoded(frame)) is not None:
                messages.append(message)
                start += length
            else:
                self.bytes_dropped += 1
                start += 1
        del pending[:start]
        return messages

    def _is_unwanted(self, frame: bytearray) -> bool:
        """Tell whether a frame is intact, but nobody wants it."""
        if self._wanted is None or frame[0] != mavlink.PROTOCOL_MARKER_V2:
            return False
        message_id = int.from_bytes(frame[7:10], "little")
        if message_id in self._wanted:
            return False
        kind = self._kinds.get(message_id)
        if kind is None:
            return self._trusts_unknown
        end = _HEADER_LENGTH + frame[1]
        checksum = self._crc(frame[1:end] + bytes((kind.crc_extra,))).crc
        return bool(checksum == int.from_bytes(frame[end : end + 2], "little"))

    def _decoded(self, frame: bytearray) -> Any:
        try:
            message = self._codec.decode(frame)
        except self._error as error:
            logger.debug("dropped a frame: %s", error)
            return None
        return message if self._trusts_unknown or message.get_msgId() >= 0 else None


def frame_length(data: bytearray, start: int) -> int | None:
    """Length of the frame at ``start``; 0 if none can start there, None if bytes are missing."""
    overhead = _OVERHEAD.get(data[start])
    if overhead is None:
        return 0
    if len(data) < start + 3:
        return None
    length = overhead + data[start + 1]
    if data[start] == mavlink.PROTOCOL_MARKER_V2:
        flags = data[start + 2]
        if flags & ~mavlink.MAVLINK_IFLAG_SIGNED:
            return 0
        if flags:
            length += mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
    return None if len(data) < start + length else length
