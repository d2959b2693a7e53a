"""Measures a flight log: tracking and velocity errors, attitude lag, tilt, reaction time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_tools.identify.stopping import RunOn
from onboard.contract.agility import GRAVITY_MPS2
from onboard.geometry.frames import FloatArray

BoolArray = NDArray[np.bool_]

# Longest attitude lag in the search, its resolution, and the least motion that shows a lag.
_LAG_MAX_S, _LAG_STEP_S = 0.8, 0.01
_MOTION_MIN_MPS2 = 0.2
# Poses farther apart than this end a stretch; the search for the lag does not cross the gap.
_GAP_S = 0.5
# The vehicle cruises if its reference is at least this fast and accelerates less than this.
_CRUISE_MIN_MPS, _CRUISE_MAX_MPS2 = 0.5, 0.1


@dataclass(frozen=True)
class Recording:
    """The part of one flight that followed setpoints, sampled at the N poses.

    Attributes:
        source: the file.
        time_s: of the poses, from any zero.
        position_error_m: measured to reference, horizontal.
        height_error_m: alike, vertical, absolute.
        velocity_error_mps: along and across the path while cruising, (M, 2), absolute.
        heading_error_rad: estimated to commanded heading while moving, absolute; NaN if unknown.
        asked_ned_mps2: horizontal acceleration of the reference, (N, 2); NaN if unknown.
        roll_rad, pitch_rad, yaw_rad: attitude.
        reaction_s: longest time from an object in range to a changed setpoint; None if unknown.
        doing: describes the vehicle's activity at a time.
        notes: what the log lacks, in words.
        rest_s: longest time from the rest of the reference to the vehicle's; None if unknown.
        run_on: after the stream of setpoints had ended; None if it did not, on purpose.
    """

    source: str
    time_s: FloatArray
    position_error_m: FloatArray
    height_error_m: FloatArray
    velocity_error_mps: FloatArray
    heading_error_rad: FloatArray
    asked_ned_mps2: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    reaction_s: float | None
    doing: Callable[[float], str]
    notes: tuple[str, ...] = ()
    rest_s: float | None = None
    run_on: RunOn | None = None


@dataclass(frozen=True)
class Measured:
    """Measured values of one flight; None for those that its log does not show.

    Attributes:
        source: the file.
        tracking_error_m, tracking_error_z_m: E_tr, horizontal and vertical.
        velocity_error_mps: dV_x, dV_y.
        reaction_time_s: tau.
        attitude_lag_s: T_e.
        heading_error_deg: of the estimate to the command, while moving.
        roll_max_deg, pitch_max_deg, tilt_max_deg: reached.
        tilt_asked_deg: of the reference, in level flight.
        worst: time and activity of the largest tracking error.
        notes: what the log lacks, in words.
        rest_time_s: until the vehicle rests, after its reference does.
        run_on_m, run_on_speed_mps, run_on_rest_s: forward run after the stream of setpoints had
            ended, the speed at which it did, and the time until rest.
    """

    source: str
    tracking_error_m: float
    tracking_error_z_m: float
    velocity_error_mps: tuple[float | None, float | None]
    reaction_time_s: float | None
    attitude_lag_s: float | None
    heading_error_deg: float | None
    roll_max_deg: float
    pitch_max_deg: float
    tilt_max_deg: float
    tilt_asked_deg: float | None
    worst: str
    notes: tuple[str, ...] = ()
    rest_time_s: float | None = None
    run_on_m: float | None = None
    run_on_speed_mps: float | None = None
    run_on_rest_s: float | None = None


def measure(recording: Recording) -> Measured:
    """Measure a recording."""
    worst = int(np.argmax(recording.position_error_m))
    when_s = float(recording.time_s[worst])
    asked_mps2 = _largest(np.hypot(*recording.asked_ned_mps2.T))
    turned_rad = _largest(recording.heading_error_rad)
    tilt_rad = np.arccos(np.cos(recording.roll_rad) * np.cos(recording.pitch_rad))
    along, across = (_largest(errors) for errors in recording.velocity_error_mps.T)
    after_s = when_s - float(recording.time_s[0])
    ran_on = recording.run_on
    return Measured(
        source=recording.source,
        tracking_error_m=float(recording.position_error_m[worst]),
        tracking_error_z_m=float(recording.height_error_m.max()),
        velocity_error_mps=(along, across),
        reaction_time_s=recording.reaction_s,
        attitude_lag_s=attitude_lag_s(recording),
        heading_error_deg=None if turned_rad is None else _degrees(turned_rad),
        roll_max_deg=_degrees(np.abs(recording.roll_rad).max()),
        pitch_max_deg=_degrees(np.abs(recording.pitch_rad).max()),
        tilt_max_deg=_degrees(tilt_rad.max()),
        tilt_asked_deg=(
            None if asked_mps2 is None else _degrees(math.atan(asked_mps2 / GRAVITY_MPS2))
        ),
        worst=f"{after_s:.1f} s after taking control, {recording.doing(when_s)}",
        notes=recording.notes,
        rest_time_s=recording.rest_s,
        run_on_m=None if ran_on is None else ran_on.distance_m,
        run_on_speed_mps=None if ran_on is None else ran_on.speed_mps,
        run_on_rest_s=None if ran_on is None else ran_on.rest_s,
    )


def attitude_lag_s(recording: Recording) -> float | None:
    """Return the delay that best maps the commanded acceleration onto the measured tilt.

    None if the commands are too small to show it.  Steady wind and drag are removed as the mean of
    each stretch of the log.
    """
    steps = round(_LAG_MAX_S / _LAG_STEP_S)
    stretches = [
        (asked_mps2, tilted_mps2)
        for asked_mps2, tilted_mps2 in _stretches(recording)
        if len(asked_mps2) >= 3 * steps
    ]
    if not stretches:
        return None
    moved_mps2 = np.concatenate([_centred(asked_mps2) for asked_mps2, _ in stretches])
    if not moved_mps2.std(axis=0).max() >= _MOTION_MIN_MPS2:  # neither is NaN
        return None
    residuals = [
        sum(
            float(np.sum((_centred(tilted[steps:]) - _centred(asked[steps - n : -n or None])) ** 2))
            for asked, tilted in stretches
        )
        for n in range(steps + 1)
    ]
    return float(np.argmin(residuals)) * _LAG_STEP_S


def _stretches(recording: Recording) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield commanded and measured acceleration, evenly sampled, of each stretch without a gap."""
    tilted_mps2 = _tilt_acceleration(recording)
    seams = np.flatnonzero(np.diff(recording.time_s) > _GAP_S) + 1
    for part in np.split(np.arange(len(recording.time_s)), seams):
        time_s = recording.time_s[part]
        grid_s = np.arange(time_s[0], time_s[-1], _LAG_STEP_S)
        yield (
            _on_grid(grid_s, time_s, recording.asked_ned_mps2[part]),
            _on_grid(grid_s, time_s, tilted_mps2[part]),
        )


