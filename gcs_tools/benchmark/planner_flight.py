"""Flights of the planner alone, at the level of references, against the true field.

The vehicle is off its reference by the whole tracking error toward the nearest obstacle; the sensor
sees from there what is not hidden, with wrong faces, late; a plan is adopted a period after it was
asked for.  Nothing here knows how the seen-free set or the certifier work.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from gcs_tools.benchmark.obstacles import Floats
from gcs_tools.benchmark.scenes import Scene
from gcs_tools.benchmark.vehicles import Vehicle
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.dense.standstill_clock import StandstillClock
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import CELL_M, SeenFree
from onboard.planning.corridor.guide import Guide, along
from onboard.planning.corridor.horizon import PIECE_S, Horizon
from onboard.planning.corridor.look import (
    TURN_FAST_RADPS,
    TURN_MAX_RADPS,
    Outlook,
    first_looks_rad,
    heading_in_flight_rad,
    looks_at_rest_rad,
)
from onboard.planning.corridor.receding_horizon import (
    HorizonPlan,
    HorizonProblem,
    RecedingHorizonPlanner,
)

_FRAME_S, _LATENCY_S = 0.1, 0.1
_DWELL_S, _AT_REST_S = 0.4, 0.4
# A plan that leads no farther than this waits.
_WAITS_M = 0.1
PAUSES_MAX = 25
_ALL_ROUND_EVERY, _PENALTY_AHEAD_M = 4, 0.8
DURATION_MAX_S = 300.0
_GUIDE_EVERY_S, _GUIDE_AT_LEAST_S = 0.4, 2.0


@dataclass
class Outcome:
    """What one flight was like."""

    end: str = "timeout"
    duration_s: float = 0.0
    first_look_s: float = 0.0
    way_m: float = 0.0
    pauses: int = 0
    clearance_min_m: float = math.inf
    certified_min_m: float = math.inf
    false_cells: int = 0
    losses: int = 0
    losses_unsafe: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    plan_s: list[float] = field(default_factory=list)
    slice_s: list[float] = field(default_factory=list)
    guide_s: list[float] = field(default_factory=list)
    track: list[tuple[float, ...]] = field(default_factory=list)

    def speed_mps(self, length_m: float, *, with_first_look: bool = True) -> float:
        """Return the length of the leg over the time that it took."""
        return length_m / (self.duration_s - (0.0 if with_first_look else self.first_look_s))


class Flight:
    """One flight along one leg.

    Args:
        scene: the true field.
        vehicle: that flies through it.
        seed: of the faces' errors.
        unseen_is_free: the ablation: all but the reported boxes counts as seen free.
        first_look: turn on the spot first, although the start is confirmed to be free.
        wish_m: distance to obstacles that is preferred.
    """

    def __init__(
        self,
        scene: Scene,
        vehicle: Vehicle,
        seed: int,
        *,
        unseen_is_free: bool = False,
        first_look: bool = False,
        wish_m: float = 0.0,
    ) -> None:
        self._scene, self._vehicle, self._unseen_is_free = scene, vehicle, unseen_is_free
        self._reports = scene.obstacles.reports(np.random.default_rng(seed), vehicle.face_error_m)
        self._known: set[int] = set()
        self._seen = SeenFree(frames_needed=vehicle.frames_needed)
        self._seen.limit(scene.half_width_m)
        self._seen.confirm(0.0, 0.0, vehicle.body_radius_m * math.sqrt(2.0) + 0.35)
        margin_m = vehicle.body_radius_m + vehicle.face_error_m
        self.guide = Guide(
            (scene.length_m, 0.0),
            margin_m,
            scene.half_width_m,
            face_error_m=vehicle.face_error_m,
            wish_m=wish_m,
        )
        self._planner = RecedingHorizonPlanner(vehicle.limits)
        self._horizon = Horizon.at_rest(0.0, 0.0, 0.0)
        self._surface_m = scene.obstacles.surface_points_m()
        self._frames: list[tuple[float, tuple[float, float], float, bool]] = []
        self._guide_of, self._guide_s = -1, -math.inf
        self.heading_rad, self._rate_radps = 0.0, 0.0
        looks = first_looks_rad(0.0, vehicle.half_view_rad) if first_look else (0.0,)
        self._looks = list(looks)
        self._dwell_s = self._idle_s = 0.0
        self._clock = StandstillClock()
        self._clock.begin_leg(0.0, scene.length_m)
        self._tries, self._best_m = 0, math.inf
        self._first_look = True
        self.outcome = Outcome()

    def fly(self, duration_max_s: float = DURATION_MAX_S) -> Outcome:
        """Fly until the goal, a collision, the last pause, or the end of the time."""
        self._count_false_cells()
        now_s = 0.0
        while now_s < duration_max_s - 1e-9:
            end = self._period(now_s)
            now_s = round(now_s + PIECE_S, 6)
            if end:
                self.outcome.end = end
                break
        self.outcome.duration_s = now_s
        self._count_false_cells()
        return self.outcome

    def _period(self, now_s: float) -> str:
        """Fly one piece of the plan; return the end of the flight, if it is one."""
        self._take_frames(now_s)
        self._receive_frames(now_s)
        x_m, y_m = self._horizon.nodes[0, 0].tolist()
        self._update_guide(now_s, (x_m, y_m))
        grid = self._grid((x_m, y_m))
        plan = self._plan(grid)
        self._measure(now_s, plan)
        flown = self._horizon
        self._horizon = plan.horizon
        if self.outcome.clearance_min_m < 0.0:
            return "collision"
        (px, py), velocity = self._horizon.nodes[0, :2].tolist()
        self.outcome.way_m += math.dist((px, py), flown.nodes[0, 0].tolist())
        speed_mps = math.hypot(*velocity)
        self.outcome.track.append((now_s, px, py, *velocity, self.heading_rad))
        if math.dist((px, py), (self._scene.length_m, 0.0)) < 1.0 and speed_mps < 0.5:
            return "arrived"
        path = self.guide.path_leg_m((px, py), 18.0)
        vehicle = self._vehicle
        outlook = Outlook(
            (px, py), self.heading_rad, vehicle.half_view_rad, path, grid, vehicle.body_radius_m
        )
        self._turn(outlook, now_s + PIECE_S, speed_mps)
        return "stuck" if self.outcome.pauses > PAUSES_MAX else ""

    def _take_frames(self, now_s: float) -> None:
        """Stamp the frames of this period, from where the vehicle truly is."""
        counts = abs(self._rate_radps) <= TURN_MAX_RADPS + 1e-6
        trajectory = self._horizon.trajectory(0.0)
        for k in range(round(PIECE_S / _FRAME_S)):
            stamp_s = now_s + k * _FRAME_S
            place = trajectory.sample(stamp_s).position_leg_m[:2]
            true = self._true_m(np.array([place]))[0].tolist()
            turned_rad = self._rate_radps * (k * _FRAME_S - PIECE_S)
            heading_rad = self.heading_rad + turned_rad
            frame = (stamp_s + _LATENCY_S, (true[0], true[1]), heading_rad, counts)
            self._frames.append(frame)

    def _receive_frames(self, now_s: float) -> None:
        vehicle, obstacles = self._vehicle, self._scene.obstacles
        due = [frame for frame in self._frames if frame[0] <= now_s + 1e-9]
        self._frames = [frame for frame in self._frames if frame[0] > now_s + 1e-9]
        for _, place, heading_rad, counts in due:
            half_rad, range_m = vehicle.half_view_rad, vehicle.range_m
            seen = obstacles.visible(place, heading_rad, half_rad, range_m)
            self._known.update(seen.tolist())
            if not counts:
                continue
            boxes = [self._reports[k] for k in sorted(self._known)]
            self._seen.centre_on(*place)
            self._seen.see(View(place, heading_rad, half_rad, range_m, boxes, vehicle.face_error_m))

    def _update_guide(self, now_s: float, place: tuple[float, float]) -> None:
        waited_s, changed = now_s - self._guide_s, self._guide_of != len(self._known)
        if waited_s > _GUIDE_AT_LEAST_S or (changed and waited_s >= _GUIDE_EVERY_S - 1e-9):
            began_s = time.thread_time()
            boxes = [self._reports[k] for k in sorted(self._known)]
            for _ in self.guide.updating(place, boxes):
                self.outcome.guide_s.append(time.thread_time() - began_s)
                began_s = time.thread_time()
            self.outcome.guide_s.append(time.thread_time() - began_s)
            self._guide_of, self._guide_s = len(self._known), now_s

    def _grid(self, place: tuple[float, float]) -> FreeGrid:
        if not self._unseen_is_free:
            return self._seen.grid()
        size, error_m = 400, self._vehicle.face_error_m
        corner = [math.floor(value / CELL_M) * CELL_M - size / 2 * CELL_M for value in place]
        unknown = np.zeros((size, size), bool)
        for k in self._known:
            box = self._reports[k].inflated(error_m)
            i0, i1 = (round((x - corner[0]) / CELL_M) for x in (box.x_min_m, box.x_max_m))
            j0, j1 = (round((y - corner[1]) / CELL_M) for y in (box.y_min_m, box.y_max_m))
            unknown[max(i0, 0) : max(i1, 0), max(j0, 0) : max(j1, 0)] = True
        table = np.zeros((size + 1, size + 1), np.int32)
        table[1:, 1:] = unknown.cumsum(axis=0).cumsum(axis=1)
        return FreeGrid((corner[0], corner[1]), CELL_M, table)

    def _plan(self, grid: FreeGrid) -> HorizonPlan:
        problem = HorizonProblem(self._horizon, grid, self.guide, self._vehicle.limits, 0.0)
        search, used_s = self._planner.plan(problem), 0.0
        while True:
            began_s = time.thread_time()
            try:
                next(search)
            except StopIteration as stop:
                used_s += time.thread_time() - began_s
                self.outcome.plan_s.append(used_s)
                plan: HorizonPlan = stop.value
                return plan
            slice_s = time.thread_time() - began_s
            used_s += slice_s
            self.outcome.slice_s.append(slice_s)

    def _measure(self, now_s: float, plan: HorizonPlan) -> None:
        """Compare the piece that is flown, the plan's way to rest and a loss with the field."""
        outcome, obstacles, vehicle = self.outcome, self._scene.obstacles, self._vehicle
        outcome.kinds[plan.kind] += 1
        flown = _sampled(self._horizon, 1)
        clearance = obstacles.distance_m(self._true_m(flown)).min() - vehicle.radius_m
        outcome.clearance_min_m = min(outcome.clearance_min_m, float(clearance))
        least = obstacles.distance_m(_sampled(plan.horizon, len(plan.horizon.jerk_mps3))).min()
        margin_m = float(least) - vehicle.body_radius_m
        outcome.certified_min_m = min(outcome.certified_min_m, margin_m)
        if vehicle.after_loss is not None:
            run = vehicle.after_loss(plan.horizon.start)
            outcome.losses += 1
            least = obstacles.distance_m(run).min()
            outcome.losses_unsafe += int(least < vehicle.body_radius_m)
        if round(now_s / PIECE_S) % 10 == 0:
            self._count_false_cells()

    def _true_m(self, places: Floats) -> Floats:
        return self._scene.obstacles.toward_nearest(places, self._vehicle.tracking_error_m)

    def _count_false_cells(self) -> None:
        """Count points of obstacles in cells that are called free."""
        grid, (x, y) = self._seen.grid(), self._surface_m.T
        d = 1e-7  # a point on the line between two cells is in none of them
        self.outcome.false_cells += int(grid.are_free(x - d, x + d, y - d, y + d).sum())

    def _turn(self, outlook: Outlook, now_s: float, speed_mps: float) -> None:
        """Turn the nose: to the looks at rest, along the guide in flight; pause where it waits."""
        before_rad = self.heading_rad
        places = self._horizon.nodes[:, 0]
        moves = float(np.hypot(*(places - places[0]).T).max()) > _WAITS_M
        self._idle_s = 0.0 if moves or speed_mps >= 0.1 else self._idle_s + PIECE_S
        here = np.array([outlook.position_leg_m])
        left_m = float(self.guide.distance_m(here[:, 0], here[:, 1])[0])
        stopped = self._clock.has_stopped(left_m, now_s, still=False)
        if self._looks:
            self._look()
            if not self._looks:
                self._idle_s = 0.0
                self._clock.restart(now_s)
                if self._first_look:
                    self._first_look, self.outcome.first_look_s = False, now_s
        elif self._idle_s >= _AT_REST_S or stopped:
            self._pause(outlook, now_s)
        else:
            self.heading_rad = heading_in_flight_rad(outlook, PIECE_S)
        self._rate_radps = (self.heading_rad - before_rad) / PIECE_S
        if left_m < self._best_m - 1.0:
            self._best_m, self._tries = left_m, 0

    def _look(self) -> None:
        step_rad = TURN_FAST_RADPS * PIECE_S
        turn_rad = self._looks[0] - self.heading_rad
        if abs(turn_rad) > 1e-9:
            self.heading_rad += max(-step_rad, min(step_rad, turn_rad))
            return
        self._dwell_s += PIECE_S
        if self._dwell_s >= _DWELL_S - 1e-9:
            self._dwell_s = 0.0
            self._looks.pop(0)

    def _pause(self, outlook: Outlook, now_s: float) -> None:
        self._clock.restart(now_s)
        self._tries += 1
        self.outcome.pauses += 1
        looks = looks_at_rest_rad(outlook, all_round=self._tries % _ALL_ROUND_EVERY == 0)
        if (self._tries >= 2 or len(looks) == 1) and outlook.path_leg_m is not None:
            x_m, y_m = along(outlook.path_leg_m, (_PENALTY_AHEAD_M,))[0].tolist()
            self.guide.penalized_leg_m.append((x_m, y_m))
            self._guide_of = -1
        self._looks = list(looks) if len(looks) > 1 else []
        self._idle_s = 0.0


def _sampled(horizon: Horizon, pieces: int) -> Floats:
    """Return ten points of each of the first pieces."""
    count = 10 if pieces == 1 else 3
    t = (PIECE_S * (np.arange(count) + 1.0) / count)[None, :, None]
    p, v, a = (horizon.nodes[:pieces, k, None, :] for k in range(3))
    j = horizon.jerk_mps3[:pieces, None, :]
    points: Floats = (p + v * t + a * t**2 / 2.0 + j * t**3 / 6.0).reshape(-1, 2)
    return points
