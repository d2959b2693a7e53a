"""From a detection frame to remembered boxes: what is believed of a frame, and where its boxes are.

A frame in the body frame is placed with the pose at its stamp.  Its boxes are off by what the
sensor states and by what a wrong heading displaces: the farther away, the more.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from onboard.files.json_payload import MalformedPayloadError
from onboard.geometry.frames import heading_displacement_m
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import TELEMETRY_RATE_HZ
from onboard.monitoring.assumptions import Violation, check_frame
from onboard.monitoring.detection_consistency import (
    DetectionConsistencyMonitor,
    Placement,
    Sighting,
)
from onboard.monitoring.detections import CLOCK_TOLERANCE_S, DetectionMonitor
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.perception.bearings import TRACKS_PER_FRAME, BearingMemory
from onboard.perception.full_view import in_full_view
from onboard.perception.obstacle_map import (
    Corners,
    Detection,
    DetectionFrame,
    corners_ned,
    parse_frame,
    shifted_corners,
)
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose

log = logging.getLogger(__name__)

# At 20 Hz a tick sees one frame; a burst beyond this is a fault, and the oldest are dropped.
MAX_PENDING_FRAMES: Final = 32
# How far apart the times of a pose between two others and of a frame from the body may be.
POSE_TIMING_S: Final = 0.5 / TELEMETRY_RATE_HZ
# What this displaces by less than this share of a sensor's error is seen sharply.
SHARP_SHARE: Final = 0.1


@dataclass
class DetectionCounters:
    """What arrived from the sensors and was not used; nothing of it ever raises."""

    malformed_frames: int = 0
    unplaced_frames: int = 0
    dropped_frames: int = 0


class _Seen(NamedTuple):
    """One detected box, placed.

    Attributes:
        track_id: which obstacle, as its sensor sees it.
        corners_ned_m: where it is.
        uncertainty_m: what the sensor states for each face.
        pose: of the body at the stamp; None where unknown.
        moves: whether an estimator reset since the stamp moves it: it came in local NED.
        blur_m: how far off a turning body may have placed it.
        in_full: whether it was seen in full view.
    """

    track_id: str
    corners_ned_m: Corners
    uncertainty_m: float
    pose: Pose | None
    moves: bool
    blur_m: float
    in_full: bool

    def displacement_m(self, heading_error_rad: float) -> float:
        """Return how far a wrong heading displaces the farthest corner.

        Boxes in local NED are placed by the autopilot's own estimate, with the same heading.
        """
        if self.pose is None:
            return 0.0
        here_ned_m = self.pose.position_ned_m[:2]
        farthest_m = max(math.dist(corner, here_ned_m) for corner in self.corners_ned_m)
        return heading_displacement_m(farthest_m, heading_error_rad)


def _in_place(stamp_s: float) -> Sequence[tuple[float, float]]:  # noqa: ARG001  no resets
    return ((0.0, 0.0),)


class DetectionIntake:
    """Reads detection frames into the navigator's map.

    Args:
        navigator: whose map they belong to, and which rechecks its plan against what is new.
        poses: where the body was.
        placements_m: how far a box in local NED with that stamp has to be moved to be in the local
            frame of now, north and east; several where an estimator reset leaves that open.
    """

    def __init__(
        self,
        navigator: Navigator,
        poses: PoseHistory,
        placements_m: Callable[[float], Sequence[tuple[float, float]]] = _in_place,
    ) -> None:
        self.counters = DetectionCounters()
        self.monitor = DetectionMonitor()
        self.consistency = DetectionConsistencyMonitor()
        self.bearings = BearingMemory()
        self._navigator, self._poses = navigator, poses
        self._placements_m = placements_m
        self._pending: deque[bytes] = deque()

    def receive(self, payload: bytes) -> None:
        """Take one detection frame; it is read in the next tick."""
        if len(self._pending) == MAX_PENDING_FRAMES:
            self._pending.popleft()
            self.counters.dropped_frames += 1
        self._pending.append(payload)

    def take(
        self, now_s: float, epoch_unix_s: float, heading: HeadingMonitor
    ) -> Iterator[Violation]:
        """Read what has arrived, and yield what it violates, each before what follows from it.

        Args:
            now_s: the time.
            epoch_unix_s: Unix time at its zero.
            heading: is told of tracks that are seen from the body once more.
        """
        while self._pending:
            payload = self._pending.popleft()
            try:
                frame = parse_frame(payload)
            except MalformedPayloadError as error:
                self.counters.malformed_frames += 1
                log.debug("dropped a malformed detection frame: %s", error)
            else:
                stamp_s = frame.stamp_unix_s - epoch_unix_s
                yield from self._take_frame(frame, stamp_s, now_s)
                yield from self._compare_bearings(frame, stamp_s, now_s, heading)

    def _compare_bearings(
        self, frame: DetectionFrame, stamp_s: float, now_s: float, heading: HeadingMonitor
    ) -> Iterator[Violation]:
        """Check the heading by the tracks that are seen from the body once more."""
        pose = self._poses.at(stamp_s)
        if frame.frame == "local_ned" or pose is None or stamp_s > now_s + CLOCK_TOLERANCE_S:
            return
        terms = self._navigator.assessment.terms
        if self._is_blurred(self._blurs_m(frame, stamp_s)):
            return
        corners_ned_m = {
            _track_id(frame, seen): corners_ned(seen, pose)
            for seen in frame.obstacles[:TRACKS_PER_FRAME]
        }
        residuals = self.bearings.residuals(
            pose, corners_ned_m, terms.position_error_m, terms.heading_error_rad
        )
        turned = heading.on_sightings(residuals, now_s, terms)
        if turned is not None:
            yield turned

    def _take_frame(
        self, frame: DetectionFrame, stamp_s: float, now_s: float
    ) -> Iterator[Violation]:
        fault = self.monitor.on_arrival(frame.source, frame.sequence, stamp_s, now_s)
        if fault is not None:
            yield fault
        if stamp_s > now_s + CLOCK_TOLERANCE_S:
            return
        pose = self._poses.at(stamp_s)
        placed_by = pose if frame.frame == "body_frd" else None
        blurs_m = None if frame.frame == "local_ned" else self._blurs_m(frame, stamp_s)
        if blurs_m is not None and (pose is None or self._is_blurred(blurs_m)):
            # Seen, but from an unknown place: as good as not seen.
            self.counters.unplaced_frames += 1
            return
        terms = self._navigator.assessment.terms
        late = self.monitor.on_frame(frame.source, stamp_s, now_s, terms)
        yield from [] if late is None else [late]
        yield from check_frame(frame, terms)
        boxes_ned_m = [corners_ned(detection, placed_by) for detection in frame.obstacles]
        in_full = [False] * len(boxes_ned_m)
        if pose is not None:
            view_rad = math.radians(frame.field_of_view_deg)
            in_full = in_full_view(boxes_ned_m, pose, view_rad, frame.range_m)
        for detection, corners_ned_m, full in zip(
            frame.obstacles, boxes_ned_m, in_full, strict=True
        ):
            track_id = _track_id(frame, detection)
            if blurs_m is None or track_id in blurs_m:
                blur_m = 0.0 if blurs_m is None else blurs_m[track_id]
                seen = _Seen(
                    track_id,
                    corners_ned_m,
                    detection.uncertainty_m,
                    pose,
                    placed_by is None,
                    blur_m,
                    full,
                )
                yield from self._take_everywhere(seen, stamp_s, now_s)

    def _take_everywhere(self, seen: _Seen, stamp_s: float, now_s: float) -> Iterator[Violation]:
        """Remember a box; where an estimator reset leaves its place open, at every one."""
        shifts_m = self._placements_m(stamp_s) if seen.moves else _in_place(stamp_s)
        if len(shifts_m) > 1 and self._navigator.obstacles.of_track(seen.track_id) is not None:
            return  # it has been seen better
        if len(shifts_m) > 1:
            # Of one sighting two places, which contradict each other: neither says where it is.
            seen = seen._replace(in_full=False)
        for shift_m in shifts_m:
            placed = seen
            if shift_m != (0.0, 0.0):
                corners_ned_m = shifted_corners(seen.corners_ned_m, shift_m)
                placed = seen._replace(corners_ned_m=corners_ned_m)
            yield from self._take_box(placed, now_s)

    def _is_blurred(self, blurs_m: dict[str, float]) -> bool:
        limit_m = self._navigator.assessment.terms.position_error_m
        return any(blur_m > limit_m for blur_m in blurs_m.values())

    def _blurs_m(self, frame: DetectionFrame, stamp_s: float) -> dict[str, float]:
        """How far off a turning body sees what is to be taken from a frame, by track.

        Pose and frame belong together only as exactly as their times do.  What is hardly blurred
        counts as sharp; of the rest what is known already has been seen better, and what is far, or
        seen at rest before the departure, will be: only what is new and near has to be taken as it
        is, or makes the frame as good as none.
        """
        turn_rad = abs(self._poses.yaw_rate_radps(stamp_s)) * POSE_TIMING_S
        sharp_m = SHARP_SHARE * self._navigator.assessment.terms.position_error_m
        blurs_m = {}
        for detection in frame.obstacles:
            track_id, blur_m = (
                _track_id(frame, detection),
                math.hypot(*detection.center_m) * turn_rad,
            )
            if blur_m <= sharp_m:
                blurs_m[track_id] = 0.0
            elif self._navigator.moving and self._must_be_known(track_id, detection):
                blurs_m[track_id] = blur_m
        return blurs_m

    def _must_be_known(self, track_id: str, detection: Detection) -> bool:
        """Tell whether what is seen is new, and so near that the contract counts on it."""
        counted_on_m = self._navigator.assessment.inflated.required_detection_range_m
        near_m = math.hypot(*detection.center_m) - math.hypot(*detection.size_m) / 2.0
        return self._navigator.obstacles.of_track(track_id) is None and near_m <= counted_on_m

    def _take_box(self, seen: _Seen, now_s: float) -> Iterator[Violation]:
        """Remember one box; a place that contradicts an earlier one is kept apart from it."""
        navigator, terms = self._navigator, self._navigator.assessment.terms
        error_m = max(seen.uncertainty_m, terms.position_error_m)
        displacement_m = seen.displacement_m(terms.heading_error_rad)
        sighting = None
        if seen.in_full:
            unshifted_m = navigator.obstacles.unshifted(seen.corners_ned_m)
            sighting = Sighting.of(unshifted_m, error_m, displacement_m + seen.blur_m)
        placement = self.consistency.take(seen.track_id, sighting, now_s)
        changed = navigator.obstacles.add(
            placement.track_id,
            seen.corners_ned_m,
            # What a sensor states less than the contract, the contract covers already.
            error_m + displacement_m if displacement_m > 0.0 else seen.uncertainty_m,
            # In standby nothing is flown by the map: what encloses all places is one obstacle.
            apart_from=_apart_from(placement, seen, navigator.phase),
            error_max_m=navigator.assessment.face_error_m,
            in_full=seen.in_full and seen.blur_m == 0.0,
        )
        if placement.violation is not None:
            yield placement.violation
        obstacle = navigator.obstacles.of_track(placement.track_id) if changed else None
        if obstacle is not None:
            navigator.recheck_plan(obstacle, now_s)


def _apart_from(placement: Placement, seen: _Seen, phase: Phase) -> str | None:
    return seen.track_id if placement.apart and phase is not Phase.STANDBY else None


def _track_id(frame: DetectionFrame, detection: Detection) -> str:
    return f"{frame.source}/{detection.id}"
