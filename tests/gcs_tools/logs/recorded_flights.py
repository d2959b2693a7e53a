"""Writes one flight as each kind of log, by the formats' descriptions.

The vehicle weaves sideways at 3 m/s, and flies straight after some 13 s.  It is so far beside its
reference, drifts so fast, is so much too low, looks so far beside and tilts so late.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.contract.agility import GRAVITY_MPS2
from tests.gcs_tools.logs.raw_log import raw_log

BESIDE_M, DRIFT_MPS, LOW_M, LOOK_RAD, LAG_S = 0.3, 0.05, 0.12, 0.03, 0.2
SPEED_MPS, SWAY_M, SWAY_RADPS, ALTITUDE_M = 3.0, 1.0, 1.5, 4.0
STRAIGHT_S = 6.5 * math.pi / SWAY_RADPS
TIMES_S = np.arange(0.0, 20.0, 0.02)
EPOCH_UNIX_S = 1.79e9
PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
OFFBOARD, GUIDED = 6 << 16, 4


def reference(time_s: float) -> tuple[float, ...]:
    """Position, velocity, acceleration; straight from where the weave turns."""
    phase = SWAY_RADPS * min(time_s, STRAIGHT_S)
    bending = float(time_s < STRAIGHT_S)
    return (
        SPEED_MPS * time_s, SWAY_M * math.sin(phase), -ALTITUDE_M,
        SPEED_MPS, bending * SWAY_M * SWAY_RADPS * math.cos(phase), 0.0,
        0.0, -bending * SWAY_M * SWAY_RADPS**2 * math.sin(phase), 0.0,
    )  # fmt: skip


def pose(time_s: float) -> tuple[float, ...]:
    x, y, z, vx, vy, vz, *_ = reference(time_s)
    # The worst is in the weave.
    beside_m, low_m = (BESIDE_M, LOW_M) if 5.0 < time_s < 6.0 else (0.1, 0.02)
    return x, y + beside_m, z + low_m, vx, vy + DRIFT_MPS, vz


def roll_rad(time_s: float) -> float:
    return math.atan(reference(time_s - LAG_S)[7] / GRAVITY_MPS2)


Stamp = Callable[[float], float]


@dataclass
class Tlog:
    """A MAVLink log under construction; messages of each vehicle by themselves."""

    entries: list[tuple[float, bytes]] = field(default_factory=list)
    mavlink1: bool = False

    def add(self, time_s: float, message: Any, system: int = 1, component: int = 1) -> None:
        codec = mavlink.MAVLink(None, system, component)
        self.entries.append((time_s, message.pack(codec, self.mavlink1)))

    def fly(
        self,
        *,
        system: int = 1,
        autopilot: int = PX4,
        mode: int = OFFBOARD,
        mask: int = 0,
        told: bool = True,
        echo_every: int = 0,
        offset_m: float = 0.0,
        target: int | None = None,
    ) -> Tlog:
        """Add the flight of one vehicle.

        Args:
            system: its id.
            autopilot, mode: as its heartbeat says.
            mask: what the set-points ignore.
            told: whether the set-points are in the log.
            echo_every: ticks between the autopilot's own words on them; 0 for none.
            offset_m: how far north of the others it flies.
            target: system that the set-points are for; it itself without.
        """
        for tick, time_s in enumerate(TIMES_S.tolist()):
            if tick % 50 == 0:
                self.add(time_s, _heartbeat(autopilot, mode), system)
            x, *rest = reference(time_s)
            if told:
                asked = mavlink.MAVLink_set_position_target_local_ned_message(
                    0,
                    system if target is None else target,
                    1,
                    1,
                    mask,
                    x + offset_m,
                    *rest,
                    0.0,
                    0.0,
                )
                self.add(time_s, asked, system, 196)
            north_m, *moved = pose(time_s)
            attitude = (roll_rad(time_s), 0.0, LOOK_RAD, 0.0, 0.0, 0.0)
            self.add(time_s, mavlink.MAVLink_attitude_message(0, *attitude), system)
            position = mavlink.MAVLink_local_position_ned_message(0, north_m + offset_m, *moved)
            self.add(time_s, position, system)
            if echo_every and tick % echo_every == 0:
                self.add(time_s, _echo(time_s, autopilot, offset_m), system)
        return self

    def write(self, path: Path, stamp: Stamp = lambda time_s: time_s) -> Path:
        """Write the entries in the order of their times, under the clock of the recorder."""
        with path.open("wb") as file:
            for time_s, frame in sorted(self.entries, key=lambda entry: entry[0]):
                stamp_us = round((EPOCH_UNIX_S + stamp(time_s)) * 1e6)
                file.write(struct.pack(">Q", stamp_us) + frame)
        return path


def _heartbeat(autopilot: int, mode: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, autopilot, 209, mode, 4, 3)


def _echo(time_s: float, autopilot: int, offset_m: float) -> Any:
    """What an autopilot says of its target: PX4 the velocity that its controller asks for."""
    x, y, z, vx, vy, vz, *acceleration = reference(time_s)
    if autopilot == PX4:
        _, flown_y, flown_z, *_ = pose(time_s)
        vy, vz = vy + 0.95 * (y - flown_y), vz + 0.95 * (z - flown_z)
        acceleration = [0.3, -0.2, -9.8]
    ignored = 0 if autopilot == PX4 else 0xC00
    return mavlink.MAVLink_position_target_local_ned_message(
        0, 1, ignored, x + offset_m, y, z, vx, vy, vz, *acceleration, 0.0, 0.0
    )


def tlog(path: Path) -> Path:
    return Tlog().fly().write(path)


def mavlink1_tlog(path: Path) -> Path:
    return Tlog(mavlink1=True).fly().write(path)


def copter_tlog(path: Path) -> Path:
    return Tlog().fly(autopilot=ARDUPILOT, mode=GUIDED).write(path)


def copter_echo_tlog(path: Path) -> Path:
    """What a ground station records of ArduPilot at 10 Hz."""
    return Tlog().fly(autopilot=ARDUPILOT, mode=GUIDED, told=False, echo_every=5).write(path)


def ulog(path: Path, *, nav_state: int = 14, taken_s: float = 0.0) -> Path:
    """Write the few records of PX4's format that carry a flight.

    Args:
        path: the file.
        nav_state: what PX4 flies from ``taken_s`` on; before, it loiters 5 m beside.
        taken_s: when that is.
    """
    topics = {
        "vehicle_local_position": "float x;float y;float z;float vx;float vy;float vz;",
        "trajectory_setpoint": (
            "float[3] position;float[3] velocity;float[3] acceleration;float yaw;"
        ),
        "vehicle_attitude": "float[4] q;",
        "vehicle_status": "uint8_t nav_state;",
    }

    def record(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<Hc", len(body), kind) + body

    with path.open("wb") as file:
        file.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
        file.write(record(b"B", bytes(40)))
        for name, fields in topics.items():
            file.write(record(b"F", f"{name}:uint64_t timestamp;{fields}".encode()))
        for number, name in enumerate(topics):
            file.write(record(b"A", struct.pack("<BH", 0, number) + name.encode()))

        def sample(number: int, time_s: float, values: bytes) -> None:
            head = struct.pack("<HQ", number, round(time_s * 1e6) + 1_000_000)
            file.write(record(b"D", head + values))

        for tick, time_s in enumerate(TIMES_S.tolist()):
            loiters = time_s < taken_s
            if tick % 25 == 0:
                sample(3, time_s, struct.pack("<B", 4 if loiters else nav_state))
            x_m, *asked = reference(time_s + 0.015)
            beside_m = 5.0 if loiters else 0.0
            sample(1, time_s + 0.015, struct.pack("<10f", x_m + beside_m, *asked, 0.0))
            sample(2, time_s, struct.pack("<4f", *_quaternion(roll_rad(time_s), LOOK_RAD)))
            sample(0, time_s, struct.pack("<6f", *pose(time_s)))
    return path


def _quaternion(roll: float, yaw: float) -> tuple[float, ...]:
    (cr, sr), (cy, sy) = ((math.cos(a / 2.0), math.sin(a / 2.0)) for a in (roll, yaw))
    return cr * cy, sr * cy, sr * sy, cr * sy


_DATAFLASH = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "UNIT": (129, "QbZ", "TimeUS,Id,Label"),
    "MULT": (130, "Qbd", "TimeUS,Id,Mult"),
    "FMTU": (131, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    "MODE": (10, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "GUIP": (11, "QBfffbffffff", "TimeUS,Type,pX,pY,pZ,Terrain,vX,vY,vZ,aX,aY,aZ"),
    "ATT": (12, "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "PSCN": (13, "Qff", "TimeUS,PN,VN"),
    "PSCE": (14, "Qff", "TimeUS,PE,VE"),
    "PSCD": (15, "Qff", "TimeUS,PD,VD"),
}
_CODES = {"Q": "Q", "B": "B", "b": "b", "M": "B", "f": "f", "d": "d", "n": "4s", "N": "16s"}


def dataflash(path: Path, *, unit_m: float = 1.0, mode: int = GUIDED, sub_mode: int = 3) -> Path:
    """Write ArduPilot's log; before Copter 4.7 GUIP is in centimetres (``unit_m`` 0.01)."""
    path.write_bytes(b"".join(_dataflash(unit_m, mode, sub_mode)))
    return path


