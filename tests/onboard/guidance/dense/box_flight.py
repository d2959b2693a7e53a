"""A slow simulator of a vehicle among boxes, with every error that the contract allows.

It knows none of the formulas of guidance: rays are cast, the vehicle is as far from its reference
as it may be towards the nearest box, each face is reported wrong by the whole error, and a loss of
the stream is integrated in small steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.geometry.box import Box
from onboard.guidance.dense.thread import Thread
from onboard.motion.trajectory import State
from onboard.perception.line_of_sight import View
from tests.onboard.guidance.dense.field_flight import IdealSeenSpace
from tests.onboard.guidance.perfect_flight import PerfectFlight

FRAME_TICKS: Final = 5
_SLOW_RADPS: Final = math.radians(20.0)
_RAYS_PER_RAD: Final = 120.0


class BoxFlight(PerfectFlight):
    """Flies north among boxes, with best effort.

    Attributes:
        clearance_m: least distance of the vehicle's body from any box.
        run_on_clearance_m: the same if the stream had been lost, at every frame.
        uncertified: ticks in which the way to rest held did not certify.
        misled: ticks in which the nose turned although its heading was said to be steady.
    """

    def __init__(
        self, contract: Contract, mission: Mission, boxes: Sequence[Box], seed: int = 0
    ) -> None:
        super().__init__(contract, mission)
        self.seen = IdealSeenSpace(start_known=True)
        self.navigator.see_by(self.seen)
        self.boxes, self._random = boxes, np.random.default_rng(seed)
        self._low = np.array([(box.x_min_m, box.y_min_m) for box in boxes])
        self._high = np.array([(box.x_max_m, box.y_max_m) for box in boxes])
        self.clearance_m = self.run_on_clearance_m = math.inf
        self.uncertified = self.misled = self._ticks = 0
        self._yaw_rad = self.pose.yaw_rad

    @property
    def thread(self) -> Thread:
        thread = self.navigator.thread
        assert thread is not None
        return thread

    def tick(self) -> None:
        self._ticks += 1
        if self._ticks % FRAME_TICKS == 0:
            self._look()
        heading_rad = self.situation.reference.heading_rad
        super().tick()
        turned_rad = abs(self.situation.reference.heading_rad - heading_rad)
        self.misled += self.navigator.pointing_rad is not None and turned_rad > math.radians(0.5)
        terms = self.navigator.assessment.terms
        north_m, east_m, down_m = self.pose.position_ned_m
        to_box_m = self._to_nearest_m((north_m, east_m))
        apart_m = float(np.hypot(*to_box_m))
        astray_m = terms.tracking_error_m * to_box_m / max(apart_m, 1e-9)
        north_m, east_m = north_m + float(astray_m[0]), east_m + float(astray_m[1])
        self.pose = self.pose._replace(position_ned_m=(north_m, east_m, down_m))
        self.clearance_m = min(self.clearance_m, self._room_m((north_m, east_m)) - terms.radius_m)
        if self.state.in_seen_space and self.thread.way.certified is not None:
            self.uncertified += not self.thread.way.certified
        if terms.passive_safety and self._ticks % FRAME_TICKS == 0:
            self._lose_stream(self.reference)

    def _look(self) -> None:
        """Report what the rays of one frame hit, each face wrong by e, and see what is free."""
        rate_radps = abs(self.pose.yaw_rad - self._yaw_rad) / 0.1
        self._yaw_rad = self.pose.yaw_rad
        terms, e = self.navigator.assessment.terms, self.navigator.assessment.terms.position_error_m
        north_m, east_m, _ = self.pose.position_ned_m
        half_rad = terms.field_of_view_rad / 2.0
        for index in self._hit((north_m, east_m), half_rad, terms.detection_range_m):
            x0_m, y0_m = self._low[index] + self._random.choice((-e, e), 2)
            x1_m, y1_m = self._high[index] + self._random.choice((-e, e), 2)
            middle_m, size_m = (
                ((x0_m + x1_m) / 2.0, (y0_m + y1_m) / 2.0),
                (x1_m - x0_m, y1_m - y0_m),
            )
            self.see(*middle_m, size_m=size_m, name=str(index), error_m=e)
        if rate_radps < _SLOW_RADPS:
            known = [obstacle.measured for obstacle in self.navigator.obstacles]
            place_m = (north_m, east_m)
            yaw_rad, range_m = self.pose.yaw_rad, terms.detection_range_m
            self.seen.see(View(place_m, yaw_rad, half_rad, range_m, known, e))

    def _hit(self, place_m: tuple[float, float], half_rad: float, range_m: float) -> list[int]:
        """Return the boxes that a ray of the frame meets first."""
        count = math.ceil(2.0 * half_rad * _RAYS_PER_RAD)
        rays_rad = self.pose.yaw_rad + np.linspace(-half_rad, half_rad, count)
        along = np.stack((np.cos(rays_rad), np.sin(rays_rad)), axis=1)
        along = np.where(np.abs(along) < 1e-9, 1e-9, along)[:, None, :]
        one, other = (self._low - place_m) / along, (self._high - place_m) / along
        enter = np.minimum(one, other).max(axis=2)
        leave = np.maximum(one, other).min(axis=2)
        distance_m = np.where((enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), math.inf)
        first = distance_m.argmin(axis=1)
        near = distance_m[np.arange(count), first] <= range_m
        return sorted(set(first[near].tolist()))

    def _lose_stream(self, state: State) -> None:
        """Coast on as the autopilot does without setpoints, then brake; E counts on top."""
        terms, limits = self.navigator.assessment.terms, self.navigator.assessment.limits
        p, v, a = (np.array(vector[:2]) for vector in state)
        brake_mps2 = min(
            limits.brake_mps2, limits.forward_mps2, limits.left_mps2, limits.right_mps2
        )
        step_s, elapsed_s = 0.02, 0.0
        while (
            elapsed_s < terms.setpoint_loss_timeout_s + terms.attitude_lag_s or np.hypot(*v) > 0.0
        ):
            if elapsed_s < terms.setpoint_loss_timeout_s:
                pull = a
            elif elapsed_s < terms.setpoint_loss_timeout_s + terms.attitude_lag_s:
                pull = np.zeros(2)
            else:
                speed_mps = float(np.hypot(*v))
                pull = -v / max(speed_mps, 1e-9) * min(brake_mps2, speed_mps / step_s)
            p = p + v * step_s + pull * step_s**2 / 2.0
            v = v + pull * step_s
            v = np.zeros(2) if np.hypot(*v) < 1e-6 else v
            elapsed_s += step_s
            room_m = self._room_m((float(p[0]), float(p[1]))) - terms.body_m
            self.run_on_clearance_m = min(self.run_on_clearance_m, room_m)

    def _to_nearest_m(self, place_m: tuple[float, float]) -> np.ndarray:
        offsets_m = np.clip(place_m, self._low, self._high) - np.array(place_m)
        nearest: np.ndarray = offsets_m[np.hypot(*offsets_m.T).argmin()]
        return nearest

    def _room_m(self, place_m: tuple[float, float]) -> float:
        return float(np.hypot(*self._to_nearest_m(place_m)))
