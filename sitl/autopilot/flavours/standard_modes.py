"""Standard modes: AVAILABLE_MODES, CURRENT_MODE, and what MAV_CMD_DO_SET_STANDARD_MODE means.

pymavlink's dialect of ArduPilot does not have the two messages, so they are packed here, from
MAVLink's definition (common.xml).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode

AVAILABLE_MODES_ID: Final = 435
CURRENT_MODE_ID: Final = 436
_NON_STANDARD: Final = 0
_PROPERTY_AUTO: Final = 4

# MAV_STANDARD_MODE of each mode that is one; PX4's, as its CURRENT_MODE shows them.
STANDARD_MODES: Final[Mapping[Mode, int]] = {
    Mode.POSCTL: 1,
    Mode.ALTCTL: 4,
    Mode.RTL: 5,
    Mode.MISSION: 6,
    Mode.LAND: 7,
    Mode.TAKEOFF: 8,
}
_MODE_OF_STANDARD: Final = {number: mode for mode, number in STANDARD_MODES.items()}


def mode_of_standard(number: float) -> Mode | None:
    """Return the mode of a MAV_STANDARD_MODE; None for an unknown number."""
    return _MODE_OF_STANDARD.get(int(number)) if math.isfinite(number) else None


class _Packed(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink is untyped
    """A message that pymavlink's dialect lacks."""

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


class CurrentMode(_Packed):
    """CURRENT_MODE: the mode flown, and the one that the user asked for."""

    layout = struct.Struct("<IIB")

    def __init__(self, mode: Mode, custom_mode: int, intended_custom_mode: int) -> None:
        standard = STANDARD_MODES.get(mode, _NON_STANDARD)
        super().__init__(
            CURRENT_MODE_ID, "CURRENT_MODE", 193, custom_mode, intended_custom_mode, standard
        )


class AvailableMode(_Packed):
    """AVAILABLE_MODES: one of them."""

    layout = struct.Struct("<IIBBB35s")

    def __init__(self, mode: Mode, custom_mode: int, index: int, count: int) -> None:
        properties = 0 if mode.needs_sticks else _PROPERTY_AUTO
        standard = STANDARD_MODES.get(mode, _NON_STANDARD)
        name = mode.name.capitalize().encode()
        super().__init__(
            AVAILABLE_MODES_ID,
            "AVAILABLE_MODES",
            134,
            *(custom_mode, properties, count, index, standard, name),
        )
