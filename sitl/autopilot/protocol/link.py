"""One MAVLink connection without its socket: frames out of bytes, bytes out of messages."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.mavlink_frames import FrameReader, FrameWriter, frame_length
from sitl.autopilot.protocol.signing import Signing


class _Outbox(bytearray):
    """The file that pymavlink writes to."""

    def write(self, data: bytes) -> None:
        self.extend(data)


class MavlinkLink:
    """Codec of one link; keeps its own sequence number.

    Attributes:
        frames_received: valid and, where signing is on, genuine frames so far.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self.frames_received = 0
        self._outbox = _Outbox()
        self._encoder = FrameWriter(self._outbox, system_id, component_id)
        self._reader = FrameReader(mavlink, trusts_unknown=False)
        self._signing: Signing | None = None

    def parse(self, data: bytes) -> list[Any]:
        """Return the genuine messages that ``data`` completes; bytes may arrive in any portions."""
        messages = self._reader.read(data)
        if self._signing is not None:
            messages = [one for one in messages if self._signing.accepts(one.get_msgbuf())]
        self.frames_received += len(messages)
        return messages

    @property
    def bytes_dropped(self) -> int:
        """Bytes that did not belong to a valid, known frame."""
        return self._reader.bytes_dropped

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


def split_frames(data: bytes, length_max: int) -> list[bytes]:
    """Cut a run of whole frames into portions of at most ``length_max``, between frames only."""
    frames = bytearray(data)
    portions = []
    start = end = 0
    while end < len(frames):
        length = frame_length(frames, end, mavlink.mavlink_map) or len(frames) - end
        if end > start and end + length - start > length_max:
            portions.append(data[start:end])
            start = end
        end += length
    if end > start:
        portions.append(data[start:end])
    return portions
