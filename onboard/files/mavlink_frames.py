"""Finds MAVLink frames in a stream of bytes.

It resynchronizes at the next byte, so corruption never discards a valid frame: pymavlink's own
parser skips the whole length that a damaged frame claims, and with it the valid frames therein.
Layouts of messages are pymavlink's, and so is the coding of those with arrays or texts.  Messages
of numbers alone, which all frequent ones are, are coded here in less than half of the time.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Collection, Mapping
from functools import cache
from operator import attrgetter
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.dialects.v20 import common as mavlink

logger = logging.getLogger(__name__)

_HEADER_LENGTH: Final = {mavlink.PROTOCOL_MARKER_V1: 6, mavlink.PROTOCOL_MARKER_V2: 10}
_CHECKSUM_LENGTH: Final = 2
# Of MAVLink 2: marker, length of the payload, flags (2), sequence, system, component, id (2 + 1).
_HEADER: Final = struct.Struct("<BBBBBBBHB")
_CHECKSUM: Final = struct.Struct("<H")


class _Layout(NamedTuple):
    """How a message that consists of numbers alone is coded.

    Attributes:
        numbers: its payload.
        check: the check byte of its definition.
        names: of its fields, in the order of the wire.
        values: gets them from a message.
        empty: attributes of a message whose fields are all zero.
    """

    numbers: struct.Struct
    check: bytes
    names: list[str]
    values: Callable[[Any], tuple[Any, ...]]
    empty: dict[str, Any]


@cache
def _layout_of(kind: Any) -> _Layout | None:
    """Return the layout of a class of messages; None if pymavlink has to code them."""
    names = list(getattr(kind, "ordered_fieldnames", ()))
    derived = not kind.__module__.startswith("pymavlink.")  # may code itself in its own way
    if derived or len(names) <= 1 or any(kind.array_lengths):
        return None
    empty = vars(kind(*(0,) * len(names)))
    return _Layout(kind.unpacker, bytes((kind.crc_extra,)), names, attrgetter(*names), empty)


def _checksum(checked: bytes | bytearray) -> int:
    """Return the CRC-16/MCRF4XX of a frame from its length on, check byte included."""
    if ardupilotmega.mcrf4xx is None:  # as where fastcrc is not installed
        return int(ardupilotmega.x25crc(checked).crc)
    return int(ardupilotmega.mcrf4xx(bytes(checked), 0xFFFF))


class FrameWriter(ardupilotmega.MAVLink):  # type: ignore[misc]  # pymavlink is untyped
    """Encodes as pymavlink does, frequent messages faster.

    Unlike pymavlink, it leaves a message of numbers as it was: without header and buffer.
    """

    seq: int

    def send(self, mavmsg: Any, force_mavlink1: bool = False) -> None:
        """Write one message to the file; see pymavlink.

        Raises:
            struct.error: a number does not fit its field.
        """
        kind: Any = type(mavmsg)
        layout = _layout_of(kind)
        special = force_mavlink1 or self.signing.sign_outgoing or self.send_callback is not None
        if layout is None or special:
            super().send(mavmsg, force_mavlink1=force_mavlink1)
            return
        # Zeros at the end are left out, but for the first byte.
        payload = layout.numbers.pack(*layout.values(mavmsg)).rstrip(b"\0") or b"\0"
        header = _HEADER.pack(
            mavlink.PROTOCOL_MARKER_V2,
            len(payload),
            0,
            0,
            self.seq,
            self.srcSystem,
            self.srcComponent,
            kind.id & 0xFFFF,
            kind.id >> 16,
        )
        checksum = _checksum(header[1:] + payload + layout.check)
        frame = header + payload + _CHECKSUM.pack(checksum)
        self.file.write(frame)
        self.seq = (self.seq + 1) % 256
        self.total_packets_sent += 1
        self.total_bytes_sent += len(frame)


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
        self._header = dialect.MAVLink_header
        self._error = dialect.MAVError
        # Otherwise an environment variable would make pymavlink accept damaged frames.
        dialect.MAVLINK_IGNORE_CRC = False
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
            layout = None if kind is None else _layout_of(kind)
            if kind is not None and layout is not None:
                if not _fits(frame, layout.check):
                    return False
                messages.append(self._message(frame, message_id, kind, layout))
                return True
            try:
                messages.append(self._codec.decode(frame))
            except self._error as error:  # its checksum does not fit, most of all
                logger.debug("no MAVLink frame: %s", error)
                return False
            return True
        return kind is None or _fits(frame, bytes((kind.crc_extra,)))

    def _message(self, frame: bytearray, message_id: int, kind: Any, layout: _Layout) -> Any:
        """Return the message of a whole frame of which the checksum fits, as pymavlink does."""
        header_length, length = _HEADER_LENGTH[frame[0]], frame[1]
        # Sequence, system and component come before the id: one byte of it, or three.
        at, flags = (4, frame[2:4]) if frame[0] == mavlink.PROTOCOL_MARKER_V2 else (2, b"\0\0")
        end = header_length + length
        payload = frame[header_length:end].ljust(layout.numbers.size, b"\0")
        message = kind.__new__(kind)
        attributes = message.__dict__
        attributes.update(layout.empty)
        attributes.update(zip(layout.names, layout.numbers.unpack_from(payload), strict=True))
        attributes["_msgbuf"], attributes["_payload"] = frame, frame[6:end]
        attributes["_crc"] = frame[end] | frame[end + 1] << 8
        attributes["_header"] = self._header(message_id, *flags, length, *frame[at : at + 3])
        return message


def _fits(frame: bytearray, check: bytes) -> bool:
    """Tell whether a frame's checksum fits."""
    end = _HEADER_LENGTH[frame[0]] + frame[1]
    return _checksum(frame[1:end] + check) == frame[end] | frame[end + 1] << 8


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
