"""Writes plain CDR, little endian, as ROS 2 serializes messages.

Primitive values are aligned to their size, counted from behind the four bytes of the header; texts
end in NUL, and their length counts it (OMG DDSI-RTPS 2.2, section 10; OMG CDR, section 15.3).
"""

from __future__ import annotations

import math
import struct
from typing import Final

_HEADER: Final = b"\x00\x01\x00\x00"


class CdrWriter:
    """Appends values to one message."""

    def __init__(self) -> None:
        self._data = bytearray()

    def add(self, kinds: str, *values: float) -> CdrWriter:
        """Append numbers.

        Args:
            kinds: one letter of `struct` for each.
            values: the numbers.
        """
        for kind, value in zip(kinds, values, strict=True):
            size = struct.calcsize(f"<{kind}")
            self._data += bytes(-len(self._data) % size)
            self._data += struct.pack(f"<{kind}", value)
        return self

    def text(self, value: str) -> CdrWriter:
        """Append a string."""
        encoded = value.encode() + b"\x00"
        self.add("I", len(encoded))
        self._data += encoded
        return self

    def raw(self, data: bytes) -> CdrWriter:
        """Append bytes that are aligned already, such as the elements of a sequence."""
        self._data += data
        return self

    def header(self, stamp_unix_s: float, frame_id: str) -> CdrWriter:
        """Append a std_msgs/Header."""
        # All of it in nanoseconds would be too long a number for a float.
        seconds = math.floor(stamp_unix_s)
        carried, nanoseconds = divmod(round((stamp_unix_s - seconds) * 1e9), 1_000_000_000)
        return self.add("iI", seconds + carried, nanoseconds).text(frame_id)

    def payload(self) -> bytes:
        """Return the whole message."""
        return _HEADER + bytes(self._data)
