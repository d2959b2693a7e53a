"""What logs say of a vehicle: ours, PX4's own, and MAVLink's."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.identify import contract_values
from gcs_tools.identify_logs import read_recording
from gcs_tools.identify_recording import Measured, Recording, attitude_lag_s, measure
from onboard.agility import GRAVITY_MPS2
from onboard.frames import FloatArray
from tests.gcs_tools.running import Clearway

# A vehicle that weaves sideways at 3 m/s, this far beside its reference, tilting this late.
BESIDE_M, DRIFT_MPS, LAG_S = 0.3, 0.05, 0.2
SPEED_MPS, SWAY_M, SWAY_RADPS = 3.0, 1.0, 1.5
TIMES_S = np.arange(0.0, 20.0, 0.02)


def reference(time_s: float) -> tuple[float, ...]:
    """Position, velocity, acceleration; straight after 12 s."""
    phase = SWAY_RADPS * time_s
    sway = SWAY_M if time_s < 12.0 else 0.0
    return (
        SPEED_MPS * time_s, sway * math.sin(phase), -4.0,
        SPEED_MPS, sway * SWAY_RADPS * math.cos(phase), 0.0,
        0.0, -sway * SWAY_RADPS**2 * math.sin(phase), 0.0,
    )  # fmt: skip


def pose(time_s: float) -> tuple[float, ...]:
    x, y, z, vx, vy, vz, *_ = reference(time_s)
    # The worst is in the weave.
    return x, y + (BESIDE_M if 5.0 < time_s < 6.0 else 0.1), z, vx, vy + DRIFT_MPS, vz


def roll_rad(time_s: float) -> float:
    return math.atan(reference(time_s - LAG_S)[7] / GRAVITY_MPS2)


def tlog(path: Path, *, mode: int = 6 << 16, autopilot: int = 12, mask: int = 0) -> Path:
    codec = mavlink.MAVLink(None, 1, 1)
    with path.open("wb") as file:

        def write(time_s: float, message: Any) -> None:
            file.write(struct.pack(">Q", round((1.79e9 + time_s) * 1e6)) + message.pack(codec))

        for tick, time_s in enumerate(TIMES_S.tolist()):
            if tick % 50 == 0:
                write(time_s, mavlink.MAVLink_heartbeat_message(2, autopilot, 209, mode, 4, 3))
                write(time_s, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            target = mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, *reference(time_s), 0.0, 0.0
            )
            write(time_s, target)
            attitude = (roll_rad(time_s), 0.0, 0.0, 0.0, 0.0, 0.0)
            write(time_s, mavlink.MAVLink_attitude_message(0, *attitude))
            write(time_s, mavlink.MAVLink_local_position_ned_message(0, *pose(time_s)))
    return path


def ulog(path: Path, *, nav_state: int = 14) -> Path:
    """Write the few records of PX4's format that carry a flight."""
    topics = {
        "vehicle_local_position": "float x;float y;float z;float vx;float vy;float vz;",
        "trajectory_setpoint": "float[3] position;float[3] velocity;float[3] acceleration;",
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
            half_rad = roll_rad(time_s) / 2.0
            quaternion = (math.cos(half_rad), math.sin(half_rad), 0.0, 0.0)
            if tick % 50 == 0:
                sample(3, time_s, struct.pack("<B", nav_state))
            sample(1, time_s, struct.pack("<9f", *reference(time_s)))
            sample(2, time_s, struct.pack("<4f", *quaternion))
            sample(0, time_s, struct.pack("<6f", *pose(time_s)))
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {"flight.tlog": tlog, "flight.ulg": ulog}


@pytest.mark.parametrize("name", WRITERS)
def test_the_autopilots_logs_give_back_what_was_flown(tmp_path: Path, name: str) -> None:
    found = measure(read_recording(WRITERS[name](tmp_path / name)))
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=2e-3)
    along_mps, across_mps = found.velocity_error_mps
    # Where the weave crosses its axis, a part of the drift points along the course.
    assert along_mps is not None
    assert along_mps < DRIFT_MPS
    assert across_mps == pytest.approx(DRIFT_MPS, abs=1e-3)
    assert found.attitude_lag_s == pytest.approx(LAG_S, abs=0.011)
    assert found.reaction_time_s is None
    steepest_deg = math.degrees(math.atan(SWAY_M * SWAY_RADPS**2 / GRAVITY_MPS2))
    assert found.tilt_asked_deg == pytest.approx(steepest_deg, abs=0.05)
    assert found.tilt_max_deg == pytest.approx(steepest_deg, abs=0.05)
    assert found.worst.startswith("5.")


