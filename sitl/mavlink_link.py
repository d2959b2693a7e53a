"""One MAVLink connection without its socket: frames out of bytes, bytes out of messages."""

from __future__ import annotations

import logging
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.signing import SIGNATURE_LENGTH, Signing

logger = logging.getLogger(__name__)

# Header after the start byte, payload length excluded, plus the checksum.
_OVERHEAD = {mavlink.PROTOCOL_MARKER_V1: 8, mavlink.PROTOCOL_MARKER_V2: 12}


class _Outbox(bytearray):
    """The `file` that pymavlink writes to."""

    def write(self, data: bytes) -> None:
        self.extend(data)


class MavlinkLink:
    """Codec of one link; keeps its own sequence number.

    Attributes:
        frames_received: valid and, where signing is on, genuine frames so far.
        bytes_dropped: bytes that were no part of a valid, known frame.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self.frames_received = 0
        self.bytes_dropped = 0
        self._outbox = _Outbox()
        self._encoder = mavlink.MAVLink(self._outbox, system_id, component_id)
        self._decoder = mavlink.MAVLink(None, system_id, component_id)
        self._signing: Signing | None = None
        self._pending = bytearray()

    def parse(self, data: bytes) -> list[Any]:
        """Return the messages that ``data`` completes; bytes may arrive in any portions.

        After a false start or a damaged frame the search goes on at the very next byte, so that
        garbage never takes an intact frame with it.
        """
        self._pending.extend(data)
        pending = self._pending
        messages: list[Any] = []
        start = 0
        while start < len(pending):
            length = _frame_length(pending, start)
            if length is None:
                break  # incomplete
            message = self._decoded(bytes(pending[start : start + length])) if length else None
            if message is None:
                self.bytes_dropped += 1
                start += 1
            else:
                start += length
                if self._signing is None or self._signing.accepts(message.get_msgbuf()):
                    self.frames_received += 1
                    messages.append(message)
        del pending[:start]
        return messages

    def sign_with(self, signing: Signing | None) -> None:
        """Sign what goes out and refuse what is not signed alike; None for neither."""
        self._signing = signing
        self._encoder.signing = mavlink.MAVLinkSigning() if signing is None else signing.outgoing

    def send(self, message: Any) -> None:
        """Queue a message in this link's sequence."""
        self._encoder.send(message)

    def forward(self, message: Any) -> None:
        """Queue a received frame unchanged, sequence and sender included."""
        self._outbox.write(message.get_msgbuf())

    def take(self) -> bytes:
        """Return and clear what is queued."""
        data = bytes(self._outbox)
        self._outbox.clear()
        return data

    def _decoded(self, frame: bytes) -> Any:
        try:
            message = self._decoder.decode(bytearray(frame))
        except mavlink.MAVError as error:
            logger.debug("dropped a frame: %s", error)
            return None
        # An id outside the dialect cannot be checked against its checksum: not a frame to us.
        return None if message.get_msgId() < 0 else message


def _frame_length(data: bytearray, start: int) -> int | None:
    """Length of the frame at ``start``; 0 if none can start there, None if bytes are missing."""
    overhead = _OVERHEAD.get(data[start])
    if overhead is None:
        return 0
    if len(data) < start + 3:
        return None
    length = overhead + int(data[start + 1])
    if data[start] == mavlink.PROTOCOL_MARKER_V2:
        flags = data[start + 2]
        if flags & ~mavlink.MAVLINK_IFLAG_SIGNED:
            return 0
        if flags:
            length += SIGNATURE_LENGTH
    return None if len(data) < start + length else length


def split_frames(data: bytes, length_max: int) -> list[bytes]:
    """Cut a run of whole frames into portions of at most ``length_max``, between frames only."""
    frames = bytearray(data)
    portions = []
    start = end = 0
    while end < len(frames):
        length = _frame_length(frames, end) or len(frames) - end
        if end > start and end + length - start > length_max:
            portions.append(data[start:end])
            start = end
        end += length
    if end > start:
        portions.append(data[start:end])
    return portions
