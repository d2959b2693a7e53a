"""Finds MAVLink frames in a stream of bytes.

It resynchronises at the next byte, so corruption never discards a valid frame: pymavlink's own
parser skips the whole length that a damaged frame claims, and with it the valid frames therein.
Decoding is pymavlink's.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

logger = logging.getLogger(__name__)

_HEADER_LENGTH: Final = {mavlink.PROTOCOL_MARKER_V1: 6, mavlink.PROTOCOL_MARKER_V2: 10}
_CHECKSUM_LENGTH: Final = 2


class FrameReader:
    """Finds the messages on one link; bytes may arrive in any portions.

    Args:
        dialect: module of `pymavlink.dialects.v20`.
        wanted: ids of the messages to decode; all if None.  Of others only the checksum is looked
            at, which takes a tenth of the time.
        trusts_unknown: whether to pass over a MAVLink 2 frame whose id is outside the dialect, of
            which the checksum cannot be checked.  An autopilot sends many of them; but corrupted
            bytes that look like one discard the frames within.

    Attributes:
        bytes_dropped: bytes that were no part of a valid frame.
    """

    def __init__(
        self, dialect: Any, wanted: Collection[int] | None = None, *, trusts_unknown: bool
    ) -> None:
        self.bytes_dropped = 0
        self._wanted = wanted
        self._trusts_unknown = trusts_unknown
        self._codec = dialect.MAVLink(None)
        self._error = dialect.MAVError
        # Otherwise an environment variable would make pymavlink accept damaged frames.
        dialect.MAVLINK_IGNORE_CRC = False
        self._crc = dialect.x25crc
        self._kinds = dialect.mavlink_map
        self._pending = bytearray()

    def read(self, data: bytes) -> list[Any]:
        """Return the wanted messages that ``data`` completes."""
        self._pending += data
        pending, start = self._pending, 0
        messages: list[Any] = []
        try:
            while start < len(pending):
                length = frame_length(pending, start, self._kinds)
                if length is None:
                    break  # incomplete
                if length and self._take(pending[start : start + length], messages):
                    start += length
                else:
                    self.bytes_dropped += 1
                    start += 1
        finally:
            del pending[:start]
        return messages

    def _take(self, frame: bytearray, messages: list[Any]) -> bool:
        """Add a frame's message, if it is wanted; tell whether it is a frame at all."""
        message_id = _id_of(frame)
        kind = self._kinds.get(message_id)
        if kind is None and not self._trusts_unknown:
            return False
        if self._wanted is None or message_id in self._wanted:
            try:
                messages.append(self._codec.decode(frame))
            except self._error as error:  # its checksum does not fit, most of all
                logger.debug("no MAVLink frame: %s", error)
                return False
            return True
        return kind is None or self._fits(frame, kind.crc_extra)

    def _fits(self, frame: bytearray, crc_extra: int) -> bool:
        """Tell whether a frame's checksum fits."""
        end = _HEADER_LENGTH[frame[0]] + frame[1]
        expected = int.from_bytes(frame[end : end + _CHECKSUM_LENGTH], "little")
        return bool(self._crc(frame[1:end] + bytes((crc_extra,))).crc == expected)


def _id_of(frame: bytearray) -> int:
    """Id of the message in a whole frame."""
    if frame[0] == mavlink.PROTOCOL_MARKER_V1:
        return frame[5]
    return frame[7] | frame[8] << 8 | frame[9] << 16


def frame_length(data: bytearray, start: int, kinds: Mapping[int, Any]) -> int | None:
    """Length of the frame at ``start``; 0 if none can start there, None if bytes are missing.

    Args:
        data: the bytes.
        start: where to look.
        kinds: `mavlink_map` of the dialect.
    """
    header_length = _HEADER_LENGTH.get(data[start])
    if header_length is None:
        return 0
    if len(data) < start + _HEADER_LENGTH[mavlink.PROTOCOL_MARKER_V1]:
        return None
    length = header_length + data[start + 1] + _CHECKSUM_LENGTH
    if data[start] == mavlink.PROTOCOL_MARKER_V1:
        # MAVLink 1 has no extension fields; messages of other dialects are not accepted.
        kind = kinds.get(data[start + 5])
        if kind is None or data[start + 1] > kind.unpacker.size:
            return 0
    else:
        flags = data[start + 2]
        if flags & ~mavlink.MAVLINK_IFLAG_SIGNED:
            return 0
        if flags:
            length += mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
    return None if len(data) < start + length else length