def test_ardupilot_in_guided_counts_too(tmp_path: Path) -> None:
    path = tlog(tmp_path / "copter.tlog", mode=4, autopilot=3)
    assert measure(read_recording(path)).tracking_error_m == pytest.approx(BESIDE_M, abs=2e-3)


def test_our_own_log_reproduces_the_result_of_the_flight(
    clearway: Clearway, tmp_path: Path
) -> None:
    assert clearway("fly", "--virtual", "--out", tmp_path).code == 0
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    ran = clearway("identify", tmp_path / "flight.mcap", "--format", "json")
    assert ran.code == 0
    document = json.loads(ran.out)
    (flight,) = document["flights"]
    assert flight["tracking_error_m"] == result["tracking_error_max_m"]
    assert flight["velocity_error_mps"] == result["velocity_error_max_mps"]
    declared_m = document["contract"]["vehicle.tracking_error_m"]
    assert 1.25 * flight["tracking_error_m"] <= declared_m
    assert declared_m < 1.25 * flight["tracking_error_m"] + 0.01
    assert 0.05 <= flight["reaction_time_s"] <= 0.15
    assert " of front/" in flight["worst"] or flight["worst"].endswith("cruising")
    table = clearway("identify", tmp_path / "flight.mcap", "--margin", "0.5").out
    assert "50 % above" in table


def weaving(asked_mps2: FloatArray, rolled_rad: FloatArray) -> Recording:
    still = np.zeros(len(TIMES_S))
    return Recording(
        "weave", TIMES_S, still, np.zeros((0, 2)), np.column_stack((still, asked_mps2)),
        rolled_rad, still, still, None, lambda _: "weaving",
    )  # fmt: skip


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.35])
def test_the_attitude_lag_is_found_in_wind(lag_s: float) -> None:
    asked_mps2 = 2.0 * np.sin(2.0 * TIMES_S) + np.sin(5.3 * TIMES_S)
    late_mps2 = 2.0 * np.sin(2.0 * (TIMES_S - lag_s)) + np.sin(5.3 * (TIMES_S - lag_s)) + 0.7
    recording = weaving(asked_mps2, np.arctan(late_mps2 / GRAVITY_MPS2))
    assert attitude_lag_s(recording) == pytest.approx(lag_s, abs=0.011)


def test_a_vehicle_that_flies_straight_shows_no_lag() -> None:
    assert attitude_lag_s(weaving(np.zeros(len(TIMES_S)), np.zeros(len(TIMES_S)))) is None


def test_the_worst_of_several_flights_is_declared() -> None:
    def flight(error_m: float, reaction_s: float | None) -> Measured:
        return Measured("f", error_m, (None, 0.04), reaction_s, 0.1, 9.0, 9.0, 9.0, 9.0, "cruising")

    declared = contract_values([flight(0.2, None), flight(0.1, 0.08)], 0.25)
    assert declared == {
        "vehicle.tracking_error_m": 0.25,
        "vehicle.velocity_error_mps.0": None,
        "vehicle.velocity_error_mps.1": 0.05,
        "vehicle.reaction_time_s": 0.1,
        "vehicle.attitude_lag_s": 0.13,
    }


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        (b"", "no flight"),
        (b"just text\n" * 100, "no flight"),
        (b"\x89MCAP0\r\n nonsense", "not a flight log"),
        (b"ULog\x01\x12\x35\x01", "ULog"),
        (b"ULog\x01\x12\x35\x01" + bytes(200), "log"),
    ],
)
def test_what_is_no_log(clearway: Clearway, tmp_path: Path, content: Any, words: str) -> None:
    path = tmp_path / "log"
    if content is not None:
        path.write_bytes(content)
    ran = clearway("identify", path)
    assert ran.code == 2
    assert ran.err.count("\n") == 1
    assert str(path) in ran.err
    assert words in ran.err


def test_flights_that_follow_no_setpoints(clearway: Clearway, tmp_path: Path) -> None:
    for path in (
        tlog(tmp_path / "loiter.tlog", mode=3 << 16),
        tlog(tmp_path / "velocity.tlog", mask=0x1C7),
        ulog(tmp_path / "loiter.ulg", nav_state=4),
    ):
        ran = clearway("identify", path)
        assert (ran.code, str(path) in ran.err) == (2, True)


@pytest.mark.parametrize("margin", ["-1", "nan", "some"])
def test_the_margin_is_a_number(clearway: Clearway, margin: str) -> None:
    assert clearway("identify", "any.mcap", "--margin", margin).code == 2
