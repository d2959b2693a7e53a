"""Check whether another node commands the vehicle, by the target that the autopilot reports.

Neither autopilot forwards setpoints that are addressed to it, so a second commander is rarely heard
directly; its trace is in POSITION_TARGET_LOCAL_NED.  ArduPilot reports the setpoint it took last.
PX4 reports its position controller's *output*: the position asked for, and the velocity asked for
plus a gain times the position error, which MPC_XY_P and MPC_Z_P bound.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from onboard.monitoring.assumptions import Assumption, Violation
from onboard.vehicle_state import Pose, Target

# The target may differ this much from ours, m and m/s: ArduPilot's is up to 0.06 m late in the
# recorded flights, and PX4's velocity leaves 0.02 m/s that the position error does not explain.
TARGET_TOLERANCE: Final = 0.15
# A target that lacks position or velocity, which we always ask for, differs by at least this.
LACKING: Final = 1.0
# Foreign targets before they count, how long they must span (a pilot's mode change looks the same
# until the next heartbeat), and within which time: the setpoints of a second commander that sends
# less often than we do are overwritten before most echoes leave.
CONFIRMATIONS: Final = 3
SPAN_MIN_S: Final = 1.2
MEMORY_S: Final = 5.0
ECHO_PATIENCE_S: Final = 0.15


class SecondCommanderMonitor:
    """Compares the autopilot's target with what was asked for."""

    def __init__(self) -> None:
        self._foreign_s: deque[float] = deque()
        self._heard_s = -math.inf

    def suspects(self, now_s: float) -> bool:
        """Tell whether the autopilot no longer follows our target, so that the error is not ours.

        Either its last target was another's, or it had targets and now has none.
        """
        if math.isinf(self._heard_s):
            return False
        another = bool(self._foreign_s) and self._foreign_s[-1] == self._heard_s
        age_s = now_s - self._heard_s
        return age_s < SPAN_MIN_S and (another or age_s > ECHO_PATIENCE_S)

    def check(
        self,
        target_heard_s: float,
        target: Target,
        ours: Iterable[Target],
        pose: Pose,
        *,
        gain_max_per_s: float,
    ) -> Violation | None:
        """Check the autopilot's target against what was asked for lately.

        Args:
            target_heard_s: when the autopilot reported its target.
            target: that target, NED; NaN where it has no position or velocity.
            ours: our setpoints until now, the newest first, as far back as the echo may lag.
            pose: the newest.
            gain_max_per_s: velocity per position error that the autopilot may add to ours.
        """
        if target_heard_s <= self._heard_s:
            return None
        away = _nearest(target, ours, pose, gain_max_per_s)
        if away is None:
            return None
        self._heard_s = target_heard_s
        if away > TARGET_TOLERANCE:
            self._foreign_s.append(target_heard_s)
        while self._foreign_s and target_heard_s - self._foreign_s[0] > MEMORY_S:
            self._foreign_s.popleft()
        lasting = len(self._foreign_s) >= CONFIRMATIONS and (
            self._foreign_s[-1] - self._foreign_s[0] >= SPAN_MIN_S
        )
        if not lasting or self._foreign_s[-1] != target_heard_s:
            return None
        return Violation(Assumption.SECOND_COMMANDER, away, TARGET_TOLERANCE, "m")


def _nearest(
    target: Target, ours: Iterable[Target], pose: Pose, gain_max_per_s: float
) -> float | None:
    """Return the distance of the target to the nearest of ours, or to the first that is near."""
    nearest = None
    for asked in ours:
        away = _distance(target, asked, pose, gain_max_per_s)
        if away <= TARGET_TOLERANCE:
            return away
        nearest = away if nearest is None else min(nearest, away)
    return nearest


def _distance(target: Target, asked: Target, pose: Pose, gain_max_per_s: float) -> float:
    """Return how far apart two targets are: metres, or unexplained m/s where that is more.

    At least `LACKING` where either lacks a number: we always ask for a position and a velocity.
    """
    (position_ned_m, velocity_ned_mps), (asked_ned_m, asked_ned_mps) = target, asked
    position_m = math.dist(position_ned_m, asked_ned_m)
    added = [there - ours for there, ours in zip(velocity_ned_mps, asked_ned_mps, strict=True)]
    error = [ours - here for ours, here in zip(asked_ned_m, pose.position_ned_m, strict=True)]
    horizontal_mps = _unexplained(added[:2], error[:2], gain_max_per_s)
    vertical_mps = _unexplained(added[2:], error[2:], gain_max_per_s)
    parts = (position_m, math.hypot(horizontal_mps, vertical_mps))
    return max(part if math.isfinite(part) else LACKING for part in parts)


def _unexplained(added_mps: list[float], error_m: list[float], gain_max_per_s: float) -> float:
    """Return the least speed left of an added velocity by any gain up to the greatest."""
    square_m2 = sum(error * error for error in error_m)
    along = sum(a * e for a, e in zip(added_mps, error_m, strict=True))
    gain_per_s = min(max(along / square_m2, 0.0), gain_max_per_s) if square_m2 > 0.0 else 0.0
    return math.hypot(*(a - gain_per_s * e for a, e in zip(added_mps, error_m, strict=True)))
