"""Time series of one vehicle's flight, resampled at the times of its poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.recording import BoolArray, Recording, cruise_velocity_error_mps
from gcs_tools.identify.stopping import RunOn, rest_time_s
from onboard.geometry.frames import FloatArray

POSES_MIN: Final = 50
# A setpoint older than this, or than three of its periods, was the last before the stream stopped.
_REFERENCE_AGE_MIN_S: Final = 0.1
# Slower setpoints cannot be interpolated: at 5 m/s² two that are 0.25 s apart leave 0.04 m open.
# A stream asked for at this rate may arrive a tenth slower.
_REFERENCE_RATE_MIN_HZ: Final = 4.0
# Entries may be out of order by this much; a hole is at least this long.
_REORDERED_S: Final = 0.02
_HOLE_S: Final = 1.0
# Stretches of a log are set apart by this, longer than any lag in the search.
_APART_S: Final = 10.0
# The heading counts while the vehicle moves: it turns to the next leg at rest.
_MOVING_MPS: Final = 0.5
_RESTING_MPS: Final = 0.05

# Columns of a reference after its time.
_REFERENCE_COLUMNS: Final = 10
_POSITION, _VELOCITY, _ACCELERATION, _YAW = slice(0, 3), slice(3, 6), slice(6, 9), 9


class Timeline:
    """Converts times of a log whose clock was set while it was written into increasing ones.

    What comes after a step back, or after a hole, is a stretch of its own, some seconds later:
    nothing is interpolated across the seam, whichever way the clock went.
    """

    def __init__(self) -> None:
        self._previous_s: float | None = None
        self._offset_s = 0.0

    def at(self, time_s: float) -> float:
        """Return the time to use for the next entry, in the order of the file."""
        if self._previous_s is not None:
            step_s = time_s - self._previous_s
            if not -_REORDERED_S <= step_s <= _HOLE_S:
                self._offset_s += _APART_S - step_s
        self._previous_s = time_s
        return time_s + self._offset_s


@dataclass(frozen=True)
class Streams:
    """One vehicle's time series, each with its own times.

    Attributes:
        source: the file, and the vehicle if there are several.
        pose: time, position and velocity, NED, (N, 7).
        reference: time, position, velocity, acceleration, NED, and yaw, (M, 11); NaN for what the
            log lacks.
        attitude: time, roll, pitch and yaw, (K, 4).
        control: time and whether setpoints were followed from then on, (L, 2).
        names: what the log calls each of the four.
        notes: what the log lacks, in words.
        reaction_s: longest time from an object in range to a changed setpoint; None if unknown.
        doing: describes the vehicle's activity at a time; None for its commanded acceleration.
        run_on: after the stream of setpoints had ended; None if it did not, on purpose.
    """

    source: str
    pose: FloatArray
    reference: FloatArray
    attitude: FloatArray
    control: FloatArray
    names: tuple[str, str, str, str]
    notes: tuple[str, ...] = ()
    reaction_s: float | None = None
    doing: Callable[[float], str] | None = None
    run_on: RunOn | None = None

    def recording(self) -> Recording:
        """Resample all at the poses that followed setpoints.

        Raises:
            CommandError: there are too few, or the log lacks a measured quantity.
        """
        self._check()
        pose = self.pose[self._followed()]
        if len(pose) < POSES_MIN:
            raise CommandError(
                f"{self.source}: the vehicle followed setpoints at {len(pose)} poses of "
                f"{self.names[0]}, at least {POSES_MIN} are needed"
            )
        time_s = pose[:, 0]
        reference = _sampled(time_s, self.reference)
        roll_rad, pitch_rad, yaw_rad = _sampled(time_s, self._unwrapped_attitude()).T
        asked_mps2 = reference[:, _ACCELERATION][:, :2]
        off_m = pose[:, 1:4] - reference[:, _POSITION]
        # A hover's estimate may seem to move while the nose turns: the reference then rests.
        rests = np.hypot(*reference[:, _VELOCITY][:, :2].T) < _RESTING_MPS
        moving = (np.hypot(*pose[:, 4:6].T) > _MOVING_MPS) & ~rests
        return Recording(
            source=self.source,
            time_s=time_s,
            position_error_m=np.hypot(*off_m[:, :2].T),
            height_error_m=np.abs(off_m[:, 2]),
            velocity_error_mps=cruise_velocity_error_mps(
                pose[:, 4:6], reference[:, _VELOCITY][:, :2], asked_mps2
            ),
            heading_error_rad=_turned_rad(yaw_rad, reference[:, _YAW])[moving],
            asked_ned_mps2=asked_mps2,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            yaw_rad=yaw_rad,
            reaction_s=self.reaction_s,
            doing=self.doing or _asking(time_s, asked_mps2),
            notes=self.notes,
            rest_s=rest_time_s(pose, self.reference),
            run_on=self.run_on,
        )

    def _check(self) -> None:
        tables = (self.pose, self.reference, self.attitude, self.control)
        missing = [name for name, table in zip(self.names, tables, strict=True) if not len(table)]
        if missing:
            raise CommandError(f"{self.source}: no flight to measure: no {', no '.join(missing)}")
        if self._reference_period_s > 1.1 / _REFERENCE_RATE_MIN_HZ:
            rate_hz = 1.0 / self._reference_period_s
            raise CommandError(
                f"{self.source}: {self.names[1]} at {rate_hz:.1f} Hz, expected at least "
                f"{_REFERENCE_RATE_MIN_HZ:g} Hz"
            )

    @property
    def _reference_period_s(self) -> float:
        periods_s = np.diff(self.reference[:, 0])
        return float(np.median(periods_s)) if len(periods_s) else 0.0

    def _followed(self) -> BoolArray:
        """Tell for each pose whether a fresh setpoint was being followed."""
        time_s, reference_s = self.pose[:, 0], self.reference[:, 0]
        taken_s = _taken_s(self.control)
        switched = np.searchsorted(self.control[:, 0], time_s, side="right") - 1
        since_s = np.where(switched >= 0, taken_s[np.maximum(switched, 0)], np.inf)
        latest = np.searchsorted(reference_s, time_s, side="right") - 1
        age_s = time_s - reference_s[np.maximum(latest, 0)]
        age_max_s = max(_REFERENCE_AGE_MIN_S, 3.0 * self._reference_period_s)
        following = np.minimum(latest + 1, len(reference_s) - 1)
        # The next setpoint must be near, too: do not interpolate over a pause of the stream.
        wait_s = np.where(time_s <= reference_s[-1], reference_s[following] - time_s, np.inf)
        # An autopilot's own target from before it took setpoints does not count.
        ours = (latest >= 0) & (reference_s[np.maximum(latest, 0)] >= since_s)
        followed: BoolArray = ours & (age_s <= age_max_s) & (wait_s <= age_max_s)
        return followed

    def _unwrapped_attitude(self) -> FloatArray:
        attitude = self.attitude.copy()
        attitude[:, 3] = np.unwrap(attitude[:, 3])
        return attitude


def _taken_s(control: FloatArray) -> FloatArray:
    """Return for each row since when setpoints are followed; infinite while they are not."""
    taken_s, since_s = np.empty(len(control)), np.inf
    for number, (time_s, followed) in enumerate(control):
        since_s = min(since_s, time_s) if followed else np.inf
        taken_s[number] = since_s
    return taken_s


def in_order(rows: list[tuple[float, ...]], columns: int, needed: int | None = None) -> FloatArray:
    """Return rows that begin with their time as a table in the order of time, (N, 1 + columns).

    Args:
        rows: in any order.
        columns: of each row, after its time.
        needed: of these, from the first, must be numbers, or the row is dropped; None for all.
    """
    table = np.array(rows, dtype=np.float64).reshape(-1, 1 + columns)
    whole = np.isfinite(table[:, : 1 + (columns if needed is None else needed)]).all(axis=1)
    table = table[whole]
    ordered: FloatArray = table[np.argsort(table[:, 0], kind="stable")]
    return ordered


def reference_in_order(rows: list[tuple[float, ...]]) -> FloatArray:
    """Return a reference's rows in the order of time, (N, 11); only the position must be known."""
    return in_order(rows, _REFERENCE_COLUMNS, _POSITION.stop)


def _sampled(time_s: FloatArray, table: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time_s, table[:, 0], column) for column in table[:, 1:].T])


def _turned_rad(yaw_rad: FloatArray, asked_rad: FloatArray) -> FloatArray:
    turned: FloatArray = np.abs((yaw_rad - asked_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return turned


def _asking(time_s: FloatArray, asked_mps2: FloatArray) -> Callable[[float], str]:
    def doing(at_s: float) -> str:
        north_mps2, east_mps2 = asked_mps2[np.searchsorted(time_s, at_s)].tolist()
        if not np.isfinite(north_mps2):
            return "commanded acceleration unknown"
        return f"commanded [{north_mps2:.2f}, {east_mps2:.2f}] m/s² north, east"

    return doing
