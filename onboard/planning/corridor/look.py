"""Where to look: headings that show the space that the next plans need.

Frames that are taken in fast turns do not count for the seen-free set.  The nose follows the guide
slowly, therefore, or jumps: it turns fast to where something new is to be seen, and dwells there.
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
# As fast as the nose turns where no frame is lost that matters.
TURN_FAST_RADPS: Final = math.radians(60.0)
# A turn that is longer than this is a jump.
_JUMP_RAD: Final = math.radians(12.0)
# The nose points this far along the guide in flight.
_AHEAD_M: Final = 2.4
_NEAR_M: Final = 0.3
# What is unseen this far along the guide is worth a turn of the nose.
_UNSEEN_WITHIN_M: Final = 5.0
_STEP_M: Final = 0.2
# At the edge of the view, cells are not seen as a whole.
_EDGE_RAD: Final = math.radians(12.0)
# Neighbouring views overlap by this, for what is lost at their edges.
_OVERLAP_RAD: Final = math.radians(20.0)
# All round takes as many looks at least.
_LOOKS_MIN: Final = 5


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
        shown_half_rad: how far off the nose a look at rest shows what is near, errors included.
    """

    position_leg_m: tuple[float, float]
    heading_rad: float
    half_view_rad: float
    path_leg_m: FloatArray | None
    grid: FreeGrid
    body_radius_m: float
    shown_half_rad: float = math.pi


def heading_in_flight_rad(outlook: Outlook, period_s: float) -> float:
    """Return the heading in flight after a period.

    The nose points along the guide; where something unseen beside the guide is out of view, it
    turns as far as that needs.
    """
    if outlook.path_leg_m is None:
        return outlook.heading_rad
    wanted_rad = outlook.heading_rad
    point = along(outlook.path_leg_m, (_AHEAD_M,))[0]
    if math.dist(point, outlook.position_leg_m) > _NEAR_M:
        wanted_rad = _bearing_rad(outlook, point)
    bearings_rad = _unseen_bearings_rad(outlook)
    if bearings_rad.size:
        off_rad = wrapped_rad(float(bearings_rad[0]) - wanted_rad)
        more_rad = abs(off_rad) - (outlook.half_view_rad - _EDGE_RAD)
        wanted_rad += math.copysign(max(more_rad, 0.0), off_rad)
    turn_rad = wrapped_rad(wanted_rad - outlook.heading_rad)
    fast = abs(turn_rad) > _JUMP_RAD
    most_rad = period_s * (TURN_FAST_RADPS if fast else TURN_MAX_RADPS)
    return outlook.heading_rad + max(-most_rad, min(most_rad, turn_rad))


def first_looks_rad(heading_rad: float, half_view_rad: float) -> tuple[float, ...]:
    """Return the headings of a turn on the spot, where no start has been confirmed to be free.

    Together the views cover all bearings; ``heading_rad`` is last.
    """
    count = math.ceil(2.0 * math.pi / _step_rad(half_view_rad))
    return tuple(heading_rad + 2.0 * math.pi * k / count for k in range(1, count + 1))


def looks_at_rest_rad(outlook: Outlook, *, all_round: bool) -> tuple[float, ...]:
    """Return the headings to dwell at, at rest, in this order; the last is the one to go on with.

    Args:
        outlook: what is known.
        all_round: look everywhere; else only at what is unseen beside the guide.  Where a turn
            shows nothing of that, the last heading alone is returned: another gap is to be tried.
    """
    base_rad = outlook.heading_rad
    looks = _covering_rad(outlook, _unseen_bearings_rad(outlook))
    if all_round:
        step_rad = min(_step_rad(outlook.half_view_rad), 2.0 * outlook.shown_half_rad)
        others = max(math.ceil(2.0 * math.pi / step_rad), _LOOKS_MIN) - 1
        turns = (*range(1, (others + 1) // 2 + 1), *range(-(others // 2), 0))
        looks = [*looks, *(base_rad + k * step_rad for k in turns)]
    if outlook.path_leg_m is not None:
        ahead_rad = _bearing_rad(outlook, along(outlook.path_leg_m, (_AHEAD_M,))[0])
        base_rad += wrapped_rad(ahead_rad - base_rad)
    return (*looks, base_rad)


def _unseen_bearings_rad(outlook: Outlook) -> FloatArray:
    """Return the bearings of unseen places that the body needs on the guide, the nearest first.

    Only those out of view: what is in view and unseen is hidden, so that no turn shows it.
    """
    if outlook.path_leg_m is None:
        return np.empty(0)
    ways_m = np.arange(_STEP_M, _UNSEEN_WITHIN_M, _STEP_M)
    middle = along(outlook.path_leg_m, ways_m)
    ahead = along(outlook.path_leg_m, ways_m + _STEP_M) - along(
        outlook.path_leg_m, ways_m - _STEP_M
    )
    ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    across = np.stack((-ahead[:, 1], ahead[:, 0]), axis=1)
    offsets_m = np.linspace(-1.0, 1.0, 7) * outlook.body_radius_m
    x, y = (middle[:, None] + offsets_m[:, None] * across[:, None]).reshape(-1, 2).T
    unseen = ~outlook.grid.are_free(x, x, y, y)
    to_x, to_y = x - outlook.position_leg_m[0], y - outlook.position_leg_m[1]
    bearings_rad = np.arctan2(to_y, to_x)
    off_rad = (bearings_rad - outlook.heading_rad + math.pi) % (2.0 * math.pi) - math.pi
    unseen &= np.abs(off_rad) > _reach_rad(outlook.half_view_rad)
    found: FloatArray = bearings_rad[unseen]
    return found


def _covering_rad(outlook: Outlook, bearings_rad: FloatArray) -> list[float]:
    """Return headings whose views hold all bearings, each for the nearest one not yet in view."""
    reach_rad = _reach_rad(outlook.half_view_rad)
    looks: list[float] = []
    left = [outlook.heading_rad + wrapped_rad(b - outlook.heading_rad) for b in bearings_rad]
    while left:
        side = [b for b in left if abs(b - left[0]) <= reach_rad]
        look = (min(side) + max(side)) / 2.0
        looks.append(look)
        left = [b for b in left if abs(b - look) > reach_rad]
    return looks


def _step_rad(half_view_rad: float) -> float:
    """Return the turn between two looks whose views overlap; by half, where the view is narrow."""
    return max(2.0 * half_view_rad - _OVERLAP_RAD, half_view_rad)


def _reach_rad(half_view_rad: float) -> float:
    """Return how far off the nose a look shows a place, edge left out; half of a narrow view."""
    return max(half_view_rad - _EDGE_RAD, half_view_rad / 2.0)


def wrapped_rad(angle_rad: float) -> float:
    """Return an angle within [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def _bearing_rad(outlook: Outlook, point_leg_m: FloatArray) -> float:
    x_m, y_m = (np.asarray(point_leg_m) - outlook.position_leg_m).tolist()
    return math.atan2(y_m, x_m)
