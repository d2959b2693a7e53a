"""Assumptions that only a history can show: silence, lateness, resets, overruns.

Every watch takes the terms that hold now, since they may be re-solved in flight
(`onboard.adaptation`), and the time as an argument.
"""

from __future__ import annotations

import math
from typing import Final

from onboard.contract import TICK_S
from onboard.mavlink import Pose
from onboard.monitor import Assumption, Violation

# Between two poses no multirotor moves farther than this beyond its own velocity.
POSITION_JUMP_M: Final = 0.5
# Ticks later than this are the computer's failure, not the scheduler's jitter.
TICK_OVERRUN_S: Final = 3.0 * TICK_S


class PositionWatch:
    """Whether the position can be believed.

    Args:
        stale_after_s: older telemetry is no telemetry.
    """

    def __init__(self, stale_after_s: float) -> None:
        self._stale_after_s = stale_after_s
        self._previous: Pose | None = None

    def check_age(self, pose: Pose | None, now_s: float) -> Violation | None:
        """Tell whether the position is too old."""
        age_s = now_s - pose.time_s if pose is not None else math.inf
        if age_s <= self._stale_after_s:
            return None
        return Violation(Assumption.TELEMETRY_AGE, age_s, self._stale_after_s, "s")

    def check_jump(self, pose: Pose) -> Violation | None:
        """Tell whether the estimator moved the vehicle since the last pose, not its motors."""
        previous, self._previous = self._previous, pose
        if previous is None:
            return None
        step_s = max(pose.time_s - previous.time_s, TICK_S)
        north_m, east_m, _ = previous.position_ned_m
        vn_mps, ve_mps, _ = previous.velocity_ned_mps
        expected_ned_m = (north_m + vn_mps * step_s, east_m + ve_mps * step_s)
        jump_m = math.dist(pose.position_ned_m[:2], expected_ned_m)
        if jump_m <= POSITION_JUMP_M:
            return None
        return Violation(Assumption.ESTIMATOR_RESET, jump_m, POSITION_JUMP_M, "m")


class TickWatch:
    """Whether decisions are made on time; time that stands still or runs backwards is not."""

    def __init__(self) -> None:
        self._previous_s: float | None = None

    def check(self, now_s: float) -> Violation | None:
        """Take note of a tick."""
        previous_s, self._previous_s = self._previous_s, now_s
        if previous_s is None or 0.0 < now_s - previous_s <= TICK_OVERRUN_S:
            return None
        return Violation(Assumption.TICK_OVERRUN, now_s - previous_s, TICK_OVERRUN_S, "s")
