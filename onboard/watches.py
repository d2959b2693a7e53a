"""Assumptions that only a history can show: silence, lateness, tracking, overruns.

Every watch takes the terms that hold now, since they may be re-solved in flight
(`onboard.adaptation`), and the time as an argument.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from onboard.agility import GRAVITY_MPS2
from onboard.contract import TICK_S, Terms
from onboard.mavlink import Pose, Target
from onboard.monitor import Assumption, Violation

# A frame from farther in the future than this has been stamped by a wrong clock.
CLOCK_TOLERANCE_S: Final = 0.1
# Consecutive poses beyond a tracking bound before it counts: one may be an estimator's glitch.
CONFIRMATIONS: Final = 3
# Ticks later than this are the computer's failure, not the scheduler's jitter.
TICK_OVERRUN_S: Final = 3.0 * TICK_S
# Acceleration below which tilt says nothing, alone and as a share of the agility: an agile vehicle
# does more than that against gusts.  And the share of it that must be there in time.
TILT_ASKED_MPS2: Final = 0.5
TILT_ASKED_SHARE: Final = 0.25
TILT_SHARE: Final = 0.4
# The autopilot itself takes this much back of what is asked for, to mend what a gust has done.
TILT_FEEDBACK_MPS2: Final = 0.8
TILT_PATIENCE_S: Final = 0.3
# Time constant with which the tilt that holds against the wind is learnt in cruise.
TRIM_TIME_S: Final = 1.0


# The autopilot's target may differ this much from ours, for rounding and for its own filters.
TARGET_TOLERANCE_M: Final = 0.15
# A mismatch must outlast a heartbeat, within this window.
HEARTBEAT_WAIT_S: Final = 1.2
ECHO_PATIENCE_S: Final = 0.15
MISMATCH_MEMORY_S: Final = 2.0


class DetectionWatch:
    """Age and lateness of what each sensor last saw; a sensor once heard is relied upon."""

    def __init__(self) -> None:
        self._newest_stamp_s: dict[str, float] = {}

    def age_s(self, now_s: float) -> float:
        """Time since the stalest sensor's newest frame was taken; infinite before the first."""
        return now_s - min(self._newest_stamp_s.values(), default=-math.inf)

    def on_frame(
        self, source: str, stamp_s: float, now_s: float, terms: Terms[float]
    ) -> list[Violation]:
        """Take a frame.

        One from the future is a clock fault and does not count as sight.  An obstacle may have
        come into range just after the frame before: what lies between that and now is how long a
        reaction can take.
        """
        ahead_s = stamp_s - now_s
        if ahead_s > CLOCK_TOLERANCE_S:
            fault = Violation(Assumption.SENSOR_CLOCK, ahead_s, CLOCK_TOLERANCE_S, "s", source)
            return [fault]
        previous_s = self._newest_stamp_s.get(source, stamp_s)
        self._newest_stamp_s[source] = max(previous_s, min(stamp_s, now_s))
        reaction_s, limit_s = now_s - previous_s, terms.reaction_time_s
        if stamp_s <= previous_s or reaction_s <= limit_s:
            return []
        return [Violation(Assumption.REACTION_TIME, reaction_s, limit_s, "s")]

    def check(self, now_s: float, terms: Terms[float]) -> Violation | None:
        """Tell whether a sensor has been silent for longer than the contract allows."""
        age_s = self.age_s(now_s)
        if age_s <= terms.frame_age_max_s:
            return None
        return Violation(Assumption.DETECTION_AGE, age_s, terms.frame_age_max_s, "s")


class TrackingWatch:
    """How well the vehicle follows its reference."""

    def __init__(self) -> None:
        self._streaks: dict[tuple[Assumption, str], int] = {}
        self.position_error_m = 0.0
        self.velocity_error_mps = (0.0, 0.0)

    def check(
        self,
        position_error_leg_m: tuple[float, float],
        velocity_leg_mps: tuple[float, float],
        reference_velocity_leg_mps: tuple[float, float],
        terms: Terms[float],
        *,
        cruising: bool,
    ) -> list[Violation]:
        """Hold one new pose against the tracking errors that the contract states.

        Args:
            position_error_leg_m: measured less reference, horizontal.
            velocity_leg_mps: measured, horizontal.
            reference_velocity_leg_mps: of the reference at that time.
            terms: the contract.
            cruising: outside every Region of Influence, where the velocity bound applies (paper,
                "Velocity Tracking Error").
        """
        self.position_error_m = math.hypot(*position_error_leg_m)
        self.velocity_error_mps = (
            abs(velocity_leg_mps[0] - reference_velocity_leg_mps[0]),
            abs(velocity_leg_mps[1] - reference_velocity_leg_mps[1]),
        )
        bounds = [
            (Assumption.TRACKING_ERROR, "", self.position_error_m, terms.tracking_error_m, "m")
        ]
        if cruising:
            # What endangers is flying faster than the contract's speed, or drifting faster than it
            # allows for; a velocity that only lags behind its reference does neither.
            excess_mps = velocity_leg_mps[0] - max(
                terms.cruise_speed_mps, reference_velocity_leg_mps[0]
            )
            sideways_mps = abs(velocity_leg_mps[1]) - terms.recentring_speed_mps
            bounds += [
                (Assumption.VELOCITY_ERROR, "x", excess_mps, terms.velocity_error_x_mps, "m/s"),
                (Assumption.VELOCITY_ERROR, "y", sideways_mps, terms.velocity_error_y_mps, "m/s"),
            ]
        return [
            Violation(assumption, measured, limit, unit, axis)
            for assumption, axis, measured, limit, unit in bounds
            if self._confirmed((assumption, axis), exceeded=measured > limit)
        ]

    def _confirmed(self, bound: tuple[Assumption, str], *, exceeded: bool) -> bool:
        self._streaks[bound] = self._streaks.get(bound, 0) + 1 if exceeded else 0
        return self._streaks[bound] >= CONFIRMATIONS


