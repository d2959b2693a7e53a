"""Checks of a trajectory against the obstacles that are known now."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from onboard.contract.heights import LEVEL_M
from onboard.guidance.envelope import envelope_from
from onboard.guidance.situation import Situation
from onboard.motion.trajectory import Trajectory, X, Z
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.certifier import certify_clear
from onboard.planning.proximity import least_room_m


class ClearCheck:
    """Certifies trajectories against obstacles, whatever the planner says of them.

    Args:
        situation: what is flown, and what is known.
    """

    def __init__(self, situation: Situation) -> None:
        self._situation = situation

    def is_clear(self, trajectory: Trajectory, obstacles: Iterable[Obstacle] | None = None) -> bool:
        """Tell whether a trajectory certifies; by default against every obstacle in its way."""
        if obstacles is None:
            obstacles = map(self.as_planned, self._near(trajectory))
        start = trajectory.sample(trajectory.start_s)
        boxes = [obstacle.region.obstacle for obstacle in obstacles]
        envelope = envelope_from(start, self._situation.envelope)
        return certify_clear(trajectory, start, trajectory.start_s, envelope, boxes).valid

    def as_planned(self, obstacle: Obstacle) -> Obstacle:
        """Return the obstacle as the flown plan assumes it, while measurements confirm that."""
        situation = self._situation
        if situation.avoidance is None:
            return obstacle
        planned = situation.avoidance.obstacle
        if not obstacle.confirms(planned, situation.assessment.face_error_m):
            return obstacle
        # The planned box under the present terms: an adapted contract may inflate it more.
        region = situation.assessment.region_around(planned.measured, planned.position_error_m)
        return replace(planned, region=region)

    def room_m(self, trajectory: Trajectory) -> float:
        """Return the least distance of a trajectory from the obstacles in its way, in metres."""
        return least_room_m(trajectory, [near.region.obstacle for near in self._near(trajectory)])

    def _near(self, trajectory: Trajectory) -> Iterator[Obstacle]:
        """Yield what a trajectory may meet; off the height of the leg all are pillars."""
        obstacles, x_m = self._situation.obstacles, trajectory.position_range_m(X)
        yield from obstacles.between(*x_m)
        if max(map(abs, trajectory.position_range_m(Z))) > LEVEL_M:
            yield from obstacles.out_of_way(*x_m)
