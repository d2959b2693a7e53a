"""One frame that counts for what is seen free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from onboard.perception.detection import (
    Corners,
    Detection,
    DetectionFrame,
    corners_ned,
    shifted_corners,
)
from onboard.vehicle_state import Pose


class Sight(NamedTuple):
    """One frame that counts.

    Attributes:
        frame: what a sensor saw.
        pose: of the body at the stamp.
        turn_radps: how fast it turned at most around then.
        placed_ned_m: corners of all its boxes in local NED, with their yaw there.
        detections: the boxes that are in the way.
        corners_ned_m: the corners of these.
        stamp_s: when it was taken, on the service's clock.
    """

    frame: DetectionFrame
    pose: Pose
    turn_radps: float
    placed_ned_m: list[Corners]
    detections: list[Detection]
    corners_ned_m: list[Corners]
    stamp_s: float


def placed_corners_ned(
    frame: DetectionFrame, pose: Pose, shift_m: Sequence[float]
) -> list[Corners]:
    """Return the corners of every box of a frame in the present local frame.

    Args:
        frame: what a sensor saw.
        pose: of the body at the stamp, which places boxes in FRD.
        shift_m: what moves boxes from local NED at that time, north and east.
    """
    if frame.frame == "body_frd":
        return [corners_ned(seen, pose) for seen in frame.obstacles]
    shift_ned_m = shift_m[0], shift_m[1]
    return [shifted_corners(corners_ned(seen, None), shift_ned_m) for seen in frame.obstacles]
