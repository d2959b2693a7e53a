"""OPEN_DRONE_ID_LOCATION for people: where another vehicle is, and how far that may be off.

Errors are classes of ASTM F3411 (https://mavlink.io/en/messages/common.html#MAV_ODID_HOR_ACC), 95 %
values and no bounds: ten metres, a second of age and a metre per second add up to tens of metres.
"""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from onboard.geometry.local_frame import GeographicPoint, LocalFrame

_NAUTICAL_MILE_M: Final = 1852.0
# By the number of the class; what is not here is unknown.
HORIZONTAL_M: Final = {
    mavlink.MAV_ODID_HOR_ACC_10NM: 10.0 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_4NM: 4.0 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_2NM: 2.0 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_1NM: _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_0_5NM: 0.5 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_0_3NM: 0.3 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_0_1NM: 0.1 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_0_05NM: 0.05 * _NAUTICAL_MILE_M,
    mavlink.MAV_ODID_HOR_ACC_30_METER: 30.0,
    mavlink.MAV_ODID_HOR_ACC_10_METER: 10.0,
    mavlink.MAV_ODID_HOR_ACC_3_METER: 3.0,
    mavlink.MAV_ODID_HOR_ACC_1_METER: 1.0,
}
SPEED_MPS: Final = {
    mavlink.MAV_ODID_SPEED_ACC_10_METERS_PER_SECOND: 10.0,
    mavlink.MAV_ODID_SPEED_ACC_3_METERS_PER_SECOND: 3.0,
    mavlink.MAV_ODID_SPEED_ACC_1_METERS_PER_SECOND: 1.0,
    mavlink.MAV_ODID_SPEED_ACC_0_3_METERS_PER_SECOND: 0.3,
}
# Classes 1 to 15, in steps of this.
_AGE_STEP_S: Final = 0.1
_AGE_CLASS_MAX: Final = 15
_SPEED_UNKNOWN_CMPS: Final = 25500


def describe(message: Any, frame: LocalFrame | None) -> tuple[str, str]:
    """Return whom OPEN_DRONE_ID_LOCATION tells of, and a sentence for people.

    Args:
        message: as decoded.
        frame: the vehicle's local frame; None while that is not known.
    """
    octets = bytes(message.id_or_mac).rstrip(b"\0")
    name = octets.hex() if octets else f"system {message.get_srcSystem()}"
    place = GeographicPoint(message.latitude / 1e7, message.longitude / 1e7)
    where = "position unknown"
    if place.problem() is None and (place.latitude_deg or place.longitude_deg):
        where = str(place)
        if frame is not None:
            away_m = math.hypot(*frame.north_east_m(place.latitude_deg, place.longitude_deg))
            where = f"{away_m:.0f} m from the local origin"
    error_m = HORIZONTAL_M.get(message.horizontal_accuracy)
    off = "accuracy unknown" if error_m is None else f"±{error_m:g} m"
    age_class = message.timestamp_accuracy
    known = 1 <= age_class <= _AGE_CLASS_MAX
    age = f"stamp ±{age_class * _AGE_STEP_S:.1f} s" if known else "stamp of unknown accuracy"
    speed = "speed unknown"
    if message.speed_horizontal < _SPEED_UNKNOWN_CMPS:
        speed = f"{message.speed_horizontal / 100.0:.1f} m/s"
        speed_error_mps = SPEED_MPS.get(message.speed_accuracy)
        speed += "" if speed_error_mps is None else f" ±{speed_error_mps:g} m/s"
    return name, f"{where}, {off}, {speed}, {age}"
