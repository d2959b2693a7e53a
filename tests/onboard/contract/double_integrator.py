"""A slow, obvious simulator of the paper's vehicle (Eq. 5), to hold the closed forms against.

Two double integrators behind a dead time, in small steps, for many vehicles at once.  It knows the
limits, the obstacle and the policy of Theorem 1 (coast, brake and swerve, speed up again), and none
of the formulas of `onboard.contract.region`.

Arrays have one entry per vehicle; x points along the leg, y to its right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onboard.contract.agility import AccelerationLimits
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray

BoolArray = NDArray[np.bool_]


@dataclass
class Start:
    """Where vehicles are when they are first told about an obstacle."""

    x_m: FloatArray
    y_m: FloatArray
    speed_mps: FloatArray
    drift_mps: FloatArray


@dataclass
class Flight:
    """What became of them.

    Attributes:
        touched: whether a vehicle was ever inside the obstacle.
        leftmost_m, rightmost_m: extremes of y.
        recovered_x_m: x at which the entry speed was back and the lateral speed gone; infinite if
            that never happened.
        backwards: whether a vehicle ever flew backwards.
    """

    touched: BoolArray
    leftmost_m: FloatArray
    rightmost_m: FloatArray
    recovered_x_m: FloatArray
    backwards: BoolArray


@dataclass(frozen=True)
class Loss:
    """The setpoint stream stops: velocity is kept, then both axes brake (theory H)."""

    at_s: FloatArray
    coast_s: float


def time_to_pass(distance_m: FloatArray, speed_mps: FloatArray, limit_mps2: float) -> FloatArray:
    """Time until a face is passed for good at full input towards it; 0 if it is never met.

    ``distance_m`` to the face and ``speed_mps`` count towards it; negative distances are beyond.
    """
    square = speed_mps * speed_mps + 2.0 * limit_mps2 * distance_m
    passing_s = (np.sqrt(np.maximum(square, 0.0)) - speed_mps) / limit_mps2
    return np.where(square > 0.0, np.maximum(passing_s, 0.0), 0.0)


def braking_way(speed_mps: FloatArray, brake_mps2: float, time_s: FloatArray) -> FloatArray:
    """Way made in ``time_s`` of full braking; the vehicle stands once it has stopped."""
    moving_s = np.minimum(time_s, speed_mps / brake_mps2)
    return (speed_mps + (speed_mps - brake_mps2 * moving_s)) / 2.0 * moving_s


def steps_of_notice(limits: AccelerationLimits) -> float:
    """How many steps before the last moment the policy engages."""
    return 2.0 * (1.0 + lopsidedness(limits))


def lopsidedness(limits: AccelerationLimits) -> float:
    """How much stronger the vehicle is to one side than to the other."""
    left, right = limits.left_mps2, limits.right_mps2
    return max(left / right, right / left)


def fly(
    start: Start,
    obstacle: Box,
    limits: AccelerationLimits,
    *,
    step_s: float,
    lag_s: float = 0.0,
    keep_clear_m: float = 0.0,
    loss: Loss | None = None,
    duration_s: float = 60.0,
) -> Flight:
    """Fly the policy of Theorem 1 round an obstacle.

    Args:
        start: one entry per vehicle.
        obstacle: what must not be touched.
        limits: full inputs.
        step_s: of the simulation; inputs are held in between.
        lag_s: dead time between an input and its effect, a multiple of ``step_s`` or nearly.
        keep_clear_m: avoid as if the obstacle began that much earlier (theory H).
        loss: when the stream stops, if it does.
        duration_s: what has not recovered by then never does.
    """
    vehicles = _Vehicles(start, obstacle, limits, step_s, lag_s, keep_clear_m)
    inside = np.zeros(len(start.x_m), dtype=bool)
    backwards = np.zeros_like(inside)
    leftmost_m, rightmost_m = start.y_m.copy(), start.y_m.copy()
    recovered_x_m = np.full(len(start.x_m), np.inf)
    for number in range(round(duration_s / step_s)):
        vehicles.decide()
        if loss is not None:
            vehicles.lose(number * step_s, loss)
        vehicles.move()
        x_m, y_m, speed_mps, _ = vehicles.true
        inside |= (
            (x_m > obstacle.x_min_m)
            & (x_m < obstacle.x_max_m)
            & (y_m > obstacle.y_min_m)
            & (y_m < obstacle.y_max_m)
        )
        backwards |= speed_mps < -1e-9
        leftmost_m, rightmost_m = np.minimum(leftmost_m, y_m), np.maximum(rightmost_m, y_m)
        recovered_x_m = np.where(
            vehicles.has_recovered() & np.isinf(recovered_x_m), x_m, recovered_x_m
        )
        if loss is None and np.isfinite(recovered_x_m).all():
            break
        if loss is not None and (np.abs(vehicles.true[2:]) < 1e-9).all():
            break
    return Flight(inside, leftmost_m, rightmost_m, recovered_x_m, backwards)


class _Vehicles:
    """State of all vehicles, and the policy that flies them.

    The policy knows which inputs are on their way.  ``coming`` is the state in which they will
    have acted: it obeys the inputs at once, and the true state follows it by the dead time.
    """

    def __init__(
        self,
        start: Start,
        obstacle: Box,
        limits: AccelerationLimits,
        step_s: float,
        lag_s: float,
        keep_clear_m: float,
    ) -> None:
        self.obstacle, self.limits, self.step_s = obstacle, limits, step_s
        self.front_m = obstacle.x_min_m - keep_clear_m
        self.entry_mps = start.speed_mps
        self.true = np.array([start.x_m, start.y_m, start.speed_mps, start.drift_mps])
        self.pending = [np.zeros((2, len(start.x_m))) for _ in range(round(lag_s / step_s))]
        self.coming = self.true.copy()
        self.coming[:2] += self.coming[2:] * len(self.pending) * step_s
        self.side = np.zeros_like(start.x_m)  # 1 right, -1 left, 0 not decided
        self.crossed = np.zeros(len(start.x_m), dtype=bool)
        self.brake_on_s = np.zeros_like(start.x_m)
        self.peak_mps = np.zeros_like(start.x_m)

    def decide(self) -> None:
        """Choose the input of this step, as Theorem 1 does."""
        self._begin()
        self._cross()
        along_mps, lateral_mps = self.coming[2:]
        engaged = self.side != 0.0
        # Sideways: to rest before and after; in between push, but no faster than the lane allows.
        pushing_mps = np.where(self.crossed, 0.0, self.side * self.peak_mps)
        # Along: brake until clear, and on for as long as the lateral speed outlasts the deficit.
        braking = engaged & (~self.crossed | (self.brake_on_s > 0.0))
        self.brake_on_s = self.brake_on_s - np.where(self.crossed, self.step_s, 0.0)
        wanted_mps = np.array([np.where(braking, 0.0, self.entry_mps), pushing_mps])
        self.input = self._limited(wanted_mps - [along_mps, lateral_mps])

    def _limited(self, change_mps: FloatArray) -> FloatArray:
        limits, wanted_mps2 = self.limits, change_mps / self.step_s
        least = np.array([[-limits.brake_mps2], [-limits.left_mps2]])
        most = np.array([[limits.forward_mps2], [limits.right_mps2]])
        return np.clip(wanted_mps2, least, most)

    def _begin(self) -> None:
        """Engage at the last moment: a few more steps of waiting, and it would be too late.

        Waiting, the vehicle also brakes its drift, which puts off the time of clearing by up to
        the ratio of the limits for every step.
        """
        x_m, y_m, along_mps, lateral_mps = self.coming
        right_m, left_m = self.obstacle.y_max_m - y_m, y_m - self.obstacle.y_min_m
        right_s = time_to_pass(right_m, lateral_mps, self.limits.right_mps2)
        left_s = time_to_pass(left_m, -lateral_mps, self.limits.left_mps2)
        clear_s = np.minimum(right_s, left_s)
        way_m = braking_way(along_mps, self.limits.brake_mps2, clear_s)
        soon_m = along_mps * steps_of_notice(self.limits) * self.step_s
        begins = (self.side == 0.0) & (x_m + way_m + soon_m >= self.front_m)
        nearer = np.where(right_s <= left_s, 1.0, -1.0)
        push_mps2 = np.where(nearer > 0.0, self.limits.right_mps2, self.limits.left_mps2)
        # Where there is time to stop, the sidestep is no faster than it could have been gained.
        pushed_s = np.minimum(clear_s, along_mps / self.limits.brake_mps2)
        gained_mps = np.maximum(pushed_s, self.step_s) * push_mps2
        peak_mps = np.maximum(nearer * lateral_mps, 0.0) + gained_mps
        self.side = np.where(begins, nearer, self.side)
        self.peak_mps = np.where(begins, peak_mps, self.peak_mps)

    def _cross(self) -> None:
        """Notice, on the true position, that the side face is cleared."""
        _, y_m, _, lateral_mps = self.true
        beyond = np.where(
            self.side > 0.0,
            (y_m >= self.obstacle.y_max_m) & (lateral_mps >= 0.0),
            (y_m <= self.obstacle.y_min_m) & (lateral_mps <= 0.0),
        )
        crosses = (self.side != 0.0) & beyond & ~self.crossed
        stop_mps2 = np.where(self.side > 0.0, self.limits.left_mps2, self.limits.right_mps2)
        settle_s = np.abs(self.coming[3]) / stop_mps2
        b, a, left_mps = self.limits.brake_mps2, self.limits.forward_mps2, self.coming[2]
        on_s = (settle_s - (self.entry_mps - left_mps) / a) / (1.0 + b / a)
        # Once stopped, wait until speeding up takes as long as the lateral speed lasts.
        on_s = np.where(on_s > left_mps / b, settle_s - self.entry_mps / a, on_s)
        self.brake_on_s = np.where(crosses, on_s, self.brake_on_s)
        self.crossed |= crosses

    def lose(self, now_s: float, loss: Loss) -> None:
        """Replace the input by what the autopilot does on its own."""
        lost, braking = now_s >= loss.at_s, now_s >= loss.at_s + loss.coast_s
        alone = np.where(braking, self._limited(-self.coming[2:]), 0.0)
        self.input = np.where(lost, alone, self.input)

    def move(self) -> None:
        """Advance by one step; the input acts after the dead time."""
        self.pending.append(self.input)
        for state, acceleration in ((self.coming, self.input), (self.true, self.pending.pop(0))):
            state[:2] += state[2:] * self.step_s + acceleration * self.step_s**2 / 2.0
            state[2:] += acceleration * self.step_s

    def has_recovered(self) -> BoolArray:
        """Whether the entry speed is back and the lateral speed gone, clear of the obstacle."""
        tiny_mps = 1e-6
        recovered: BoolArray = (
            self.crossed
            & (np.abs(self.true[2] - self.entry_mps) < tiny_mps)
            & (np.abs(self.true[3]) < tiny_mps)
        )
        return recovered
