"""Writes CDR as ROS 2 reads it: OMG DDS-XTypes 1.3, 7.4.1, plain CDR version 1, little endian."""

from __future__ import annotations

import struct
from typing import Final

_HEADER: Final = b"\x00\x01\x00\x00"


class CdrWriter:
    """Appends values; alignment counts from behind the header."""

    def __init__(self) -> None:
        self._data = bytearray()

    def payload(self) -> bytes:
        """Return what was written, with its header."""
        return _HEADER + bytes(self._data)

    def u8(self, *values: int) -> CdrWriter:
        """Write bytes; a boolean is 0 or 1."""
        self._data += bytes(values)
        return self

    def i32(self, *values: int) -> CdrWriter:
        """Write signed integers of 32 bits."""
        return self._add("i", 4, values)

    def u32(self, *values: int) -> CdrWriter:
        """Write unsigned integers of 32 bits, or lengths of sequences."""
        return self._add("I", 4, values)

    def f32(self, *values: float) -> CdrWriter:
        """Write numbers in single precision."""
        return self._add("f", 4, values)

    def f64(self, *values: float) -> CdrWriter:
        """Write numbers in double precision."""
        return self._add("d", 8, values)

    def text(self, value: str) -> CdrWriter:
        """Write a string: its length with the zero byte that ends it, then UTF-8."""
        data = value.encode() + b"\x00"
        self.u32(len(data))
        self._data += data
        return self

    def _add(self, kind: str, size: int, values: tuple[float, ...]) -> CdrWriter:
        if values:  # a sequence without elements has no alignment either
            self._data += bytes(-len(self._data) % size)
        self._data += struct.pack(f"<{len(values)}{kind}", *values)
        return self
