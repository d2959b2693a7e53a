"""The entries of a ``.tlog``: Unix time in microseconds (eight bytes, big-endian), one frame."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_STAMP = struct.Struct(">Q")
_V1, _V2, _SIGNED, _SIGNATURE_BYTES = 0xFE, 0xFD, 0x01, 13


@dataclass(frozen=True)
class Entry:
    """One frame, and when it crossed the link."""

    time_unix_s: float
    frame: bytes

    @property
    def sender(self) -> tuple[int, int]:
        """System and component that sent it."""
        at = 3 if self.frame[0] == _V1 else 5
        return self.frame[at], self.frame[at + 1]

    @property
    def message_id(self) -> int:
        if self.frame[0] == _V1:
            return self.frame[5]
        return int.from_bytes(self.frame[7:10], "little")


def read_tlog(path: Path) -> Iterator[Entry]:
    """Yield the entries of a file, up to where it breaks off."""
    data, at = path.read_bytes(), 0
    while at + _STAMP.size + 3 <= len(data):
        (stamp_us,) = _STAMP.unpack_from(data, at)
        at += _STAMP.size
        if data[at] == _V1:
            length = 8 + data[at + 1]
        elif data[at] == _V2:
            length = 12 + data[at + 1] + (_SIGNATURE_BYTES if data[at + 2] & _SIGNED else 0)
        else:
            raise ValueError(f"{path}: byte {at} begins no MAVLink frame")
        if at + length > len(data):
            return
        yield Entry(stamp_us * 1e-6, data[at : at + length])
        at += length


def write_tlog(path: Path, entries: Iterable[Entry]) -> None:
    with path.open("wb") as file:
        for entry in entries:
            file.write(_STAMP.pack(round(entry.time_unix_s * 1e6)) + entry.frame)


class Decoder:
    """Reads the messages of the dialect that both autopilots speak; None for those of others."""

    def __init__(self) -> None:
        self._codec = mavlink.MAVLink(None)

    def decode(self, entry: Entry) -> Any | None:
        if entry.message_id not in mavlink.mavlink_map:
            return None
        return self._codec.decode(bytearray(entry.frame))
