"""The MAVLink traffic as a ``.tlog``: what MAVProxy, Mission Planner and QGroundControl replay.

A sequence of entries: Unix time in microseconds, eight bytes, big-endian; then one MAVLink frame.
"""

from __future__ import annotations

import struct
from types import TracebackType
from typing import Final, Self

from onboard.recording.flight_log import Direction
from onboard.recording.rotation import LogParts

# Length of a frame without its payload and signature (https://mavlink.io/en/guide/serialization).
_V1_MAGIC, _V1_OVERHEAD = 0xFE, 8
_V2_MAGIC, _V2_OVERHEAD = 0xFD, 12
_SIGNATURE_BYTES: Final = 13
_SIGNED: Final = 0x01


class FrameSplitter:
    """Cuts a byte stream into MAVLink frames; bytes between frames are dropped."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def split(self, data: bytes) -> list[bytes]:
        """Take bytes; return the frames that they complete, whole and in order."""
        buffer, frames = self._buffer, []
        buffer += data
        while buffer:
            if buffer[0] not in (_V1_MAGIC, _V2_MAGIC):
                del buffer[0]
                continue
            length = _frame_length(buffer)
            if length is None or len(buffer) < length:
                break
            frames.append(bytes(buffer[:length]))
            del buffer[:length]
        return frames


def _frame_length(buffer: bytearray) -> int | None:
    """Length of the frame at the start of the buffer; None before its header is there."""
    if len(buffer) < 3:
        return None
    if buffer[0] == _V1_MAGIC:
        return _V1_OVERHEAD + buffer[1]
    return _V2_OVERHEAD + buffer[1] + (_SIGNATURE_BYTES if buffer[2] & _SIGNED else 0)


class TelemetryLog:
    """Writes both directions of a MAVLink link to a ``.tlog``, and to the next when it is full.

    Args:
        parts: names and sizes of the files.

    Raises:
        OSError: the file cannot be written, or exists.
    """

    def __init__(self, parts: LogParts) -> None:
        self._parts = parts
        self._file = parts.open_next()
        self._splitters: dict[Direction, FrameSplitter] = {
            "received": FrameSplitter(),
            "sent": FrameSplitter(),
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Append bytes as they crossed the link.

        Raises:
            OSError: the disk is full, or gone.
        """
        if self._file.tell() >= self._parts.part_bytes:
            self._file.close()
            self._file = self._parts.open_next()
        stamp = struct.pack(">Q", round(time_unix_s * 1e6))
        for frame in self._splitters[direction].split(data):
            self._file.write(stamp + frame)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
