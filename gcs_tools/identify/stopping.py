"""Measures how a vehicle stops: after its reference has, and after the stream of setpoints has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs_tools.logs.flight_log import Log
from onboard.geometry.frames import FloatArray
from onboard.geometry.rest import MOVED_MAX_M, WINDOW_S
from onboard.recording.messages import StateRecord

# Phase of a flight that identifies the vehicle, and its state while no setpoints are sent.
IDENTIFYING: Final = "identify"
SILENT: Final = "silent"
# A reference slower than this rests; it has moved if it was faster than that before.
_RESTING_MPS, _MOVED_MPS = 0.05, 0.5
# It must rest for this long, or the vehicle's own rest cannot be seen.
_DWELL_S: Final = 2.0
_POSES_MIN: Final = 10


@dataclass(frozen=True)
class RunOn:
    """What a vehicle did after the stream of setpoints had ended.

    Attributes:
        distance_m: forward, from the last setpoint or from where the vehicle was then, whichever is
            longer.
        speed_mps: of the last setpoint.
        rest_s: until it came to rest.
    """

    distance_m: float
    speed_mps: float
    rest_s: float


def rest_time_s(pose: FloatArray, reference: FloatArray) -> float | None:
    """Return the longest time from the rest of a reference to that of the vehicle.

    Args:
        pose: time, position, velocity, NED, (N, 7), in the order of time.
        reference: time, position, velocity, acceleration, yaw, NED, (M, 11), alike.

    Returns:
        The time; None if the reference never came to rest for long enough.
    """
    speed_mps = np.hypot(reference[:, 4], reference[:, 5])
    # What is not a number is neither.
    resting = speed_mps < _RESTING_MPS
    begins = np.flatnonzero(resting[1:] & ~resting[:-1]) + 1
    longest_s = None
    for begin in begins.tolist():
        moved = speed_mps[max(begin - 100, 0) : begin].max(initial=0.0) > _MOVED_MPS
        ends = np.flatnonzero(~resting[begin:])
        end = begin + int(ends[0]) if len(ends) else len(reference)
        rested_s = _rested_s(pose, reference[begin, 0], reference[end - 1, 0]) if moved else None
        if rested_s is not None:
            longest_s = max(rested_s, longest_s or 0.0)
    return longest_s


def run_on(log: Log) -> RunOn | None:
    """Return how a vehicle ran on in an identification flight; None if none was asked for.

    None, too, where the vehicle did not come to rest: a pilot may have taken it over meanwhile.
    """
    states = [s for s in log.states if s.phase == IDENTIFYING and s.position_ned_m is not None]
    first = next((n for n, s in enumerate(states) if s.state == SILENT), 0)
    last = states[first - 1] if first else None
    silent = [s for s in states[first:] if s.state == SILENT]
    if last is None or len(silent) < _POSES_MIN:
        return None
    path = np.array([(_measured_s(s), *(s.position_ned_m or ())) for s in silent])
    begin_s = last.time_s
    rested_s = _rested_s(np.column_stack((path, path[:, 1:])), begin_s, path[-1, 0])
    target_m, velocity_mps = last.reference_position_ned_m, last.reference_velocity_ned_mps
    if rested_s is None or target_m is None or velocity_mps is None:
        return None
    speed_mps = float(np.hypot(*velocity_mps[:2]))
    course = np.array(velocity_mps[:2]) / max(speed_mps, 1e-9)
    here_m = np.array((last.position_ned_m or target_m)[:2]) @ course
    from_m = min(float(np.array(target_m[:2]) @ course), float(here_m))
    return RunOn(float((path[:, 1:3] @ course).max()) - from_m, speed_mps, rested_s)


def _measured_s(state: StateRecord) -> float:
    return state.time_s - (state.telemetry_age_s or 0.0)


def _rested_s(pose: FloatArray, begin_s: float, end_s: float) -> float | None:
    """Return how long after ``begin_s`` the vehicle rests, until ``end_s``; None if it does not.

    It rests as `onboard.geometry.rest` has it: within a second it moves by half a metre at most.

    Args:
        pose: time and horizontal position in its first columns, (N, 3 or more).
        begin_s: when it should come to rest.
        end_s: when it should have.
    """
    within = pose[(pose[:, 0] >= begin_s) & (pose[:, 0] <= end_s)]
    if end_s - begin_s < _DWELL_S or len(within) < _POSES_MIN:
        return None
    moving_s = within[[_leaves(within[n:]) for n in range(len(within))], 0]
    if not len(moving_s):
        return 0.0
    # The vehicle must have rested before the end, too, or the rest was not seen.
    rested_s = float(moving_s[-1]) + WINDOW_S
    return None if rested_s > end_s - WINDOW_S else float(moving_s[-1]) - begin_s


def _leaves(path: FloatArray) -> bool:
    """Tell whether the vehicle is farther away within the next second than a hover wanders."""
    soon = path[path[:, 0] <= path[0, 0] + WINDOW_S]
    return bool(np.hypot(*(soon[:, 1:3] - path[0, 1:3]).T).max() > MOVED_MAX_M)
