"""Writes the MAVLink traffic of a flight log as a ``.tlog``.

MAVProxy, Mission Planner and QGroundControl replay such a file.  It is a sequence of entries: Unix
time in microseconds, eight bytes, big-endian; then one MAVLink frame.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, Final

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import DAMAGED
from onboard.recording.flight_log import MAVLINK_ENCODING

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
        """Take bytes; return the frames that they complete, in order."""
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
    """Return the length of the frame at the start of the buffer; None if its header is cut."""
    if len(buffer) < 3:
        return None
    if buffer[0] == _V1_MAGIC:
        return _V1_OVERHEAD + buffer[1]
    return _V2_OVERHEAD + buffer[1] + (_SIGNATURE_BYTES if buffer[2] & _SIGNED else 0)


class _Traffic:
    """The MAVLink bytes of a log, part after part.

    Attributes:
        problems: parts that are cut or damaged, one sentence each.
    """

    def __init__(self) -> None:
        self.problems: list[str] = []

    def entries(self, path: Path) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, Unix time in microseconds and bytes of each message, in order of the file.

        Raises:
            CommandError: the file cannot be read, or is not MCAP.
        """
        topics: dict[int, str] = {}
        read_anything = False
        try:
            with path.open("rb") as file:
                for record in StreamReader(file, validate_crcs=True).records:
                    read_anything = True
                    if isinstance(record, Channel):
                        if record.message_encoding == MAVLINK_ENCODING:
                            topics[record.id] = record.topic
                    elif isinstance(record, Message) and record.channel_id in topics:
                        yield topics[record.channel_id], record.log_time // 1000, record.data
        except OSError as error:
            raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from error
        except DAMAGED as error:
            if not read_anything:
                raise CommandError(f"{path}: is not a flight log: {error}") from error
            self.problems.append(f"{path.name} breaks off before its end: the rest is missing")


def write_tlog(parts: Sequence[Path], path: Path) -> tuple[int, list[str]]:
    """Write both directions of the MAVLink traffic.

    Args:
        parts: files of one log, in order.
        path: the file, overwritten.

    Returns:
        How many frames were written, and what could not be read.

    Raises:
        CommandError: a part cannot be read, the log has no MAVLink traffic, or the file cannot be
            written.
    """
    traffic = _Traffic()
    # Read before writing, so that a log without traffic leaves an earlier file untouched.
    entries = _frames(traffic, parts)
    first = next(entries, None)
    if first is None:
        raise CommandError(
            f"{parts[0]}: has no MAVLink traffic: a daemon's log has, a simulated flight's has not"
        )
    try:
        with path.open("wb") as file:
            count = _write_entry(file, first) + sum(_write_entry(file, e) for e in entries)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
    return count, traffic.problems


def _frames(traffic: _Traffic, parts: Sequence[Path]) -> Iterator[tuple[int, bytes]]:
    """Yield every frame with the time of the message that completed it."""
    # A frame may begin in one message, or one part, and end in the next.
    splitters: dict[str, FrameSplitter] = {}
    for part in parts:
        for topic, time_us, data in traffic.entries(part):
            for frame in splitters.setdefault(topic, FrameSplitter()).split(data):
                yield time_us, frame


def _write_entry(file: BinaryIO, entry: tuple[int, bytes]) -> int:
    time_us, frame = entry
    file.write(struct.pack(">Q", time_us) + frame)
    return 1
