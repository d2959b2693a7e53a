"""Distances as an autopilot reports them over MAVLink.

https://mavlink.io/en/messages/common.html#OBSTACLE_DISTANCE and #DISTANCE_SENSOR
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.obstacle_field import FloatArray

SECTORS: Final = 72
SECTOR_RAD: Final = 2.0 * math.pi / SECTORS
_UNKNOWN: Final = 65535
_UNKNOWN_COVARIANCE: Final = 255


def obstacle_distance(
    time_s: float,
    sectors: NDArray[np.intp],
    ranges_m: FloatArray,
    limits_m: tuple[float, float],
) -> Any:
    """Return OBSTACLE_DISTANCE of the nearest range in each sector around the nose.

    Args:
        time_s: of the measurement, since the autopilot started.
        sectors: (n,) index of each beam's sector, clockwise; sector 0 has the nose in its middle.
        ranges_m: (n,), infinite where nothing returned, NaN where nothing is known.
        limits_m: between which ranges are measurements.
    """
    least_cm, greatest_cm = (round(100.0 * limit_m) for limit_m in limits_m)
    nearest_m = np.full(SECTORS, math.nan)
    np.fmin.at(nearest_m, sectors, ranges_m)
    centimetres = np.minimum(np.floor(100.0 * nearest_m), greatest_cm + 1)
    return mavlink.MAVLink_obstacle_distance_message(
        round(time_s * 1e6),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        np.where(np.isnan(centimetres), _UNKNOWN, centimetres).astype(int).tolist(),
        round(math.degrees(SECTOR_RAD)),
        least_cm,
        greatest_cm,
        math.degrees(SECTOR_RAD),
        0.0,
        mavlink.MAV_FRAME_BODY_FRD,
    )


def distance_sensor(
    time_s: float, range_m: float, view_rad: float, limits_m: tuple[float, float]
) -> Any:
    """Return DISTANCE_SENSOR of one beam that looks forward; see `obstacle_distance`."""
    least_cm, greatest_cm = (round(100.0 * limit_m) for limit_m in limits_m)
    return mavlink.MAVLink_distance_sensor_message(
        round(time_s * 1e3) % 2**32,
        least_cm,
        greatest_cm,
        math.floor(min(100.0 * range_m, greatest_cm + 1)),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_NONE,
        _UNKNOWN_COVARIANCE,
        view_rad,
        view_rad,
    )
