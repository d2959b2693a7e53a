"""Feeds the seen-free set of the vehicle: which frames count, and what takes the set away.

Everything that is flown in seen-free space rests on frames that report *no* obstacle, so that a
frame counts only if all that it may be wrong about is within the contract (two-tier theory,
A1-sensor).  A frame that does not count also breaks its sensor's row of successive frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from onboard.geometry.box import Box
from onboard.geometry.fence import Fence
from onboard.geometry.frames import FloatArray, LegFrame, Vector, wrap_angle
from onboard.geometry.free_grid import FreeGrid
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.seen.contradiction import contradiction
from onboard.monitoring.seen.heights_seen import HeightsSeen
from onboard.monitoring.seen.looks_around import LooksAround
from onboard.monitoring.seen.operators_word import OperatorsWord
from onboard.monitoring.seen.sight import Sight, placed_corners_ned, view_of
from onboard.monitoring.seen.sight_queue import SightQueue
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.perception.detection import (
    ANY_HEIGHT,
    Corners,
    Detection,
    DetectionFrame,
    DownRange,
)
from onboard.perception.face_strips import enclosing_boxes, strip_around
from onboard.perception.line_of_sight import BOXES_MAX
from onboard.perception.placement import POSE_TIMING_S
from onboard.perception.pose_history import PoseHistory
from onboard.perception.seen_free import CELL_M, SeenFree
from onboard.vehicle_state import Pose

# Frames of a body that turns faster do not count: 20 ms of 60 deg/s displace by 0.25 m at 12 m.
TURN_MAX_RADPS: Final = math.radians(20.0)
_TURN_AROUND_S: Final = 0.1
# The pose of a frame is moved on by no more than this.
_POSE_APART_S: Final = 0.05
# A vehicle that drifts at rest stays on the disc where it began, by this.
START_MARGIN_M: Final = 0.3
_NEXT_CORNER: Final = (1, 2, 3, 0)
# What makes a frame that shows it, and what has been seen with it, unfit to say what is free.
DOUBTS: Final = frozenset(
    {
        Assumption.SENSOR_CLOCK,
        Assumption.DETECTION_UNCERTAINTY,
        Assumption.DETECTION_CONSISTENCY,
        Assumption.HEADING_ERROR,
        Assumption.POSITION_QUALITY,
    }
)


class SeenSpace:
    """The seen-free set in the frame of the leg that is flown, and what is known beside it.

    Args:
        flight: whose leg, contract and map count.
        poses: where the body was.
        frames_needed: K, see `SeenFree`.
        is_mover: tells what moves: it hides what is behind it, and contradicts nothing.
        is_peer: the same of a box, by its corners, that is another vehicle of the fleet.
        on_void: learns that nothing counts any more, and whether the local frame stands.

    Attributes:
        relied_on: whether what is flown was certified in the set, so that a contradiction is a
            violation; guidance says so.  Otherwise it only voids the set.
        lane_half_width_m: beyond so much beside a leg nothing counts as free, whatever is asked.
        void_reason: why the set was emptied last; empty if it never was.
        frames_needed: K, as given.
    """

    def __init__(
        self,
        flight: SupervisedFlight,
        poses: PoseHistory,
        *,
        frames_needed: int = 3,
        is_mover: Callable[[DetectionFrame, Detection], bool] = lambda _, __: False,
        is_peer: Callable[[Corners], bool] = lambda _: False,
        on_void: Callable[[bool], None] = lambda _: None,
    ) -> None:
        self._flight, self._poses = flight, poses
        self._is_mover, self._is_peer = is_mover, is_peer
        self._set = SeenFree(frames_needed=frames_needed)
        self._leg = flight.leg
        self._heights = HeightsSeen(flight)
        self._set.level_m = self._heights.level_m
        self._half_width_m = self.lane_half_width_m = math.inf
        self._pending = SightQueue[Sight](self._break_row)
        self._stamps_s: dict[str, float] = {}
        self._looks = LooksAround()
        self.relied_on = False
        self.void_reason, self.on_void = "", on_void
        self.frames_needed = frames_needed
        self._counted: dict[str, int] = {}
        self._word = OperatorsWord()
        self._fence: Fence | None = None

    # ------------------------------------------------------------------ what is asked of it

    @property
    def version(self) -> int:
        """Changes whenever the set does."""
        self.begin_leg(self._flight.leg)
        return self._set.version

    @property
    def frames_counted(self) -> int:
        """How many frames of the sensor with the most of them have counted so far."""
        return max(self._counted.values(), default=0)

    @property
    def size(self) -> int:
        """Number of free cells."""
        return self._set.size

    def grid(self) -> FreeGrid:
        """Return what is free, in the frame of the leg; the same snapshot until it changes."""
        self.begin_leg(self._flight.leg)
        return self._set.grid()

    def boxes(self) -> list[Box]:
        """Return every known obstacle near the vehicle, in the frame of the leg, as measured."""
        self.begin_leg(self._flight.leg)
        x_m, y_m = self._set.centre_leg_m
        return self._known_boxes(x_m, y_m, self._set.reach_m)

    # ------------------------------------------------------------------ what guidance tells it

    def confirm_start(self, x_m: float, y_m: float) -> bool:
        """Take the place where the vehicle rests for free, body and margin included (A0).

        Returns:
            Whether it is: a sensor has looked at it all round, and no known obstacle is there.
        """
        self.begin_leg(self._flight.leg)
        radius_m = self._start_radius_m
        north_m, east_m, _ = self._leg.position_ned((x_m, y_m, 0.0))
        if not self._looks.are_all_round((north_m, east_m), self._same_place_m, self.frames_needed):
            return False
        if self._is_known_occupied(x_m, y_m, radius_m):
            return False
        self._set.centre_on(x_m, y_m)
        self._set.confirm(x_m, y_m, radius_m)
        return True

    def confirm_by_word(self, north_m: float, east_m: float, radius_m: float) -> None:
        """Take a disc for free that the operator has confirmed, unless an obstacle is known there.

        Once, and not after the local frame has moved or come into doubt.

        Args:
            north_m: of its centre, local NED.
            east_m: likewise.
            radius_m: its radius.
        """
        self.begin_leg(self._flight.leg)
        x_m, y_m, _ = self._leg.position_leg((north_m, east_m, 0.0))
        if self._word.may_be_taken and not self._is_known_occupied(x_m, y_m, radius_m):
            self._word.take(north_m, east_m, radius_m)
            self._set.confirm(x_m, y_m, radius_m)

    def _is_known_occupied(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Tell whether a known obstacle may reach into a disc."""
        reach_m = radius_m + math.sqrt(2.0) * self._flight.assessment.terms.map_error_m
        return any(
            math.hypot(
                max(box.x_min_m - x_m, 0.0, x_m - box.x_max_m),
                max(box.y_min_m - y_m, 0.0, y_m - box.y_max_m),
            )
            <= reach_m
            for box in self._known_boxes(x_m, y_m, reach_m)
        )

    def limit(self, half_width_m: float) -> None:
        """Call nothing free that is farther than this from the line of a leg; stays in force."""
        self._half_width_m = min(half_width_m, self.lane_half_width_m)
        self._set.limit(self._half_width_m)

    def keep_in(self, fence: Fence | None) -> None:
        """Call nothing free that a geofence in local NED forbids; stays in force; None: ends."""
        self._fence = fence
        self._set.keep_in(fence, self._leg)

    def begin_leg(self, leg: LegFrame) -> None:
        """State the set in the frame of another leg; one at another height has not been seen."""
        before = self._leg
        if self._heights.have_grown():
            self.void("the heights flown at have grown", frame_stands=True)
        if leg == before:
            return
        self._leg = leg
        self._pending.clear()
        origin_m = before.position_leg(leg.origin_ned_m)
        turn_rad = wrap_angle(leg.heading_rad - before.heading_rad)
        self._set = self._set.turned((origin_m[0], origin_m[1]), turn_rad)
        self._set.limit(self._half_width_m)
        if self._fence is not None:
            self._set.keep_in(self._fence, leg)
        if self._heights.leave(origin_m[2]):
            self.void("the leg is at another height", frame_stands=True)
        self._set.level_m = self._heights.level_m

    def shift(self, shift_ned_m: Vector) -> None:
        """Move the set into the present local frame, which a declared reset has moved."""
        self.begin_leg(self._flight.leg)
        x_m, y_m, z_m = self._leg.vector_leg(shift_ned_m)
        self._pending.clear()
        self._looks.shift(shift_ned_m[0], shift_ned_m[1])
        self._word.shift(shift_ned_m[0], shift_ned_m[1])
        if self._heights.leave(-z_m):
            self.void("the estimate of the height was reset")
        else:
            self._set.level_m = self._heights.level_m
            self._set.shift(x_m, y_m)
            self.on_void(False)

    def void(self, reason: str, *, frame_stands: bool = False) -> None:
        """Take nothing for free any more.

        Args:
            reason: for the record.
            frame_stands: the local frame and the sensor are not in doubt.
        """
        self._pending.clear()
        self._word.forget(frame_stands=frame_stands)
        self.on_void(frame_stands)
        self._looks.forget()
        self._heights.forget()
        self._set.level_m = self._heights.level_m
        self._set.void()
        self.void_reason = reason

    # ------------------------------------------------------------------ frames

    def take(
        self,
        frame: DetectionFrame,
        stamp_s: float,
        now_s: float,
        shifts_m: Sequence[Sequence[float]],
        filled_m: Callable[[Detection, Corners], DownRange] = lambda *_: ANY_HEIGHT,
    ) -> Sight | None:
        """Take a frame that nothing speaks against, to be counted in one of the next ticks.

        Args:
            frame: what a sensor saw.
            stamp_s: when, on the service's clock.
            now_s: the time.
            shifts_m: what moves boxes from local NED at that time into the present frame;
                several if it is ambiguous.
            filled_m: heights that a box may fill, as for `onboard.perception.placement.place`.

        Returns:
            What counts; None if the frame does not.
        """
        terms = self._flight.assessment.terms
        pose = self._poses.at(stamp_s, _POSE_APART_S)
        turn_radps = self._poses.fastest_turn_radps(stamp_s, _TURN_AROUND_S)
        counts = (
            pose is not None
            and turn_radps <= TURN_MAX_RADPS
            and now_s - stamp_s <= terms.frame_age_max_s
            and stamp_s > self._stamps_s.get(frame.source, -math.inf)
            and len(frame.obstacles) <= BOXES_MAX
            and (frame.frame == "body_frd" or len(shifts_m) == 1)
        )
        if pose is None or not counts or self._is_off_height(pose):
            self.skip(frame)
            return None
        self._stamps_s[frame.source] = stamp_s
        placed_ned_m = placed_corners_ned(frame, pose, shifts_m[0])
        in_way = self._heights.in_way(frame, placed_ned_m, filled_m)
        sight = Sight(frame, pose, turn_radps, placed_ned_m, *in_way, stamp_s)
        self._pending.add(frame.source, sight)
        return sight

    def skip(self, frame: DetectionFrame) -> None:
        """Take note of a frame that does not count: its sensor's row of frames begins again."""
        self._pending.add_break(frame.source)

    def _break_row(self, source: str) -> None:
        self._set.break_row(source)  # of the present leg's set

    def advance(self, pose: Pose | None, *, trusted: bool) -> Violation | None:
        """Count a frame that waits, at most one a tick unless more sensors than ticks see.

        Args:
            pose: the newest.
            trusted: whether nothing speaks against the position.

        Returns:
            The contradiction between a report and what has been seen, which voids the set.
        """
        self.begin_leg(self._flight.leg)
        if not trusted and (self._set.size or self._pending or self._looks):
            # It may drift without a jump: what was seen before is elsewhere once it is good again.
            self.void("the position is not to be believed")
        elif not trusted:
            self.on_void(False)
        seen = self._set.size or self._looks
        if seen and pose is not None and self._is_off_height(pose):
            self.void("the vehicle has left the height of the leg", frame_stands=True)
        for _ in range(1 if len(self._pending) <= 2 else 2):
            sight = self._pending.pop()
            if sight is not None and (violation := self._see(sight)) is not None:
                return violation
        return None

    def _see(self, sight: Sight) -> Violation | None:
        frame, pose, terms = sight.frame, sight.pose, self._flight.assessment.terms
        x_m, y_m, _ = self._leg.position_leg(pose.position_ned_m)
        # What stamp and pose may be apart displaces and turns the frame besides.
        heading_error_rad = terms.heading_error_rad + sight.turn_radps * POSE_TIMING_S
        clock_error_m = math.hypot(*pose.velocity_ned_mps[:2]) * POSE_TIMING_S
        seen_leg_m, e = self._in_leg_m(sight.corners_ned_m), terms.map_error_m
        far_m = np.hypot(seen_leg_m[..., 0] - x_m, seen_leg_m[..., 1] - y_m).max(axis=1)
        margins_m = e + clock_error_m + heading_error_rad * far_m
        still = [
            i
            for i, (seen, at) in enumerate(zip(sight.detections, sight.corners_ned_m, strict=True))
            if not (self._is_mover(frame, seen) or self._is_peer(at))
            and self._heights.surely_in_way(frame, seen, pose)
        ]
        contradicting = self._contradicting(seen_leg_m[still], margins_m[still])
        if contradicting is None and still:
            farthest_m = math.sqrt(2.0) * float(margins_m[still].max())
            placed = [sight.corners_ned_m[i] for i in still]
            contradicting = self._word.contradicted_by(placed, farthest_m)
        if contradicting is not None:
            track_id = frame.track_id(sight.detections[still[contradicting]])
            self.void(f"{track_id} is reported where all was seen free")
            return contradiction(track_id)
        near = self._known_boxes(x_m, y_m, terms.detection_range_m)
        boxes = [*enclosing_boxes(seen_leg_m, e), *near]
        view = view_of(sight, self._leg, terms, boxes, (clock_error_m, heading_error_rad))
        self._set.centre_on(x_m, y_m)
        self._set.see(view, frame.source)
        self._counted[frame.source] = self._counted.get(frame.source, 0) + 1
        start_m = self._start_radius_m + math.sqrt(2.0) * terms.map_error_m
        if view.range_m >= start_m and view.blind_m == 0.0:
            here_ned_m = pose.position_ned_m[:2]
            self._looks.note(view, here_ned_m, pose.yaw_rad, frame.source, self._same_place_m)
        return None

    @property
    def _same_place_m(self) -> float:
        return self._flight.assessment.terms.tracking_error_m + START_MARGIN_M

    @property
    def _start_radius_m(self) -> float:
        body_m = self._flight.assessment.terms.body_m
        return math.sqrt(2.0) * (body_m + CELL_M) + START_MARGIN_M

    def _contradicting(self, seen_leg_m: FloatArray, margins_m: FloatArray) -> int | None:
        """Return the index of a box of which a face lies where all has been seen free.

        A face is within the strip ``face +- margin``, its ends within ``+- margin`` of theirs, and
        touches its obstacle: a strip that is wholly free cannot hold it.
        """
        if not len(seen_leg_m):
            return None
        begins_m, ends_m = seen_leg_m, seen_leg_m[:, _NEXT_CORNER]
        middles_m = (begins_m + ends_m) / 2.0
        suspects = self._set.holds(middles_m[..., 0], middles_m[..., 1])
        if not suspects.any():
            return None
        for box, side in np.argwhere(suspects).tolist():
            pieces = strip_around(begins_m[box, side], ends_m[box, side], float(margins_m[box]))
            if self._set.are_free(*pieces):
                return int(box)
        return None

    def _in_leg_m(self, corners_ned_m: Sequence[Corners]) -> FloatArray:
        """Return boxes, (n, 4, 2) corners, in the frame of the leg."""
        points_m = np.zeros((len(corners_ned_m), 4, 3))
        if corners_ned_m:
            points_m[..., :2] = corners_ned_m
        return self._leg.position_leg_from_ned(points_m)[..., :2]

    def _known_boxes(self, x_m: float, y_m: float, reach_m: float) -> list[Box]:
        """Return what is known within reach, each obstacle as the union of its measurements."""
        return [
            box
            for box in self._flight.obstacles.boxes_between(x_m - reach_m, x_m + reach_m)
            if box.y_min_m <= y_m + reach_m and box.y_max_m >= y_m - reach_m
        ]

    def _is_off_height(self, pose: Pose) -> bool:
        off_m = pose.position_ned_m[2] - self._leg.origin_ned_m[2]
        return abs(off_m) > self._flight.assessment.terms.tracking_error_z_m
