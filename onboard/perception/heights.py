"""Which heights a detected obstacle may fill, errors included, and what of them a frame shows.

A top or a bottom counts only where the sensor had it well inside its vertical view at the attitude
of the frame: a face at the edge of the view says where the view ends, not the obstacle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from onboard.contract.heights import VIEW_EDGE_RAD, half_band_m
from onboard.contract.terms import Terms
from onboard.perception.detection import (
    ANY_HEIGHT,
    Corners,
    Detection,
    DetectionFrame,
    DownRange,
)
from onboard.perception.placement import POSE_TIMING_S
from onboard.vehicle_state import Pose

# What is nearer than this is at the sensor.
_NEAR_MIN_M: Final = 1e-3


def tilt_rad(pose: Pose) -> float:
    """Return the angle between the body's down and down: it turns no direction by more."""
    upright = math.cos(pose.roll_rad) * math.cos(pose.pitch_rad)
    aside = math.hypot(math.sin(pose.pitch_rad), math.cos(pose.pitch_rad) * math.sin(pose.roll_rad))
    return math.atan2(aside, upright)  # exact for small angles, unlike the arc cosine


@dataclass(frozen=True)
class VerticalView:
    """How far up and down a sensor sees for certain, whatever way the body tilts.

    Attributes:
        up_rad, down_rad: from the level; not above zero where nothing is certain.
    """

    up_rad: float
    down_rad: float

    @classmethod
    def of(cls, frame: DetectionFrame, pose: Pose, terms: Terms[float]) -> VerticalView:
        """Return the view of a frame: what both frame and contract state, less tilt and edge."""
        up_rad, down_rad = terms.view_up_rad or 0.0, terms.view_down_rad or 0.0
        if frame.vertical_field_of_view_deg is not None:
            up_deg, down_deg = frame.vertical_field_of_view_deg
            up_rad = min(up_rad, math.radians(up_deg))
            down_rad = min(down_rad, math.radians(down_deg))
        less_rad = tilt_rad(pose) + VIEW_EDGE_RAD
        return cls(up_rad - less_rad, down_rad - less_rad)

    def blind_m(self, above_m: float, below_m: float) -> float:
        """Return within which distance not all of some heights about the sensor is in view.

        Args:
            above_m: how far they reach above the sensor.
            below_m: likewise below.
        """
        if min(self.up_rad, self.down_rad) <= 0.0:
            return math.inf
        return max(above_m / math.tan(self.up_rad), below_m / math.tan(self.down_rad), 0.0)

    def shows(self, high_m: float, nearest_m: float, farthest_m: float, *, up: bool) -> bool:
        """Tell whether a face lies inside the edge above it, or for a bottom below it.

        Args:
            high_m: of the face above the sensor, or for a bottom below it, errors included.
            nearest_m: least distance of the face.
            farthest_m: greatest.
            up: whether it is a top.
        """
        away_m = nearest_m if high_m > 0.0 else farthest_m
        edge_rad = self.up_rad if up else self.down_rad
        return math.atan2(high_m, max(away_m, _NEAR_MIN_M)) < edge_rad


def heights_filled_m(
    frame: DetectionFrame,
    detection: Detection,
    corners_ned_m: Corners,
    pose: Pose | None,
    terms: Terms[float],
) -> DownRange:
    """Return the heights that an obstacle may fill, in local NED, errors included.

    Infinite where top or bottom are unknown: obstacles count as pillars by the contract, or their
    faces were not in view.

    Args:
        frame: that shows it.
        detection: it.
        corners_ned_m: where it is.
        pose: of the body at the stamp.
        terms: of the contract.
    """
    radius_z_m, error_z_m = terms.radius_z_m, terms.position_error_z_m
    stated, unknown = detection.down_m, pose is None or detection.partial
    if radius_z_m is None or error_z_m is None or stated is None or unknown or pose is None:
        return ANY_HEIGHT
    body_m = pose.position_ned_m[2]
    from_m, error_m = _placed_m(frame, detection, pose, error_z_m)
    view = VerticalView.of(frame, pose, terms)
    nearest_m, farthest_m = distances_m(corners_ned_m, pose.position_ned_m[:2])
    # An error of the faces, and the sensor anywhere in the body.
    spread_m = math.sqrt(2.0) * terms.map_error_m + terms.radius_m
    near_m, far_m = max(nearest_m - spread_m, 0.0), farthest_m + spread_m
    top_m, bottom_m = ANY_HEIGHT
    if stated[0] is not None:
        down_m = from_m + stated[0] - error_m
        if view.shows(body_m + radius_z_m - down_m, near_m, far_m, up=True):
            top_m = down_m
    if stated[1] is not None:
        down_m = from_m + stated[1] + error_m
        if view.shows(down_m - body_m + radius_z_m, near_m, far_m, up=False):
            bottom_m = down_m
    return top_m, bottom_m


def heights_shown_m(
    frame: DetectionFrame, detection: Detection, pose: Pose, terms: Terms[float]
) -> DownRange:
    """Return where top and bottom of an obstacle are at the least extent, in local NED.

    It reaches at least up to the first and down to the second, whatever the errors: what was
    measured is a part of it, also where the view cuts it.  A thin one may have the first below the
    second.  Infinite where the sensor does not state them.

    Args:
        frame: that shows it.
        detection: it.
        pose: of the body at the stamp.
        terms: of the contract.
    """
    if detection.down_m is None or terms.position_error_z_m is None:
        return ANY_HEIGHT
    from_m, error_m = _placed_m(frame, detection, pose, terms.position_error_z_m)
    top_m, bottom_m = detection.down_m
    return (
        -math.inf if top_m is None else from_m + top_m + error_m,
        math.inf if bottom_m is None else from_m + bottom_m - error_m,
    )


