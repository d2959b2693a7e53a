"""What each tick leaves behind: records for the flight log and for Zenoh, as JSON.

Topics: ``state`` every tick, ``obstacles`` and ``plan`` when they change, ``events`` as they come.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from onboard.autonomy import Autonomy
from onboard.frames import LegFrame
from onboard.navigator import PlannedStep
from onboard.obstacles import Obstacle
from onboard.region import Box
from onboard.trajectory import Trajectory

Topic = Literal["state", "obstacles", "plan", "events"]

PATH_STEP_S: Final = 0.1


@dataclass(frozen=True)
class Record:
    """One line of the log.

    Attributes:
        topic: what kind.
        time_unix_s: when.
        payload: JSON values, ``time_s`` (Unix) among them.
    """

    topic: Topic
    time_unix_s: float
    payload: dict[str, Any]


class Journal:
    """Collects the records of a service.

    Args:
        autonomy: the service; its events are taken from it here and nowhere else.
        timed: record how long plans took; a simulation does not, to be the same every time.
    """

    def __init__(self, autonomy: Autonomy, *, timed: bool) -> None:
        self._autonomy = autonomy
        self._timed = timed
        self._obstacles_revision = 0

    def collect(self, now_s: float) -> list[Record]:
        """Return what the tick at ``now_s`` left behind."""
        autonomy, navigator = self._autonomy, self._autonomy.navigator
        records = [self._record("state", now_s, autonomy.snapshot(now_s))]
        if navigator.obstacles.revision != self._obstacles_revision:
            self._obstacles_revision = navigator.obstacles.revision
            found = [_obstacle(obstacle, navigator.leg) for obstacle in navigator.obstacles]
            records.append(self._record("obstacles", now_s, {"obstacles": found}))
        plans = [self._record("plan", now_s, self._plan(s)) for s in navigator.take_planned()]
        events = [self._record("events", e.time_s, e.as_json()) for e in autonomy.events()]
        return records + plans + events

    def _record(self, topic: Topic, time_s: float, payload: dict[str, Any]) -> Record:
        time_unix_s = round(self._autonomy.epoch_unix_s + time_s, 6)
        return Record(topic, time_unix_s, {"time_s": time_unix_s, **payload})

    def _plan(self, step: PlannedStep) -> dict[str, Any]:
        trajectory, epoch_s = step.plan.trajectory, self._autonomy.epoch_unix_s
        return {
            "obstacle": step.obstacle.id,
            "kind": step.plan.kind,
            "side": step.plan.side,
            "cost": step.plan.cost,
            "plan_time_ms": step.plan_time_s * 1e3 if self._timed else None,
            "start_s": epoch_s + trajectory.start_s,
            "end_s": epoch_s + trajectory.end_s,
            "keep_out_ned_m": box_ned_m(step.obstacle.region.keep_out, step.leg),
            "region_ned_m": box_ned_m(step.obstacle.region.extent, step.leg),
            "path_ned_m": _path_ned_m(trajectory, step.leg),
        }


def _obstacle(obstacle: Obstacle, leg: LegFrame) -> dict[str, Any]:
    return {
        "id": obstacle.id,
        "measured_ned_m": box_ned_m(obstacle.measured, leg),
        "keep_out_ned_m": box_ned_m(obstacle.region.keep_out, leg),
        "region_ned_m": box_ned_m(obstacle.region.extent, leg),
    }


def box_ned_m(box: Box, leg: LegFrame) -> list[list[float]]:
    """Corners of a leg-frame box, [north, east] each, in metres."""
    corners = [
        (box.x_min_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_min_m, 0.0),
        (box.x_max_m, box.y_max_m, 0.0),
        (box.x_min_m, box.y_max_m, 0.0),
    ]
    ned_m: list[list[float]] = leg.position_ned_from_leg(np.array(corners))[:, :2].tolist()
    return ned_m


def _path_ned_m(trajectory: Trajectory, leg: LegFrame) -> list[list[float]]:
    times_s = np.append(
        np.arange(trajectory.start_s, trajectory.end_s, PATH_STEP_S), trajectory.end_s
    )
    points = [trajectory.sample(time_s).position_leg_m for time_s in times_s.tolist()]
    ned_m: list[list[float]] = leg.position_ned_from_leg(np.array(points)).tolist()
    return ned_m
