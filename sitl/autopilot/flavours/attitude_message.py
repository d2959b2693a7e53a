"""SET_ATTITUDE_TARGET: the attitude and thrust that PX4 flies in OFFBOARD.

Simulation shortcuts: the attitude is flown as the acceleration that its thrust gives the vehicle,
so that the controller's tilt limit and least thrust hold here, too; body rates are not flown, and a
message that gives nothing else keeps no stream alive.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.setpoint_message import NOTHING
from sitl.plant.multirotor import GRAVITY_MPS2, rotate_ned_from_frd
from sitl.plant.setpoint import Setpoint

_THRUST_BODY_SET = 1 << 5  # ATTITUDE_TARGET_TYPEMASK, not yet in pymavlink's dialect
_IGNORED = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
    | mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    | _THRUST_BODY_SET
)
_NORM_TOLERANCE = 0.1


def attitude_setpoint(message: Any, hover_thrust: float) -> Setpoint | None:
    """Return the setpoint of a SET_ATTITUDE_TARGET; None if PX4 ignores it, or it is noise.

    Args:
        message: quaternion from body to NED, and thrust from 0 to 1.
        hover_thrust: the thrust that carries the vehicle.
    """
    values = (*message.q, message.thrust)
    if int(message.type_mask) & _IGNORED or not all(map(math.isfinite, values)):
        return None
    norm = math.hypot(*message.q)
    if abs(norm - 1.0) > _NORM_TOLERANCE or not 0.0 <= message.thrust <= 1.0:
        return None
    w, x, y, z = (value / norm for value in message.q)
    thrust_mps2 = GRAVITY_MPS2 * message.thrust / hover_thrust
    north, east, down = rotate_ned_from_frd(w, x, y, z, 0.0, 0.0, -thrust_mps2)
    return Setpoint.of(
        NOTHING,
        NOTHING,
        (north, east, down + GRAVITY_MPS2),
        (0.0, 0.0, 0.0),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        0.0,
    )
