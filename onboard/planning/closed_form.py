"""Trajectories from formulas: the vertex manoeuvre (Theorem 1), braking, cruising, arriving.

They need no solver and exist wherever the contract holds; they cost more than the plans of the QP,
which the planner therefore tries first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from onboard.contract.agility import GRAVITY_MPS2
from onboard.motion.axis_profile import (
    AxisLimits,
    AxisState,
    Profile,
    Segment,
    coasting_speed,
    cut,
    displacement,
    largest,
    speed_change,
)
from onboard.motion.trajectory import Trajectory, X, Y, Z
from onboard.planning.problem import cost

if TYPE_CHECKING:
    from onboard.motion.trajectory import State
    from onboard.planning.problem import AvoidanceProblem, Envelope, Side, Sidestep

# Starts exactly on a boundary must not fail on round-off; half of what the certifier tolerates.
_SLACK_M = 5e-7
_SLACK_S = 1e-9

# Lateral speeds tried between the least and the greatest that fit the lane.
_LATERAL_SPEEDS = 3

# Shares of the greatest speed before the face that are tried when the exit speed comes too late.
_SLOWER = (1.0, 0.75, 0.5, 0.25, 0.0)

# A drift builds up its speed in about this time, and its acceleration in that: longer than any lag.
_DRIFT_RISE_S = 1.0
_DRIFT_RAMP_S = 0.25

# Duration of the piece that stands for a hover.
_HOVER_S = 1.0


def vertex_manoeuvre(problem: AvoidanceProblem, side: Side) -> Trajectory | None:
    """Brake, sidestep with full input, speed up again: the cheapest of a family of one parameter.

    Sideways: build up speed to a peak, then stop beyond the face.  Along the leg: slow down so as
    to reach the front face when the side face is cleared, not before, then regain the exit speed.
    With unlimited jerk these are the constant inputs at the vertices of W of Theorem 1.

    Returns:
        None if no member of the family stays in the lane, short of the front face until clear,
        and at its exit speed by the post-obstacle border.
    """
    vertical = _settling(problem.start.axis(Z), problem.envelope, None)
    share = _share_of_box(vertical)
    sidestep = problem.sidestep(side)
    family = _LateralFamily(sidestep, sidestep.limits.scaled(share))
    slow_down = _SlowDown(problem, problem.envelope.along.scaled(share))
    found: list[Trajectory] = []
    for peak_mps in family.peak_speeds_mps():
        lateral = family.profile(peak_mps)
        along = _profile_along(slow_down, family.clear_from_s(lateral), lateral.duration_s)
        if along is not None:
            y = lateral if side == "right" else _mirrored(lateral)
            found.append(Trajectory.from_profiles(problem.start_s, along, y, vertical))
    return min(found, key=lambda trajectory: cost(trajectory, problem), default=None)


def brake_to_hover(start: State, start_s: float, envelope: Envelope) -> Trajectory:
    """Stop on every axis as fast as the envelope allows, then hover."""
    return cruise(start, start_s, envelope, 0.0)


def cruise(
    start: State, start_s: float, envelope: Envelope, speed_mps: float, *, z_m: float | None = None
) -> Trajectory:
    """Take up a speed along the leg and keep it; come to rest sideways and in height.

    Args:
        start: state to continue.
        start_s: absolute time of ``start``.
        envelope: what the vehicle can be asked to fly.
        speed_mps: speed along the leg to hold after the last piece.
        z_m: height to settle at, z in the leg frame; by default where the climb or descent stops.
    """
    vertical = _settling(start.axis(Z), envelope, z_m)
    share = _share_of_box(vertical)
    along = speed_change(start.axis(X), speed_mps, _cruise_limits(envelope, share))
    return _from_segments(start, start_s, envelope, along, vertical)


def stop_at(
    start: State,
    start_s: float,
    envelope: Envelope,
    x_m: float,
    speed_mps: float,
    *,
    z_m: float | None = None,
    recentring_mps: float = 0.0,
) -> Trajectory | None:
    """Fly along the leg at up to ``speed_mps`` and come to rest at ``x_m``, then hover.

    Args:
        start: state to continue.
        start_s: absolute time of ``start``.
        envelope: what the vehicle can be asked to fly.
        x_m: where to stop.
        speed_mps: highest speed along the leg.
        z_m: height to settle at, as for `cruise`.
        recentring_mps: highest lateral speed of a drift back to the leg line; 0 to come to rest
            sideways instead.

    Returns:
        None if the vehicle cannot stop before it has passed ``x_m``.
    """
    vertical = _settling(start.axis(Z), envelope, z_m)
    x, limits = start.axis(X), _cruise_limits(envelope, _share_of_box(vertical))
    if x.after(speed_change(x, 0.0, limits)).position_m > x_m:
        return None
    along = displacement(x, x_m, speed_mps, limits)
    return _from_segments(start, start_s, envelope, along, vertical, recentring_mps)


def _cruise_limits(envelope: Envelope, box_share: float) -> AxisLimits:
    """Full braking, but only half the forward acceleration.

    An obstacle may come up while the vehicle still speeds up.  The attitude lag T in the contract
    covers two ramps of T/2: taking off half the acceleration, and building up full braking
    (tests/onboard/planning/test_closed_form.py, the varieties that are speeding up).
    """
    limits = envelope.along.scaled(box_share)
    return limits._replace(acceleration_max_mps2=limits.acceleration_max_mps2 / 2.0)


def _from_segments(
    start: State,
    start_s: float,
    envelope: Envelope,
    along: tuple[Segment, ...],
    vertical: Profile,
    recentring_mps: float = 0.0,
) -> Trajectory:
    """Put a motion along the leg together with coming to rest sideways, on the line or anywhere.

    A drift uses half the lateral limits at most, as speeding up does and for the same reason.
    """
    y, across = start.axis(Y), envelope.across.scaled(_share_of_box(vertical))
    if recentring_mps > 0.0:
        gentle = _drift_limits(across, recentring_mps)
        sideways = displacement(y, 0.0, recentring_mps, gentle)
    else:
        sideways = speed_change(y, 0.0, across)
    return Trajectory.from_profiles(
        start_s,
        Profile(*start.axis(X)[:2], (*along, Segment(_HOVER_S, 0.0))),
        Profile(*y[:2], sideways),
        vertical,
    )


def _drift_limits(across: AxisLimits, speed_mps: float) -> AxisLimits:
    """Limits with which a drift is begun and ended where time is of no importance.

    With full acceleration so small a speed is reached before the attitude is: the vehicle
    overshoots it, by more than the contract allows (config/scenarios/recentring.yaml).
    """
    half, gentle_mps2 = across.scaled(0.5), speed_mps / _DRIFT_RISE_S
    return AxisLimits(
        max(half.acceleration_min_mps2, -gentle_mps2),
        min(half.acceleration_max_mps2, gentle_mps2),
        min(half.jerk_max_mps3, gentle_mps2 / _DRIFT_RAMP_S),
    )


def _settling(z: AxisState, envelope: Envelope, z_m: float | None) -> Profile:
    """Come to rest in height, at ``z_m`` where that is given."""
    limits = envelope.vertical
    if z_m is None:
        return Profile(*z[:2], speed_change(z, 0.0, limits))
    return Profile(*z[:2], displacement(z, z_m, envelope.speed_max_mps, limits))


def _share_of_box(vertical: Profile) -> float:
    """Part of W that is left at the greatest downward acceleration of a motion in height."""
    starts_mps2 = [segment.acceleration_mps2 for segment in vertical.segments]
    return 1.0 - max(0.0, *starts_mps2) / GRAVITY_MPS2 if starts_mps2 else 1.0


@dataclass(frozen=True)
class _LateralFamily:
    """Lateral profiles, one for each peak speed."""

    sidestep: Sidestep
    limits: AxisLimits

    @property
    def start(self) -> AxisState:
        return self.sidestep.start

    def profile(self, peak_mps: float) -> Profile:
        """Go to a peak speed and from it to rest; hold it in between if that is too short."""
        rising = Profile(*self.start[:2], speed_change(self.start, peak_mps, self.limits))
        at_peak = AxisState(0.0, rising.final.velocity_mps, 0.0)
        stopping = speed_change(at_peak, 0.0, self.limits)
        direct = rising.then(*stopping)
        end_m = direct.final.position_m
        if end_m >= self.sidestep.face_m or peak_mps <= 0.0:
            return direct
        return rising.then(Segment((self.sidestep.lane_m - end_m) / peak_mps, 0.0), *stopping)

    def end_m(self, peak_mps: float) -> float:
        """Where going to a peak speed and to rest ends without a hold; grows with the peak."""
        rising = self.start.after(speed_change(self.start, peak_mps, self.limits))
        return rising.after(speed_change(rising, 0.0, self.limits)).position_m

    def peak_speeds_mps(self) -> list[float]:
        """Peak speeds whose profiles end beyond the face and inside the lane."""
        width_m = max(self.sidestep.lane_m - self.start.position_m, 0.0)
        ceiling_mps = math.sqrt(2.0 * width_m * -self.limits.acceleration_min_mps2)
        ceiling_mps = min(
            max(ceiling_mps, self.start.velocity_mps, 0.0), self.sidestep.speed_max_mps
        )
        greatest_mps = largest(
            lambda peak_mps: self.end_m(peak_mps) - self.sidestep.lane_m - _SLACK_M,
            0.0,
            ceiling_mps,
        )
        if greatest_mps is None:
            return []
        least_mps = largest(
            lambda peak_mps: self.end_m(peak_mps) - self.sidestep.face_m, 0.0, greatest_mps
        )
        span_mps = greatest_mps - (least_mps or 0.0)
        return [greatest_mps - span_mps * i / _LATERAL_SPEEDS for i in range(_LATERAL_SPEEDS)]

    def clear_from_s(self, lateral: Profile) -> float:
        """Time from which a profile that ends beyond the face stays beyond it."""
        crossing_s = lateral.last_time_at_s(self.sidestep.face_m)
        if crossing_s is not None:
            return crossing_s
        return 0.0 if self.start.position_m >= self.sidestep.face_m else lateral.duration_s


@dataclass(frozen=True)
class _SlowDown:
    """The half along the leg: slow down to a low speed, and regain the exit speed in the end."""

    problem: AvoidanceProblem
    limits: AxisLimits

    @property
    def start(self) -> AxisState:
        return self.problem.start.axis(X)

    @property
    def coasting_mps(self) -> float:
        return max(0.0, coasting_speed(self.start, self.limits.jerk_max_mps3))

    def position_at(self, low_mps: float, time_s: float) -> float:
        """Where slowing down (or speeding up) to a low speed and keeping it has led by a time."""
        return self.released(low_mps, time_s).position_m

    def released(self, low_mps: float, release_s: float) -> AxisState:
        """State at the release, which may come in the middle of the slowing down."""
        return self.start.after(self.until_release(low_mps, release_s))

    def until_release(self, low_mps: float, release_s: float) -> tuple[Segment, ...]:
        """Slow down as quickly as the limits allow and keep the low speed, until the release."""
        return cut(speed_change(self.start, low_mps, self.limits), release_s)

    def after_release(self, released: AxisState) -> tuple[Segment, ...]:
        """Take up the exit speed."""
        return speed_change(released, self.problem.exit_speed_mps, self.limits)

    def arrival_s(self, low_mps: float, release_s: float) -> float:
        """When the vehicle is at the post-obstacle border.

        Extrapolated at exit speed, backwards too if that is regained beyond the border, which
        makes it fall monotonically with the low speed.
        """
        released = self.released(low_mps, release_s)
        segments = self.after_release(released)
        left_m = self.problem.region.x_pob_m - released.after(segments).position_m
        regained_s = release_s + sum(segment.duration_s for segment in segments)
        return regained_s + left_m / self.problem.exit_speed_mps

    def profile(self, low_mps: float, release_s: float) -> Profile | None:
        """Return the whole profile up to the border; None if it comes before the exit speed."""
        slowing = self.until_release(low_mps, release_s)
        regaining = self.after_release(self.start.after(slowing))
        profile = Profile(*self.start[:2], slowing + regaining)
        left_m = self.problem.region.x_pob_m - profile.final.position_m
        if left_m < -_SLACK_M:
            return None
        return profile.then(Segment(max(left_m, 0.0) / self.problem.exit_speed_mps, 0.0))


def _profile_along(slow_down: _SlowDown, clear_s: float, settled_s: float) -> Profile | None:
    """Slow down as little as the front face and the end of the sidestep ask for.

    PAPER: the paper's policy brakes at the vertex of W throughout, which reverses for v < V; here
    the low speed is never negative (erratum 10): shown by
    tests/onboard/planning/test_closed_form.py::test_never_reverses_from_any_speed.
    """
    problem = slow_down.problem
    highest_mps = max(slow_down.coasting_mps, problem.exit_speed_mps)
    if clear_s > 0.0:
        front_m = problem.region.keep_out.x_min_m + _SLACK_M
        speed_mps = largest(
            lambda low_mps: slow_down.position_at(low_mps, clear_s) - front_m, 0.0, highest_mps
        )
        if speed_mps is None:
            return None
        highest_mps = speed_mps
    low_mps = largest(
        lambda low_mps: settled_s - slow_down.arrival_s(low_mps, clear_s), 0.0, highest_mps
    )
    if low_mps is None:
        # Even the slowest approach comes too early: keep braking beyond the front face.
        early_s = largest(
            lambda early_s: settled_s - slow_down.arrival_s(0.0, settled_s - early_s),
            0.0,
            settled_s - clear_s,
        )
        return None if early_s is None else slow_down.profile(0.0, settled_s - early_s)
    # Slower still leaves more room to speed up in, if the wait at the face is long.
    for share in _SLOWER:
        along = slow_down.profile(share * low_mps, clear_s)
        if along is not None:
            return along
    return None


def _mirrored(profile: Profile) -> Profile:
    """Exchange left and right."""
    segments = (Segment(d, -a, -j) for d, a, j in profile.segments)
    return Profile(-profile.position_m, -profile.velocity_mps, tuple(segments))
