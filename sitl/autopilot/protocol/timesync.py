"""TIMESYNC as PX4 answered it before November 2025: with an uninitialized target."""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# Neither all systems (0) nor an existing one; the content of an uninitialized field is arbitrary.
_UNINITIALIZED_TARGET: Final = bytes((0xA5, 0x5A))


class MisaddressedTimesync(mavlink.MAVLink_timesync_message):  # type: ignore[misc]  # untyped
    """TIMESYNC with the target fields, which pymavlink's dialect lacks and no receiver reads."""

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame; see pymavlink."""
        payload = self.unpacker.pack(self.tc1, self.ts1) + _UNINITIALIZED_TARGET
        packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packed
