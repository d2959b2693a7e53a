"""From a detection frame to remembered boxes: what to believe of a frame, and what it violates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from onboard.monitoring.assumptions import Violation, check_frame
from onboard.monitoring.detection_consistency import (
    DetectionConsistencyMonitor,
    Placement,
    Sighting,
)
from onboard.monitoring.detections import CLOCK_TOLERANCE_S, DetectionMonitor
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.movers.frame_rows import Uncounted
from onboard.monitoring.movers.mover_space import MoverSpace
from onboard.monitoring.seen.seen_space import DOUBTS, SeenSpace
from onboard.monitoring.supervised_flight import SupervisedFlight, in_control
from onboard.perception.bearings import TRACKS_PER_FRAME, BearingMemory
from onboard.perception.detection import (
    ANY_HEIGHT,
    Corners,
    Detection,
    DetectionFrame,
    DownRange,
    corners_ned,
)
from onboard.perception.heights import heights_filled_m
from onboard.perception.intake import DetectionCounters
from onboard.perception.movers.moving_detection import ReportsFrame, is_complete
from onboard.perception.placement import PlacedBox, blurs_m, place
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose

# A box displaced by less than this share of the sensor's error counts as sharp.
SHARP_SHARE: Final = 0.1
_IN_PLACE: Final = ((0.0, 0.0),)


class DetectionEvaluator:
    """Checks frames against the contract and against earlier ones, and remembers their boxes.

    Args:
        flight: whose map the boxes belong to, and which rechecks its plan against what is new.
        poses: where the body was.
        placements_m: how far a box in local NED with that stamp has to be moved to be in the
            present local frame, north and east; several where an estimator reset leaves that open.
        counters: count frames that cannot be placed.
        heights_stand: whether a height in local NED with that stamp is one in the present frame.

    Attributes:
        is_peer: tells whether a box, by its corners in local NED and by how much they may be off,
            may be another vehicle of the fleet.  It hides what is behind it, and is no obstacle.
    """

    def __init__(
        self,
        flight: SupervisedFlight,
        poses: PoseHistory,
        placements_m: Callable[[float], Sequence[tuple[float, float]]],
        counters: DetectionCounters,
        heights_stand: Callable[[float], bool] = lambda _stamp_s: True,
    ) -> None:
        self.monitor = DetectionMonitor()
        self.consistency = DetectionConsistencyMonitor()
        self.bearings = BearingMemory()
        self._flight, self._poses = flight, poses
        self._placements_m = placements_m
        self._counters = counters
        self._heights_stand = heights_stand
        self.is_peer: Callable[[Corners, float], bool] = lambda *_: False
        self.movers = MoverSpace(flight, self._static_boxes_ned_m)
        self.seen = SeenSpace(
            flight,
            poses,
            is_mover=self.movers.is_mover,
            is_peer=self._is_peer,
            on_void=self._void_movers,
        )

    def evaluate(
        self, frame: DetectionFrame, stamp_s: float, now_s: float, heading: HeadingMonitor
    ) -> Iterator[Violation]:
        """Take one frame, and yield what it violates, each before what follows from it.

        What nothing speaks against also tells what is free.

        Args:
            frame: what a sensor saw.
            stamp_s: when, on the service's clock.
            now_s: the time.
            heading: learns of tracks that are seen from the body once more.
        """
        if isinstance(frame, ReportsFrame):
            yield from self._take_reports(frame, stamp_s, now_s)
            return
        doubted = False
        for violation in self._evaluate(frame, stamp_s, now_s, heading):
            doubted |= violation.assumption in DOUBTS
            yield violation
        why = Uncounted.CROWDED if self.movers.is_crowded(stamp_s) else None
        if doubted or not is_complete(frame):
            why = Uncounted.DOUBTED if doubted else Uncounted.INCOMPLETE
        if why is not None:
            self.seen.skip(frame)
            self.movers.skip(frame, why)
            return
        filled_m = self._filled_m(frame, self._poses.at(stamp_s), stamp_s)
        sight = self.seen.take(frame, stamp_s, now_s, self._placements_m(stamp_s), filled_m)
        if sight is None:
            self.movers.skip(frame, Uncounted.PLACELESS)
        else:
            yield from self.movers.see(sight)

    def _evaluate(
        self, frame: DetectionFrame, stamp_s: float, now_s: float, heading: HeadingMonitor
    ) -> Iterator[Violation]:
        fault = self.monitor.on_arrival(frame.source, frame.sequence, stamp_s, now_s)
        if fault is not None:
            yield fault
        if stamp_s > now_s + CLOCK_TOLERANCE_S:
            return
        yield from self._take_frame(frame, stamp_s, now_s)
        yield from self._compare_bearings(frame, stamp_s, now_s, heading)

    def _take_frame(
        self, frame: DetectionFrame, stamp_s: float, now_s: float
    ) -> Iterator[Violation]:
        pose = self._poses.at(stamp_s)
        blur_by_track_m = None if frame.frame == "local_ned" else self._blurs_m(frame, stamp_s)
        if blur_by_track_m is not None and (pose is None or self._is_blurred(blur_by_track_m)):
            # Seen from an unknown place, the boxes cannot be used.
            self._counters.unplaced_frames += 1
            return
        terms = self._flight.assessment.terms
        late = self.monitor.on_frame(frame.source, stamp_s, now_s, terms)
        if late is not None:
            yield late
        yield from check_frame(frame, terms)
        placed = place(frame, pose, blur_by_track_m, self._filled_m(frame, pose, stamp_s))
        shifts_m = self._placements_m(stamp_s)
        if len(shifts_m) == 1:  # else it is not known where it saw them
            here = [box.shifted_by(shifts_m[0]) if box.moves else box for box in placed]
            yield from self.movers.track(frame, here, stamp_s)
        moving = {
            frame.track_id(seen) for seen in frame.obstacles if self.movers.is_mover(frame, seen)
        }
        for box in placed:
            if box.track_id not in moving and not self._is_peer(box.corners_ned_m):
                yield from self._take_everywhere(box, stamp_s, now_s)

    def _take_reports(
        self, frame: ReportsFrame, stamp_s: float, now_s: float
    ) -> Iterator[Violation]:
        """Add the movers that are reported; one from the future has been stamped wrongly."""
        shifts_m = self._placements_m(stamp_s)
        if len(shifts_m) != 1 or stamp_s > now_s + CLOCK_TOLERANCE_S:
            self._counters.unplaced_frames += 1
            return
        placed = place(frame, None, None, lambda *_: ANY_HEIGHT)
        yield from self.movers.track(
            frame, [box.shifted_by(shifts_m[0]) for box in placed], stamp_s
        )

    def _filled_m(
        self, frame: DetectionFrame, pose: Pose | None, stamp_s: float
    ) -> Callable[[Detection, Corners], DownRange]:
        """Return what tells the heights that a box of a frame may fill."""
        terms = self._flight.assessment.terms
        if frame.frame == "local_ned" and not self._heights_stand(stamp_s):
            return lambda *_: ANY_HEIGHT
        return lambda detection, corners_ned_m: heights_filled_m(
            frame, detection, corners_ned_m, pose, terms
        )

    def _compare_bearings(
        self, frame: DetectionFrame, stamp_s: float, now_s: float, heading: HeadingMonitor
    ) -> Iterator[Violation]:
        """Check the heading by the tracks that are seen from the body once more.

        What moves tells no heading.
        """
        pose = self._poses.at(stamp_s)
        if frame.frame == "local_ned" or pose is None:
            return
        terms = self._flight.assessment.terms
        if self._is_blurred(self._blurs_m(frame, stamp_s)):
            return
        corners_ned_m = {
            frame.track_id(seen): corners_ned(seen, pose)
            for seen in frame.obstacles[:TRACKS_PER_FRAME]
            if not self.movers.is_mover(frame, seen) and not self._is_peer(corners_ned(seen, pose))
        }
        residuals = self.bearings.residuals(
            pose, corners_ned_m, terms.map_error_m, terms.heading_error_rad
        )
        turned = heading.on_sightings(residuals, now_s, terms)
        if turned is not None:
            yield turned

    def _take_everywhere(
        self, seen: PlacedBox, stamp_s: float, now_s: float
    ) -> Iterator[Violation]:
        """Remember a box; where an estimator reset leaves its place open, at every one."""
        shifts_m = self._placements_m(stamp_s) if seen.moves else _IN_PLACE
        if len(shifts_m) > 1 and self._flight.obstacles.remembers(seen.track_id):
            return  # it has been seen better
        if len(shifts_m) > 1:
            # Of one sighting two places, which contradict each other: neither says where it is.
            seen = seen._replace(in_full=False)
        for shift_m in shifts_m:
            yield from self._take_box(seen.shifted_by(shift_m), now_s)

    def _take_box(self, seen: PlacedBox, now_s: float) -> Iterator[Violation]:
        """Remember one box; a place that contradicts an earlier one is kept apart from it."""
        flight, terms = self._flight, self._flight.assessment.terms
        error_m = max(seen.uncertainty_m + terms.drift_m, terms.map_error_m)
        displacement_m = seen.displacement_m(terms.heading_error_rad)
        counts_on_errors = displacement_m + terms.drift_m > 0.0
        sighting = None
        if seen.in_full:
            unshifted_m = flight.obstacles.unshifted(seen.corners_ned_m)
            sighting = Sighting.of(unshifted_m, error_m, displacement_m + seen.blur_m)
        placement = self.consistency.take(seen.track_id, sighting, now_s)
        changed = flight.obstacles.add(
            placement.track_id,
            seen.corners_ned_m,
            # What a sensor states less than the contract, the contract covers already.
            # A box at an angle to the leg has its corners off by more than its faces.
            math.sqrt(2.0) * (error_m if counts_on_errors else seen.uncertainty_m) + displacement_m,
            apart_from=self._apart_from(placement, seen, now_s),
            error_max_m=flight.assessment.face_error_m,
            in_full=seen.in_full and seen.blur_m == 0.0,
            partial=seen.partial,
            down_m=seen.down_m,
            filled_m=seen.filled_m,
        )
        if placement.violation is not None:
            yield placement.violation
        obstacle = flight.obstacles.of_track(placement.track_id) if changed else None
        if obstacle is not None:
            flight.recheck_plan(obstacle, now_s)

    def _apart_from(self, placement: Placement, seen: PlacedBox, now_s: float) -> str | None:
        """Return the track that a box contradicts.

        In STANDBY nothing is flown by the map: what encloses all places is one obstacle.
        """
        return seen.track_id if placement.apart and in_control(self._flight, now_s) else None

    def _is_peer(self, corners_ned_m: Corners) -> bool:
        return self.is_peer(corners_ned_m, self._flight.assessment.terms.map_error_m)

    def _void_movers(self, frame_stands: bool) -> None:
        self.movers.void(frame_stands=frame_stands)

    def _static_boxes_ned_m(self) -> list[Corners]:
        """Return the corners of what is known to stand still near the vehicle, local NED."""
        leg = self._flight.leg
        return [
            [
                leg.position_ned((x_m, y_m, 0.0))[:2]
                for x_m in (box.x_min_m, box.x_max_m)
                for y_m in (box.y_min_m, box.y_max_m)
            ]
            for box in self.seen.boxes()
        ]

    def _blurs_m(self, frame: DetectionFrame, stamp_s: float) -> dict[str, float]:
        """Return how far off a turning body sees what is to be taken from a frame, by track.

        What is hardly blurred counts as sharp.  Of the rest, what is known already has been seen
        better, and what is far, or seen at rest before the departure, will be: only what is new
        and near has to be taken as it is, or makes the frame unusable.
        """
        sharp_m = SHARP_SHARE * self._flight.assessment.terms.position_error_m
        return blurs_m(frame, self._poses.yaw_rate_radps(stamp_s), sharp_m, self._must_be_known)

    def _must_be_known(self, track_id: str, detection: Detection) -> bool:
        """Tell whether a box seen in motion is new, and so near that the contract counts on it."""
        if not self._flight.moving:
            return False
        counted_on_m = self._flight.assessment.inflated.required_detection_range_m
        near_m = math.hypot(*detection.center_m) - math.hypot(*detection.size_m) / 2.0
        return not self._flight.obstacles.remembers(track_id) and near_m <= counted_on_m

    def _is_blurred(self, blur_by_track_m: Mapping[str, float]) -> bool:
        limit_m = self._flight.assessment.terms.position_error_m
        return any(blur_m > limit_m for blur_m in blur_by_track_m.values())