def _dataflash(unit_m: float, mode: int, sub_mode: int) -> Iterator[bytes]:
    for name, (number, form, columns) in _DATAFLASH.items():
        length = 3 + struct.calcsize("<" + "".join(_code(c) for c in form))
        texts = (name.encode(), form.encode(), columns.encode())
        yield _record("FMT", number, length, *texts)
    yield _record("UNIT", 0, ord("m"), b"m")
    yield _record("MULT", 0, ord("0"), 1.0)
    yield _record("MULT", 0, ord("B"), 0.01)
    scale = b"0" if unit_m == 1.0 else b"B"
    yield _record("FMTU", 0, 11, b"--mmm-mmmmmm", b"--" + scale * 3 + b"-" + scale * 6)
    for tick, time_s in enumerate(TIMES_S.tolist()):
        at_us = round(time_s * 1e6) + 50_000_000
        if tick % 100 == 0:
            yield _record("MODE", at_us, mode, mode, 2)
        x, y, z, vx, vy, vz, ax, ay, az = (value / unit_m for value in reference(time_s))
        yield _record("GUIP", at_us, sub_mode, x, y, -z, 0, vx, vy, -vz, ax, ay, -az)
        if tick % 5 == 0:
            roll_deg, yaw_deg = math.degrees(roll_rad(time_s)), math.degrees(LOOK_RAD)
            yield _record("ATT", at_us, 0.0, roll_deg, 0.0, 0.0, 0.0, yaw_deg)
            north_m, east_m, down_m, vn, ve, vd = pose(time_s)
            yield _record("PSCN", at_us, north_m, vn)
            yield _record("PSCE", at_us, east_m, ve)
            yield _record("PSCD", at_us, down_m, vd)


