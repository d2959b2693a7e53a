"""Where the body was at the time of a detection frame."""

from __future__ import annotations

import bisect
import math
from collections import deque
from itertools import pairwise

from onboard.geometry.frames import wrap_angle
from onboard.vehicle_state import Pose


class PoseHistory:
    """The last few poses, to place what was seen from the body.

    Args:
        span_s: how far back it remembers.

    Attributes:
        generation: changes whenever the local frame has moved.
    """

    def __init__(self, span_s: float = 2.0) -> None:
        self.generation = 0
        self._span_s = span_s
        self._poses: deque[Pose] = deque(maxlen=500)

    @property
    def is_empty(self) -> bool:
        """Whether no pose is known."""
        return not self._poses

    def add(self, pose: Pose) -> None:
        """Remember a pose; poses come in the order of time."""
        self._poses.append(pose)
        while self._poses[0].time_s < pose.time_s - self._span_s:
            self._poses.popleft()

    def forget(self) -> None:
        """Forget every pose: the local frame has moved by an unknown vector since."""
        self.generation += 1
        self._poses.clear()

    def shift(self, shift_ned_m: tuple[float, float, float]) -> None:
        """Move every pose into the present local frame, which a reset has moved by a vector."""
        self.generation += 1
        for index, pose in enumerate(self._poses):
            moved = zip(pose.position_ned_m, shift_ned_m, strict=True)
            north_m, east_m, down_m = (before_m + shift_m for before_m, shift_m in moved)
            self._poses[index] = pose._replace(position_ned_m=(north_m, east_m, down_m))

    def at(self, time_s: float, tolerance_s: float = 0.1) -> Pose | None:
        """Return the pose nearest to ``time_s``, moved on to that time; None if none is near.

        The heading moves on too: a hundredth of a second in a turn displaces what is seen at the
        end of the range by more than a sensor's error.
        """
        poses = self._poses
        after = bisect.bisect_left(poses, time_s, key=_time_of)
        around = [poses[i] for i in (after - 1, after) if 0 <= i < len(poses)]
        nearest = min(around, key=lambda pose: abs(pose.time_s - time_s), default=None)
        if nearest is None or abs(nearest.time_s - time_s) > tolerance_s:
            return None
        later_s = time_s - nearest.time_s
        (north_m, east_m, down_m), (vn, ve, vd) = nearest.position_ned_m, nearest.velocity_ned_mps
        return nearest._replace(
            time_s=time_s,
            position_ned_m=(north_m + vn * later_s, east_m + ve * later_s, down_m + vd * later_s),
            yaw_rad=nearest.yaw_rad + self.yaw_rate_radps(time_s) * later_s,
        )

    def yaw_rate_radps(self, time_s: float) -> float:
        """Return how fast the body turned at a time, from the two poses around it; 0 if unknown."""
        after = bisect.bisect_left(self._poses, time_s, key=_time_of)
        second = min(max(after, 1), len(self._poses) - 1)
        if second < 1:
            return 0.0
        begin, end = self._poses[second - 1], self._poses[second]
        lasting_s = end.time_s - begin.time_s
        return wrap_angle(end.yaw_rad - begin.yaw_rad) / lasting_s if lasting_s > 0.0 else 0.0

    def fastest_turn_radps(self, time_s: float, around_s: float) -> float:
        """Return how fast the body turned at most around a time, in magnitude.

        Infinite unless one pose at least is older than the time and two are near: a turn that
        nothing tells of is not slow.
        """
        poses = self._poses
        first = bisect.bisect_left(poses, time_s - around_s, key=_time_of)
        last = bisect.bisect_right(poses, time_s + around_s, key=_time_of)
        near = [poses[index] for index in range(max(first - 1, 0), last)]
        if len(near) < 2 or near[0].time_s > time_s:
            return math.inf
        return max(_turn_radps(begin, end) for begin, end in pairwise(near))


def _time_of(pose: Pose) -> float:
    return pose.time_s


def _turn_radps(begin: Pose, end: Pose) -> float:
    turn_rad, lasting_s = abs(wrap_angle(end.yaw_rad - begin.yaw_rad)), end.time_s - begin.time_s
    if lasting_s > 0.0:
        return turn_rad / lasting_s
    return math.inf if turn_rad > 0.0 else 0.0
