"""State and commands of the vehicle: pose, status, setpoint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

# Position (NED, m) and velocity (NED, m/s); NaN where there is none.
Target = tuple[tuple[float, float, float], tuple[float, float, float]]

# An autopilot without a heartbeat for this long has not granted anything, nor is it known to obey.
AUTOPILOT_SILENCE_S: Final = 3.0


class Setpoint(NamedTuple):
    """One point of a plan, as SET_POSITION_TARGET_LOCAL_NED carries it.

    Attributes:
        position_ned_m, velocity_ned_mps, acceleration_ned_mps2: NED.
        yaw_ned_rad: heading of the nose, from north towards east.
    """

    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]
    acceleration_ned_mps2: tuple[float, float, float]
    yaw_ned_rad: float


class Pose(NamedTuple):
    """Position, velocity and attitude at one instant of the daemon's clock.

    Attributes:
        time_s: when the position arrived.
        position_ned_m, velocity_ned_mps: NED.
        roll_rad, pitch_rad, yaw_rad: attitude, the latest known at that time.
        measured_s: when the position was measured, by the autopilot's clock; None if unknown.
    """

    time_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    measured_s: float | None = None


@dataclass(frozen=True)
class VehicleStatus:
    """What the autopilot reports of itself.

    Attributes:
        heard_s: time of its last heartbeat.
        armed: motors armed.
        external_control: its mode obeys our setpoints, as its profile knows.
        mode: name of its mode, for people.
        airborne: from EXTENDED_SYS_STATE; None until known.
        failsafe: whether one of its failsafes acts (system status CRITICAL or EMERGENCY).
    """

    heard_s: float = -math.inf
    armed: bool = False
    external_control: bool = False
    mode: str = "unknown"
    airborne: bool | None = None
    failsafe: bool = False
