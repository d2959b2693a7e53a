"""Readers of flight logs: the daemon's MCAP, PX4's ULog, and MAVLink tlogs of either autopilot."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.errors import CommandError
from gcs_tools.flight_log import Log, read_log
from gcs_tools.identify_recording import BoolArray, Recording, cruise_velocity_error_mps
from onboard.contract import TICK_S
from onboard.frames import FloatArray

_MCAP_MAGIC, _ULOG_MAGIC = b"\x89MCAP", b"ULog"
_FLYING = frozenset({"cruise", "avoid"})
# A reference older than this is none: the stream had stopped.
_REFERENCE_AGE_MAX_S = 0.1
_POSES_MIN = 50

_PX4_OFFBOARD_STATE = 14
_OFFBOARD_MODES = {mavlink.MAV_AUTOPILOT_PX4: 6 << 16, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: 4}


def read_recording(path: Path) -> Recording:
    """Read a log of any kind; its first bytes tell which.

    Raises:
        CommandError: the file is missing, no log, or holds no flight on setpoints.
    """
    try:
        with path.open("rb") as file:
            start = file.read(len(_MCAP_MAGIC))
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from error
    if start == _MCAP_MAGIC:
        return _of_ours(path, read_log(path))
    if start.startswith(_ULOG_MAGIC):
        return _Streams.of_ulog(path).recording()
    return _Streams.of_tlog(path).recording()


def _of_ours(path: Path, log: Log) -> Recording:
    """Take what the daemon has measured itself, tick by tick."""
    states = [state for state in log.topic("/state") if state["phase"] in _FLYING]
    states = [state for state in states if state["reference_position_ned_m"] is not None]
    if len(states) < _POSES_MIN:
        raise CommandError(f"{path}: the daemon did not fly in this log")
    plans = log.topic("/plan")

    def doing(time_s: float) -> str:
        for plan in reversed(plans):
            if plan["start_s"] <= time_s <= plan["end_s"]:
                into_s = time_s - plan["start_s"]
                return f"{into_s:.1f} s into {plan['kind']} {plan['side']} of {plan['obstacle']}"
        return "cruising"

    cruising = [state["velocity_error_mps"] for state in states if state["cruising"]]
    ages_s = [state["detection_age_s"] for state in states]
    # What came into range just after the newest frame waits for the next one, and for its tick.
    reaction_s = None if None in ages_s else max(ages_s) + TICK_S
    return Recording(
        source=str(path),
        time_s=_column(states, "time_s"),
        position_error_m=_column(states, "tracking_error_m"),
        velocity_error_mps=np.array(cruising, dtype=np.float64).reshape(-1, 2),
        asked_ned_mps2=_column(states, "reference_acceleration_ned_mps2")[:, :2],
        roll_rad=_column(states, "roll_rad"),
        pitch_rad=_column(states, "pitch_rad"),
        yaw_rad=_column(states, "yaw_rad"),
        reaction_s=reaction_s,
        doing=doing,
    )


def _column(states: list[dict[str, Any]], key: str) -> FloatArray:
    return np.array([state[key] for state in states], dtype=np.float64)


@dataclass(frozen=True)
class _Streams:
    """Time series as an autopilot logs them, each with its own times.

    Attributes:
        path: the file.
        pose: time, position and velocity, NED, (N, 7).
        reference: time, position, velocity and acceleration, NED, (M, 10).
        attitude: time, roll, pitch and yaw, (K, 4).
        control: time and whether setpoints were followed from then on, (L, 2).
    """

    path: Path
    pose: FloatArray
    reference: FloatArray
    attitude: FloatArray
    control: FloatArray

    def recording(self) -> Recording:
        """Bring all to the times of the poses that followed setpoints.

        Raises:
            CommandError: there are none.
        """
        if min(map(len, (self.pose, self.reference, self.attitude, self.control))) == 0:
            raise CommandError(f"{self.path}: no flight on position, velocity and acceleration")
        pose = self.pose[self._followed()]
        if len(pose) < _POSES_MIN:
            raise CommandError(f"{self.path}: the vehicle did not follow setpoints in this log")
        time_s = pose[:, 0]
        reference = _sampled(time_s, self.reference)
        roll_rad, pitch_rad, yaw_rad = _sampled(time_s, self._unwrapped_attitude()).T
        asked_mps2 = reference[:, 6:8]
        return Recording(
            source=str(self.path),
            time_s=time_s,
            position_error_m=np.hypot(*(pose[:, 1:3] - reference[:, 0:2]).T),
            velocity_error_mps=cruise_velocity_error_mps(
                pose[:, 4:6], reference[:, 3:5], asked_mps2
            ),
            asked_ned_mps2=asked_mps2,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            yaw_rad=yaw_rad,
            reaction_s=None,
            doing=_asking(time_s, asked_mps2),
        )

    def _followed(self) -> BoolArray:
        """Tell for each pose whether a fresh setpoint was being followed."""
        time_s, reference_s = self.pose[:, 0], self.reference[:, 0]
        switched = np.searchsorted(self.control[:, 0], time_s, side="right") - 1
        in_control = (switched >= 0) & (self.control[np.maximum(switched, 0), 1] > 0.0)
        latest = np.searchsorted(reference_s, time_s, side="right") - 1
        age_s = time_s - reference_s[np.maximum(latest, 0)]
        followed: BoolArray = in_control & (latest >= 0) & (age_s <= _REFERENCE_AGE_MAX_S)
        return followed

    def _unwrapped_attitude(self) -> FloatArray:
        attitude = self.attitude.copy()
        attitude[:, 3] = np.unwrap(attitude[:, 3])
        return attitude

    @classmethod
    def of_ulog(cls, path: Path) -> _Streams:
        """Read a PX4 log.

        Raises:
            CommandError: it is damaged, or lacks what is measured.
        """
        # Only for those who have such logs.
        from pyulog import ULog  # noqa: PLC0415

        names = ["vehicle_local_position", "trajectory_setpoint", "vehicle_attitude"]
        try:
            with path.open("rb") as file:  # given a name, pyulog leaves a damaged file open
                log = ULog(file, [*names, "vehicle_status"])
            data = {each.name: each.data for each in log.data_list}
            pose, asked, attitude = (data[name] for name in names)
            state = data["vehicle_status"]["nav_state"] == _PX4_OFFBOARD_STATE
            return cls(
                path,
                _table(pose, ["x", "y", "z", "vx", "vy", "vz"]),
                _finite(_table(asked, [f"{of}[{n}]" for of in _SETPOINT for n in range(3)])),
                _euler(_table(attitude, [f"q[{n}]" for n in range(4)])),
                np.column_stack((_seconds(data["vehicle_status"]), state)),
            )
        except KeyError as error:
            raise CommandError(f"{path}: the log has no {error.args[0]}") from error
        except Exception as error:  # a damaged file is answered with whatever pyulog stumbles over
            raise CommandError(f"{path}: is not a ULog file: {error}") from error

    @classmethod
    def of_tlog(cls, path: Path) -> _Streams:
        """Read the MAVLink messages that a ground station, or the daemon, has recorded."""
        rows: defaultdict[str, list[Sequence[float]]] = defaultdict(list)
        log = mavutil.mavlogfile(str(path))
        try:
            while (message := log.recv_match(type=list(_TLOG))) is not None:
                kind = message.get_type()
                row = _TLOG[kind](message)
                if row is not None:
                    rows[kind].append((message._timestamp, *row))  # noqa: SLF001  its only name
        finally:
            log.close()
        pose, asked, attitude, control = (np.array(rows[kind], dtype=np.float64) for kind in _TLOG)
        return cls(path, pose, asked, attitude, control)


_SETPOINT = ("position", "velocity", "acceleration")


def _pose_row(m: Any) -> Sequence[float] | None:
    return m.x, m.y, m.z, m.vx, m.vy, m.vz


def _setpoint_row(m: Any) -> Sequence[float] | None:
    whole = m.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED and not m.type_mask & 0x1FF
    return (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz) if whole else None


def _attitude_row(m: Any) -> Sequence[float] | None:
    return m.roll, m.pitch, m.yaw


def _control_row(m: Any) -> Sequence[float] | None:
    mode = _OFFBOARD_MODES.get(m.autopilot)
    return None if mode is None else (float(m.custom_mode == mode),)


_TLOG: dict[str, Callable[[Any], Sequence[float] | None]] = {
    "LOCAL_POSITION_NED": _pose_row,
    "SET_POSITION_TARGET_LOCAL_NED": _setpoint_row,
    "ATTITUDE": _attitude_row,
    "HEARTBEAT": _control_row,
}


def _seconds(data: dict[str, Any]) -> FloatArray:
    seconds: FloatArray = data["timestamp"].astype(np.float64) * 1e-6
    return seconds


def _table(data: dict[str, Any], columns: list[str]) -> FloatArray:
    return np.column_stack((_seconds(data), *(data[name] for name in columns)))


def _finite(table: FloatArray) -> FloatArray:
    """Drop setpoints that leave something open, which PX4 writes as NaN."""
    finite: FloatArray = table[np.isfinite(table).all(axis=1)]
    return finite


def _euler(table: FloatArray) -> FloatArray:
    """Time and quaternion (w, x, y, z), (N, 5) -> time, roll, pitch, yaw, (N, 4)."""
    time_s, w, x, y, z = table.T
    roll_rad = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch_rad = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw_rad = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack((time_s, roll_rad, pitch_rad, yaw_rad))


def _sampled(time_s: FloatArray, table: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time_s, table[:, 0], column) for column in table[:, 1:].T])


def _asking(time_s: FloatArray, asked_mps2: FloatArray) -> Callable[[float], str]:
    def doing(at_s: float) -> str:
        north_mps2, east_mps2 = asked_mps2[np.searchsorted(time_s, at_s)].tolist()
        return f"asked for [{north_mps2:.2f}, {east_mps2:.2f}] m/s² north, east"

    return doing
