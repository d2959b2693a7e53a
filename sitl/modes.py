"""Flight modes, and how PX4 writes them into HEARTBEAT.custom_mode."""

from __future__ import annotations

import enum


class Mode(enum.Enum):
    """A flight mode; the value is PX4's (main mode, sub mode)."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    MISSION = (4, 4)
    RTL = (4, 5)
    LAND = (4, 6)
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode: main mode in the third byte, sub mode in the fourth."""
        main, sub = self.value
        return int(main << 16 | sub << 24)

    @property
    def needs_sticks(self) -> bool:
        """Whether a pilot's manual control flies the vehicle."""
        return self in {Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED}


_BY_CODE = {mode.value: mode for mode in Mode}


def mode_from_code(main: int, sub: int) -> Mode | None:
    """Return the mode of MAV_CMD_DO_SET_MODE's params 2 and 3; sub modes matter in AUTO only."""
    return _BY_CODE.get((main, sub if main == 4 else 0))


class LandedState(enum.IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4
