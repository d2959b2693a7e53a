"""Where the boxes of a frame are in local NED, and how exactly that is known.

A frame in the body frame is placed with the pose at its stamp.  Its boxes are off by what the
sensor states and by what a wrong heading displaces: the farther away, the more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from onboard.geometry.frames import heading_displacement_m
from onboard.mavlink.endpoint import TELEMETRY_RATE_HZ
from onboard.perception.detection import (
    ANY_HEIGHT,
    Corners,
    Detection,
    DetectionFrame,
    DownRange,
    corners_ned,
    down_range_ned,
    shifted_corners,
)
from onboard.perception.full_view import in_full_view
from onboard.vehicle_state import Pose

# How far apart the times of a pose between two others and of a frame from the body may be.
POSE_TIMING_S: Final = 0.5 / TELEMETRY_RATE_HZ


class PlacedBox(NamedTuple):
    """One detected box in local NED.

    Attributes:
        track_id: which obstacle, as its sensor sees it.
        corners_ned_m: where it is.
        down_m: top and bottom; None for any height.
        uncertainty_m: what the sensor states for each face.
        pose: of the body at the stamp; None where unknown.
        moves: whether an estimator reset since the stamp moves it: it came in local NED.
        blur_m: how far off a turning body may have placed it.
        in_full: whether the sensor had it in full view.
        partial: whether the sensor says that it is a part of something.
        filled_m: heights that it may fill, errors included (`onboard.perception.heights`).
    """

    track_id: str
    corners_ned_m: Corners
    down_m: DownRange | None
    uncertainty_m: float
    pose: Pose | None
    moves: bool
    blur_m: float
    in_full: bool
    partial: bool
    filled_m: DownRange = ANY_HEIGHT

    def displacement_m(self, heading_error_rad: float) -> float:
        """Return how far a wrong heading displaces the farthest corner.

        Boxes in local NED are placed by the autopilot's own estimate, with the same heading.
        """
        if self.pose is None:
            return 0.0
        here_ned_m = self.pose.position_ned_m[:2]
        farthest_m = max(math.dist(corner, here_ned_m) for corner in self.corners_ned_m)
        return heading_displacement_m(farthest_m, heading_error_rad)

    def shifted_by(self, shift_ned_m: tuple[float, float]) -> PlacedBox:
        """Return the same box elsewhere, north and east."""
        if shift_ned_m == (0.0, 0.0):
            return self
        return self._replace(corners_ned_m=shifted_corners(self.corners_ned_m, shift_ned_m))


def blurs_m(
    frame: DetectionFrame,
    yaw_rate_radps: float,
    sharp_m: float,
    is_needed: Callable[[str, Detection], bool],
) -> dict[str, float]:
    """Return how far off a turning body sees what is to be taken from a frame, by track.

    Pose and frame belong together only as exactly as their times do.

    Args:
        frame: in the body frame.
        yaw_rate_radps: how fast the body turned.
        sharp_m: a box blurred by no more than this counts as sharp, 0.
        is_needed: tells of a track and its box whether it has to be taken although it is blurred;
            blurred boxes that are not needed are left out.
    """
    turn_rad = abs(yaw_rate_radps) * POSE_TIMING_S
    found = {}
    for detection in frame.obstacles:
        track_id = frame.track_id(detection)
        blur_m = math.hypot(*detection.center_m) * turn_rad
        if blur_m <= sharp_m:
            found[track_id] = 0.0
        elif is_needed(track_id, detection):
            found[track_id] = blur_m
    return found


def place(
    frame: DetectionFrame,
    pose: Pose | None,
    blur_by_track_m: Mapping[str, float] | None,
    filled_m: Callable[[Detection, Corners], DownRange] = lambda *_: ANY_HEIGHT,
) -> list[PlacedBox]:
    """Place the boxes of a frame.

    Args:
        frame: what a sensor saw.
        pose: of the body at the stamp; None where unknown, which a frame from the body must not
            have.
        blur_by_track_m: for a frame from the body, the boxes to take and their `blurs_m`; None for
            one in local NED, whose boxes are all taken.
        filled_m: heights that a box with these corners in local NED may fill, errors included.
    """
    placed_by = pose if frame.frame == "body_frd" else None
    boxes_ned_m = [corners_ned(detection, placed_by) for detection in frame.obstacles]
    in_full = [False] * len(boxes_ned_m)
    if pose is not None:
        view_rad = math.radians(frame.field_of_view_deg)
        in_full = in_full_view(boxes_ned_m, pose, view_rad, frame.range_m)
    placed = []
    for detection, corners_ned_m, full in zip(frame.obstacles, boxes_ned_m, in_full, strict=True):
        track_id = frame.track_id(detection)
        blur_m = 0.0 if blur_by_track_m is None else blur_by_track_m.get(track_id)
        if blur_m is not None:
            placed.append(
                PlacedBox(
                    track_id,
                    corners_ned_m,
                    down_range_ned(detection, placed_by),
                    detection.uncertainty_m,
                    pose,
                    placed_by is None,
                    blur_m,
                    full and not detection.partial,
                    detection.partial,
                    filled_m(detection, corners_ned_m),
                )
            )
    return placed
