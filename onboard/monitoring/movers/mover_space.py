"""Feeds the mover-free set and the tracks of movers, and checks what the contract says of them.

Without `requirements.movers` nothing is kept, and every detection counts as standing still.  Beside
declared heights all that moves is flown over: only what is not measured so is tracked, and no set
of places without movers is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from onboard.files.contract_terms.mover_terms import UNKNOWN, MoverClass
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.monitoring.assumptions import ALL_ROUND_DEG, Assumption, Violation
from onboard.monitoring.movers.claimed_boxes import ClaimedBoxes
from onboard.monitoring.movers.flown_over import FlownOver
from onboard.monitoring.movers.frame_rows import FrameRows, Uncounted
from onboard.monitoring.movers.glances import around, box_margin_m, glance_of, turned
from onboard.monitoring.seen.sight import Sight
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.perception.detection import Corners, Detection, DetectionFrame
from onboard.perception.face_strips import strip_around
from onboard.perception.movers.box_rows import BoxRows
from onboard.perception.movers.mover_free import MoverFree
from onboard.perception.movers.moving_detection import (
    MovingDetection,
    ReturnsFrame,
    is_complete,
    is_mover,
    is_whole,
    kind_of,
    turned_velocity_mps,
)
from onboard.perception.movers.static_claims import StaticClaims
from onboard.perception.movers.tracker import (
    MEMORY_S,
    TRACKS_MAX,
    Bound,
    MoverTracker,
    Sighting,
)
from onboard.perception.placement import POSE_TIMING_S, PlacedBox
from onboard.planning.mover_certifier import UNASKED, Movers
from onboard.vehicle_state import Pose

# Corners of what stands still.
KnownBoxes = Callable[[], Sequence[Corners]]


class MoverSpace:
    """What is known of movers around one vehicle, in local NED.

    Args:
        flight: whose contract counts.
        known_boxes: returns what stands still near the vehicle, which hides what is behind.
        frames_needed: K, as of the seen-free set.

    Attributes:
        all_round_s: stamp of the newest frame of what sees all round; minus infinity before it.
    """

    def __init__(
        self, flight: SupervisedFlight, known_boxes: KnownBoxes, *, frames_needed: int = 3
    ) -> None:
        self._flight, self._known_boxes = flight, known_boxes
        self._claims = StaticClaims()
        self.all_round_s = self._crowded_s = -math.inf
        terms = flight.assessment.terms
        self.active = terms.movers_level != "none"
        self._over = FlownOver(flight) if self.active and not terms.movers_meet else None
        self.needs_ring = terms.movers_meet and terms.movers_level != "passive_in_view"
        # Where not all round is seen, any may step behind an obstacle out of view.
        self._hidden = any(mover.hidden for mover in terms.movers) or not self.needs_ring
        bounds, unknown = bounds_of(terms.movers)
        self._tracker = MoverTracker(bounds, unknown, stamp_error_s=POSE_TIMING_S)
        self._new: frozenset[str] = frozenset()
        self._frame_rows = FrameRows(frames_needed)
        self._free: MoverFree | None = None
        if terms.movers_meet:
            self._free = MoverFree(
                unknown.speed_max_mps,
                terms.detection_range_m,
                frames_needed=frames_needed,
                stamp_error_s=POSE_TIMING_S,
                shadows_open=not (self._hidden and self.needs_ring),
            )

    @property
    def movers(self) -> Movers | None:
        """What ways to rest are certified against; None where movers are none of the contract."""
        if self._over is not None:
            return Movers(UNASKED, tuple(self._tracker), POSE_TIMING_S)
        if self._free is None:
            return None
        missing = self._frame_rows.missing(self._free.frames_in_row)
        return Movers(self._free, tuple(self._tracker), POSE_TIMING_S, missing)

    @property
    def free(self) -> MoverFree | None:
        """The mover-free set; None where movers are none of the contract, or all flown over."""
        return self._free

    @property
    def refusal(self) -> str | None:
        """Why no place can ever count as free of movers, as sensors are; None if one may."""
        return self._frame_rows.refusal() if self._free is not None else None

    @property
    def tracks(self) -> MoverTracker:
        """The movers that are seen."""
        return self._tracker

    def is_mover(self, frame: DetectionFrame, detection: Detection) -> bool:
        """Tell whether a detection is taken for one that moves.

        What a ranging sensor meets at heights at which nothing moves stands still.
        """
        if not self.active or (self._over is not None and isinstance(frame, ReturnsFrame)):
            return False
        return is_mover(detection) or self._claims.is_broken(frame.track_id(detection))

    # ------------------------------------------------------------------ what changes

    def begin_flight(self) -> None:
        """Begin again: none hides at the start, unless the contract says that some may."""
        self._claims = StaticClaims()
        self._tracker.clear()  # what was too fast before is found again
        if self._free is not None:
            self._free.begin()

    def take_word(self, pose: Pose, radius_m: float, now_s: float) -> None:
        """Take the operator's word that no mover is so near now, where no ring sees all round."""
        if self._free is not None and not self.needs_ring:
            north_m, east_m, _ = pose.position_ned_m
            self._free.take_word(north_m, east_m, radius_m, now_s)

    def near(self, pose: Pose | None, radius_m: float, now_s: float) -> list[str]:
        """Return the tracks that contradict such a word."""
        if pose is None or self._free is None or self.needs_ring:
            return []
        north_m, east_m, _ = pose.position_ned_m
        around_it = Box(
            north_m - radius_m, north_m + radius_m, east_m - radius_m, east_m + radius_m
        )
        return [
            track.id
            for track in self._tracker
            if track.predicted(now_s, POSE_TIMING_S).intersects(around_it)
        ]

    def void(self, *, frame_stands: bool = False) -> None:
        """Forget everything: the local frame has moved, or is in doubt.

        Args:
            frame_stands: neither is the case; what was seen is of another height, where other
                movers may be.
        """
        if frame_stands:
            if self._free is not None:
                self._free.forget_seen()
            return
        self._tracker.clear()
        self._claims.clear()
        self._new = frozenset()
        if self._free is not None:
            self._free.void()

    def track(
        self, frame: DetectionFrame, placed: Sequence[PlacedBox], stamp_s: float
    ) -> list[Violation]:
        """Take the boxes of a frame whose movers have been placed; return what they violate.

        Args:
            frame: what a sensor saw.
            placed: its boxes, in local NED.
            stamp_s: when, on the service's clock.
        """
        if not self.active:
            return []
        found = self._take(frame, placed, stamp_s)
        ring = frame.field_of_view_deg >= ALL_ROUND_DEG and is_complete(frame)
        if ring and not self.is_crowded(stamp_s):
            self.all_round_s = max(self.all_round_s, stamp_s)
        return found

    def is_crowded(self, stamp_s: float) -> bool:
        """Tell whether there were more movers than are followed when a frame was taken, or lately.

        Those that are not followed would have been for so long: until then any place may hold one.
        """
        return stamp_s <= self._crowded_s + MEMORY_S

    def _overflow(self, stamp_s: float) -> None:
        """Take it that any place may hold a mover: not all that a frame shows are followed."""
        self._crowded_s, self._new = max(self._crowded_s, stamp_s), frozenset()
        if self._free is not None:
            self._free.forget_seen()

    def _take(
        self, frame: DetectionFrame, placed: Sequence[PlacedBox], stamp_s: float
    ) -> list[Violation]:
        by_id = {frame.track_id(seen): seen for seen in frame.obstacles}
        if isinstance(frame, ReturnsFrame) and self._over is None:
            self._track_returns(frame, [(by_id[box.track_id], box) for box in placed], stamp_s)
            return []
        found: list[Violation] = []
        sightings = []
        for box in placed:
            detection = by_id[box.track_id]
            if self.is_mover(frame, detection):
                if self._over is not None:
                    found += self._over.check(detection, box)
                if self._over is None or self._over.meets(detection, box):
                    sightings.append(self._sighting(frame, detection, box))
                    found += self._check_size(detection, box)
            else:
                found += self._check_claim(detection, box)
        known = {track.id for track in self._tracker}
        unexplained = self._unexplained([each for each in sightings if each.whole], stamp_s)
        complete = is_complete(frame)
        too_fast = self._tracker.take(frame.source, sightings, stamp_s, complete=complete)
        if too_fast is None:
            self._overflow(stamp_s)
            return found
        new = {each.track_id for each in sightings} - known | self._tracker.renamed
        self._new = frozenset(new & unexplained)
        found += [
            Violation(Assumption.MOVER_CLASS, each.speed_mps, each.limit_mps, "m/s", each.track_id)
            for each in too_fast
        ]
        return found

    def _track_returns(
        self, frame: DetectionFrame, seen: list[tuple[Detection, PlacedBox]], stamp_s: float
    ) -> None:
        """Take what a sensor that tells ranges only has measured: what is not claimed may move.

        Tracks say where something was measured; where else that may be, the mover-free set says.
        """
        claimed, moving = self._claimed(), []
        for detection, box in seen:
            sighting = self._sighting(frame, detection, box)._replace(whole=True)
            if not claimed.explain(box.corners_ned_m, sighting.error_m):
                moving.append(sighting)
        self._new = frozenset(self._unexplained(moving, stamp_s))
        if not self._tracker.replace_returns(frame.source, moving, stamp_s):
            self._overflow(stamp_s)

    def _claimed(self) -> ClaimedBoxes:
        return ClaimedBoxes(self._known_boxes(), self._flight.assessment.terms.map_error_m)

    def see(self, sight: Sight) -> list[Violation]:
        """Take a frame that counts: it shows where no mover is; return what it contradicts.

        Args:
            sight: the frame, its pose, and its boxes in local NED.
        """
        if self._free is None:
            return []
        terms = self._flight.assessment.terms
        north_m, east_m, _ = sight.pose.position_ned_m
        self._free.centre_on(north_m, east_m)
        late = self._late_first_sights(sight)
        corners = np.array(sight.placed_ned_m).reshape(-1, 4, 2)
        moving = self._moving(sight, corners)
        known = [around(corners_m) for corners_m in self._known_boxes()]
        glance = glance_of(sight, terms, moving, self._tracker.bound, known, hidden=self._hidden)
        placed = self._free.see(glance, sight.frame.source)
        self._frame_rows.note(sight.frame, None if placed else Uncounted.LATE)
        self._new = frozenset()
        return late

    def skip(self, frame: DetectionFrame, why: Uncounted) -> None:
        """Take note of a frame that does not count: its sensor's row of frames begins again."""
        if self._free is not None:
            self._free.break_row(frame.source)
            self._frame_rows.note(frame, why)

    def check_ring(self, now_s: float) -> Violation | None:
        """Tell whether what sees all round has been silent for longer than the contract allows."""
        terms = self._flight.assessment.terms
        age_s = now_s - self.all_round_s
        if not self.needs_ring or age_s <= terms.frame_age_max_s:
            return None
        note = "nothing that sees all round is heard"
        if self.is_crowded(now_s):
            note = str(Uncounted.CROWDED)
        age = (age_s, terms.frame_age_max_s, "s", "all round", note)
        return Violation(Assumption.DETECTION_AGE, *age)

    # ------------------------------------------------------------------ parts

    def _sighting(self, frame: DetectionFrame, detection: Detection, box: PlacedBox) -> Sighting:
        terms = self._flight.assessment.terms
        error_m = max(box.uncertainty_m + terms.drift_m, terms.map_error_m)
        error_m += box.displacement_m(terms.heading_error_rad) + box.blur_m
        yaw_rad = box.pose.yaw_rad if box.pose is not None and not box.moves else 0.0
        return Sighting(
            frame.track_id(detection),
            kind_of(detection),
            around(box.corners_ned_m),
            # What stamp and pose are apart displaces a box seen from the body.
            turned(box.corners_ned_m) * error_m + self._clock_error_m(box),
            is_whole(detection),
            turned_velocity_mps(detection, yaw_rad),
        )

    def _clock_error_m(self, box: PlacedBox) -> float:
        if box.pose is None or box.moves:
            return 0.0
        return math.hypot(*box.pose.velocity_ned_mps[:2]) * POSE_TIMING_S

    def _check_size(self, detection: Detection, box: PlacedBox) -> list[Violation]:
        limit_m = self._tracker.bound(kind_of(detection)).size_max_m
        limit_m += 2.0 * max(detection.uncertainty_m, self._flight.assessment.terms.map_error_m)
        largest_m = max(detection.size_m)
        if largest_m <= limit_m:
            return []
        return [Violation(Assumption.MOVER_CLASS, largest_m, limit_m, "m", box.track_id)]

    def _check_claim(self, detection: Detection, box: PlacedBox) -> list[Violation]:
        if not (isinstance(detection, MovingDetection) and detection.box_whole and box.in_full):
            return []
        terms = self._flight.assessment.terms
        error_m = max(box.uncertainty_m, terms.map_error_m) + box.blur_m
        error_m += box.displacement_m(terms.heading_error_rad) + self._clock_error_m(box)
        error_m *= turned(box.corners_ned_m)
        moved = self._claims.check(box.track_id, around(box.corners_ned_m), error_m)
        if moved is None:
            return []
        claim = (moved.displacement_m, moved.limit_m, "m", box.track_id)
        return [Violation(Assumption.STATIC_CLAIM, *claim)]

    def _unexplained(self, sightings: Sequence[Sighting], stamp_s: float) -> set[str]:
        """Return which sightings, if their names are new, cannot be of a mover that is known."""
        if len(sightings) > TRACKS_MAX:
            return set()  # the tracker takes none of them
        known = BoxRows(track.predicted(stamp_s, POSE_TIMING_S) for track in self._tracker)
        return {
            each.track_id for each in sightings if not known.meet(each.measured, each.error_m).any()
        }

    def _late_first_sights(self, sight: Sight) -> list[Violation]:
        """Tell of each new mover whether one of its faces lies where none could be."""
        assert self._free is not None  # noqa: S101  the caller checked
        found = []
        for detection, corners_m in zip(sight.frame.obstacles, sight.placed_ned_m, strict=True):
            track_id = sight.frame.track_id(detection)
            if track_id not in self._new:
                continue
            corners = np.array(corners_m)
            margin_m = box_margin_m(sight, self._flight.assessment.terms, corners)
            if isinstance(sight.frame, ReturnsFrame):
                # Somewhere in the box something is.
                low, high = corners.min(axis=0) - margin_m, corners.max(axis=0) + margin_m
                until_s = np.array([sight.stamp_s + POSE_TIMING_S])
                if self._free.are_free(low[None], high[None], until_s):
                    found.append(_first_sight(track_id))
                continue
            for begin_m, end_m in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                low_n, high_n, low_e, high_e = strip_around(begin_m, end_m, margin_m)
                low, high = np.stack((low_n, low_e), axis=1), np.stack((high_n, high_e), axis=1)
                until_s = np.full(len(low), sight.stamp_s + POSE_TIMING_S)
                if self._free.are_free(low, high, until_s):
                    found.append(_first_sight(track_id))
                    break
        return found

    def _moving(self, sight: Sight, corners: FloatArray) -> list[bool]:
        """Tell of each box of a frame whether it may move."""
        frame = sight.frame
        if not isinstance(frame, ReturnsFrame):
            return [self.is_mover(frame, seen) for seen in frame.obstacles]
        return self._claimed().unexplained(
            corners, partial(box_margin_m, sight, self._flight.assessment.terms)
        )


def bounds_of(classes: Sequence[MoverClass]) -> tuple[dict[str, Bound], Bound]:
    """Return what each class keeps to, and what a mover without a declared class does."""
    bounds = {each.kind: Bound(each.speed_max_mps, each.size_max_m) for each in classes}
    largest = Bound(
        max((each.speed_max_mps for each in classes), default=0.0),
        max((each.size_max_m for each in classes), default=0.0),
    )
    return bounds, bounds.get(UNKNOWN, largest)


def _first_sight(track_id: str) -> Violation:
    sentence = f"mover {track_id} was first seen where none could be"
    return Violation(Assumption.MOVER_FIRST_SIGHT, 1.0, 0.0, "movers", track_id, sentence=sentence)