def _placed_m(
    frame: DetectionFrame, detection: Detection, pose: Pose, error_z_m: float
) -> tuple[float, float]:
    """Return what a stated height is counted from, local NED, and how far it may be off."""
    error_m = max(detection.down_uncertainty_m or 0.0, error_z_m)
    # What stamp and pose may be apart displaces a climbing body.
    error_m += abs(pose.velocity_ned_mps[2]) * POSE_TIMING_S
    return pose.position_ned_m[2] if frame.frame == "body_frd" else 0.0, error_m


def distances_m(corners_ned_m: Corners, here_ned_m: Sequence[float]) -> tuple[float, float]:
    """Return the least and the greatest horizontal distance of a rectangle from a place."""
    ahead_m = [(north - here_ned_m[0], east - here_ned_m[1]) for north, east in corners_ned_m]
    nearest_m, signs = math.inf, set()
    for (ax, ay), (bx, by) in zip(ahead_m, [*ahead_m[1:], ahead_m[0]], strict=True):
        dx, dy = bx - ax, by - ay
        length2_m2 = dx * dx + dy * dy
        along = 0.0 if length2_m2 == 0.0 else min(max(-(ax * dx + ay * dy) / length2_m2, 0.0), 1.0)
        nearest_m = min(nearest_m, math.hypot(ax + along * dx, ay + along * dy))
        signs.add(ax * by - ay * bx > 0.0)
    if len(signs) == 1:  # every side on the same hand: inside
        nearest_m = 0.0
    return nearest_m, max(math.hypot(x_m, y_m) for x_m, y_m in ahead_m)


@dataclass(frozen=True)
class ShownHeights:
    """How much of the heights flown at a frame shows.

    Attributes:
        blind_m: nearer than this, not all of them are in view; infinite where no place shows them.
        high_m: how far they reach above or below the sensor at most.
        azimuth_error_rad: how far a direction among them may seem to turn as the body tilts.
    """

    blind_m: float = 0.0
    high_m: float = 0.0
    azimuth_error_rad: float = 0.0

    def half_view_rad(self, half_rad: float) -> float:
        """Return what is left of half a view around the sensor's axis; all round stays so."""
        return half_rad if half_rad >= math.pi else max(half_rad - self.azimuth_error_rad, 0.0)

    def level_range_m(self, range_m: float) -> float:
        """Return how far away, horizontally, the farthest of these heights is within range."""
        return math.sqrt(max(range_m * range_m - self.high_m * self.high_m, 0.0))


def shown_heights(
    frame: DetectionFrame, pose: Pose, leg_down_m: float, terms: Terms[float]
) -> ShownHeights:
    """Return what a frame shows of the band around a leg; all of it where obstacles are pillars.

    Args:
        frame: of a sensor that is within the body.
        pose: of the body at the stamp.
        leg_down_m: height of the leg, local NED.
        terms: of the contract.
    """
    if terms.radius_z_m is None:
        return ShownHeights()
    half_m, lower_m = half_band_m(terms), pose.position_ned_m[2] - leg_down_m
    above_m, below_m = half_m + lower_m + terms.radius_z_m, half_m - lower_m + terms.radius_z_m
    reported_m = frame.reported_height_m
    if reported_m is not None and (above_m > reported_m[0] or below_m > reported_m[1]):
        return ShownHeights(blind_m=math.inf)
    view = VerticalView.of(frame, pose, terms)
    blind_m = view.blind_m(above_m, below_m)
    steepest_rad = max(view.up_rad, view.down_rad, 0.0)
    return ShownHeights(
        blind_m, max(above_m, below_m), azimuth_error_rad(steepest_rad, tilt_rad(pose))
    )


def level_blind_m(terms: Terms[float]) -> float:
    """Return how near a level vehicle on its leg sees all heights flown at; 0 among pillars."""
    if terms.radius_z_m is None:
        return 0.0
    up_rad, down_rad = terms.view_up_rad or 0.0, terms.view_down_rad or 0.0
    view = VerticalView(up_rad - VIEW_EDGE_RAD, down_rad - VIEW_EDGE_RAD)
    high_m = half_band_m(terms) + terms.radius_z_m
    return view.blind_m(high_m, high_m)


def azimuth_error_rad(elevation_rad: float, tilted_rad: float) -> float:
    """Return how far the bearing of a direction may be off in a body that is tilted.

    Args:
        elevation_rad: of the direction above or below the level, at most.
        tilted_rad: of the body.

    A turn by t about a level axis takes (cos p, sin p, tan e) to (cos p, sin p cos t - tan e sin t,
    ...): seen from above, the tip, which is 1 away, moves by tan(e) sin(t) + (1 - cos t) at most.
    Pitch before roll twists besides, by 2 atan(tan(pitch/2) tan(roll/2)) <= 1 - cos(t).
    """
    sunk = 1.0 - math.cos(tilted_rad)
    moved = math.tan(elevation_rad) * math.sin(tilted_rad) + sunk
    return math.asin(min(moved, 1.0)) + sunk
