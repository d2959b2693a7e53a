"""Reads flight logs of any kind; recognizes them by their content, not their name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.dataflash import BINARY_MAGIC, streams_of_dataflash
from gcs_tools.identify.recording import Recording
from gcs_tools.identify.stopping import IDENTIFYING, run_on
from gcs_tools.identify.streams import Streams, Timeline, in_order, reference_in_order
from gcs_tools.identify.tlog import is_raw_capture, is_tlog, streams_of_tlog
from gcs_tools.logs.flight_log import Log, read_log
from onboard.contract.assessment import TICK_S
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES
from onboard.recording.messages import StateRecord

_Value = TypeVar("_Value")

# Phases in which the vehicle follows the reference of the log.
_FOLLOWED: Final = frozenset((*FLYING_PHASES, IDENTIFYING))

_MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
_ULOG_MAGIC: Final = b"ULog\x01\x12\x35"
_PX4_OFFBOARD_STATE: Final = 14
# Files that are often given by mistake, by their first bytes.
_OTHERS: Final = (
    (b"version https://git-lfs", "a pointer of Git LFS; the log itself is missing: git lfs pull"),
    (b"\x1f\x8b", "compressed (gzip): unpack it first"),
    (b"PK\x03\x04", "a ZIP archive: unpack it first"),
    (b"\x28\xb5\x2f\xfd", "compressed (zstd): unpack it first"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive: unpack it first"),
    (b"FMT, 128,", "a DataFlash log converted to text: give the .BIN itself"),
    (b"#ROSBAG", "a ROS bag"),
    (b"SQLite format 3", "a database"),
)
_EXPECTED: Final = "expected our MCAP, PX4's ULog, ArduPilot's DataFlash .BIN or a MAVLink tlog"


class NotALogError(CommandError):
    """A file is not a flight log of a known kind."""


def read_recording(path: Path, system_id: int | None = None) -> Recording:
    """Read a log of any kind.

    Args:
        path: the file.
        system_id: MAVLink id of the vehicle, in a tlog of several.

    Raises:
        NotALogError: the file is something else.
        CommandError: the file cannot be read, or holds no flight on setpoints.
    """
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not start:
        raise NotALogError(f"{path}: the file is empty, {_EXPECTED}")
    if start.startswith(_MCAP_MAGIC):
        return _recording_of_ours(path)
    if start.startswith(_ULOG_MAGIC):
        return _streams_of_ulog(path).recording()
    if start.startswith(BINARY_MAGIC):
        return streams_of_dataflash(path).recording()
    for magic, what in _OTHERS:
        if start.startswith(magic):
            raise NotALogError(f"{path}: not a log, but {what}")
    data = bytearray(path.read_bytes())
    if is_raw_capture(data):
        raise NotALogError(f"{path}: not a log, but MAVLink without times (a raw capture)")
    if not is_tlog(data):
        raise NotALogError(f"{path}: not a log, {_EXPECTED}")
    return streams_of_tlog(data, str(path), system_id).recording()


def _recording_of_ours(path: Path) -> Recording:
    log = read_log(path)
    if malformed := log.malformed.get("/state"):
        raise CommandError(
            f"{path}: {malformed} states in this log cannot be read: another version of Clearway "
            "wrote them"
        )
    try:
        streams = _streams_of_ours(path, log)
    except ValueError as error:
        raise CommandError(
            f"{path}: the states in this log cannot be read ({error}): another version of "
            "Clearway wrote them"
        ) from error
    return streams.recording()


def _streams_of_ours(path: Path, log: Log) -> Streams:
    """Return the daemon's states of each tick in flight.

    A pose is older than its tick by the age of the telemetry.
    """
    timeline = Timeline()
    flown = [(timeline.at(state.time_s), state) for state in log.states]
    known = [(at_s, s) for at_s, s in flown if s.position_ned_m and s.roll_rad is not None]
    posed = {at_s - (s.telemetry_age_s or 0.0): s for at_s, s in known}
    asked = [(at_s, s) for at_s, s in flown if s.reference_position_ned_m is not None]
    ages_s = [s.detection_age_s for _, s in flown if s.phase in FLYING_PHASES]
    known_ages_s = [age_s for age_s in ages_s if age_s is not None]
    # An obstacle that comes into range just after a frame waits for the next frame and its tick.
    heard = bool(ages_s) and len(known_ages_s) == len(ages_s)
    return Streams(
        source=str(path),
        pose=in_order(
            [(t, *_given(s.position_ned_m), *_given(s.velocity_ned_mps)) for t, s in posed.items()],
            6,
        ),
        reference=reference_in_order([(t, *_reference_row(s)) for t, s in asked]),
        attitude=in_order(
            [
                (t, _given(s.roll_rad), _given(s.pitch_rad), _given(s.yaw_rad))
                for t, s in posed.items()
            ],
            3,
        ),
        control=in_order([(t, float(s.phase in _FOLLOWED)) for t, s in flown], 1),
        names=("position", "reference: the daemon did not fly in it", "attitude", "state"),
        reaction_s=max(known_ages_s) + TICK_S if heard else None,
        doing=_doing(log),
        run_on=run_on(log),
    )


def _reference_row(state: StateRecord) -> tuple[float, ...]:
    return (
        *_given(state.reference_position_ned_m),
        *_given(state.reference_velocity_ned_mps),
        *_given(state.reference_acceleration_ned_mps2),
        _given(state.leg_heading_rad),
    )


def _given(value: _Value | None) -> _Value:
    """Return a value that this version's daemon always writes together with another.

    Raises:
        ValueError: it is missing.
    """
    if value is None:
        raise ValueError("a value is missing")
    return value


def _doing(log: Log) -> Callable[[float], str]:
    """Return what tells what was flown at a time."""
    passes = [(e.time_s, e.text) for e in log.events if e.text.startswith("pass ")]
    if not any(state.phase == IDENTIFYING for state in log.states):
        return _Plans(log)

    def doing(time_s: float) -> str:
        begun = [(since_s, text) for since_s, text in passes if since_s <= time_s]
        if not begun:
            return "before the first pass"
        since_s, text = begun[-1]
        return f"{time_s - since_s:.1f} s into {text}"

    return doing


class _Plans:
    """Tells what was flown at a time."""

    def __init__(self, log: Log) -> None:
        self._plans = [p for p in log.plans if p.start_s is not None and p.end_s is not None]

    def __call__(self, time_s: float) -> str:
        for plan in reversed(self._plans):
            start_s = _given(plan.start_s)
            if start_s <= time_s <= _given(plan.end_s):
                return f"{time_s - start_s:.1f} s into {plan.kind} {plan.side} of {plan.obstacle}"
        return "cruising"


def _streams_of_ulog(path: Path) -> Streams:
    """Read a PX4 log; its clock counts from the start and is never set.

    Raises:
        CommandError: it is damaged, or lacks a measured quantity.
    """
    # Loaded only for such logs.
    from pyulog import ULog  # noqa: PLC0415

    names = (
        "vehicle_local_position",
        "trajectory_setpoint",
        "vehicle_attitude",
        "vehicle_status",
    )
    try:
        with path.open("rb") as file:  # given a name, pyulog leaves a damaged file open
            log = ULog(file, list(names))
        data = {each.name: each.data for each in reversed(log.data_list)}  # the first instance
        pose, asked, attitude, status = (data[name] for name in names)
        yaw = [column for column in ("yaw",) if column in asked]
        reference = _table(asked, [f"{of}[{n}]" for of in _SETPOINT for n in range(3)] + yaw)
        if not yaw:
            reference = np.column_stack((reference, np.full(len(reference), np.nan)))
        state = status["nav_state"] == _PX4_OFFBOARD_STATE
        return Streams(
            source=str(path),
            pose=_table(pose, ["x", "y", "z", "vx", "vy", "vz"]),
            reference=_whole(reference),
            attitude=_euler(_table(attitude, [f"q[{n}]" for n in range(4)])),
            control=np.column_stack((_seconds(status), state)),
            names=names,
        )
    except KeyError as error:
        raise CommandError(f"{path}: the log has no {error.args[0]}") from error
    except Exception as error:  # pyulog raises anything on damaged files
        raise CommandError(f"{path}: damaged ULog file: {error}") from error


_SETPOINT: Final = ("position", "velocity", "acceleration")


def _seconds(data: dict[str, Any]) -> FloatArray:
    seconds: FloatArray = data["timestamp"].astype(np.float64) * 1e-6
    return seconds


def _table(data: dict[str, Any], columns: list[str]) -> FloatArray:
    table = np.column_stack((_seconds(data), *(data[name] for name in columns)))
    ordered: FloatArray = table[np.argsort(table[:, 0], kind="stable")]
    return ordered


def _whole(reference: FloatArray) -> FloatArray:
    """Drop setpoints without position, velocity or acceleration, which PX4 logs as NaN."""
    whole: FloatArray = reference[np.isfinite(reference[:, :-1]).all(axis=1)]
    return whole


def _euler(table: FloatArray) -> FloatArray:
    """Time and quaternion (w, x, y, z), (N, 5) -> time, roll, pitch, yaw, (N, 4)."""
    time_s, w, x, y, z = table.T
    roll_rad = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch_rad = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw_rad = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack((time_s, roll_rad, pitch_rad, yaw_rad))
