"""What an autopilot decides: what the rotors do, and how it responds to requests."""

from __future__ import annotations

import enum
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.plant.setpoint import Setpoint


class Drive(enum.Enum):
    """What the rotors do."""

    OFF = enum.auto()
    IDLE = enum.auto()
    FLY = enum.auto()


class Actuation(NamedTuple):
    """What the controller does until the next decision; only FLY has a setpoint."""

    drive: Drive
    setpoint: Setpoint | None = None


class Verdict(enum.IntEnum):
    """Result of a request, as MAV_RESULT."""

    ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = mavlink.MAV_RESULT_DENIED
    UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
    FAILED = mavlink.MAV_RESULT_FAILED
