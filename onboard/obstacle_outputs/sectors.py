"""Obstacles as OBSTACLE_DISTANCE has them: the nearest one in each of 72 sectors around the body.

Sector 0 is centred on the nose, the others follow clockwise.  A sector without an obstacle is
unknown, not free: what was not seen is not free, and the message has no other word for it
(https://mavlink.io/en/messages/common.html#OBSTACLE_DISTANCE).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from onboard.mavlink.transmitter import SECTOR_DEG, SECTOR_MAX_CM, SECTOR_MIN_CM
from onboard.recording.messages import Outline

WIDTH_RAD: Final = math.radians(SECTOR_DEG)
SECTORS: Final = 360 // SECTOR_DEG
UNKNOWN: Final = 65_535
# More distant ones are not drawn; a forest must not delay a tick.
OBSTACLES_MAX: Final = 300
_TURN_MIN_RAD: Final = 1e-9


def sectors_cm(
    outlines: Iterable[Outline], position_ned_m: Sequence[float], yaw_rad: float
) -> list[int]:
    """Return the distance of the nearest obstacle in each sector [cm].

    Args:
        outlines: corners of each obstacle, north and east, in turn.
        position_ned_m: of the body.
        yaw_rad: of the body.
    """
    nearest_m = [math.inf] * SECTORS
    north_m, east_m = position_ned_m[:2]
    around = [[(n_m - north_m, e_m - east_m) for n_m, e_m in each] for each in outlines if each]
    around.sort(key=lambda corners: min(math.hypot(*corner) for corner in corners))
    for corners in around[:OBSTACLES_MAX]:
        if _contains_body(corners):
            nearest_m = [0.0] * SECTORS
            break
        for begin_m, end_m in pairwise([*corners, corners[0]]):
            _add_edge(nearest_m, begin_m, end_m, yaw_rad)
    return [_centimetres(each) for each in nearest_m]


def _centimetres(distance_m: float) -> int:
    if distance_m * 100.0 > SECTOR_MAX_CM:
        return UNKNOWN
    return max(math.floor(distance_m * 100.0), SECTOR_MIN_CM)


def _add_edge(
    nearest_m: list[float],
    begin_m: tuple[float, float],
    end_m: tuple[float, float],
    yaw_rad: float,
) -> None:
    """Take one side of an obstacle: its distance along a bearing is its height over a cosine."""
    first_rad = math.atan2(begin_m[1], begin_m[0]) - yaw_rad
    turn_rad = _wrapped(math.atan2(end_m[1], end_m[0]) - yaw_rad - first_rad)
    if turn_rad < 0.0:
        first_rad, turn_rad, begin_m, end_m = first_rad + turn_rad, -turn_rad, end_m, begin_m
    if turn_rad < _TURN_MIN_RAD:  # seen along the side: its near end
        index = round(first_rad / WIDTH_RAD) % SECTORS
        nearest_m[index] = min(nearest_m[index], math.hypot(*begin_m), math.hypot(*end_m))
        return
    length_m = math.hypot(end_m[0] - begin_m[0], end_m[1] - begin_m[1])
    height_m = abs(begin_m[0] * end_m[1] - begin_m[1] * end_m[0]) / length_m
    foot_rad = _foot_rad(begin_m, end_m, first_rad)
    index = round(first_rad / WIDTH_RAD)
    last_rad = first_rad + turn_rad
    while (index - 0.5) * WIDTH_RAD < last_rad:
        from_rad = max((index - 0.5) * WIDTH_RAD, first_rad)
        to_rad = min((index + 0.5) * WIDTH_RAD, last_rad)
        near_rad = min(max(foot_rad, from_rad), to_rad)
        distance_m = height_m / max(math.cos(near_rad - foot_rad), 1e-9)
        nearest_m[index % SECTORS] = min(nearest_m[index % SECTORS], distance_m)
        index += 1


def _foot_rad(begin_m: tuple[float, float], end_m: tuple[float, float], first_rad: float) -> float:
    """Return the bearing of the foot of the height of a side, near the bearing of its begin."""
    along = (end_m[0] - begin_m[0], end_m[1] - begin_m[1])
    share = -(begin_m[0] * along[0] + begin_m[1] * along[1]) / (along[0] ** 2 + along[1] ** 2)
    foot = (begin_m[0] + share * along[0], begin_m[1] + share * along[1])
    offset_rad = math.atan2(foot[1], foot[0]) - math.atan2(begin_m[1], begin_m[0])
    return first_rad + _wrapped(offset_rad)


def _contains_body(corners: list[tuple[float, float]]) -> bool:
    """Tell whether the interior of a convex outline contains the origin.

    A point, or a box without width seen along itself, has no interior: its sides alone count.
    """
    crosses = [
        begin[0] * end[1] - begin[1] * end[0]
        for begin, end in pairwise([*corners, corners[0]])
        if begin != end
    ]
    return bool(crosses) and (all(c > 0.0 for c in crosses) or all(c < 0.0 for c in crosses))


def _wrapped(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
