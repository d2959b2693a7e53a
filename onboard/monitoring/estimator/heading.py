"""Check that the nose points where it is told to, and that the estimated heading can be believed.

Nothing on board measures the true heading.  Four things contradict a wrong one: the estimate
itself, if it differs from the commanded heading; the magnetometer, if the estimator rejects it; the
gyros, if the estimate turns and they do not; and tracks that are seen again from the body, if all
of them have turned by an angle.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from onboard.contract.assessment import Terms
from onboard.geometry.frames import wrap_angle
from onboard.mavlink.heading_drift import HeadingDrift
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.perception.bearings import BearingResidual
from onboard.vehicle_state import Pose

# As before a leg begins; the recorded flights stay within 3°, except for moments.
POINTING_TOLERANCE_RAD: Final = math.radians(5.0)
POINTING_CONFIRMATION_S: Final = 1.0
# Beyond one the estimator rejects the magnetometer: ESTIMATOR_STATUS.mag_ratio of PX4,
# EKF_STATUS_REPORT.compass_variance of ArduPilot.  They come once or twice a second.
COMPASS_RATIO_MAX: Final = 1.0
COMPASS_CONFIRMATION_S: Final = 2.0
# Within this time the error changes by twice the contract's at most.  Gyros drift by 0.5° besides,
# and rates between two messages are unknown; recorded swings: up to 11° where a flight went well,
# 18° before the contact.
DRIFT_WINDOW_S: Final = 10.0
DRIFT_TOLERANCE_RAD: Final = math.radians(3.0)
_DRIFT_STEP_S: Final = 0.1
# A sensor is mounted, and boxes are fitted, to within this.
SIGHTING_TOLERANCE_RAD: Final = math.radians(5.0)
SIGHTING_CONFIRMATION_S: Final = 1.0
# Sightings farther apart than this confirm nothing.
SIGHTING_GAP_S: Final = 1.0


class _Confirmation:
    """Tells whether something has been true without a break for a time."""

    def __init__(self, confirmation_s: float) -> None:
        self._confirmation_s = confirmation_s
        self._since_s: float | None = None

    def update(self, now_s: float, *, exceeded: bool) -> bool:
        """Take whether it is true now; tell whether it has been for the time of confirmation."""
        if not exceeded:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._confirmation_s


class HeadingMonitor:
    """Compares the estimated heading with the command, magnetometer, gyros and sightings."""

    def __init__(self) -> None:
        self._astray = _Confirmation(POINTING_CONFIRMATION_S)
        self._rejected = _Confirmation(COMPASS_CONFIRMATION_S)
        self._turned = _Confirmation(SIGHTING_CONFIRMATION_S)
        self._sighted_s = -math.inf
        self._drifts: deque[tuple[float, float]] = deque()
        self._drift_begun = 0

    def check_pointing(self, pose: Pose, commanded_rad: float | None) -> Violation | None:
        """Tell whether the nose has been off its command, so that the sensor looks elsewhere.

        Args:
            pose: heading, and when.
            commanded_rad: where it has to point; None while the vehicle turns there.
        """
        error_rad = 0.0 if commanded_rad is None else abs(wrap_angle(pose.yaw_rad - commanded_rad))
        if not self._astray.update(pose.time_s, exceeded=error_rad > POINTING_TOLERANCE_RAD):
            return None
        return _violation(error_rad, POINTING_TOLERANCE_RAD, "pointing")

    def check_compass(self, ratio: float | None, now_s: float) -> Violation | None:
        """Tell whether the estimator has been rejecting the magnetometer.

        Args:
            ratio: its innovation to the gate; None if the autopilot does not report it.
            now_s: the time.
        """
        exceeded = ratio is not None and ratio > COMPASS_RATIO_MAX
        if not self._rejected.update(now_s, exceeded=exceeded) or ratio is None:
            return None
        return Violation(Assumption.HEADING_ERROR, ratio, COMPASS_RATIO_MAX, "of gate", "compass")

    def check_drift(
        self, drift: HeadingDrift, now_s: float, terms: Terms[float]
    ) -> Violation | None:
        """Tell whether the estimate has turned against the gyros, from one side to the other.

        Never where no heading error is declared: boxes are then placed by another heading than the
        autopilot's, and real estimates swing by several degrees without any harm to them.

        Args:
            drift: what it has turned beyond them so far.
            now_s: the time.
            terms: of the contract.
        """
        if terms.heading_error_rad == 0.0:
            return None
        drifts = self._drifts
        if drift.begun != self._drift_begun:
            self._drift_begun = drift.begun
            drifts.clear()
        if drifts and now_s - drifts[-1][0] < _DRIFT_STEP_S:
            return None
        drifts.append((now_s, drift.drift_rad))
        while now_s - drifts[0][0] > DRIFT_WINDOW_S:
            drifts.popleft()
        sums_rad = [drift_rad for _, drift_rad in drifts]
        swing_rad = max(sums_rad) - min(sums_rad)
        limit_rad = 2.0 * terms.heading_error_rad + DRIFT_TOLERANCE_RAD
        return _violation(swing_rad, limit_rad, "gyros") if swing_rad > limit_rad else None

    def on_sightings(
        self, residuals: Sequence[BearingResidual], now_s: float, terms: Terms[float]
    ) -> Violation | None:
        """Take the residuals of the well-known tracks in one frame from the body.

        A heading that is wrong turns all of them alike, so their mean counts.  The heading of now
        and the one with which the tracks were placed may each be off by the contract's error.
        """
        if not residuals:
            return None
        if now_s - self._sighted_s > SIGHTING_GAP_S:
            self._turned = _Confirmation(SIGHTING_CONFIRMATION_S)
        self._sighted_s = now_s
        turned_rad = abs(sum(residual.angle_rad for residual in residuals)) / len(residuals)
        explained_rad = sum(residual.error_rad for residual in residuals) / len(residuals)
        limit_rad = 2.0 * terms.heading_error_rad + SIGHTING_TOLERANCE_RAD + explained_rad
        if not self._turned.update(now_s, exceeded=turned_rad > limit_rad):
            return None
        return _violation(turned_rad, limit_rad, "sightings")


def _violation(measured_rad: float, limit_rad: float, subject: str) -> Violation:
    return Violation(
        Assumption.HEADING_ERROR, math.degrees(measured_rad), math.degrees(limit_rad), "°", subject
    )
