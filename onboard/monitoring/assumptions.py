"""The contract's assumptions, as they are checked in flight.

Each `Assumption` names one thing that the guarantee rests on.  A check returns a `Violation` with
what was seen and what was allowed; `onboard.guidance.navigator` responds to it.  What cannot be
confirmed counts as failed: no frame means a blind sensor, no telemetry an unknown position.  The
checks here need one observation; those that need a history have a module each: `loop_overrun`,
`detections`, `detection_consistency`, and those in the rooms `estimator` and `response`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Final

from onboard.contract.arithmetic import SCALAR
from onboard.contract.derivation import face_error_m
from onboard.contract.terms import Terms
from onboard.events import Event, EventData, EventName, Severity
from onboard.perception.detection import DetectionFrame
from onboard.perception.obstacle_map import Obstacle

# A frame with this view is that of an all-round sensor.
ALL_ROUND_DEG: Final = 360.0 - 1e-6


@unique
class Assumption(StrEnum):
    """What the guarantee rests on; the values appear in logs, results and STATUSTEXT."""

    DETECTION_AGE = "detection_age"
    REACTION_TIME = "reaction_time"
    DETECTION_RANGE = "detection_range"
    FIELD_OF_VIEW = "field_of_view"
    DETECTION_UNCERTAINTY = "detection_uncertainty"
    DETECTION_CONSISTENCY = "detection_consistency"
    SENSOR_CLOCK = "sensor_clock"
    SENSOR_CONTRADICTION = "sensor_contradiction"
    OBSTACLE_SIZE = "obstacle_size"
    ROI_INTERSECTION = "roi_intersection"
    LATE_FIRST_SIGHT = "late_first_sight"
    MOVER_FIRST_SIGHT = "mover_first_sight"
    MOVER_CLASS = "mover_class"
    STATIC_CLAIM = "static_claim"
    REST_SPEED = "rest_speed"
    YIELD_TIME = "yield_time"
    MOVER_VIEW = "mover_view"
    TRACKING_ERROR = "tracking_error"
    TRACKING_ERROR_Z = "tracking_error_z"
    VELOCITY_ERROR = "velocity_error"
    TILT_RESPONSE = "tilt_response"
    TELEMETRY_AGE = "telemetry_age"
    ESTIMATOR_RESET = "estimator_reset"
    POSITION_QUALITY = "position_quality"
    HEADING_ERROR = "heading_error"
    WIND = "wind"
    FLIGHT_TIME = "flight_time"
    SECOND_COMMANDER = "second_commander"
    TICK_OVERRUN = "tick_overrun"
    LATE_TICKS = "late_ticks"
    PLAN_EXISTS = "plan_exists"
    NO_PASSAGE = "no_passage"
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
        note: what else helps to find the cause, for people.
        sentence: for people, in place of the numbers where they would not tell enough.
    """

    assumption: Assumption
    measured: float
    limit: float
    unit: str
    subject: str = ""
    note: str = ""
    sentence: str = ""

    @property
    def key(self) -> str:
        """What is violated and on what, without numbers: the same while it lasts."""
        return f"{self.assumption} {self.subject}".rstrip()

    def __str__(self) -> str:
        if self.sentence:
            return f"{self.assumption}: {self.sentence}"
        where = f" ({self.subject})" if self.subject else ""
        note = f"; {self.note}" if self.note else ""
        numbers = f"{self.measured:.2f}, limit {self.limit:.2f} {self.unit}"
        return f"{self.assumption}{where}: {numbers}{note}"

    def event(self, now_s: float) -> Event:
        """Return the event that reports it."""
        data: EventData = {
            "assumption": self.assumption.value,
            # JSON has no infinity; a sensor that was never heard has no age.
            "measured": self.measured if math.isfinite(self.measured) else None,
            "limit": self.limit,
            "unit": self.unit,
            "subject": self.subject,
        }
        return Event(now_s, EventName.VIOLATION, Severity.ERROR, str(self), data)


def check_frame(frame: DetectionFrame, terms: Terms[float]) -> list[Violation]:
    """Check a frame's declared range, field of view and uncertainty against the contract."""
    found: list[Violation] = []
    range_m, assumed_deg = terms.detection_range_m, math.degrees(terms.field_of_view_rad)
    ring_m = terms.all_round_range_m or 0.0
    if ring_m > 0.0 and frame.field_of_view_deg >= ALL_ROUND_DEG:
        range_m, assumed_deg = min(ring_m, range_m), 0.0
    if frame.range_m < range_m:
        found.append(
            Violation(
                Assumption.DETECTION_RANGE,
                frame.range_m,
                range_m,
                "m",
                frame.source,
            )
        )
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
    """Check one obstacle against the environment that the contract assumes."""
    found: list[Violation] = []
    # What was seen from afar only is known no better than that.
    unknown_m = max(obstacle.position_error_m - face_error_m(terms, SCALAR), 0.0)
    limit_m = measured_size_max(terms) + 2.0 * unknown_m
    largest_m = max(obstacle.measured.size_m)
    if largest_m > limit_m:
        found.append(Violation(Assumption.OBSTACLE_SIZE, largest_m, limit_m, "m", obstacle.id))
    if conflicting is not None:
        apart_m, limit_m = _centre_distance(obstacle, conflicting), terms.obstacle_separation_min_m
        which = f"{obstacle.id} and {conflicting.id}"
        found.append(Violation(Assumption.ROI_INTERSECTION, apart_m, limit_m, "m", which))
    return found


def measured_size_max(terms: Terms[float]) -> float:
    """Return the largest measured extent that the contract covers: each face may be off."""
    return terms.obstacle_size_max_m + 2.0 * face_error_m(terms, SCALAR)


def _centre_distance(one: Obstacle, other: Obstacle) -> float:
    a, b = one.measured, other.measured
    return math.hypot(
        (a.x_min_m + a.x_max_m - b.x_min_m - b.x_max_m) / 2.0,
        (a.y_min_m + a.y_max_m - b.y_min_m - b.y_max_m) / 2.0,
    )
