"""The problem of avoiding one obstacle (Eq. 17), as planner and certifier both receive it.

Everything is in the leg frame (x along the leg, y right, z down).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.motion.axis_profile import AxisLimits, AxisState
from onboard.motion.trajectory import X, Y, Z

if TYPE_CHECKING:
    from onboard.contract.region import RegionOfInfluence
    from onboard.geometry.keep_out import KeepOut
    from onboard.motion.trajectory import State, Trajectory, Vector

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

# A planner's choice, not a limit of the vehicle: descending faster would cost too much agility.
_DESCENT_SHARE_OF_GRAVITY = 0.1

# What a second of delay costs: as much as flying for a second with 1 m/s² [m²/s⁴].
DELAY_COST_M2PS4 = 1.0


@dataclass(frozen=True)
class Envelope:
    """Limits of what the vehicle may be asked to fly.

    Attributes:
        limits: the box W of horizontal accelerations in level flight.  Roll and pitch bound the
            ratio of horizontal acceleration to lift, so W is proportional to g - z acceleration.
        thrust_max_mps2: T_max / m.
        jerk_max_mps3: greatest jerk on each axis, either way; ``math.inf`` lets acceleration jump.
        speed_max_mps: greatest speed along the leg; the least is 0, a plan never reverses.
        trim_mps2: acceleration that the tilt gives beyond W, against the wind.

    Raises:
        ValueError: the thrust cannot hold height at a corner of W, or a limit is not above zero.
    """

    limits: AccelerationLimits
    thrust_max_mps2: float
    jerk_max_mps3: Vector
    speed_max_mps: float
    trim_mps2: float = 0.0

    def __post_init__(self) -> None:
        if not all(limit > 0.0 for limit in (*self.jerk_max_mps3, self.speed_max_mps)):
            raise ValueError(
                f"jerk_max_mps3 = {self.jerk_max_mps3} m/s³, speed_max_mps = "
                f"{self.speed_max_mps!r} m/s: all must be above zero"
            )
        if self.climb_acceleration_mps2 <= 0.0:
            raise ValueError(
                f"thrust_max_mps2 = {self.thrust_max_mps2!r} m/s² cannot hold height at full tilt"
            )

    @property
    def climb_acceleration_mps2(self) -> float:
        """Upward acceleration that leaves thrust for every corner of W as it then is.

        Thrust at a corner of W is proportional to g - z acceleration, because W is.
        """
        w = self.limits
        along = (max(w.brake_mps2, w.forward_mps2) + self.trim_mps2) / GRAVITY_MPS2
        across = (max(w.left_mps2, w.right_mps2) + self.trim_mps2) / GRAVITY_MPS2
        return self.thrust_max_mps2 / math.hypot(1.0, along, across) - GRAVITY_MPS2

    @property
    def jerk_is_limited(self) -> bool:
        """Whether acceleration must be continuous."""
        return not math.isinf(max(self.jerk_max_mps3))

    @property
    def along(self) -> AxisLimits:
        """Limits on x in level flight."""
        w = self.limits
        return AxisLimits(-w.brake_mps2, w.forward_mps2, self.jerk_max_mps3[X])

    @property
    def across(self) -> AxisLimits:
        """Limits on y in level flight."""
        w = self.limits
        return AxisLimits(-w.left_mps2, w.right_mps2, self.jerk_max_mps3[Y])

    @property
    def vertical(self) -> AxisLimits:
        """Limits on z that leave most of W; negative is up."""
        descent_mps2 = min(self.climb_acceleration_mps2, _DESCENT_SHARE_OF_GRAVITY * GRAVITY_MPS2)
        return AxisLimits(-self.climb_acceleration_mps2, descent_mps2, self.jerk_max_mps3[Z])


@dataclass(frozen=True)
class AvoidanceProblem:
    """Pass one obstacle inside its Region of Influence, and leave as the contract says.

    Attributes:
        start: reference state that the plan continues; heading for the obstacle, short of it.
        start_s: absolute time of ``start``.
        region: where to stay (lane, post-obstacle border) and what to stay out of (keep-out box).
        envelope: what the vehicle can be asked to fly.
        exit_speed_mps: speed along the leg to leave with, at the post-obstacle border.
        cruise_z_m: height to return to, z in the leg frame.
        climb_m: how far above ``cruise_z_m`` the plan may rise; 0 keeps it level.
        climb_preferred: rise whenever that certifies, not only when it is cheaper.
        coast_time_s: time for which the autopilot keeps its velocity when the setpoint stream
            stops (passive safety); 0 without that clause.
        further_keep_outs: what to stay out of besides, and may move; a plan is certified against
            it, but not optimized for it.
    """

    start: State
    start_s: float
    region: RegionOfInfluence
    envelope: Envelope
    exit_speed_mps: float
    cruise_z_m: float = 0.0
    climb_m: float = 0.0
    climb_preferred: bool = False
    coast_time_s: float = 0.0
    further_keep_outs: tuple[KeepOut, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.exit_speed_mps <= self.envelope.speed_max_mps:
            raise ValueError(
                f"exit_speed_mps = {self.exit_speed_mps!r} m/s: must lie above 0 and at most at "
                f"{self.envelope.speed_max_mps!r} m/s"
            )
        if not (self.climb_m >= 0.0 and self.coast_time_s >= 0.0):
            raise ValueError(
                f"climb_m = {self.climb_m!r} m, coast_time_s = {self.coast_time_s!r} s: "
                "must not be negative"
            )

    def sidestep(self, side: Side) -> Sidestep:
        """Return the lateral half of the problem."""
        region, start, limits = self.region, self.start.axis(Y), self.envelope.across
        if side == "right":
            face_m, lane_m = region.keep_out.y_max_m, region.lane_right_m
            coast_m = region.manoeuvre.y_max_m - lane_m
        else:
            start, limits = AxisState(*(-value for value in start)), limits.mirrored()
            face_m, lane_m = -region.keep_out.y_min_m, -region.lane_left_m
            coast_m = -region.manoeuvre.y_min_m - lane_m
        speed_max_mps = coast_m / self.coast_time_s if self.coast_time_s else math.inf
        return Sidestep(start, limits, face_m, lane_m, speed_max_mps)


@dataclass(frozen=True)
class Sidestep:
    """The lateral half of an avoidance, mirrored for the left side: the way out is towards +y.

    Attributes:
        start: lateral state.
        limits: lateral limits in level flight.
        face_m: side face to clear.
        lane_m: how far the plan may go.
        speed_max_mps: greatest lateral speed from which a coast stays in the region.
    """

    start: AxisState
    limits: AxisLimits
    face_m: float
    lane_m: float
    speed_max_mps: float

    @property
    def is_clear(self) -> bool:
        """Whether the start is beyond the side face, with no velocity back towards it."""
        return self.start.position_m >= self.face_m and self.start.velocity_mps >= 0.0


# An entry slower than this share of the cruise speed is not what the plan returns to.
SLOW_ENTRY_SHARE: Final = 0.5


def exit_speeds_mps(entry_speed_mps: float, cruise_speed_mps: float) -> tuple[float, ...]:
    """Return the speeds along the leg to leave a region with, in the order to try them.

    The speed of entry, as in the paper; after a slow entry the speed of cruising, else half of it.

    PAPER: Eq. 14 demands no more than 0 <= x' <= V at the border; a plan that has to leave at the
    speed of an entry near rest takes hours: tests/onboard/planning/test_planner.py::
    test_starts_near_rest_have_short_plans.
    """
    slow_mps = SLOW_ENTRY_SHARE * cruise_speed_mps
    if entry_speed_mps < slow_mps:
        return cruise_speed_mps, slow_mps
    return (min(entry_speed_mps, cruise_speed_mps),)


def cost(trajectory: Trajectory, problem: AvoidanceProblem) -> float:
    """Effort and delay of an avoidance [m²/s³]: the J of Eq. 17, which the paper leaves open.

    Integral of the squared acceleration, plus `DELAY_COST_M2PS4` times the time by which the
    vehicle arrives later than at exit speed all along.
    """
    begin, end = trajectory.acceleration_leg_mps2, trajectory.ends[2]
    squares = (begin * begin + begin * end + end * end).sum(axis=1) / 3.0
    distance_m = problem.region.x_pob_m - problem.start.position_leg_m[X]
    delay_s = trajectory.end_s - trajectory.start_s - distance_m / problem.exit_speed_mps
    return float(squares @ trajectory.durations_s) + DELAY_COST_M2PS4 * delay_s
