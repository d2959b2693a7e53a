"""Where to look: headings that show the space that the next plans need.

Frames that are taken in fast turns do not count for the seen-free set.  In flight the nose follows
the guide slowly, therefore; at rest it turns to each of a few headings and dwells there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.planning.corridor.guide import along

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid

# Frames count while the nose turns no faster than this.
TURN_MAX_RADPS: Final = math.radians(20.0)
# The nose points this far along the guide in flight.
_AHEAD_M: Final = 2.4
_NEAR_M: Final = 0.3
# At rest, the guide is looked at this far ahead.
_ALONG_GUIDE_M: Final = (2.0, 4.0)
# Neighbouring views overlap by this, for what is lost at their edges.
_OVERLAP_RAD: Final = math.radians(20.0)
_SAME_RAD: Final = 0.1


@dataclass(frozen=True)
class Outlook:
    """What the vehicle knows when it decides where to look.

    Attributes:
        position_leg_m: of the reference.
        heading_rad: of the nose, from the leg towards its right.
        half_view_rad: half of the sensor's field of view.
        path_leg_m: the guide's path from there, (k, 2); None where no way leads on.
        grid: the seen-free set.
        body_radius_m: radius of the vehicle plus its tracking error.
    """

    position_leg_m: tuple[float, float]
    heading_rad: float
    half_view_rad: float
    path_leg_m: FloatArray | None
    grid: FreeGrid
    body_radius_m: float


def heading_in_flight_rad(outlook: Outlook, step_max_rad: float) -> float:
    """Return the next heading in flight: towards the guide, by ``step_max_rad`` at most."""
    if outlook.path_leg_m is None:
        return outlook.heading_rad
    point = along(outlook.path_leg_m, (_AHEAD_M,))[0]
    if math.dist(point, outlook.position_leg_m) <= _NEAR_M:
        return outlook.heading_rad
    turn_rad = wrapped_rad(_bearing_rad(outlook, point) - outlook.heading_rad)
    return outlook.heading_rad + max(-step_max_rad, min(step_max_rad, turn_rad))


def first_looks_rad(heading_rad: float, half_view_rad: float) -> tuple[float, ...]:
    """Return the headings of the first look, at rest before the leg; ``heading_rad`` is last."""
    aside_rad = 2.0 * half_view_rad - _OVERLAP_RAD
    return heading_rad + aside_rad, heading_rad - aside_rad, heading_rad


def looks_at_rest_rad(outlook: Outlook, *, all_round: bool) -> tuple[float, ...]:
    """Return the headings to dwell at, at rest, in this order; the last is the one to go on with.

    Args:
        outlook: what is known.
        all_round: look everywhere; else only along the guide, if that shows anything new.
    """
    base_rad = outlook.heading_rad
    looks = []
    if outlook.path_leg_m is not None:
        for point in along(outlook.path_leg_m, _ALONG_GUIDE_M):
            bearing_rad = base_rad + wrapped_rad(_bearing_rad(outlook, point) - base_rad)
            if abs(bearing_rad - base_rad) > _SAME_RAD:
                looks.append(bearing_rad)
    if all_round or not looks:
        step_rad = 2.0 * outlook.half_view_rad - _OVERLAP_RAD
        looks += [base_rad + k * step_rad for k in (1, 2, -2, -1)]
    return (*looks, base_rad)


def wrapped_rad(angle_rad: float) -> float:
    """Return an angle within [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def _bearing_rad(outlook: Outlook, point_leg_m: FloatArray) -> float:
    x_m, y_m = (np.asarray(point_leg_m) - outlook.position_leg_m).tolist()
    return math.atan2(y_m, x_m)
