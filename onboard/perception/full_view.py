"""Which boxes of a frame the sensor saw in full view, so that they locate an obstacle.

A box at the edge of the view, at the end of the range or behind another is seen in part, and the
part that is seen moves with the vehicle; successive sightings of it need not agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.detection import Corners
from onboard.vehicle_state import Pose

# The edge of a view, and of what another box hides, is known no better than this.
EDGE_RAD: Final = math.radians(2.0)
# In a frame of more boxes, occlusion is not computed, and none counts as seen in full.
BOXES_MAX: Final = 256


def in_full_view(
    boxes_ned_m: Sequence[Corners], pose: Pose, field_of_view_rad: float, range_m: float
) -> list[bool]:
    """Tell of each box whether all that faces the sensor could be seen at once.

    Args:
        boxes_ned_m: corners of every box of the frame.
        pose: of the body, of which the nose is the axis of the view.
        field_of_view_rad: full opening angle; 2 pi sees all round.
        range_m: how far the sensor sees.
    """
    if not 0 < len(boxes_ned_m) <= BOXES_MAX:
        return [False] * len(boxes_ned_m)
    ahead_m = np.array(boxes_ned_m) - np.array(pose.position_ned_m[:2])
    middle_m = ahead_m.mean(axis=1)
    middle_rad = np.arctan2(middle_m[:, 1], middle_m[:, 0]) - pose.yaw_rad
    corners_rad = np.arctan2(ahead_m[..., 1], ahead_m[..., 0]) - pose.yaw_rad
    aside_rad = _wrapped(corners_rad - middle_rad[:, None])
    left_rad, right_rad = aside_rad.min(axis=1), aside_rad.max(axis=1)
    distance_m = np.hypot(ahead_m[..., 0], ahead_m[..., 1])
    seen = (right_rad - left_rad < math.pi) & (distance_m.max(axis=1) <= range_m)
    if field_of_view_rad < 2.0 * math.pi - 1e-6:
        reach_rad = np.abs(_wrapped(middle_rad)) + np.maximum(-left_rad, right_rad)
        seen &= reach_rad <= field_of_view_rad / 2.0 - EDGE_RAD
    if len(boxes_ned_m) == 1:  # nothing hides it
        return [bool(seen[0])]
    # Angle from the middle of a box (rows) to the middle of another (columns).
    apart_rad = _wrapped(middle_rad[None, :] - middle_rad[:, None])
    overlap = (apart_rad + left_rad <= right_rad[:, None] + EDGE_RAD) & (
        apart_rad + right_rad >= left_rad[:, None] - EDGE_RAD
    )
    nearest_m = distance_m.min(axis=1)
    hidden = overlap & (nearest_m[None, :] < nearest_m[:, None])
    in_view: list[bool] = (seen & ~hidden.any(axis=1)).tolist()
    return in_view


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    wrapped: FloatArray = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
    return wrapped
