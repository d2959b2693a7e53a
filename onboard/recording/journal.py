"""Collects the records that each tick leaves behind, for the flight log and for Zenoh.

``state`` comes every tick, ``monitors`` at a rate for people, ``obstacles``, ``movers``,
``margins`` and ``plan`` when they change, ``events`` as they come.  Viewers' scenes are built on
the ground.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from onboard.autonomy import Autonomy
from onboard.contract.assessment import Assessment
from onboard.contract.region import RegionOfInfluence, boundary_depth_at
from onboard.events import Event
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.guidance.avoidance_step import PlannedStep
from onboard.motion.trajectory import Trajectory
from onboard.perception.detection import DownRange
from onboard.perception.obstacle_map import Obstacle
from onboard.recording.messages import (
    CertificateRecord,
    ClauseMargin,
    EventRecord,
    KnownObstacle,
    Margins,
    Monitors,
    Obstacles,
    Outline,
    PlanRecord,
    Reading,
    Record,
    StateRecord,
)
from onboard.recording.movers import MoverJournal
from onboard.recording.seen_space import SeenSpaceJournal
from onboard.recording.state import finite, state_of, unix_time_s
from onboard.vehicle_state import AUTOPILOT_SILENCE_S

PATH_STEP_S: Final = 0.1
# A plan's record is bounded, however long the plan is.
PATH_POINTS_MAX: Final = 400
# Often enough for people and viewers; a map that keeps changing is not recorded more often either.
SLOW_PERIOD_S: Final = 0.2
# Obstacles farther along the leg than this do not count for the clearance that is shown.
CLEARANCE_HORIZON_M: Final = 30.0
_BOUNDARY_POINTS: Final = 17


class Journal:
    """Collects the records of a service.

    Args:
        autonomy: the service; its events are taken from it here and nowhere else.
        timed: record how long plans took; a simulation does not, to be the same every time.
        shown: record monitors and obstacles, too, which only people and viewers need.
    """

    def __init__(self, autonomy: Autonomy, *, timed: bool, shown: bool = True) -> None:
        self.autonomy = autonomy
        self._timed = timed
        self._slow_due_s = -math.inf if shown else math.inf
        self._seen_space = SeenSpaceJournal(shown=shown)
        self._movers = MoverJournal(shown=shown)
        self._obstacles_revision = 0
        self._assessment: Assessment | None = None
        # Obstacles are replaced, never changed: what was derived from one stays valid.
        self._described: dict[str, tuple[Obstacle, LegFrame, KnownObstacle]] = {}

    def collect(self, now_s: float) -> list[Record]:
        """Return the records of the tick at ``now_s``."""
        state = state_of(self.autonomy, now_s)
        records: list[Record] = [state]
        if self.autonomy.assessment is not self._assessment:
            self._assessment = self.autonomy.assessment
            records.append(margins(self._assessment, state.time_s))
        if now_s >= self._slow_due_s:
            self._slow_due_s = now_s + SLOW_PERIOD_S
            records += self._slow(now_s, state)
        navigator = self.autonomy.navigator
        seen = self._seen_space.collect(navigator.shield, navigator.leg, state.time_s, now_s)
        if seen is not None:
            records.append(seen)
        movers = self._movers.collect(self.autonomy, state.time_s, now_s)
        if movers is not None:
            records.append(movers)
        for step in navigator.take_planned():
            records.append(self._plan(step, state.time_s))
        for event in self.autonomy.events():
            records.append(event_record(event, unix_time_s(self.autonomy, event.time_s)))
        return records

    def _slow(self, now_s: float, state: StateRecord) -> Iterator[Record]:
        yield monitors(self.autonomy, state, now_s)
        navigator = self.autonomy.navigator
        if navigator.obstacles.revision != self._obstacles_revision:
            self._obstacles_revision = navigator.obstacles.revision
            yield Obstacles(
                time_s=state.time_s,
                height_m=-navigator.leg.origin_ned_m[2],
                obstacles=self._obstacles(navigator.leg),
                passed_over=[
                    KnownObstacle(
                        id=track_id,
                        measured_ned_m=list(track.corners_ned_m),
                        down_m=_heights(track.filled_m),
                    )
                    for track_id, track in navigator.obstacles.passed_over()
                ],
            )

    def _obstacles(self, leg: LegFrame) -> list[KnownObstacle]:
        before, self._described = self._described, {}
        for obstacle in self.autonomy.navigator.obstacles:
            known = before.get(obstacle.id)
            if known is None or known[0] is not obstacle or known[1] is not leg:
                known = obstacle, leg, _obstacle(obstacle, leg, self.autonomy.assessment)
            self._described[obstacle.id] = known
        return [described for _, _, described in self._described.values()]

    def _plan(self, step: PlannedStep, time_s: float) -> PlanRecord:
        trajectory, epoch_s = step.plan.trajectory, self.autonomy.epoch_unix_s
        certificate = step.plan.certificate
        return PlanRecord(
            time_s=time_s,
            obstacle=step.obstacle.id,
            kind=step.plan.kind,
            side=step.plan.side,
            cost=step.plan.cost,
            certificate=CertificateRecord(
                valid=certificate.valid, failures=list(certificate.failures)
            ),
            plan_time_ms=step.plan_time_s * 1e3 if self._timed else None,
            start_s=epoch_s + trajectory.start_s,
            end_s=epoch_s + trajectory.end_s,
            keep_out_ned_m=outline_of(step.obstacle.region.keep_out, step.leg),
            region_ned_m=outline_of(step.obstacle.region.manoeuvre, step.leg),
            path_ned_m=path_of(trajectory, step.leg),
        )


def event_record(event: Event, time_s: float) -> EventRecord:
    """Return an event as it is logged and published; ``time_s`` is its Unix time."""
    return EventRecord(
        time_s=time_s,
        name=event.name,
        severity=event.severity.name.lower(),
        text=event.text,
        data=event.data,
    )


def margins(assessment: Assessment, time_s: float) -> Margins:
    """Return every clause of the contract as it is flown now."""
    return Margins(
        time_s=time_s,
        compliant=assessment.compliant,
        binding=assessment.binding.name,
        clauses=[
            ClauseMargin(
                name=clause.name,
                required=clause.required,
                declared=clause.declared,
                margin=clause.margin,
                unit=clause.unit,
                holds=clause.holds,
            )
            for clause in assessment.clauses
        ],
    )


def monitors(autonomy: Autonomy, state: StateRecord, now_s: float) -> Monitors:
    """Return what is monitored in flight.

    Args:
        autonomy: the service.
        state: its record of this tick.
        now_s: the time.
    """
    terms = autonomy.assessment.terms
    along_mps, across_mps = state.velocity_error_mps or (None, None)
    heartbeat_age_s = finite(now_s - autonomy.link.status.heard_s)
    return Monitors(
        time_s=state.time_s,
        tracking_error=Reading(
            measured=state.tracking_error_m, limit=terms.tracking_error_m, unit="m"
        ),
        velocity_error_along=Reading(
            measured=along_mps, limit=terms.velocity_error_x_mps, unit="m/s"
        ),
        velocity_error_across=Reading(
            measured=across_mps, limit=terms.velocity_error_y_mps, unit="m/s"
        ),
        detection_age=Reading(
            measured=state.detection_age_s, limit=terms.frame_age_max_s, unit="s"
        ),
        telemetry_age=Reading(measured=state.telemetry_age_s, unit="s"),
        heartbeat_age=Reading(measured=heartbeat_age_s, limit=AUTOPILOT_SILENCE_S, unit="s"),
        clearance=Reading(measured=_clearance_m(autonomy), limit=0.0, unit="m"),
    )


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


def _obstacle(obstacle: Obstacle, leg: LegFrame, assessment: Assessment) -> KnownObstacle:
    region = obstacle.region
    lane = Box(region.approach_x_m, region.x_pob_m, region.lane_left_m, region.lane_right_m)
    return KnownObstacle(
        id=obstacle.id,
        measured_ned_m=outline_of(obstacle.measured, leg),
        keep_out_ned_m=outline_of(region.keep_out, leg),
        region_ned_m=outline_of(region.extent, leg),
        lane_ned_m=outline_of(lane, leg),
        boundary_ned_m=_seen_from_above(_collision_set_boundary(region, assessment), leg),
        down_m=_heights(obstacle.filled_m),
    )


def _heights(filled_m: DownRange) -> tuple[float | None, float | None] | None:
    top_m, bottom_m = (finite(each) for each in filled_m)
    return None if top_m is bottom_m is None else (top_m, bottom_m)


def _collision_set_boundary(region: RegionOfInfluence, assessment: Assessment) -> FloatArray:
    """Points (N, 3) of the collision set boundary, leg frame, from the left to the right."""
    box, speed_mps = region.obstacle, assessment.inflated.manoeuvre_encounter.speed_mps
    y_m = np.linspace(box.y_min_m, box.y_max_m, _BOUNDARY_POINTS)
    depths_m = [boundary_depth_at(y, box, assessment.limits, speed_mps) for y in y_m.tolist()]
    return np.column_stack((box.x_min_m - np.array(depths_m), y_m, np.zeros_like(y_m)))


def outline_of(box: Box, leg: LegFrame) -> Outline:
    """Return the corners of a leg-frame box."""
    corners = [
        (box.x_min_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_max_m, 0.0),
        (box.x_min_m, box.y_max_m, 0.0),
    ]
    return _seen_from_above(np.array(corners), leg)


def path_of(trajectory: Trajectory, leg: LegFrame) -> list[tuple[float, float, float]]:
    """Return points of a trajectory, NED: every `PATH_STEP_S`, or `PATH_POINTS_MAX` of them."""
    duration_s = trajectory.end_s - trajectory.start_s
    count = min(math.ceil(duration_s / PATH_STEP_S) + 1, PATH_POINTS_MAX)
    times_s = trajectory.start_s + np.minimum(
        np.arange(count) * max(PATH_STEP_S, duration_s / (count - 1)), duration_s
    )
    points_ned_m = leg.position_ned_from_leg(trajectory.positions_leg_m(times_s))
    return [(x, y, z) for x, y, z in points_ned_m.tolist()]


def _seen_from_above(points_leg_m: FloatArray, leg: LegFrame) -> Outline:
    """Return points (N, 3) of the leg frame as [north, east]."""
    return [(x, y) for x, y, _ in leg.position_ned_from_leg(points_leg_m).tolist()]
