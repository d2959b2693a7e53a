"""The flight as viewers draw it: messages in Foxglove's schemas from the records of the journal.

Topics: ``tf``, ``pose``, ``path/flown``, ``path/planned``, ``scene/obstacles``, ``scene/plan``.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, Final

from onboard.recording import foxglove_messages as foxglove
from onboard.recording.record import Record

# The flown path that each message repeats, for a viewer that jumps there: this long, this fine.
TRAIL_POINTS: Final = 120
TRAIL_PERIOD_S: Final = 0.5
# Obstacles are known from above only; they are drawn this much higher than the vehicle flies.
HEADROOM_M: Final = 1.0

_OBSTACLE: Final = (0.36, 0.50, 0.31, 0.8)
_KEEP_OUT: Final = (0.88, 0.48, 0.0, 0.9)
_REGION: Final = (0.69, 0.23, 0.28, 0.9)
_LANE: Final = (0.35, 0.55, 0.85, 0.6)
_BOUNDARY: Final = (0.85, 0.10, 0.10, 1.0)
_PLAN: Final = (0.88, 0.48, 0.0, 1.0)
_NAME: Final = (0.9, 0.9, 0.9, 1.0)


class Scene:
    """Draws a flight, record by record; remembers the path flown."""

    def __init__(self) -> None:
        self._trail: deque[Sequence[float]] = deque(maxlen=TRAIL_POINTS)
        self._trail_due_s = -math.inf

    def vehicle(self, time_unix_s: float, state: dict[str, Any]) -> Iterator[Record]:
        """Draw where the vehicle is and was; nothing while nobody knows."""
        position_ned_m = state["position_ned_m"]
        if position_ned_m is None:
            return
        attitude_rad = (state["roll_rad"], state["pitch_rad"], state["yaw_rad"])
        vehicle = foxglove.pose(position_ned_m, attitude_rad)
        transforms = foxglove.frame_transforms(time_unix_s, vehicle)
        yield Record("tf", time_unix_s, transforms, "foxglove.FrameTransforms")
        pose = foxglove.pose_in_frame(time_unix_s, vehicle)
        yield Record("pose", time_unix_s, pose, "foxglove.PoseInFrame")
        if time_unix_s >= self._trail_due_s:
            self._trail_due_s = time_unix_s + TRAIL_PERIOD_S
            self._trail.append(position_ned_m)
            path = foxglove.poses_in_frame(time_unix_s, self._trail)
            yield Record("path/flown", time_unix_s, path, "foxglove.PosesInFrame")

    def obstacles(
        self, time_unix_s: float, known: dict[str, Any], height_m: float
    ) -> Iterator[Record]:
        """Draw everything known; ``height_m`` is that at which the leg is flown."""
        entities = [
            foxglove.entity(
                time_unix_s,
                obstacle["id"],
                cubes=[_column(obstacle["measured_ned_m"], height_m + HEADROOM_M)],
                lines=[
                    _outline(obstacle["keep_out_ned_m"], height_m, _KEEP_OUT),
                    _outline(obstacle["region_ned_m"], height_m, _REGION),
                    _outline(obstacle["lane_ned_m"], height_m, _LANE),
                    foxglove.line(_at_height(obstacle["boundary_ned_m"], height_m), _BOUNDARY, 3.0),
                ],
                texts=[
                    foxglove.text(
                        (*obstacle["measured_ned_m"][0], -height_m - HEADROOM_M),
                        obstacle["id"],
                        _NAME,
                    )
                ],
            )
            for obstacle in known["obstacles"]
        ]
        update = foxglove.scene_update(time_unix_s, entities)
        yield Record("scene/obstacles", time_unix_s, update, "foxglove.SceneUpdate")

    def plan(self, time_unix_s: float, plan: dict[str, Any]) -> Iterator[Record]:
        """Draw the plan that is flown from now on."""
        points_ned_m = plan["path_ned_m"]
        path = foxglove.poses_in_frame(time_unix_s, points_ned_m)
        yield Record("path/planned", time_unix_s, path, "foxglove.PosesInFrame")
        lines = [foxglove.line(points_ned_m, _PLAN, 4.0)]
        entity = foxglove.entity(time_unix_s, "plan", lines=lines)
        update = foxglove.scene_update(time_unix_s, [entity])
        yield Record("scene/plan", time_unix_s, update, "foxglove.SceneUpdate")


def _column(corners_ned_m: Sequence[Sequence[float]], height_m: float) -> dict[str, Any]:
    """Return a box that stands on the ground; the corners go round, the first side along x."""
    (north_m, east_m), (ahead_north_m, ahead_east_m), across, (aside_north_m, aside_east_m) = (
        corners_ned_m
    )
    along_m = (ahead_north_m - north_m, ahead_east_m - east_m)
    size_m = (
        math.hypot(*along_m),
        math.hypot(aside_north_m - north_m, aside_east_m - east_m),
        height_m,
    )
    center_m = ((north_m + across[0]) / 2.0, (east_m + across[1]) / 2.0, -height_m / 2.0)
    return foxglove.cube(center_m, size_m, math.atan2(along_m[1], along_m[0]), _OBSTACLE)


def _outline(
    corners_ned_m: Sequence[Sequence[float]], height_m: float, colour: foxglove.Colour
) -> dict[str, Any]:
    closed = [*corners_ned_m, corners_ned_m[0]]
    return foxglove.line(_at_height(closed, height_m), colour)


def _at_height(
    points_ned_m: Sequence[Sequence[float]], height_m: float
) -> list[tuple[float, float, float]]:
    return [(north_m, east_m, -height_m) for north_m, east_m in points_ned_m]
