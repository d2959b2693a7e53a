"""What the autopilot has said about its position, decoded; `onboard.monitoring` evaluates it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Generic, NamedTuple, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles.profile import EstimatorFacts
from onboard.mavlink.profiles.registry import OTHER

# A source is silent after this time, or after some of its usual intervals, whichever is longer:
# links lose messages.  GPS silence is how ArduPilot shows a loss, and counts sooner.
SILENCE_S: Final = 1.5
SILENCE_INTERVALS: Final = 6.0
GPS_SILENCE_S: Final = 1.0
GPS_SILENCE_INTERVALS: Final = 5.0
FIX_TYPE_MIN: Final[int] = mavlink.GPS_FIX_TYPE_3D_FIX
# Weight of a new interval in the running average.
_INTERVAL_SHARE: Final = 0.25
_TEXTS_MAX: Final = 20


class EstimatorReport(NamedTuple):
    """ESTIMATOR_STATUS or EKF_STATUS_REPORT; NaN where the message lacks a value."""

    name: str
    flags: int
    velocity_ratio: float
    position_ratio: float
    height_ratio: float
    accuracy_m: float


class GpsReport(NamedTuple):
    """GPS_RAW_INT."""

    fix_type: int

    @property
    def has_fix(self) -> bool:
        """Whether the receiver has a fix in three dimensions."""
        return self.fix_type >= FIX_TYPE_MIN


class HealthReport(NamedTuple):
    """SYS_STATUS: bits of MAV_SYS_STATUS_SENSOR."""

    present: int
    enabled: int
    health: int

    @property
    def working(self) -> int:
        """Sensors that are present, enabled and healthy."""
        return self.present & self.enabled & self.health

    @property
    def failed(self) -> int:
        """Sensors that are present and enabled, but not healthy."""
        return self.present & self.enabled & ~self.health


Report = TypeVar("Report", EstimatorReport, GpsReport, HealthReport)


@dataclass
class Source(Generic[Report]):
    """The latest report of one kind.

    Attributes:
        report: None until heard.
        heard_s: when.
        interval_s: usual time between two of them; 0 until known.
        silence_least_s, silence_intervals: the longest silence, in seconds and in usual intervals.
    """

    report: Report | None = None
    heard_s: float = -math.inf
    interval_s: float = 0.0
    silence_least_s: float = SILENCE_S
    silence_intervals: float = SILENCE_INTERVALS

    def hear(self, report: Report, now_s: float) -> None:
        """Take a report."""
        if self.report is not None:
            interval_s = now_s - self.heard_s
            share = _INTERVAL_SHARE if self.interval_s else 1.0
            self.interval_s += share * (interval_s - self.interval_s)
        self.report, self.heard_s = report, now_s

    def silence_s(self, now_s: float) -> float | None:
        """Return how long the source has been silent; None if that is not too long."""
        silent_s = now_s - self.heard_s
        return silent_s if silent_s > self.silence_limit_s else None

    @property
    def silence_limit_s(self) -> float:
        """How long the source may be silent."""
        return max(self.silence_least_s, self.silence_intervals * self.interval_s)


@dataclass
class PositionReports:
    """What the autopilot has said about its position, decoded.

    Attributes:
        facts: how its profile reads them.
        estimator, gps, health: the latest of each kind.
        fix_s: when the GPS last had a fix.
        texts: STATUSTEXT of severity WARNING and worse, with their times.
    """

    facts: EstimatorFacts = OTHER.estimator
    estimator: Source[EstimatorReport] = field(default_factory=Source)
    gps: Source[GpsReport] = field(
        default_factory=lambda: Source(
            silence_least_s=GPS_SILENCE_S, silence_intervals=GPS_SILENCE_INTERVALS
        )
    )
    health: Source[HealthReport] = field(default_factory=Source)
    fix_s: float = -math.inf
    texts: list[tuple[float, str]] = field(default_factory=list)

    def hear_gps(self, report: GpsReport, now_s: float) -> None:
        """Take a GPS_RAW_INT."""
        self.gps.hear(report, now_s)
        if report.has_fix:
            self.fix_s = now_s

    def hear_text(self, text: str, now_s: float) -> None:
        """Take a STATUSTEXT, of severity WARNING or worse."""
        self.texts = [*self.texts[1 - _TEXTS_MAX :], (now_s, text)]
