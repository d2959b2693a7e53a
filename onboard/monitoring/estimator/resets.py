"""Resets of the autopilot's estimator: detected on all three axes, measured and added up.

A reset moves the vehicle in the local frame, not in the world.  Everything stated in the frame
before it (boxes, past poses, the reference) keeps its place in the world only if it moves by the
same vector.  Distances between what has moved do not change, so certificates stay valid.  The
mission does not move: it is stated in the local frame as it is now.

A flight may go on across resets that the contract declares (`estimator_reset_max_m`).  Their sum
since the departure counts, not each alone: by that much the legs flown may lie beside the legs
planned in the world, and many small steps are a drift.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from onboard.contract.assessment import TICK_S
from onboard.events import Event, EventData, EventName, Severity
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.vehicle_state import AUTOPILOT_SILENCE_S, Pose

# Positions and velocities of real estimators disagree by up to 0.04 m from one message to the next
# (0.2 m while dead-reckoning without GPS); an obstacle's place must not be off by much more.
POSITION_JUMP_M: Final = 0.35
# What acceleration may add to the mean of two velocities: a dt² / 8, for an agile vehicle.
_ACCELERATION_MAX_MPS2: Final = 10.0
# After a longer silence a reset cannot be told from motion, nor its size; then this is too far.
CONTINUITY_S: Final = 0.5
_JUMP_AFTER_SILENCE_M: Final = 0.5
# A larger step is not believed either: moved there and back, a map would lose its digits.
_SHIFT_MAX_M: Final = 1e4
# The autopilot's clock is used across such a step; beyond, it has restarted or wrapped.
_OWN_STEP_MAX_S: Final = 2.0
# A sensor that reports in the local frame learns of a reset this much earlier or later than we do.
SENSOR_FRAME_TOLERANCE_S: Final = 0.1
_RESETS_REMEMBERED: Final = 100

Vector = tuple[float, float, float]


class EstimatorReset(NamedTuple):
    """One jump of the estimate.

    Attributes:
        before_s, after_s: when the poses before and after it arrived.
        shift_ned_m: by which vector the estimate moved beyond the motion of the vehicle.
        measured: whether that vector is known; not after a silence, and not if absurd.
    """

    before_s: float
    after_s: float
    shift_ned_m: Vector
    measured: bool

    @property
    def size_m(self) -> float:
        """How far the estimate moved."""
        return math.hypot(*self.shift_ned_m)

    @property
    def axis(self) -> str:
        """Which part of the position moved most."""
        north_m, east_m, down_m = self.shift_ned_m
        return "vertical" if abs(down_m) > math.hypot(north_m, east_m) else "horizontal"

    def violation(self) -> Violation:
        """Return the violation that a reset is where the contract declares none."""
        return Violation(Assumption.ESTIMATOR_RESET, self.size_m, POSITION_JUMP_M, "m", self.axis)


class PoseMonitor:
    """Whether the position is recent, and continues the one before on all three axes.

    Args:
        telemetry_timeout_s: older telemetry is ignored.
    """

    def __init__(self, telemetry_timeout_s: float) -> None:
        self._telemetry_timeout_s = telemetry_timeout_s
        self._previous: Pose | None = None

    def check_age(self, pose: Pose | None, now_s: float, heard_s: float) -> Violation | None:
        """Tell whether the position or the latest heartbeat, of ``heard_s``, is too old."""
        age_s = now_s - pose.time_s if pose is not None else math.inf
        if age_s > self._telemetry_timeout_s:
            return Violation(Assumption.TELEMETRY_AGE, age_s, self._telemetry_timeout_s, "s")
        silent_s = now_s - heard_s
        if silent_s <= AUTOPILOT_SILENCE_S:
            return None
        note = "no heartbeat of the autopilot"
        return Violation(Assumption.TELEMETRY_AGE, silent_s, AUTOPILOT_SILENCE_S, "s", note=note)

    def check_jump(self, pose: Pose) -> EstimatorReset | None:
        """Tell whether the estimator, not the motors, moved the vehicle since the last pose."""
        previous, self._previous = self._previous, pose
        if previous is None:
            return None
        step_s = _step_s(previous, pose)
        shift_ned_m = _beyond_motion(previous, pose, step_s)
        silence_s = max(abs(step_s), pose.time_s - previous.time_s)
        measured = silence_s <= CONTINUITY_S and math.hypot(*shift_ned_m) <= _SHIFT_MAX_M
        allowed_m = POSITION_JUMP_M + _ACCELERATION_MAX_MPS2 * step_s**2 / 8.0
        reset = EstimatorReset(previous.time_s, pose.time_s, shift_ned_m, measured)
        return reset if reset.size_m > (allowed_m if measured else _JUMP_AFTER_SILENCE_M) else None


def _step_s(previous: Pose, pose: Pose) -> float:
    """Return the time between two poses: by the autopilot's clock, which no link delays, if sane.

    Negative where the link delivered the later pose first.
    """
    if previous.measured_s is not None and pose.measured_s is not None:
        own_s = pose.measured_s - previous.measured_s
        if 0.0 < abs(own_s) <= _OWN_STEP_MAX_S:
            return own_s
    return max(pose.time_s - previous.time_s, TICK_S)


def _beyond_motion(previous: Pose, pose: Pose, step_s: float) -> Vector:
    """Return how far a pose lies from where the mean of both velocities leads."""
    north_m, east_m, down_m = (
        now_m - before_m - (before_mps + now_mps) / 2.0 * step_s
        for before_m, now_m, before_mps, now_mps in zip(
            previous.position_ned_m,
            pose.position_ned_m,
            previous.velocity_ned_mps,
            pose.velocity_ned_mps,
            strict=True,
        )
    )
    return north_m, east_m, down_m


class ResetLedger:
    """The resets so far: those still to respond to, their vectors for late frames, their sum."""

    def __init__(self) -> None:
        self._pending: list[EstimatorReset] = []
        self._past: deque[EstimatorReset] = deque(maxlen=_RESETS_REMEMBERED)
        self._flight_m = 0.0

    def add(self, reset: EstimatorReset) -> None:
        """Remember a reset until it is taken, and its vector for frames still to come."""
        self._pending.append(reset)
        if reset.measured:
            self._past.append(reset)

    def take_pending(self) -> list[EstimatorReset]:
        """Return and forget the resets since the last call."""
        pending, self._pending = self._pending, []
        return pending

    def begin_flight(self) -> None:
        """Count from here: a flight departs."""
        self._flight_m = 0.0

    def count(self, reset: EstimatorReset, bound_m: float) -> Violation | None:
        """Count a reset in flight.

        Args:
            reset: what happened.
            bound_m: the contract's `estimator_reset_max_m`.

        Returns:
            What ends the flight: a reset of unknown size, or more than the contract declares since
            the departure; None if the flight may go on.
        """
        self._flight_m += reset.size_m
        if reset.measured and self._flight_m <= bound_m:
            return None
        limit_m = max(bound_m, POSITION_JUMP_M)
        measured_m = max(self._flight_m, reset.size_m)
        return Violation(Assumption.ESTIMATOR_RESET, measured_m, limit_m, "m", reset.axis)

    def event(self, reset: EstimatorReset, obstacles: int, now_s: float) -> Event:
        """Return the event that states what has moved, and the sum of the resets so far."""
        north_m, east_m, down_m = reset.shift_ned_m
        text = (
            f"estimator reset by ({north_m:.2f}, {east_m:.2f}, {down_m:.2f}) m: reference, plan, "
            f"{obstacles} obstacles and past poses moved along; {self._flight_m:.2f} m so far"
        )
        data: EventData = {"shift_ned_m": reset.shift_ned_m, "flight_m": self._flight_m}
        return Event(now_s, EventName.ESTIMATOR_RESET, Severity.NOTICE, text, data)

    def placements_m(self, stamp_s: float) -> list[tuple[float, float]]:
        """Return what moves boxes stated in the local frame at a time into the present one.

        Returns:
            Vectors north and east: one, or several where it is open which resets the
            sensor knew of.
        """
        tolerance_s = SENSOR_FRAME_TOLERANCE_S
        heard = sum(reset.after_s + tolerance_s < stamp_s for reset in self._past)
        perhaps = sum(reset.before_s - tolerance_s <= stamp_s for reset in self._past)
        shifts_m = [reset.shift_ned_m for reset in self._past]
        return [
            (sum(m[0] for m in shifts_m[first:]), sum(m[1] for m in shifts_m[first:]))
            for first in range(heard, perhaps + 1)
        ]

    def are_all_heard(self, stamp_s: float) -> bool:
        """Tell whether boxes stated in the local frame at a time are in the present one.

        Where that is open, their heights are: `placements_m` moves them horizontally only.
        """
        return all(reset.after_s + SENSOR_FRAME_TOLERANCE_S < stamp_s for reset in self._past)
