"""One frame that counts, as the sets of free space take it."""

from __future__ import annotations

from typing import NamedTuple

from onboard.perception.detection import Corners, DetectionFrame
from onboard.vehicle_state import Pose


class Sight(NamedTuple):
    """One frame that counts.

    Attributes:
        frame: what a sensor saw.
        pose: of the body at the stamp.
        turn_radps: fastest turn around it.
        corners_ned_m: of the boxes in local NED.
        stamp_s: when it was taken, on the service's clock.
    """

    frame: DetectionFrame
    pose: Pose
    turn_radps: float
    corners_ned_m: list[Corners]
    stamp_s: float
