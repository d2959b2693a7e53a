"""MAVLink frames out of a stream of bytes, so that garbage never takes an intact one with it.

pymavlink's own parser gives up the whole length that a damaged frame claims, and with it the intact
frames therein.  Here the search goes on at the very next byte; decoding stays pymavlink's.
"""

from __future__ import annotations

import logging
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

logger = logging.getLogger(__name__)

# What surrounds the payload: start byte, header, checksum.
_OVERHEAD: Final = {mavlink.PROTOCOL_MARKER_V1: 8, mavlink.PROTOCOL_MARKER_V2: 12}


class FrameReader:
    """Finds the messages on one link; bytes may arrive in any portions.

    Args:
        dialect: module of `pymavlink.dialects.v20`.
        trusts_unknown: whether a frame whose id is outside the dialect, so that its checksum says
            nothing, is believed to be one.  An autopilot sends many of them, garbage looks like
            them.

    Attributes:
        bytes_dropped: bytes that were no part of a valid frame.
    """

    def __init__(self, dialect: Any, *, trusts_unknown: bool) -> None:
        self.bytes_dropped = 0
        self._codec = dialect.MAVLink(None)
        self._error = dialect.MAVError
        self._trusts_unknown = trusts_unknown
        self._pending = bytearray()

    def read(self, data: bytes) -> list[Any]:
        """Return the messages that ``data`` completes."""
        self._pending += data
        pending, start = self._pending, 0
        messages = []
        while start < len(pending):
            length = frame_length(pending, start)
            if length is None:
                break  # incomplete
            message = self._decoded(pending[start : start + length]) if length else None
            if message is None:
                self.bytes_dropped += 1
                start += 1
            else:
                messages.append(message)
                start += length
        del pending[:start]
        return messages

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