def cruise_velocity_error_mps(
    velocity_ned_mps: FloatArray, reference_ned_mps: FloatArray, asked_ned_mps2: FloatArray
) -> FloatArray:
    """Return the error along and across the reference's course while it cruises, (M, 2).

    Args:
        velocity_ned_mps: measured, horizontal, (N, 2).
        reference_ned_mps: of the reference, alike.
        asked_ned_mps2: acceleration of the reference, alike.
    """
    speed_mps = np.hypot(*reference_ned_mps.T)
    steady = np.hypot(*asked_ned_mps2.T) < _CRUISE_MAX_MPS2
    cruising = steady & (speed_mps > _CRUISE_MIN_MPS)
    course = reference_ned_mps[cruising] / speed_mps[cruising, None]
    error_mps = velocity_ned_mps[cruising] - reference_ned_mps[cruising]
    along_mps = np.abs((error_mps * course).sum(axis=1))
    across_mps = np.abs(error_mps[:, 1] * course[:, 0] - error_mps[:, 0] * course[:, 1])
    return np.column_stack((along_mps, across_mps))


def _tilt_acceleration(recording: Recording) -> FloatArray:
    """Return the acceleration of the attitude in level flight, north and east, (N, 2)."""
    forward_mps2 = -GRAVITY_MPS2 * np.tan(recording.pitch_rad)
    right_mps2 = GRAVITY_MPS2 * np.tan(recording.roll_rad)
    cosine, sine = np.cos(recording.yaw_rad), np.sin(recording.yaw_rad)
    return np.column_stack(
        (cosine * forward_mps2 - sine * right_mps2, sine * forward_mps2 + cosine * right_mps2)
    )


def _on_grid(grid_s: FloatArray, time_s: FloatArray, values: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(grid_s, time_s, column) for column in values.T])


def _centred(values: FloatArray) -> FloatArray:
    centred: FloatArray = values - values.mean(axis=0)
    return centred


def _largest(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else None


def _degrees(angle_rad: float) -> float:
    return math.degrees(float(angle_rad))
