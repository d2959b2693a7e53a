"""Reads CDR as ROS 2 serializes its messages: OMG DDS-XTypes 1.3, 7.4.1, plain CDR version 1.

Four bytes say the order of bytes; alignment counts from what follows them.  ROS 2 uses neither
parameter lists nor version 2.  Whatever a payload contains, all that is raised is `DecodeError`.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

_HEADER_BYTES: Final = 4
_ORDERS: Final = {b"\x00\x00": ">", b"\x00\x01": "<"}
# Some implementations fill the payload up to a multiple of four.
_PADDING_MAX: Final = 3
STRING_BYTES_MAX: Final = 1024


class DecodeError(ValueError):
    """A payload that cannot be a message of its kind.

    Attributes:
        reason: what is wrong, in a few words without numbers, so that it can be counted by.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class CdrReader:
    """Reads one payload from its begin to its end.

    Args:
        payload: with the header of four bytes.

    Raises:
        DecodeError: the header is not one of plain CDR, version 1.
    """

    def __init__(self, payload: bytes) -> None:
        order = _ORDERS.get(payload[:2])
        if order is None or len(payload) < _HEADER_BYTES:
            raise DecodeError("not plain CDR")
        self.order = order
        self._data = memoryview(payload)[_HEADER_BYTES:]
        self._at = 0

    @property
    def left(self) -> int:
        """Number of bytes that have not been read."""
        return len(self._data) - self._at

    def u8(self) -> int:
        """Read one byte."""
        return int(self._take(1, 1)[0])

    def flag(self) -> bool:
        """Read a boolean: a byte that is 0 or 1."""
        value = self.u8()
        if value > 1:
            raise DecodeError("boolean is neither 0 nor 1")
        return bool(value)

    def i32(self) -> int:
        """Read a signed integer of 32 bits."""
        return int(struct.unpack(f"{self.order}i", self._take(4, 4))[0])

    def u32(self) -> int:
        """Read an unsigned integer of 32 bits."""
        return int(struct.unpack(f"{self.order}I", self._take(4, 4))[0])

    def f32(self) -> float:
        """Read a number in single precision."""
        return float(struct.unpack(f"{self.order}f", self._take(4, 4))[0])

    def f64(self) -> float:
        """Read a number in double precision."""
        return float(struct.unpack(f"{self.order}d", self._take(8, 8))[0])

    def f64s(self, count: int) -> tuple[float, ...]:
        """Read a fixed number of numbers in double precision."""
        return struct.unpack(f"{self.order}{count}d", self._take(8 * count, 8))

    def text(self) -> str:
        """Read a string: its length with the zero byte that ends it, then UTF-8."""
        length = self.u32()
        if length > STRING_BYTES_MAX:
            raise DecodeError("string too long")
        if length == 0:
            return ""
        data = bytes(self._take(length, 1))
        if data[-1] != 0:
            raise DecodeError("string without end")
        try:
            return data[:-1].decode()
        except UnicodeDecodeError as error:
            raise DecodeError("string is not UTF-8") from error

    def count(self, least_bytes: int, limit: int | None = None, of: str = "elements") -> int:
        """Read the length of a sequence; no more than the rest of the payload can contain.

        Args:
            least_bytes: that one element of it takes, at least.
            limit: how many of them are read at most; None for as many as there are.
            of: what they are, for the error.
        """
        number = self.u32()
        if limit is not None and number > limit:
            raise DecodeError(f"number of {of}")
        if number * least_bytes > self.left:
            raise DecodeError("sequence longer than the payload")
        return number

    def f32s(self) -> NDArray[np.float32]:
        """Read a sequence of numbers in single precision, without a copy where possible."""
        number = self.count(4)
        found = np.frombuffer(self._take(4 * number, 4), f"{self.order}f4")
        return found.astype(np.float32, copy=False)

    def blob(self) -> memoryview:
        """Read a sequence of bytes, without a copy."""
        return self._take(self.count(1), 1)

    def end(self) -> None:
        """Check that nothing follows but padding.

        Raises:
            DecodeError: more follows, so that this is another message.
        """
        if self.left > _PADDING_MAX:
            raise DecodeError("bytes left over")

    def _take(self, size: int, alignment: int) -> memoryview:
        begin = -(-self._at // alignment) * alignment if size else self._at
        if begin + size > len(self._data):
            raise DecodeError("truncated")
        self._at = begin + size
        return self._data[begin : self._at]
