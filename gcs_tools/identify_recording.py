"""What a flight log says of the vehicle: how far it strayed, how late and how steeply it tilted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onboard.agility import GRAVITY_MPS2
from onboard.frames import FloatArray

BoolArray = NDArray[np.bool_]

# Longest attitude lag that is looked for, its resolution, and the least motion that shows one.
_LAG_MAX_S, _LAG_STEP_S = 0.8, 0.01
_MOTION_MIN_MPS2 = 0.2
# Cruising: a reference this fast that hardly accelerates.
_CRUISE_MIN_MPS, _CRUISE_MAX_MPS2 = 0.5, 0.1


@dataclass(frozen=True)
class Recording:
    """The part of one flight that followed setpoints, sampled at the N poses.

    Attributes:
        source: the file.
        time_s: of the poses, from any zero.
        position_error_m: measured to reference, horizontal.
        velocity_error_mps: along and across the path while cruising, (M, 2), absolute.
        asked_ned_mps2: horizontal acceleration of the reference, (N, 2).
        roll_rad, pitch_rad, yaw_rad: attitude.
        reaction_s: the longest that an object in range may have waited for a changed setpoint;
            None where the log does not tell.
        doing: what the vehicle was up to at a time, in words.
    """

    source: str
    time_s: FloatArray
    position_error_m: FloatArray
    velocity_error_mps: FloatArray
    asked_ned_mps2: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    reaction_s: float | None
    doing: Callable[[float], str]


@dataclass(frozen=True)
class Measured:
    """What one flight, or the worst of several, has shown; None where nothing did.

    Attributes:
        source: the file.
        tracking_error_m: E_tr.
        velocity_error_mps: dV_x, dV_y.
        reaction_time_s: tau.
        attitude_lag_s: T_e.
        roll_max_deg, pitch_max_deg, tilt_max_deg: reached.
        tilt_asked_deg: of the reference, in level flight.
        worst: when and doing what the tracking error was largest.
    """

    source: str
    tracking_error_m: float
    velocity_error_mps: tuple[float | None, float | None]
    reaction_time_s: float | None
    attitude_lag_s: float | None
    roll_max_deg: float
    pitch_max_deg: float
    tilt_max_deg: float
    tilt_asked_deg: float
    worst: str


def measure(recording: Recording) -> Measured:
    """Return what a recording shows."""
    worst = int(np.argmax(recording.position_error_m))
    when_s = float(recording.time_s[worst])
    asked_mps2 = np.hypot(*recording.asked_ned_mps2.T)
    tilt_rad = np.arccos(np.cos(recording.roll_rad) * np.cos(recording.pitch_rad))
    along, across = (_largest(errors) for errors in recording.velocity_error_mps.T)
    after_s = when_s - float(recording.time_s[0])
    return Measured(
        source=recording.source,
        tracking_error_m=float(recording.position_error_m[worst]),
        velocity_error_mps=(along, across),
        reaction_time_s=recording.reaction_s,
        attitude_lag_s=attitude_lag_s(recording),
        roll_max_deg=_degrees(np.abs(recording.roll_rad).max()),
        pitch_max_deg=_degrees(np.abs(recording.pitch_rad).max()),
        tilt_max_deg=_degrees(tilt_rad.max()),
        tilt_asked_deg=_degrees(math.atan(asked_mps2.max() / GRAVITY_MPS2)),
        worst=f"{after_s:.1f} s after taking control, {recording.doing(when_s)}",
    )


def attitude_lag_s(recording: Recording) -> float | None:
    """Return the delay that best maps the acceleration asked for onto the tilt that followed.

    None if too little was asked for to tell.  Steady wind and drag are taken off as means.
    """
    grid_s = np.arange(recording.time_s[0], recording.time_s[-1], _LAG_STEP_S)
    asked_mps2 = _on_grid(grid_s, recording.time_s, recording.asked_ned_mps2)
    tilted_mps2 = _on_grid(grid_s, recording.time_s, _tilt_acceleration(recording))
    steps = round(_LAG_MAX_S / _LAG_STEP_S)
    if len(grid_s) < 3 * steps or asked_mps2.std(axis=0).max() < _MOTION_MIN_MPS2:
        return None
    followed_mps2 = tilted_mps2[steps:]
    residuals = [
        float(
            np.mean((_centred(followed_mps2) - _centred(asked_mps2[steps - n : -n or None])) ** 2)
        )
        for n in range(steps + 1)
    ]
    return float(np.argmin(residuals)) * _LAG_STEP_S


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
    """Horizontal acceleration that the attitude gives in level flight, north and east, (N, 2)."""
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
    return float(values.max()) if len(values) else None


def _degrees(angle_rad: float) -> float:
    return math.degrees(float(angle_rad))