class TiltWatch:
    """Whether the attitude delivers the acceleration that is asked for.

    Tilt is read as acceleration in level flight, g tan; what holds against the wind is learnt
    while none is asked for, and taken off.
    """

    def __init__(self) -> None:
        self._trim_mps2 = (0.0, 0.0)
        self._lacking_since_s: float | None = None

    def check(
        self, pose: Pose, asked_frd_mps2: tuple[float, float], terms: Terms[float]
    ) -> Violation | None:
        """Hold the attitude against the horizontal acceleration asked for.

        Args:
            pose: attitude, and when.
            asked_frd_mps2: forward and right, of the reference one attitude lag ago.
            terms: the contract.
        """
        tilt_mps2 = (
            -GRAVITY_MPS2 * math.tan(pose.pitch_rad),
            GRAVITY_MPS2 * math.tan(pose.roll_rad),
        )
        asked_mps2 = math.hypot(*asked_frd_mps2)
        agility_mps2 = GRAVITY_MPS2 * math.tan(min(terms.roll_max_rad, terms.pitch_max_rad))
        if asked_mps2 < max(TILT_ASKED_MPS2, TILT_ASKED_SHARE * agility_mps2):
            share = TICK_S / TRIM_TIME_S if asked_mps2 < TILT_ASKED_MPS2 / 10.0 else 0.0
            self._trim_mps2 = (
                self._trim_mps2[0] + share * (tilt_mps2[0] - self._trim_mps2[0]),
                self._trim_mps2[1] + share * (tilt_mps2[1] - self._trim_mps2[1]),
            )
            self._lacking_since_s = None
            return None
        delivered_mps2 = (
            (tilt_mps2[0] - self._trim_mps2[0]) * asked_frd_mps2[0]
            + (tilt_mps2[1] - self._trim_mps2[1]) * asked_frd_mps2[1]
        ) / asked_mps2
        limit_mps2 = min(TILT_SHARE * asked_mps2, asked_mps2 - TILT_FEEDBACK_MPS2)
        if delivered_mps2 >= limit_mps2:
            self._lacking_since_s = None
            return None
        if self._lacking_since_s is None:
            self._lacking_since_s = pose.time_s
        if pose.time_s - self._lacking_since_s < TILT_PATIENCE_S + terms.attitude_lag_s:
            return None
        return Violation(Assumption.TILT_RESPONSE, delivered_mps2, limit_mps2, "m/s²")


class RivalWatch:
    """Whether the autopilot goes where we say; if not, somebody else commands it too.

    A mode that the pilot has just taken looks the same until the next heartbeat, so a mismatch
    must outlast that; commanders take turns, so it need not be without interruption.
    """

    def __init__(self) -> None:
        self._mismatches_s: deque[float] = deque()
        self._heard_s = -math.inf

    def suspects(self, now_s: float) -> bool:
        """Tell whether the autopilot's target is no longer ours, so that its error is not ours.

        Either its last target was another's, or it had targets and now has none.
        """
        if math.isinf(self._heard_s):
            return False
        another = bool(self._mismatches_s) and self._mismatches_s[-1] == self._heard_s
        age_s = now_s - self._heard_s
        return age_s < HEARTBEAT_WAIT_S and (another or age_s > ECHO_PATIENCE_S)

    def check(
        self, target_heard_s: float, target: Target, ours: Iterable[Target]
    ) -> Violation | None:
        """Hold the autopilot's target against what we have asked for of late.

        Args:
            target_heard_s: when the autopilot said where it is going.
            target: where that is, and how fast.
            ours: our setpoints until now, the newest first, as far back as the echo may lag.
        """
        if target_heard_s <= self._heard_s:
            return None
        away_m = _nearest(target, ours)
        if away_m is None:
            return None
        self._heard_s = target_heard_s
        if not away_m <= TARGET_TOLERANCE_M:  # a target without numbers is not ours either
            self._mismatches_s.append(target_heard_s)
        while self._mismatches_s and target_heard_s - self._mismatches_s[0] > MISMATCH_MEMORY_S:
            self._mismatches_s.popleft()
        lasting = len(self._mismatches_s) >= CONFIRMATIONS and (
            self._mismatches_s[-1] - self._mismatches_s[0] >= HEARTBEAT_WAIT_S
        )
        if not lasting:
            return None
        return Violation(Assumption.SECOND_COMMANDER, away_m, TARGET_TOLERANCE_M, "m")


def _nearest(target: Target, ours: Iterable[Target]) -> float | None:
    """Return how far the target is from the nearest of ours, or from the first that is near."""
    nearest_m = None
    for asked in ours:
        away_m = _away(target, asked)
        if away_m <= TARGET_TOLERANCE_M:
            return away_m
        nearest_m = away_m if nearest_m is None else min(nearest_m, away_m)
    return nearest_m


def _away(target: Target, asked: Target) -> float:
    """Return how far apart two targets are: horizontal metres, or m/s where that is more.

    Infinite where one of them has no numbers: whoever asked for no velocity, we did not.
    """
    position_m, velocity_mps = (math.dist(a[:2], b[:2]) for a, b in zip(target, asked, strict=True))
    away = max(position_m, velocity_mps)
    return away if math.isfinite(position_m + velocity_mps) else math.inf


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
