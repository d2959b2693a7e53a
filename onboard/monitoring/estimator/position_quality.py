"""Check whether the autopilot's position can be believed, by its estimator and its sources.

The estimate goes on while its sources fail: after a GPS loss both autopilots dead-reckon, and
LOCAL_POSITION_NED does not show it.  PX4 reported GPS_RAW_INT fix 0 at once and a growing accuracy,
and cleared its horizontal flags only 5.7 s later; ArduPilot's GPS_RAW_INT falls silent, and its
failover came after 8 s and 22 m.  So the monitor checks the sources too, not the estimate alone.

The response to a doubtful position is a stop, while the estimate is still good; a position that is
made up, or has been dead-reckoned for `DEAD_RECKONING_S`, is left to the autopilot's own failsafe.

For a vehicle that departed without a GPS fix (optical flow, visual odometry), GPS does not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum, auto
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.position_reports import EstimatorReport, HealthReport, PositionReports, Source
from onboard.mavlink.profiles.profile import NEEDED_ESTIMATOR_FLAGS
from onboard.monitoring.assumptions import Assumption, Violation

# Dead reckoning is good for about this long: long enough to stop, before drift counts.
DEAD_RECKONING_S: Final = 3.0
# A GPS that had a fix this recently has lost it; otherwise the vehicle does not use one.
FIX_MEMORY_S: Final = 10.0
# A text about the estimate keeps the vehicle from departing for this long.
TEXT_MEMORY_S: Final = 5.0
# Signs must last this long: the next message confirms them, at the rates that are asked for.
GPS_CONFIRMED_S: Final = 0.3
RATIO_CONFIRMED_S: Final = 0.5
HEALTH_CONFIRMED_S: Final = 0.6
# PX4's nominal horizontal accuracy is 0.3 m; 2 m and thrice what it was when it departed is lost.
ACCURACY_MAX_M: Final = 2.0
ACCURACY_FACTOR_MAX: Final = 3.0


class Worth(Enum):
    """What a sign leaves of the position."""

    DOUBTED = auto()
    DEAD_RECKONED = auto()
    MADE_UP = auto()


class Sign(NamedTuple):
    """One sign that the position is not what it should be.

    Attributes:
        subject: which, for logs; one violation is reported for each.
        sentence: for people.
        worth: what it leaves of the position.
        measured, limit, unit: in numbers.
        lasting_s: how long it must last to count.
    """

    subject: str
    sentence: str
    worth: Worth
    measured: float
    limit: float
    unit: str
    lasting_s: float = 0.0

    def violation(self) -> Violation:
        """Return the assumption that it breaks."""
        return Violation(
            Assumption.POSITION_QUALITY,
            self.measured,
            self.limit,
            self.unit,
            self.subject,
            sentence=self.sentence,
        )


class PositionQualityMonitor:
    """Compares the reports with those at the departure.

    Args:
        reports: kept up to date by the link.
    """

    def __init__(self, reports: PositionReports) -> None:
        self._reports = reports
        self._since_s: dict[str, float] = {}
        # Since when the position is dead-reckoned, or worse.
        self._reckoned_s = math.inf
        self._departed_s = math.inf
        self._by_gps = False
        self._estimator_relied = False
        self._health_bits = 0
        self._accuracy_max_m = math.inf
        # What the signs of the estimator were read from last, and what they were.
        self._asked: tuple[object, ...] = (None,) * 4
        self._answered: list[Sign] = []

    def departure_failures(self, now_s: float) -> list[str]:
        """Return why the position is not good enough to depart on; empty if it is."""
        reports = self._reports
        by_gps, estimated, health = self._sources(now_s)
        lost = not by_gps and now_s - reports.fix_s <= FIX_MEMORY_S
        gps_signs = self._gps_signs(now_s) if by_gps or lost else iter(())
        signs = list(gps_signs)
        if estimated:
            signs += self._estimator_signs(math.inf, absolute=by_gps)
        failures = [sign.sentence for sign in signs]
        failures += [
            f"the autopilot has just said: {text}"
            for time_s, text in reports.texts
            if now_s - time_s <= TEXT_MEMORY_S and self._is_alarming(text)
        ]
        health_report = reports.health.report
        if health and health_report is not None:
            failed = reports.facts.position_health & health_report.failed
            failures += [_unhealthy(failed).sentence] if failed else []
        if not estimated and reports.estimator.report is not None:
            silence = self._silence(reports.estimator.report.name, reports.estimator, now_s)
            failures += [] if silence is None else [silence.sentence]
        elif not estimated and not (by_gps and health):
            failures.append(
                "position quality unknown: neither ESTIMATOR_STATUS nor EKF_STATUS_REPORT heard, "
                "nor GPS_RAW_INT with a fix and SYS_STATUS"
            )
        return list(dict.fromkeys(failures))

    def depart(self, now_s: float) -> None:
        """Remember what the flight relies on: every source that confirms the position now."""
        self._departed_s, self._since_s, self._reckoned_s = now_s, {}, math.inf
        self._by_gps, self._estimator_relied, health = self._sources(now_s)
        bits = self._reports.facts.position_health
        bits |= mavlink.MAV_SYS_STATUS_SENSOR_GPS if self._by_gps else 0
        report = self._reports.health.report
        self._health_bits = bits & report.working if health and report is not None else 0
        estimator = self._reports.estimator.report
        known = self._by_gps and estimator is not None and estimator.accuracy_m >= 0.0
        self._accuracy_max_m = math.inf
        if known and estimator is not None:
            accuracy_max_m = ACCURACY_FACTOR_MAX * estimator.accuracy_m
            self._accuracy_max_m = max(ACCURACY_MAX_M, accuracy_max_m)

    def forget_flight(self) -> None:
        """Check nothing until the next departure: the vehicle has landed."""
        self._departed_s = math.inf

    def check(self, now_s: float) -> Sign | None:
        """Return the worst sign that has lasted long enough; None before the departure."""
        if now_s < self._departed_s:
            return None
        signs = list(self._signs(now_s))
        self._since_s = {s.subject: self._since_s.get(s.subject, now_s) for s in signs}
        reckoned = any(sign.worth is not Worth.DOUBTED for sign in signs)
        self._reckoned_s = min(self._reckoned_s, now_s) if reckoned else math.inf
        lasting = [s for s in signs if now_s - self._since_s[s.subject] >= s.lasting_s - 1e-9]
        return max(lasting, key=lambda sign: sign.worth.value, default=None)

    def lost_for_s(self, sign: Sign, now_s: float) -> float:
        """Return for how long the position has been as bad as a sign says; infinite if made up."""
        if sign.worth is Worth.MADE_UP:
            return math.inf
        return max(now_s - self._reckoned_s, 0.0)

    def _sources(self, now_s: float) -> tuple[bool, bool, bool]:
        """Tell what confirms the position now: GPS with a fix, the estimator, SYS_STATUS."""
        reports = self._reports
        gps, estimator, health = (
            source.report is not None and source.silence_s(now_s) is None
            for source in (reports.gps, reports.estimator, reports.health)
        )
        fix = reports.gps.report is not None and reports.gps.report.has_fix
        # One that has a fix but is not navigated by does not count.
        report = reports.estimator.report
        navigated = report is None or bool(report.flags & mavlink.ESTIMATOR_POS_HORIZ_ABS)
        return gps and fix and navigated, estimator, health

    def _signs(self, now_s: float) -> Iterator[Sign]:
        reports = self._reports
        if self._by_gps:
            yield from self._gps_signs(now_s)
        if self._estimator_relied:
            yield from self._reported_signs()
            assert reports.estimator.report is not None  # noqa: S101  it was heard
            silence = self._silence(reports.estimator.report.name, reports.estimator, now_s)
            if silence is not None:
                yield silence
        if self._health_bits:
            yield from self._health_signs(now_s)
        for time_s, text in reports.texts:
            if time_s >= self._departed_s and self._is_alarming(text):
                sentence = f"the autopilot says: {text}"
                yield Sign("text", sentence, Worth.DOUBTED, 1.0, 0.0, "texts")

    def _gps_signs(self, now_s: float) -> Iterator[Sign]:
        gps = self._reports.gps
        if gps.report is not None and not gps.report.has_fix:
            fix_type = gps.report.fix_type
            yield Sign(
                "gps_fix",
                f"GPS fix lost (fix type {fix_type}): position is dead-reckoned",
                Worth.DEAD_RECKONED,
                float(fix_type),
                float(mavlink.GPS_FIX_TYPE_3D_FIX),
                "fix type",
                GPS_CONFIRMED_S,
            )
        silent_s = gps.silence_s(now_s)
        if silent_s is not None:
            yield Sign(
                "gps_silent",
                f"GPS_RAW_INT silent for {silent_s:.1f} s: position may be dead-reckoned",
                Worth.DEAD_RECKONED,
                silent_s,
                gps.silence_limit_s,
                "s",
            )

    def _reported_signs(self) -> list[Sign]:
        """Return what the newest report of the estimator says; read again only with the next."""
        reports = self._reports
        asked = reports.estimator.report, reports.facts, self._accuracy_max_m, self._by_gps
        if any(one is not other for one, other in zip(asked, self._asked, strict=True)):
            self._asked = asked
            signs = self._estimator_signs(self._accuracy_max_m, absolute=self._by_gps)
            self._answered = list(signs)
        return self._answered

    def _estimator_signs(self, accuracy_max_m: float, *, absolute: bool) -> Iterator[Sign]:
        report, facts = self._reports.estimator.report, self._reports.facts
        if report is None:
            return
        where = f"{report.name}, flags {report.flags:#x}"
        for flags, what in NEEDED_ESTIMATOR_FLAGS:
            if not report.flags & flags:
                sentence = f"{what} lost ({where}): position is made up"
                yield Sign("estimator_flags", sentence, Worth.MADE_UP, 0.0, 1.0, "flags")
        # One that is taken back is lost, although a relative position goes on.
        if absolute and not report.flags & mavlink.ESTIMATOR_POS_HORIZ_ABS:
            sentence = f"absolute horizontal position lost ({where}): position is dead-reckoned"
            yield Sign("absolute_position", sentence, Worth.DEAD_RECKONED, 0.0, 1.0, "flags")
        for flag, what in facts.made_up_flags.items():
            if report.flags & flag:
                sentence = f"{what} ({where}): position is made up"
                yield Sign("estimator_flags", sentence, Worth.MADE_UP, 1.0, 0.0, "flags")
        for flag, what in facts.doubt_flags.items():
            if report.flags & flag:
                yield Sign(
                    what.replace(" ", "_").lower(),
                    f"{what} ({where}): position is doubtful",
                    Worth.DOUBTED,
                    1.0,
                    0.0,
                    "flags",
                    RATIO_CONFIRMED_S,
                )
        yield from self._ratio_signs(report, facts.ratio_max)
        if report.accuracy_m > accuracy_max_m:
            yield Sign(
                "accuracy",
                f"horizontal accuracy {report.accuracy_m:.1f} m, limit {accuracy_max_m:.1f} m "
                f"({report.name}): position is doubtful",
                Worth.DOUBTED,
                report.accuracy_m,
                accuracy_max_m,
                "m",
                RATIO_CONFIRMED_S,
            )

    @staticmethod
    def _ratio_signs(report: EstimatorReport, limit: float) -> Iterator[Sign]:
        ratios = {
            "velocity": report.velocity_ratio,
            "position": report.position_ratio,
            "height": report.height_ratio,
        }
        for what, ratio in ratios.items():
            if ratio > limit:
                yield Sign(
                    f"{what}_ratio",
                    f"{what} test ratio {ratio:.2f}, limit {limit:.2f} ({report.name}): "
                    "position is doubtful",
                    Worth.DOUBTED,
                    ratio,
                    limit,
                    "",
                    RATIO_CONFIRMED_S,
                )

    def _health_signs(self, now_s: float) -> Iterator[Sign]:
        health = self._reports.health
        silence = self._silence("SYS_STATUS", health, now_s)
        if silence is not None:
            yield silence
        report = health.report
        assert report is not None  # noqa: S101  its bits were relied on
        failed = self._health_bits & ~report.working
        if failed & mavlink.MAV_SYS_STATUS_SENSOR_GPS:
            sentence = "GPS unhealthy (SYS_STATUS): position is dead-reckoned"
            yield _unhealthy(failed)._replace(
                subject="gps_health", sentence=sentence, worth=Worth.DEAD_RECKONED
            )
        if failed & self._reports.facts.position_health:
            yield _unhealthy(failed)

    @staticmethod
    def _silence(
        name: str, source: Source[EstimatorReport] | Source[HealthReport], now_s: float
    ) -> Sign | None:
        silent_s = source.silence_s(now_s)
        if silent_s is None:
            return None
        sentence = f"{name} silent for {silent_s:.1f} s: position quality cannot be confirmed"
        return Sign(
            f"{name} silent", sentence, Worth.DOUBTED, silent_s, source.silence_limit_s, "s"
        )

    def _is_alarming(self, text: str) -> bool:
        lower, facts = text.lower(), self._reports.facts
        return any(words in lower for words in facts.texts) and not any(
            words in lower for words in facts.cleared
        )


def _unhealthy(failed: int) -> Sign:
    sentence = f"position estimate unhealthy (SYS_STATUS, {failed:#x}): position is doubtful"
    measured, limit = float(failed), 0.0
    return Sign(
        "estimate_health", sentence, Worth.DOUBTED, measured, limit, "bits", HEALTH_CONFIRMED_S
    )
