"""The contract's assumptions, watched in flight.

Each `Assumption` names one thing that the guarantee rests on.  A check returns a `Violation` with
what was seen and what was allowed; `onboard.navigator` answers it.  What cannot be confirmed counts
as failed: no frame is a blind sensor, no telemetry is an unknown position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Final

from onboard.contract import TICK_S, Terms
from onboard.events import Event, Severity
from onboard.mavlink import Pose
from onboard.obstacles import DetectionFrame, Obstacle

# A frame from farther in the future than this has been stamped by a wrong clock.
CLOCK_TOLERANCE_S: Final = 0.1
# Consecutive poses beyond a tracking bound before it counts: one may be an estimator's glitch.
CONFIRMATIONS: Final = 3
# Between two poses no multirotor moves farther than this beyond its own velocity.
POSITION_JUMP_M: Final = 0.5


@unique
class Assumption(StrEnum):
    """What the guarantee rests on; the values appear in logs, results and STATUSTEXT."""

    DETECTION_AGE = "detection_age"
    DETECTION_RANGE = "detection_range"
    FIELD_OF_VIEW = "field_of_view"
    DETECTION_UNCERTAINTY = "detection_uncertainty"
    SENSOR_CLOCK = "sensor_clock"
    OBSTACLE_SIZE = "obstacle_size"
    ROI_INTERSECTION = "roi_intersection"
    LATE_FIRST_SIGHT = "late_first_sight"
    TRACKING_ERROR = "tracking_error"
    VELOCITY_ERROR = "velocity_error"
    TELEMETRY_AGE = "telemetry_age"
    ESTIMATOR_RESET = "estimator_reset"
    PLAN_EXISTS = "plan_exists"
    LEG_END_CLEAR = "leg_end_clear"
    TARGET_REACHED = "target_reached"
    SELF_CHECK = "self_check"


@dataclass(frozen=True)
class Violation:
    """An assumption that does not hold.

    Attributes:
        assumption: which.
        measured, limit, unit: what was seen and what was allowed.
        subject: what it was seen on, such as an obstacle's id.
    """

    assumption: Assumption
    measured: float
    limit: float
    unit: str
    subject: str = ""

    def __str__(self) -> str:
        where = f" ({self.subject})" if self.subject else ""
        return f"{self.assumption}{where}: {self.measured:.2f}, limit {self.limit:.2f} {self.unit}"

    def event(self, now_s: float) -> Event:
        """Return the event that reports it."""
        data = {
            "assumption": self.assumption.value,
            # JSON has no infinity; a sensor that was never heard has no age.
            "measured": self.measured if math.isfinite(self.measured) else None,
            "limit": self.limit,
            "unit": self.unit,
            "subject": self.subject,
        }
        return Event(now_s, "violation", Severity.ERROR, str(self), data)


def check_frame(frame: DetectionFrame, terms: Terms[float]) -> list[Violation]:
    """Hold what a sensor declares in a frame against what the contract assumes of it."""
    found: list[Violation] = []
    if frame.range_m < terms.detection_range_m:
        found.append(
            Violation(
                Assumption.DETECTION_RANGE,
                frame.range_m,
                terms.detection_range_m,
                "m",
                frame.source,
            )
        )
    assumed_deg = math.degrees(terms.field_of_view_rad)
    if frame.field_of_view_deg < assumed_deg - 1e-9:
        found.append(
            Violation(
                Assumption.FIELD_OF_VIEW, frame.field_of_view_deg, assumed_deg, "°", frame.source
            )
        )
    worst_m = max((o.uncertainty_m for o in frame.obstacles), default=0.0)
    if worst_m > terms.position_error_m:
        found.append(
            Violation(
                Assumption.DETECTION_UNCERTAINTY,
                worst_m,
                terms.position_error_m,
                "m",
                frame.source,
            )
        )
    return found


def check_obstacle(
    obstacle: Obstacle, conflicting: Obstacle | None, terms: Terms[float]
) -> list[Violation]:
    """Hold one obstacle against the environment that the contract assumes."""
    found: list[Violation] = []
    # A measured face may be off by its error, on both sides.
    limit_m = terms.obstacle_size_max_m + 2.0 * terms.position_error_m
    largest_m = max(obstacle.measured.size_m)
    if largest_m > limit_m:
        found.append(Violation(Assumption.OBSTACLE_SIZE, largest_m, limit_m, "m", obstacle.id))
    if conflicting is not None:
        apart_m = _centre_distance(obstacle, conflicting)
        found.append(
            Violation(
                Assumption.ROI_INTERSECTION,
                apart_m,
                terms.obstacle_separation_min_m,
                "m",
                f"{obstacle.id} and {conflicting.id}",
            )
        )
    return found


def _centre_distance(one: Obstacle, other: Obstacle) -> float:
    a, b = one.measured, other.measured
    return math.hypot(
        (a.x_min_m + a.x_max_m - b.x_min_m - b.x_max_m) / 2.0,
        (a.y_min_m + a.y_max_m - b.y_min_m - b.y_max_m) / 2.0,
    )


class DetectionWatch:
    """Age of what the sensor last saw.

    Args:
        terms: the contract.
    """

    def __init__(self, terms: Terms[float]) -> None:
        self._terms = terms
        self._newest_stamp_s = -math.inf

    def age_s(self, now_s: float) -> float:
        """Time since the newest frame was taken; infinite before the first."""
        return now_s - self._newest_stamp_s

    def on_frame(self, source: str, stamp_s: float, now_s: float) -> Violation | None:
        """Take a frame; one from the future is a clock fault and does not count as sight."""
        ahead_s = stamp_s - now_s
        if ahead_s > CLOCK_TOLERANCE_S:
            return Violation(Assumption.SENSOR_CLOCK, ahead_s, CLOCK_TOLERANCE_S, "s", source)
        self._newest_stamp_s = max(self._newest_stamp_s, min(stamp_s, now_s))
        return None

    def check(self, now_s: float) -> Violation | None:
        """Tell whether the sensor has been silent for longer than the contract allows."""
        age_s = self.age_s(now_s)
        if age_s <= self._terms.frame_age_max_s:
            return None
        return Violation(Assumption.DETECTION_AGE, age_s, self._terms.frame_age_max_s, "s")


class TrackingWatch:
    """How well the vehicle follows its reference, and whether its position can be believed.

    Args:
        terms: the contract.
        stale_after_s: older telemetry is no telemetry.
    """

    def __init__(self, terms: Terms[float], stale_after_s: float) -> None:
        self._terms = terms
        self._stale_after_s = stale_after_s
        self._previous: Pose | None = None
        self._streaks: dict[str, int] = {}
        self.position_error_m = 0.0
        self.velocity_error_mps = (0.0, 0.0)

    def restart(self) -> None:
        """Forget the past: a new reference begins."""
        self._previous = None
        self._streaks.clear()

    def check_age(self, pose: Pose | None, now_s: float) -> Violation | None:
        """Tell whether the position is too old to be believed."""
        age_s = now_s - pose.time_s if pose is not None else math.inf
        if age_s <= self._stale_after_s:
            return None
        return Violation(Assumption.TELEMETRY_AGE, age_s, self._stale_after_s, "s")

    def check_jump(self, pose: Pose) -> Violation | None:
        """Tell whether the estimator moved the vehicle since the last call, not its motors."""
        previous, self._previous = self._previous, pose
        if previous is None or pose is previous:
            return None
        step_s = max(pose.time_s - previous.time_s, TICK_S)
        jump_m = math.dist(
            pose.position_ned_m[:2],
            [
                at + velocity * step_s
                for at, velocity in zip(
                    previous.position_ned_m[:2], previous.velocity_ned_mps[:2], strict=True
                )
            ],
        )
        if jump_m <= POSITION_JUMP_M:
            return None
        return Violation(Assumption.ESTIMATOR_RESET, jump_m, POSITION_JUMP_M, "m")

    def check_tracking(
        self,
        position_error_leg_m: tuple[float, float],
        velocity_leg_mps: tuple[float, float],
        reference_velocity_leg_mps: tuple[float, float],
        *,
        cruising: bool,
    ) -> list[Violation]:
        """Hold one new pose against the tracking errors that the contract states.

        Args:
            position_error_leg_m: measured less reference, horizontal.
            velocity_leg_mps: measured, horizontal.
            reference_velocity_leg_mps: of the reference at that time.
            cruising: outside every Region of Influence, where the velocity bound applies (paper,
                "Velocity Tracking Error").
        """
        terms = self._terms
        self.position_error_m = math.hypot(*position_error_leg_m)
        self.velocity_error_mps = (
            abs(velocity_leg_mps[0] - reference_velocity_leg_mps[0]),
            abs(velocity_leg_mps[1] - reference_velocity_leg_mps[1]),
        )
        found = [
            self._confirmed(
                Assumption.TRACKING_ERROR, self.position_error_m, terms.tracking_error_m, "m"
            )
        ]
        # What endangers is flying faster than the contract's speed, or sideways.
        excess_mps = velocity_leg_mps[0] - terms.cruise_speed_mps
        if cruising:
            found += [
                self._confirmed(
                    Assumption.VELOCITY_ERROR, excess_mps, terms.velocity_error_x_mps, "m/s", "x"
                ),
                self._confirmed(
                    Assumption.VELOCITY_ERROR,
                    self.velocity_error_mps[1],
                    terms.velocity_error_y_mps,
                    "m/s",
                    "y",
                ),
            ]
        return [violation for violation in found if violation is not None]

    def _confirmed(
        self, assumption: Assumption, measured: float, limit: float, unit: str, subject: str = ""
    ) -> Violation | None:
        key = assumption if not subject else f"{assumption}.{subject}"
        streak = self._streaks.get(key, 0) + 1 if measured > limit else 0
        self._streaks[key] = streak
        if streak < CONFIRMATIONS:
            return None
        return Violation(assumption, measured, limit, unit, subject)
