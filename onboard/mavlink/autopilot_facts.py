"""What each autopilot says about its position, and how: one table for each.

PX4: ESTIMATOR_STATUS; test ratios of 1 and more mean that measurements are rejected.  ArduPilot:
EKF_STATUS_REPORT; its own failsafe acts on variances from FS_EKF_THRESH = 0.8 on.  The flags up to
PRED_POS_HORIZ_ABS mean the same in both.  Flags and texts of PX4 1.15 and of Copter 4.7-dev, from
recordings of GPS losses and from the message definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

POSITION_RATE_HZ: Final = 50.0
# Its interval shares no divisor with that of set-points, 20 ms: an echo in step with ours would
# leave just after each of them, and never show another commander's.
TARGET_RATE_HZ: Final = 1000.0 / 37.0

_REQUESTED: Final = (
    (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, POSITION_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_ATTITUDE, POSITION_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 5.0),
    (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, TARGET_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 5.0),
    (mavlink.MAVLINK_MSG_ID_SYS_STATUS, 2.0),
)
_ESTIMATOR_STATUS: Final = (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, 5.0)
_EKF_STATUS_REPORT: Final = (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 5.0)


@dataclass(frozen=True, eq=False)
class AutopilotFacts:
    """How one autopilot says what its position is worth.

    Attributes:
        requested_hz: messages that the service needs, and their rates; an autopilot sends GPS data
            no more often than its receiver does.
        made_up_flags: of the estimator: each means that the position is made up, in flight.
        doubt_flags: of the estimator: each means that it doubts a sensor.
        ratio_max: greatest innovation test ratio or variance of velocity and position.
        position_health: SYS_STATUS bits that stand for the position estimate itself.
        texts: STATUSTEXT, lower case, that says that the estimate is in trouble.
        cleared: words in such a text that say the opposite.
    """

    requested_hz: tuple[tuple[int, float], ...]
    made_up_flags: Mapping[int, str]
    doubt_flags: Mapping[int, str]
    ratio_max: float
    position_health: int
    texts: tuple[str, ...]
    cleared: tuple[str, ...] = ("cleared", "dead reckoning stopped", "is using")


_CONSTANT_POSITION: Final = {mavlink.ESTIMATOR_CONST_POS_MODE: "constant position mode"}

PX4: Final = AutopilotFacts(
    requested_hz=(*_REQUESTED, _ESTIMATOR_STATUS),
    made_up_flags=MappingProxyType(_CONSTANT_POSITION),
    doubt_flags=MappingProxyType(
        {
            mavlink.ESTIMATOR_GPS_GLITCH: "GPS glitch",
            mavlink.ESTIMATOR_ACCEL_ERROR: "accelerometer error",
        }
    ),
    ratio_max=1.0,
    # PX4 reports its local position estimate under this bit.
    position_health=mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    texts=(
        "gps fix lost",
        "gnss fix lost",
        "gps lost",
        "gps fusion timeout",
        "stopped gps fusion",
        "dead reckoning",
        "dead-reckoning",
        "position estimate invalid",
        "position lost",
        "navigation failure",
        "estimator failure",
        "switched to backup estimator",
        "primary ekf changed",
    ),
)

ARDUPILOT: Final = AutopilotFacts(
    requested_hz=(*_REQUESTED, _EKF_STATUS_REPORT),
    made_up_flags=MappingProxyType(
        {**_CONSTANT_POSITION, mavlink.EKF_UNINITIALIZED: "estimator not initialised"}
    ),
    doubt_flags=MappingProxyType({mavlink.EKF_GPS_GLITCHING: "GPS glitch"}),
    ratio_max=0.8,
    position_health=mavlink.MAV_SYS_STATUS_AHRS,
    texts=(
        "lane switch",
        "ekf primary changed",
        "ekf variance",
        "ekf failsafe",
        "stopped aiding",
        "dead reckoning",
        "gps glitch",
        "gps: no fix",
        "gps lost",
        "no gps",
        "bad ahrs",
        "ahrs: not healthy",
        "vibration compensation on",
    ),
)

# Another autopilot: what both say alike.
OTHER: Final = AutopilotFacts(
    requested_hz=(*_REQUESTED, _ESTIMATOR_STATUS),
    made_up_flags=MappingProxyType(_CONSTANT_POSITION),
    doubt_flags=MappingProxyType({}),
    ratio_max=1.0,
    position_health=0,
    texts=("gps lost", "dead reckoning"),
)

_BY_AUTOPILOT: Final = MappingProxyType(
    {mavlink.MAV_AUTOPILOT_PX4: PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: ARDUPILOT}
)


def facts_of(autopilot: int) -> AutopilotFacts:
    """Return the facts of a MAV_AUTOPILOT."""
    return _BY_AUTOPILOT.get(autopilot, OTHER)
