"""What each tick leaves behind: records for the flight log and for Zenoh, as JSON.

Topics of our own: ``state`` every tick, ``monitors`` at a rate for people, ``obstacles``,
``margins`` and ``plan`` when they change, ``events`` as they come.  For viewers, the same in
Foxglove's schemas: see `onboard.recording.foxglove_scene`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from onboard.autonomy import Autonomy
from onboard.contract.assessment import Assessment
from onboard.contract.region import RegionOfInfluence, boundary_depth_at
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.guidance.authority import AUTOPILOT_SILENCE_S
from onboard.guidance.avoidance_step import PlannedStep
from onboard.motion.trajectory import Trajectory
from onboard.perception.obstacle_map import Obstacle
from onboard.recording.foxglove_scene import Scene
from onboard.recording.record import Record

PATH_STEP_S: Final = 0.1
# However long a plan is, its record is not.
PATH_POINTS_MAX: Final = 400
# Often enough for people and viewers; a changing map is not worth more than this either.
SLOW_PERIOD_S: Final = 0.2
# Obstacles farther along the leg than this do not count for the clearance that is shown.
CLEARANCE_HORIZON_M: Final = 30.0
_BOUNDARY_POINTS: Final = 17


class Journal:
    """Collects the records of a service.

    Args:
        autonomy: the service; its events are taken from it here and nowhere else.
        timed: record how long plans took; a simulation does not, to be the same every time.
        shown: record what is for people and viewers, too; nobody looks at a campaign.
    """

    def __init__(self, autonomy: Autonomy, *, timed: bool, shown: bool = True) -> None:
        self.autonomy = autonomy
        self._timed, self._shown = timed, shown
        self._scene = Scene()
        self._slow_due_s = -math.inf if shown else math.inf
        self._obstacles_revision = 0
        self._assessment: Assessment | None = None
        # Obstacles are replaced, never changed: what was said of one stays true.
        self._described: dict[str, tuple[Obstacle, LegFrame, dict[str, Any]]] = {}

    def collect(self, now_s: float) -> list[Record]:
        """Return what the tick at ``now_s`` left behind."""
        state = self._record("state", now_s, self.autonomy.snapshot(now_s))
        records = [state]
        if self.autonomy.assessment is not self._assessment:
            self._assessment = self.autonomy.assessment
            records.append(self._record("margins", now_s, margins(self._assessment)))
        if now_s >= self._slow_due_s:
            self._slow_due_s = now_s + SLOW_PERIOD_S
            records += self._slow(now_s, state.payload)
            records += self._scene.vehicle(state.time_unix_s, state.payload)
        for step in self.autonomy.navigator.take_planned():
            plan = self._record("plan", now_s, self._plan(step))
            records.append(plan)
            if self._shown:
                records += self._scene.plan(plan.time_unix_s, plan.payload)
        records += [self._record("events", e.time_s, e.as_json()) for e in self.autonomy.events()]
        return records

    def _slow(self, now_s: float, state: dict[str, Any]) -> Iterator[Record]:
        yield self._record("monitors", now_s, monitors(self.autonomy, state, now_s))
        navigator = self.autonomy.navigator
        if navigator.obstacles.revision == self._obstacles_revision:
            return
        self._obstacles_revision = navigator.obstacles.revision
        known = self._record("obstacles", now_s, {"obstacles": self._obstacles(navigator.leg)})
        yield known
        height_m = -navigator.leg.origin_ned_m[2]
        yield from self._scene.obstacles(known.time_unix_s, known.payload, height_m)

    def _record(self, topic: str, time_s: float, payload: dict[str, Any]) -> Record:
        time_unix_s = round(self.autonomy.epoch_unix_s + time_s, 6)
        return Record(topic, time_unix_s, {"time_s": time_unix_s, **payload})

    def _obstacles(self, leg: LegFrame) -> list[dict[str, Any]]:
        before, self._described = self._described, {}
        for obstacle in self.autonomy.navigator.obstacles:
            said = before.get(obstacle.id)
            if said is None or said[0] is not obstacle or said[1] is not leg:
                said = obstacle, leg, _obstacle(obstacle, leg, self.autonomy.assessment)
            self._described[obstacle.id] = said
        return [described for _, _, described in self._described.values()]

    def _plan(self, step: PlannedStep) -> dict[str, Any]:
        trajectory, epoch_s = step.plan.trajectory, self.autonomy.epoch_unix_s
        certificate = step.plan.certificate
        return {
            "obstacle": step.obstacle.id,
            "kind": step.plan.kind,
            "side": step.plan.side,
            "cost": step.plan.cost,
            "certificate": {"valid": certificate.valid, "failures": list(certificate.failures)},
            "plan_time_ms": step.plan_time_s * 1e3 if self._timed else None,
            "start_s": epoch_s + trajectory.start_s,
            "end_s": epoch_s + trajectory.end_s,
            "keep_out_ned_m": box_ned_m(step.obstacle.region.keep_out, step.leg),
            "region_ned_m": box_ned_m(step.obstacle.region.extent, step.leg),
            "path_ned_m": path_of(trajectory, step.leg),
        }


def margins(assessment: Assessment) -> dict[str, Any]:
    """Return every clause of the contract as it is flown now."""
    return {
        "compliant": assessment.compliant,
        "binding": assessment.binding.name,
        "clauses": [
            {
                "name": clause.name,
                "required": clause.required,
                "declared": clause.declared,
                "margin": clause.margin,
                "unit": clause.unit,
                "holds": clause.holds,
            }
            for clause in assessment.clauses
        ],
    }


def monitors(autonomy: Autonomy, state: dict[str, Any], now_s: float) -> dict[str, Any]:
    """Return what is watched in flight: measured, limit (null: none stated), unit.

    Args:
        autonomy: the service.
        state: its snapshot of this tick.
        now_s: the time.
    """
    terms = autonomy.assessment.terms
    along_mps, across_mps = state["velocity_error_mps"]
    pose, heard_s = autonomy.link.pose, autonomy.link.status.heard_s
    watched = {
        "tracking_error": (state["tracking_error_m"], terms.tracking_error_m, "m"),
        "velocity_error_along": (along_mps, terms.velocity_error_x_mps, "m/s"),
        "velocity_error_across": (across_mps, terms.velocity_error_y_mps, "m/s"),
        "detection_age": (state["detection_age_s"], terms.frame_age_max_s, "s"),
        "telemetry_age": (None if pose is None else now_s - pose.time_s, None, "s"),
        "heartbeat_age": (
            now_s - heard_s if math.isfinite(heard_s) else None,
            AUTOPILOT_SILENCE_S,
            "s",
        ),
        "clearance": (_clearance_m(autonomy), 0.0, "m"),
    }
    return {
        name: {"measured": measured, "limit": limit, "unit": unit}
        for name, (measured, limit, unit) in watched.items()
    }


def _clearance_m(autonomy: Autonomy) -> float | None:
    """Vehicle centre to the nearest known face, less the radius; None where nothing is near."""
    pose, leg = autonomy.link.pose, autonomy.navigator.leg
    if pose is None:
        return None
    x_m, y_m, _ = leg.position_leg_from_ned(np.array(pose.position_ned_m)).tolist()
    near = autonomy.navigator.obstacles.between(
        x_m - CLEARANCE_HORIZON_M, x_m + CLEARANCE_HORIZON_M
    )
    distance_m = min((_distance_m(o.measured, x_m, y_m) for o in near), default=None)
    return None if distance_m is None else distance_m - autonomy.assessment.terms.radius_m


def _distance_m(box: Box, x_m: float, y_m: float) -> float:
    return math.hypot(
        max(box.x_min_m - x_m, 0.0, x_m - box.x_max_m),
        max(box.y_min_m - y_m, 0.0, y_m - box.y_max_m),
    )


def _obstacle(obstacle: Obstacle, leg: LegFrame, assessment: Assessment) -> dict[str, Any]:
    region = obstacle.region
    lane = Box(
        region.extent.x_min_m, region.extent.x_max_m, region.lane_left_m, region.lane_right_m
    )
    return {
        "id": obstacle.id,
        "measured_ned_m": box_ned_m(obstacle.measured, leg),
        "keep_out_ned_m": box_ned_m(region.keep_out, leg),
        "region_ned_m": box_ned_m(region.extent, leg),
        "lane_ned_m": box_ned_m(lane, leg),
        "boundary_ned_m": _ned_m(_collision_set_boundary(region, assessment), leg)[:, :2].tolist(),
    }


def _collision_set_boundary(region: RegionOfInfluence, assessment: Assessment) -> FloatArray:
    """Points (N, 3) of the collision set boundary, leg frame, from the left to the right."""
    box, speed_mps = region.obstacle, assessment.inflated.encounter.speed_mps
    y_m = np.linspace(box.y_min_m, box.y_max_m, _BOUNDARY_POINTS)
    depths_m = [boundary_depth_at(y, box, assessment.limits, speed_mps) for y in y_m.tolist()]
    return np.column_stack((box.x_min_m - np.array(depths_m), y_m, np.zeros_like(y_m)))


def box_ned_m(box: Box, leg: LegFrame) -> list[list[float]]:
    """Corners of a leg-frame box, [north, east] each, in metres."""
    corners = [
        (box.x_min_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_max_m, 0.0),
        (box.x_min_m, box.y_max_m, 0.0),
    ]
    ned_m: list[list[float]] = _ned_m(np.array(corners), leg)[:, :2].tolist()
    return ned_m


def path_of(trajectory: Trajectory, leg: LegFrame) -> list[list[float]]:
    """Points of a trajectory, NED, in metres: every `PATH_STEP_S`, or `PATH_POINTS_MAX` of them."""
    duration_s = trajectory.end_s - trajectory.start_s
    count = min(math.ceil(duration_s / PATH_STEP_S) + 1, PATH_POINTS_MAX)
    times_s = trajectory.start_s + np.minimum(
        np.arange(count) * max(PATH_STEP_S, duration_s / (count - 1)), duration_s
    )
    points = [trajectory.sample(time_s).position_leg_m for time_s in times_s.tolist()]
    ned_m: list[list[float]] = _ned_m(np.array(points), leg).tolist()
    return ned_m


def _ned_m(points_leg_m: FloatArray, leg: LegFrame) -> FloatArray:
    return leg.position_ned_from_leg(points_leg_m)