def _code(letter: str) -> str:
    return "64s" if letter == "Z" else _CODES[letter]


def _record(name: str, *values: Any) -> bytes:
    number, form, _ = _DATAFLASH[name]
    layout = "<" + "".join(map(_code, form))
    return b"\xa3\x95" + bytes((number,)) + struct.pack(layout, *values)


def centimetres(path: Path) -> Path:
    return dataflash(path, unit_m=0.01)


def mcap(
    path: Path, stamp: Stamp = lambda time_s: time_s, said: dict[str, Any] | None = None
) -> Path:
    """Write what the daemon logs: the reference of a tick, and the pose known at it.

    Args:
        path: the file.
        stamp: the clock of the daemon.
        said: what each state says instead.
    """
    with raw_log(path) as write:
        for time_s in TIMES_S.tolist():
            north_m, east_m, down_m, vn, ve, vd = pose(time_s)
            now_s = time_s + 0.01
            asked = reference(now_s)
            state = {
                "time_s": EPOCH_UNIX_S + stamp(now_s),
                "phase": "cruise",
                "position_ned_m": (north_m, east_m, down_m),
                "velocity_ned_mps": (vn, ve, vd),
                "roll_rad": roll_rad(time_s),
                "pitch_rad": 0.0,
                "yaw_rad": LOOK_RAD,
                "reference_position_ned_m": asked[0:3],
                "reference_velocity_ned_mps": asked[3:6],
                "reference_acceleration_ned_mps2": asked[6:9],
                "leg_heading_rad": 0.0,
                "cruising": True,
                "velocity_error_mps": (9.0, 9.0),
                "detection_age_s": 0.05,
                "telemetry_age_s": 0.01,
            }
            write("state", EPOCH_UNIX_S + now_s, state | (said or {}))
    return path
