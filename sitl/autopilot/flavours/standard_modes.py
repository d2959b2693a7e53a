"""Standard modes: AVAILABLE_MODES, CURRENT_MODE, and what MAV_CMD_DO_SET_STANDARD_MODE means."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Final

from sitl.autopilot.modes import Mode
from sitl.autopilot.packed_message import PackedMessage

AVAILABLE_MODES_ID: Final = 435
CURRENT_MODE_ID: Final = 436
AVAILABLE_MODES_MONITOR_ID: Final = 437
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


class CurrentMode(PackedMessage):
    """CURRENT_MODE: the mode flown, and the one that the user asked for."""

    layout = struct.Struct("<IIB")

    def __init__(self, mode: Mode, custom_mode: int, intended_custom_mode: int) -> None:
        standard = STANDARD_MODES.get(mode, _NON_STANDARD)
        super().__init__(
            CURRENT_MODE_ID, "CURRENT_MODE", 193, custom_mode, intended_custom_mode, standard
        )


class AvailableMode(PackedMessage):
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


class AvailableModesMonitor(PackedMessage):
    """AVAILABLE_MODES_MONITOR: a number that changes with the list of modes, here never."""

    layout = struct.Struct("<B")

    def __init__(self) -> None:
        super().__init__(AVAILABLE_MODES_MONITOR_ID, "AVAILABLE_MODES_MONITOR", 30, 0)
