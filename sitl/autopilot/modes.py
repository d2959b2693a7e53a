"""Flight modes; each flavour encodes them in its own way."""

from __future__ import annotations

import enum


class Mode(enum.Enum):
    """What the autopilot flies; the value is PX4's name for it."""

    MANUAL = "manual"
    ALTCTL = "altitude control"
    POSCTL = "position control"
    ACRO = "acro"
    STABILIZED = "stabilized"
    TAKEOFF = "take-off"
    HOLD = "hold"
    MISSION = "mission"
    RTL = "return"
    LAND = "land"
    OFFBOARD = "offboard"

    @property
    def needs_sticks(self) -> bool:
        """Whether a pilot's manual control flies the vehicle."""
        return self in _STICK_MODES


_STICK_MODES = {Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED}


class LandedState(enum.IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4
