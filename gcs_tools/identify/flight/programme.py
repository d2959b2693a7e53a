"""What is flown to identify a vehicle: passes with swerves, stops, and an end of the stream.

Every pass is flown at the speed to be declared with the accelerations and the jerk that plans use
(`onboard.guidance.envelope`), so that the errors are those of an avoidance:

1. and 2., there and back: cruise, swerve to one side, across to the other and back, cruise, brake;
3. and 4., there and back: cruise, then brake and sidestep at once, the corner of the limits;
5. on request: cruise, and let the stream of setpoints end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.flight.free_air import FreeAir
from onboard.contract.assessment import Assessment
from onboard.contract.run_on import contract_run_on
from onboard.guidance.envelope import envelope_of
from onboard.motion.axis_profile import (
    AxisState,
    Profile,
    Segment,
    displacement,
    speed_change,
)
from onboard.motion.trajectory import State, Trajectory
from onboard.planning.problem import Envelope

# Steady flight before and after the swerves, from which the velocity error is read.
STEADY_S: Final = 2.0
# Swerves are no wider than this to either side: wider ones show nothing more.
_SWERVE_MAX_M: Final = 4.0
# And no narrower: twice this lets a lateral acceleration reach its limit at any usual lag.
_SWERVE_MIN_M: Final = 1.0
# The reference may be that far beyond its declared error, and the vehicle is still in the box.
_ROOM_M: Final = 1.0
_SPEED_STEP_MPS: Final = 0.1
_REST: Final = AxisState(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pass:
    """One manoeuvre from rest, in a frame that begins there with its x axis along the nose.

    Attributes:
        name: for the operator.
        trajectory: of the reference, from time 0.
        back: whether the nose points against the direction at the beginning.
        silent_from_s: when the stream of setpoints ends; None for never.
    """

    name: str
    trajectory: Trajectory
    back: bool = False
    silent_from_s: float | None = None


@dataclass(frozen=True)
class Programme:
    """All passes in order.

    Attributes:
        air: the box that they stay in, a margin off its sides.
        margin_m: that margin.
        speed_mps: of each pass.
        passes: in order.
        envelope: the limits that they keep to.
    """

    air: FreeAir
    margin_m: float
    speed_mps: float
    passes: tuple[Pass, ...]
    envelope: Envelope

    @property
    def duration_s(self) -> float:
        """Time of all passes, without turns and rests."""
        return sum(each.trajectory.end_s for each in self.passes)


def programme(
    assessment: Assessment, air: FreeAir, speed_mps: float | None, *, run_on: bool
) -> Programme:
    """Return what fits into a box of free air.

    Args:
        assessment: of the contract, whose limits hold.
        air: the box.
        speed_mps: of the passes; None for the contract's cruise speed.
        run_on: whether the stream of setpoints ends in the last pass.

    Raises:
        CommandError: the speed exceeds the contract's, or the box is too small; the message says
            what it takes.
    """
    terms = assessment.terms
    speed_mps = speed_mps or terms.cruise_speed_mps
    if speed_mps > terms.cruise_speed_mps:
        raise CommandError(
            f"--speed {speed_mps:g} m/s: the contract's vehicle.cruise_speed_mps is "
            f"{terms.cruise_speed_mps:g} m/s, expected no more"
        )
    margin_m = terms.radius_m + terms.tracking_error_m + _ROOM_M
    shape = _Passes(envelope_of(assessment), speed_mps, _swerve_m(air, margin_m))
    run_on_m = contract_run_on(assessment.terms, speed_mps).reach_m(speed_mps) if run_on else None
    needed_m = shape.length_m(run_on_m)
    length_m = air.length_m - 2.0 * margin_m
    if needed_m > length_m:
        fits = _fastest(shape, run_on, assessment, length_m)
        cure = f", or --speed {fits:.1f}" if fits is not None else ""
        raise CommandError(
            f"--free-air {air}: {needed_m + 2.0 * margin_m:.1f} m of length are needed at "
            f"{speed_mps:g} m/s, {margin_m:.1f} m at each end included: state a longer box{cure}"
        )
    return Programme(air, margin_m, speed_mps, shape.all(run_on=run_on), shape.envelope)


def braking(state: State, envelope: Envelope) -> Trajectory:
    """Return the quickest way to rest from any state of a pass, from time 0 on."""
    along, across, down = (state.axis(axis) for axis in range(3))
    x, y, z = (
        Profile(axis.position_m, axis.velocity_mps, speed_change(axis, 0.0, limits))
        for axis, limits in (
            (along, envelope.along),
            (across, envelope.across),
            (down, envelope.vertical),
        )
    )
    # A reference at rest has nothing to change: an instant keeps it a trajectory.
    return Trajectory.from_profiles(0.0, x.then(Segment(0.02, 0.0)), y, z)


def _swerve_m(air: FreeAir, margin_m: float) -> float:
    swerve_m = min(air.width_m / 2.0 - margin_m, _SWERVE_MAX_M)
    if swerve_m < _SWERVE_MIN_M:
        raise CommandError(
            f"--free-air {air}: {2.0 * (margin_m + _SWERVE_MIN_M):.1f} m of width are needed, "
            f"{margin_m:.1f} m at each side included: state a wider box"
        )
    return swerve_m


def _fastest(shape: _Passes, run_on: bool, assessment: Assessment, length_m: float) -> float | None:
    """Return the fastest speed, in steps of 0.1 m/s, whose passes are no longer; None if none."""
    steps = int(shape.speed_mps / _SPEED_STEP_MPS)
    for step in range(steps, 4, -1):
        speed_mps = step * _SPEED_STEP_MPS
        slower = _Passes(shape.envelope, speed_mps, shape.swerve_m)
        run_m = contract_run_on(assessment.terms).reach_m(speed_mps) if run_on else None
        if slower.length_m(run_m) <= length_m:
            return speed_mps
    return None


class _Passes:
    """The passes of one speed and one width.

    Args:
        envelope: the limits.
        speed_mps: of the cruise.
        swerve_m: to either side.
    """

    def __init__(self, envelope: Envelope, speed_mps: float, swerve_m: float) -> None:
        self.envelope, self.speed_mps, self.swerve_m = envelope, speed_mps, swerve_m
        cruising = AxisState(0.0, speed_mps, 0.0)
        self._starting = speed_change(_REST, speed_mps, envelope.along)
        self._braking = speed_change(cruising, 0.0, envelope.along)
        self._starting_s, self._braking_s = map(_duration_s, (self._starting, self._braking))
        self._starting_m = _REST.after(self._starting).position_m
        self._braking_m = cruising.after(self._braking).position_m

    def all(self, *, run_on: bool) -> tuple[Pass, ...]:
        """Return the passes in order; each pair leads there and back."""
        swerves_m = self._swerves_m
        stop_m = self._stop_m
        passes = (
            self._swerving(1.0, swerves_m),
            self._swerving(-1.0, swerves_m, back=True),
            self._stopping(1.0, stop_m),
            # The nose points back: the way home lies to its right, too.
            self._stopping(1.0, stop_m, back=True),
        )
        return (*passes, self._falling_silent()) if run_on else passes

    def length_m(self, run_on_m: float | None) -> float:
        """Return the length of the longest pass."""
        silent_m = self._starting_m + STEADY_S * self.speed_mps + (run_on_m or 0.0)
        return max(self._swerves_m, self._stop_m, 0.0 if run_on_m is None else silent_m)

    @property
    def _swerves_m(self) -> float:
        longest_s = max(_duration_s(self._swerves(side)) for side in (1.0, -1.0))
        cruise_m = (longest_s + 2.0 * STEADY_S) * self.speed_mps
        return self._starting_m + cruise_m + self._braking_m

    @property
    def _stop_m(self) -> float:
        return self._starting_m + STEADY_S * self.speed_mps + self._braking_m

    def _swerves(self, side: float) -> tuple[Segment, ...]:
        """Swerve to one side, 1 for right, across to the other one and back."""
        here = _REST
        segments: tuple[Segment, ...] = ()
        for target_m in (side * self.swerve_m, -side * self.swerve_m, 0.0):
            step = displacement(here, target_m, self.speed_mps, self.envelope.across)
            here, segments = AxisState(target_m, 0.0, 0.0), (*segments, *step)
        return segments

    def _swerving(self, side: float, length_m: float, *, back: bool = False) -> Pass:
        cruise_s = (length_m - self._starting_m - self._braking_m) / self.speed_mps
        x = Profile(0.0, 0.0, (*self._starting, Segment(cruise_s, 0.0), *self._braking))
        y = Profile(0.0, 0.0, (Segment(self._starting_s + STEADY_S, 0.0), *self._swerves(side)))
        return Pass("swerves", _level(x, y), back)

    def _stopping(self, side: float, length_m: float, *, back: bool = False) -> Pass:
        cruise_s = (length_m - self._starting_m - self._braking_m) / self.speed_mps
        x = Profile(0.0, 0.0, (*self._starting, Segment(cruise_s, 0.0), *self._braking))
        aside = displacement(_REST, side * self.swerve_m, self.speed_mps, self.envelope.across)
        y = Profile(0.0, 0.0, (Segment(self._starting_s + cruise_s, 0.0), *aside))
        return Pass("stop beside the way", _level(x, y), back)

    def _falling_silent(self) -> Pass:
        cruise = Segment(STEADY_S, 0.0)
        x = Profile(0.0, 0.0, (*self._starting, cruise, *self._braking))
        silent_s = self._starting_s + STEADY_S
        return Pass("end of the stream", _level(x, Profile(0.0, 0.0)), silent_from_s=silent_s)


def _level(x: Profile, y: Profile) -> Trajectory:
    return Trajectory.from_profiles(0.0, x, y, Profile(0.0, 0.0))


def _duration_s(segments: tuple[Segment, ...]) -> float:
    return sum(each.duration_s for each in segments)
