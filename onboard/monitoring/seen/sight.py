"""One frame that counts for what is seen free, and what it shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from onboard.contract.terms import Terms
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame, wrap_angle
from onboard.monitoring.seen.scan_limits import resolved_m, scan_of
from onboard.perception.detection import (
    Corners,
    Detection,
    DetectionFrame,
    corners_ned,
    shifted_corners,
)
from onboard.perception.heights import shown_heights
from onboard.perception.line_of_sight import View
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


def view_of(
    sight: Sight,
    leg: LegFrame,
    terms: Terms[float],
    boxes: Sequence[Box],
    pose_errors: tuple[float, float],
) -> View:
    """Return what a frame shows to be free of the heights around a leg.

    Args:
        sight: the frame.
        leg: that is flown.
        terms: of the contract.
        boxes: of all that is in the way, in the frame of the leg.
        pose_errors: of position [m] and heading [rad] at the stamp, besides what boxes carry.
    """
    frame, pose, e = sight.frame, sight.pose, terms.map_error_m
    clock_error_m, heading_error_rad = pose_errors
    x_m, y_m, _ = leg.position_leg(pose.position_ned_m)
    # A scan is placed by the pose as a whole; boxes carry that error in their faces already.
    scan, view_rad = scan_of(frame, terms), math.radians(frame.field_of_view_deg)
    shown = shown_heights(frame, pose, leg.origin_ned_m[2], terms)
    range_m = min(frame.range_m, terms.detection_range_m, resolved_m(frame, terms))
    return View(
        position_leg_m=(x_m, y_m),
        heading_leg_rad=wrap_angle(pose.yaw_rad - leg.heading_rad),
        half_view_rad=shown.half_view_rad(min(view_rad, terms.field_of_view_rad) / 2.0),
        range_m=shown.level_range_m(range_m),
        boxes=boxes,
        # A face that is turned by the error of the heading is off by as much more.
        face_error_m=e * (1.0 + heading_error_rad),
        pose_error_m=clock_error_m + (e if scan else 0.0),
        placing_error_m=math.sqrt(2.0) * e,
        heading_error_rad=heading_error_rad,
        free_range_m=scan,
        scan_half_view_rad=view_rad / 2.0,
        blind_m=shown.blind_m,
    )
