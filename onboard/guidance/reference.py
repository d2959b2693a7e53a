"""The trajectory that is flown now, and the one that takes over from it.

The reference is continuous over states: every trajectory starts on the one before it, not at the
measured state.  The contract allows for the tracking error.

Where a guard is set, it is what is flown: a certified trajectory that agrees with what is intended
up to a time, and then comes to rest.  If nothing renews it in time, the vehicle stops.
"""

from __future__ import annotations

from onboard.geometry.frames import LegFrame, wrap_angle
from onboard.motion.trajectory import State, Trajectory, Vector
from onboard.vehicle_state import Setpoint


class Reference:
    """What the vehicle is commanded to fly, in the leg frame.

    Attributes:
        current: the trajectory that is flown; None while nothing is.
        upcoming: the trajectory that takes over at its own start, between this tick and the next,
            or has done so since the last `hand_over`; None if there is none.
        guard: certified, and flown instead of both; None where nothing certifies what is intended.
        heading_rad: of the nose, from the leg towards its right.
    """

    def __init__(self) -> None:
        self.current: Trajectory | None = None
        self.upcoming: Trajectory | None = None
        self.guard: Trajectory | None = None
        self.heading_rad = 0.0

    @property
    def intended(self) -> Trajectory | None:
        """What would be flown from the next tick on, if the guard is renewed in time."""
        return self.upcoming or self.current

    def fly(self, trajectory: Trajectory) -> None:
        """Fly a trajectory from now on, whatever was to take over and whatever guards it."""
        self.current, self.upcoming, self.guard = trajectory, None, None

    def intend(self, trajectory: Trajectory) -> None:
        """Fly a trajectory from now on; where a guard is set, once it has been renewed."""
        self.current, self.upcoming = trajectory, None

    def fly_guard(self) -> None:
        """Intend nothing but the guard, where one is set."""
        if self.guard is not None:
            self.fly(self.guard)

    def schedule(self, trajectory: Trajectory, now_s: float) -> None:
        """Have a trajectory take over at its own start; until then what is flown now goes on."""
        self.hand_over(now_s)
        self.upcoming = trajectory

    def hand_over(self, now_s: float) -> None:
        """Make the upcoming trajectory the current one, once it has started."""
        if self.upcoming is not None and now_s >= self.upcoming.start_s:
            self.intend(self.upcoming)

    def clear(self) -> None:
        """Fly nothing."""
        self.current = self.upcoming = self.guard = None
        self.heading_rad = 0.0

    def sample(self, time_s: float) -> State | None:
        """Return the reference at a time, leg frame; None while nothing is flown."""
        if self.guard is not None:
            return self.guard.sample(time_s)
        flown = self.current
        if self.upcoming is not None and time_s >= self.upcoming.start_s:
            flown = self.upcoming
        return None if flown is None else flown.sample(time_s)

    def remaining(self, now_s: float) -> Trajectory | None:
        """Return what will be flown from now on if nothing else is decided; None at its end."""
        flown, then = self.guard or self.current, None if self.guard else self.upcoming
        if flown is None or (then is None and now_s >= flown.end_s):
            return None
        if then is None:
            return flown.from_time(now_s)
        if now_s >= then.start_s:
            return then.from_time(now_s) if now_s < then.end_s else None
        if now_s >= flown.end_s:
            return then
        return flown.from_time(now_s).until(then.start_s).followed_by(then)

    def setpoint(self, time_s: float, leg: LegFrame) -> Setpoint | None:
        """Return the reference at a time as a setpoint in NED; None while nothing is flown."""
        state = self.sample(time_s)
        if state is None:
            return None
        yaw_rad = leg.heading_rad
        if self.heading_rad != 0.0:
            yaw_rad = wrap_angle(yaw_rad + self.heading_rad)
        return Setpoint(
            leg.position_ned(state.position_leg_m),
            leg.vector_ned(state.velocity_leg_mps),
            leg.vector_ned(state.acceleration_leg_mps2),
            yaw_rad,
        )

    def shift(self, shift_leg_m: Vector) -> None:
        """Move what is flown, and what takes over, by a vector in the leg frame."""
        if self.current is not None:
            self.current = self.current.shifted_by(shift_leg_m)
        if self.upcoming is not None:
            self.upcoming = self.upcoming.shifted_by(shift_leg_m)
        if self.guard is not None:
            self.guard = self.guard.shifted_by(shift_leg_m)
