"""Flies one leg at reference level: the planner for dense fields, with an ideal sensor.

The reference itself is flown, without tracking error, latency or wind, and the sensor reports every
face exactly, within its range and view and only with a free line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Final, TypeVar

import numpy as np

from gcs_tools.preflight.rehearsal.narrowest_gap import narrowest_gap_m
from gcs_tools.preflight.rehearsal.prediction import LegRehearsal, Point, Wait
from gcs_tools.preflight.tier import start_clear_radius_m
from onboard.contract.assessment import Assessment
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.guidance.dense.limits import rest_limits_of
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import CELL_M, SeenFree
from onboard.planning.corridor.guide import Guide, along
from onboard.planning.corridor.horizon import PIECE_S, Horizon
from onboard.planning.corridor.receding_horizon import HorizonProblem, RecedingHorizonPlanner

# Frames that show a cell before it counts as free, and their period.
_FRAMES_NEEDED: Final = 3
_FRAME_S: Final = 0.1
# Frames in faster turns do not count: in flight the nose turns no faster, at rest it may.
_TURN_IN_FLIGHT_RADPS: Final = math.radians(20.0)
_TURN_AT_REST_RADPS: Final = math.radians(60.0)
_DWELL_S: Final = 0.6
_VIEW_OVERLAP_RAD: Final = math.radians(20.0)
# At rest for so long, or without progress for so long, the vehicle pauses and looks around.
_IDLE_S: Final = 0.6
_NO_PROGRESS_S: Final = 5.0
_PAUSES_MAX: Final = 25
# A mission that gets on more slowly than this on average counts as not passed.
_SLOWEST_MPS: Final = 0.2
_GUIDE_PERIOD_S: Final = 0.4
_GUIDE_PATH_M: Final = 18.0
_ARRIVED_M: Final = 1.0
_BESIDE_M: Final = 20.0

_Returned = TypeVar("_Returned")


class LegFlight:
    """One leg, flown from rest at its start.

    Args:
        assessment: the contract.
        boxes_m: every obstacle in the leg frame, (N, 4).
        length_m: of the leg.
        half_width_m: of the corridor.
    """

    def __init__(
        self, assessment: Assessment, boxes_m: FloatArray, length_m: float, half_width_m: float
    ) -> None:
        x_m, y_m = boxes_m[:, :2], np.abs(boxes_m[:, 2:]).min(axis=1)
        near = (x_m[:, 1] > -_BESIDE_M) & (x_m[:, 0] < length_m + _BESIDE_M)
        self._boxes_m = boxes_m[near & ((y_m < _BESIDE_M) | (boxes_m[:, 2] * boxes_m[:, 3] < 0.0))]
        self._boxes = [Box(*map(float, row)) for row in self._boxes_m]
        self._assessment, self._length_m = assessment, length_m
        self._known = np.zeros(len(self._boxes), bool)
        self._limits = rest_limits_of(assessment, any_heading=True)
        self._seen = SeenFree(frames_needed=_FRAMES_NEEDED)
        self._seen.limit(half_width_m)
        room_m = start_clear_radius_m(assessment) + math.sqrt(2.0) * CELL_M
        self._seen.confirm(0.0, 0.0, room_m)
        margin_m = assessment.terms.body_m + assessment.face_error_m
        self._guide = Guide(
            (length_m, 0.0),
            margin_m,
            half_width_m,
            face_error_m=assessment.face_error_m,
            wish_m=assessment.contract.vehicle.clearance_wish_m,
        )
        self._planner = RecedingHorizonPlanner(self._limits)
        self._flown = Horizon.at_rest(0.0, 0.0, 0.0)
        self._heading_rad = self._guided_s = self._idle_s = self._dwelt_s = 0.0
        self._guide_stale = True
        aside_rad = assessment.terms.sure_view_rad - _VIEW_OVERLAP_RAD
        self._aside_rad = max(aside_rad, _VIEW_OVERLAP_RAD)
        self._looks_rad = [self._aside_rad, -self._aside_rad, 0.0]
        self._looks_in_a_row = 0
        self._left_m = self._best_left_m = math.inf
        self._progressed_s = 0.0
        self._waits: list[tuple[Point, float]] = []
        self._wait_began_s: float | None = None

    def flown(self, name: str, frame: LegFrame) -> LegRehearsal:
        """Fly until the end of the leg, or until there is no way on."""
        points: list[FloatArray] = []
        speeds: list[float] = []
        now_s, passes = 0.0, False
        while now_s < self._length_m / _SLOWEST_MPS and len(self._waits) <= _PAUSES_MAX:
            place_m, velocity_mps = self._flown.start[:2]
            points.append(place_m)
            speeds.append(float(np.hypot(*velocity_mps)))
            left_m = math.hypot(self._length_m - place_m[0], place_m[1])
            if left_m < _ARRIVED_M and speeds[-1] < _ARRIVED_M / 2.0:
                passes = True
                break
            self._step(now_s)
            now_s += PIECE_S
        path_m = np.array(points)
        ned_m = frame.position_ned_from_leg(np.column_stack((path_m, np.zeros(len(path_m)))))
        waits_m = [
            frame.position_ned_from_leg(np.array([(*place, 0.0)])) for place, _ in self._waits
        ]
        return LegRehearsal(
            name,
            passes,
            now_s,
            float(np.hypot(*np.diff(path_m, axis=0).T).sum()),
            narrowest_gap_m(path_m, self._boxes_m),
            tuple(
                Wait((float(place_m[0, 0]), float(place_m[0, 1])), duration_s)
                for place_m, (_, duration_s) in zip(waits_m, self._waits, strict=True)
            ),
            ned_m[:, :2],
            np.array(speeds),
        )

    def _step(self, now_s: float) -> None:
        turned_radps = self._turn(now_s) / PIECE_S
        if abs(turned_radps) <= _TURN_IN_FLIGHT_RADPS + 1e-9:
            trajectory = self._flown.trajectory(0.0)
            for number in range(round(PIECE_S / _FRAME_S)):
                x_m, y_m, _ = trajectory.sample(now_s + number * _FRAME_S).position_leg_m
                self._see(float(x_m), float(y_m))
        x_m, y_m = self._flown.start[0].tolist()
        stale_s = now_s - self._guided_s
        if (self._guide_stale and (stale_s >= _GUIDE_PERIOD_S or now_s == 0.0)) or stale_s >= 2.0:
            known = [box for box, known in zip(self._boxes, self._known, strict=True) if known]
            self._guide.update((x_m, y_m), known)
            self._guided_s, self._guide_stale = now_s, False
        problem = HorizonProblem(self._flown, self._seen.grid(), self._guide, self._limits, 0.0)
        self._flown = _returned(self._planner.plan(problem)).horizon
        self._judge_progress(now_s)

    def _see(self, x_m: float, y_m: float) -> None:
        """Take one frame: what lies in view becomes known, what is open becomes free."""
        terms = self._assessment.terms
        half_rad, range_m = terms.sure_view_rad / 2.0, terms.detection_range_m
        low_m, high_m = self._boxes_m[:, ::2], self._boxes_m[:, 1::2]
        offset_m = np.clip((x_m, y_m), low_m, high_m) - (x_m, y_m)
        distance_m = np.hypot(*offset_m.T)
        bearing_rad = np.arctan2(offset_m[:, 1], offset_m[:, 0]) - self._heading_rad
        bearing_rad = (bearing_rad + math.pi) % (2.0 * math.pi) - math.pi
        near = distance_m <= range_m
        found = near & (np.abs(bearing_rad) <= half_rad) & ~self._known
        self._known |= found
        self._guide_stale |= bool(found.any())
        boxes = [self._boxes[index] for index in np.flatnonzero(near).tolist()]
        self._seen.centre_on(x_m, y_m)
        self._seen.see(
            View(
                (x_m, y_m), self._heading_rad, half_rad, range_m, boxes,
                self._assessment.face_error_m,
            )
        )  # fmt: skip

    def _turn(self, now_s: float) -> float:
        """Turn the nose for one step, to the next look or along the guide; return the turn."""
        before_rad = self._heading_rad
        if self._looks_rad:
            step_rad = _TURN_AT_REST_RADPS * PIECE_S
            left_rad = self._looks_rad[0] - self._heading_rad
            if abs(left_rad) < 1e-9:
                self._dwelt_s += PIECE_S
                if self._dwelt_s >= _DWELL_S:
                    self._looks_rad.pop(0)
                    self._dwelt_s = 0.0
        else:
            if self._wait_began_s is not None:
                self._waits[-1] = (self._waits[-1][0], now_s - self._wait_began_s)
                self._wait_began_s = None
            step_rad = _TURN_IN_FLIGHT_RADPS * PIECE_S
            left_rad = self._bearing_rad(2.4) - self._heading_rad
            left_rad = (left_rad + math.pi) % (2.0 * math.pi) - math.pi
        self._heading_rad += max(-step_rad, min(step_rad, left_rad))
        return self._heading_rad - before_rad

    def _bearing_rad(self, ahead_m: float) -> float:
        """Return the bearing of a point ahead on the guide; the heading where no way leads on."""
        place = self._flown.start[0]
        path_m = self._guide.path_leg_m((float(place[0]), float(place[1])), _GUIDE_PATH_M)
        if path_m is None:
            return self._heading_rad
        x_m, y_m = (along(path_m, (ahead_m,))[0] - place).tolist()
        return math.atan2(y_m, x_m) if math.hypot(x_m, y_m) > 0.3 else self._heading_rad

    def _judge_progress(self, now_s: float) -> None:
        """Begin a pause where nothing moves, or nothing has come nearer for a while."""
        place = self._flown.start[0]
        self._left_m = float(self._guide.distance_m(place[:1], place[1:])[0])
        if self._left_m < self._best_left_m - 1.0:
            self._looks_in_a_row = 0
        if self._left_m < self._best_left_m - 0.2:
            self._best_left_m, self._progressed_s = self._left_m, now_s
        if self._looks_rad:
            self._progressed_s, self._idle_s = now_s, 0.0
            return
        still = float(np.abs(self._flown.nodes[:, 1]).max()) <= 0.05
        self._idle_s = self._idle_s + PIECE_S if still else 0.0
        if self._idle_s >= _IDLE_S or now_s - self._progressed_s > _NO_PROGRESS_S:
            self._pause(now_s)

    def _pause(self, now_s: float) -> None:
        """Look along the guide, then all round; later make the way that failed dearer."""
        place = (float(self._flown.start[0][0]), float(self._flown.start[0][1]))
        self._waits.append((place, 0.0))
        self._wait_began_s = now_s
        self._looks_in_a_row += 1
        base_rad = self._heading_rad
        looks = [self._bearing_rad(ahead_m) for ahead_m in (2.0, 4.0)]
        looks = [look_rad for look_rad in looks if abs(look_rad - base_rad) > 0.1]
        if self._looks_in_a_row > 1 or not looks:
            looks += [base_rad + k * self._aside_rad for k in (1, 2, -2, -1)]
        self._looks_rad = [*looks, base_rad]
        path_m = self._guide.path_leg_m(place, _GUIDE_PATH_M)
        if self._looks_in_a_row > 1 and path_m is not None:
            x_m, y_m = along(path_m, (0.8,))[0].tolist()
            self._guide.penalized_leg_m.append((x_m, y_m))
            self._guide_stale = True


def _returned(slices: Generator[None, None, _Returned]) -> _Returned:
    """Run every slice of a plan and return it."""
    while True:
        try:
            next(slices)
        except StopIteration as end:
            returned: _Returned = end.value
            return returned
