"""Messages that pymavlink's dialect of ArduPilot lacks, packed from MAVLink's definition."""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class PackedMessage(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink is untyped
    """A message that pymavlink's dialect lacks.

    Args:
        number: message id.
        name: as in MAVLink's definition.
        crc_extra: the check byte of its definition.
        values: of its fields, in the order of the wire.
    """

    layout: ClassVar[struct.Struct]

    def __init__(self, number: int, name: str, crc_extra: int, *values: Any) -> None:
        super().__init__(number, name)
        self.crc_extra = crc_extra
        self._values = values

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame; see pymavlink."""
        payload = self.layout.pack(*self._values)
        packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packed
