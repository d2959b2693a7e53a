"""What one frame says of movers: where it shows none, and what each that it shows may fill."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from onboard.contract.terms import Terms
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.monitoring.assumptions import ALL_ROUND_DEG
from onboard.monitoring.seen.scan_limits import resolved_m, scan_of
from onboard.monitoring.seen.sight import Sight
from onboard.perception.detection import Corners, DetectionFrame
from onboard.perception.face_strips import enclosing_boxes
from onboard.perception.line_of_sight import View
from onboard.perception.movers.glance import Glance, boxes_array, without
from onboard.perception.movers.moving_detection import ReturnsFrame, exposure_s, is_whole, kind_of
from onboard.perception.movers.tracker import Bound, with_hidden_part
from onboard.perception.placement import POSE_TIMING_S

_Row = tuple[float, float, float, float]


class _Shown(NamedTuple):
    """Boxes of a frame.

    Attributes:
        blocking: what each hides, the exposure included.
        movers: least and greatest north, least and greatest east that each mover may fill.
        cores: what each mover fills at least.
    """

    blocking: list[Box]
    movers: list[_Row]
    cores: list[_Row]


def glance_of(
    sight: Sight,
    terms: Terms[float],
    moving: Sequence[bool],
    bound_of: Callable[[str], Bound],
    known: Sequence[Box],
    *,
    hidden: bool,
) -> Glance:
    """Return what a frame says of movers, as the seen-free set takes it, but in local NED.

    Args:
        sight: the frame, its pose, and its boxes in local NED.
        terms: the contract's.
        moving: of each box, whether it may move.
        bound_of: what the class of a mover keeps to.
        known: boxes that stand still, which hide what is behind.
        hidden: whether movers may hide behind what stands still from the start.
    """
    shown = _shown(sight, terms, moving, bound_of)
    view = _view(sight, terms, shown.blocking)
    return Glance(
        replace(view, boxes=[*shown.blocking, *known]),
        sight.stamp_s,
        boxes_array(shown.movers),
        None if hidden else without(view, list(moving)),
        exposure_s(sight.frame),
        boxes_array(shown.cores),
    )


def _shown(
    sight: Sight, terms: Terms[float], moving: Sequence[bool], bound_of: Callable[[str], Bound]
) -> _Shown:
    frame = sight.frame
    corners = np.array(sight.placed_ned_m).reshape(-1, 4, 2)
    shown = _Shown(enclosing_boxes(corners, terms.map_error_m), [], [])
    returned, lasting_s = isinstance(frame, ReturnsFrame), exposure_s(frame)
    for index, (detection, moves) in enumerate(zip(frame.obstacles, moving, strict=True)):
        if not moves:
            continue
        margin_m = box_margin_m(sight, terms, corners[index])
        bound = bound_of(kind_of(detection))
        raw = shown.blocking[index]
        grown = raw.inflated(margin_m)
        # Of a return, all that its sensor does not see past stays unseen.
        if not (is_whole(detection) or returned):
            raw = grown = with_hidden_part(raw, margin_m, bound.size_max_m)
        shown.blocking[index] = raw.inflated(bound.speed_max_mps * lasting_s)
        # While a measurement lasts, what moves is anywhere within its way.
        grown = grown.inflated(bound.speed_max_mps * (POSE_TIMING_S + lasting_s))
        row = (grown.x_min_m, grown.x_max_m, grown.y_min_m, grown.y_max_m)
        shown.movers.append(row)
        # A return says only that something is in its box, not what that fills.
        shown.cores.append(row if returned else _core(corners[index], margin_m))
    return shown


def _view(sight: Sight, terms: Terms[float], boxes: list[Box]) -> View:
    frame, pose, e = sight.frame, sight.pose, terms.map_error_m
    heading_error_rad = terms.heading_error_rad + sight.turn_radps * POSE_TIMING_S
    clock_error_m = math.hypot(*pose.velocity_ned_mps[:2]) * POSE_TIMING_S
    scan = scan_of(frame, terms)
    return View(
        position_leg_m=pose.position_ned_m[:2],
        heading_leg_rad=pose.yaw_rad,
        half_view_rad=_half_view_rad(frame, terms),
        range_m=min(frame.range_m, _declared_range_m(frame, terms), resolved_m(frame, terms)),
        boxes=boxes,
        face_error_m=e * (1.0 + heading_error_rad),
        pose_error_m=clock_error_m + (e if scan else 0.0),
        placing_error_m=math.sqrt(2.0) * e,
        heading_error_rad=heading_error_rad,
        free_range_m=scan,
        scan_half_view_rad=math.radians(frame.field_of_view_deg) / 2.0,
    )


def box_margin_m(sight: Sight, terms: Terms[float], corners_m: FloatArray) -> float:
    """Return how far the faces of one box may be off, its stamp and its growth included."""
    north_m, east_m, _ = sight.pose.position_ned_m
    far_m = float(np.hypot(corners_m[:, 0] - north_m, corners_m[:, 1] - east_m).max())
    speed_mps = math.hypot(*sight.pose.velocity_ned_mps[:2])
    heading_rad = terms.heading_error_rad + sight.turn_radps * POSE_TIMING_S
    return terms.map_error_m + speed_mps * POSE_TIMING_S + heading_rad * far_m


def _half_view_rad(frame: DetectionFrame, terms: Terms[float]) -> float:
    """Return half of what a frame shows: all round, or no more than the contract counts on."""
    view_rad = math.radians(frame.field_of_view_deg)
    if frame.field_of_view_deg >= ALL_ROUND_DEG:
        return math.pi
    return min(view_rad, terms.field_of_view_rad) / 2.0


def _declared_range_m(frame: DetectionFrame, terms: Terms[float]) -> float:
    """Return how far the contract counts on what a sensor says: a ring no farther than declared."""
    ring_m = terms.all_round_range_m or 0.0
    if ring_m > 0.0 and frame.field_of_view_deg >= ALL_ROUND_DEG:
        return min(ring_m, terms.detection_range_m)
    return terms.detection_range_m


def _core(corners_m: FloatArray, error_m: float) -> tuple[float, float, float, float]:
    """Return a part along the axes of what a box fills for sure; its middle if that is too little.

    The square in its inscribed circle lies within it, however it is turned.
    """
    sides_m = np.hypot(*(corners_m[1:3] - corners_m[0:2]).T)
    half_m = max(float(sides_m.min()) / math.sqrt(8.0) - error_m, 0.0)
    north_m, east_m = corners_m.mean(axis=0)
    return north_m - half_m, north_m + half_m, east_m - half_m, east_m + half_m


def turned(corners_m: Corners) -> float:
    """Return how much farther along the axes a corner of a turned box is off than its faces."""
    (x0_m, y0_m), (x1_m, y1_m), (x2_m, y2_m), _ = corners_m
    sides = ((x1_m - x0_m, y1_m - y0_m), (x2_m - x1_m, y2_m - y1_m))
    longer = max(sides, key=lambda side: math.hypot(*side))
    length_m = math.hypot(*longer)
    # A box without extent may be turned by any angle.
    return math.sqrt(2.0) if length_m < 1e-3 else sum(map(abs, longer)) / length_m


def around(corners_m: Corners) -> Box:
    """Return the box along the axes around some corners."""
    first, second = zip(*corners_m, strict=True)
    return Box(min(first), max(first), min(second), max(second))
