"""What logs say of a vehicle: ours, the autopilots' own, and MAVLink's."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.command import contract_values
from gcs_tools.identify.logs import NotALogError, read_recording
from gcs_tools.identify.recording import Measured, Recording, attitude_lag_s, measure
from gcs_tools.identify.streams import Timeline
from onboard.contract.agility import GRAVITY_MPS2
from onboard.geometry.frames import FloatArray
from tests.gcs_tools.logs.recorded_flights import (
    ARDUPILOT,
    BESIDE_M,
    DRIFT_MPS,
    GUIDED,
    LAG_S,
    LOOK_RAD,
    LOW_M,
    PX4,
    SWAY_M,
    SWAY_RADPS,
    TIMES_S,
    Stamp,
    Tlog,
    centimetres,
    copter_echo_tlog,
    copter_tlog,
    dataflash,
    mavlink1_tlog,
    mcap,
    reference,
    tlog,
    ulog,
)
from tests.gcs_tools.running import Clearway

WRITERS: dict[str, Callable[[Path], Path]] = {
    "px4.tlog": tlog,
    "mavlink1.tlog": mavlink1_tlog,
    "copter.tlog": copter_tlog,
    "echo.tlog": copter_echo_tlog,
    "flight.ulg": ulog,
    "copter.BIN": dataflash,
    "copter46.BIN": centimetres,
    "flight.mcap": mcap,
}
# Poses every tenth of a second, and set-points of every tenth, leave this much open.
COARSE = {"echo.tlog", "copter.BIN", "copter46.BIN"}


def check_flight(found: Measured, *, coarse: bool = False, heading: bool = True) -> None:
    """Compare with what was flown, whichever log it is from."""
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=5e-3 if coarse else 2e-3)
    assert found.tracking_error_z_m == pytest.approx(LOW_M, abs=1e-3)
    along_mps, across_mps = found.velocity_error_mps
    # Where the weave crosses its axis, a part of the drift points along the course.
    assert along_mps is not None
    assert along_mps < DRIFT_MPS + 1e-3
    assert across_mps == pytest.approx(DRIFT_MPS, abs=5e-3 if coarse else 1e-3)
    assert found.attitude_lag_s == pytest.approx(LAG_S, abs=0.021 if coarse else 0.011)
    steepest_deg = math.degrees(math.atan(SWAY_M * SWAY_RADPS**2 / GRAVITY_MPS2))
    assert found.tilt_asked_deg == pytest.approx(steepest_deg, abs=0.1)
    assert found.tilt_max_deg == pytest.approx(steepest_deg, abs=0.1)
    if heading:
        assert found.heading_error_deg == pytest.approx(math.degrees(LOOK_RAD), abs=0.01)


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_of_log_gives_back_what_was_flown(tmp_path: Path, name: str) -> None:
    found = measure(read_recording(WRITERS[name](tmp_path / name)))
    # Neither of ArduPilot's logs tells which heading we asked for.
    told = name not in COARSE
    check_flight(found, coarse=name in COARSE, heading=told)
    assert (found.heading_error_deg is not None) == told
    assert (found.reaction_time_s is not None) == (name == "flight.mcap")
    assert found.worst.startswith("5.")


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("suffix", ["", ".ulg", ".tlog"])
def test_the_content_tells_the_kind(tmp_path: Path, name: str, suffix: str) -> None:
    whole, renamed = WRITERS[name](tmp_path / "log"), tmp_path / f"renamed{suffix}"
    found = measure(read_recording(whole.rename(renamed)))
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=5e-3)


@pytest.mark.parametrize("name", WRITERS)
def test_a_log_that_breaks_off_is_measured_until_then(tmp_path: Path, name: str) -> None:
    path = WRITERS[name](tmp_path / name)
    path.write_bytes(path.read_bytes()[: round(0.7 * path.stat().st_size) + 1])
    found = measure(read_recording(path))
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=5e-3)


@pytest.mark.parametrize("name", ["px4.tlog", "copter.BIN"])
@pytest.mark.parametrize("damage", [b"", b"\xfd" * 300, bytes(5000), b"\xa3\x95\x0b"])
def test_a_damaged_log_is_measured_around_the_damage(
    tmp_path: Path, name: str, damage: bytes
) -> None:
    path = WRITERS[name](tmp_path / name)
    data = path.read_bytes()
    at = round(0.8 * len(data)) + 7
    # A piece is missing, and something else is in its place.
    path.write_bytes(data[:at] + damage + data[at + 100 :])
    check_flight(measure(read_recording(path)), coarse=name in COARSE, heading=name == "px4.tlog")


# ---------------------------------------------------------------------- clocks

CLOCKS: dict[str, Stamp] = {
    "back by 30 s": lambda t: t if t < 9.0 else t - 30.0,
    "back by 0.3 s": lambda t: t if t < 9.0 else t - 0.3,
    "ahead by 2 s": lambda t: t if t < 9.0 else t + 2.0,
    "ahead by a year": lambda t: t if t < 9.0 else t + 3.15e7,
    "from 1970": lambda t: t - 1.79e9 if t < 1.0 else t,
    "to and fro": lambda t: t + 100.0 * (int(t / 6.0) % 2),
}


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("kind", ["tlog", "mcap"])
def test_a_clock_that_is_set_in_flight_changes_nothing(
    tmp_path: Path, kind: str, clock: str
) -> None:
    path = tmp_path / "log"
    if kind == "tlog":
        Tlog().fly().write(path, CLOCKS[clock])
    else:
        mcap(path, CLOCKS[clock])
    check_flight(measure(read_recording(path)))


def test_a_hole_in_a_log_is_not_flown_over(tmp_path: Path) -> None:
    log = Tlog().fly()
    log.entries = [entry for entry in log.entries if not 7.0 < entry[0] < 11.0]
    check_flight(measure(read_recording(log.write(tmp_path / "hole.tlog"))))


def test_a_pause_of_the_stream_is_not_interpolated_over(tmp_path: Path) -> None:
    """What is asked for after a pause, far away, is not a reference for what came before."""
    log, paused = Tlog().fly(), Tlog()
    for time_s, frame in log.entries:
        told = frame[6] == 196
        if not (told and 7.0 < time_s < 9.0):
            paused.entries.append((time_s, frame))
    for time_s in TIMES_S[(TIMES_S >= 9.0) & (TIMES_S < 9.2)].tolist():
        x_m, *rest = reference(time_s)
        far = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0, x_m + 60.0, *rest, 0.0, 0.0
        )
        paused.entries = [e for e in paused.entries if e[0] != time_s or e[1][6] != 196]
        paused.add(time_s, far, 1, 196)
    paused.entries = [e for e in paused.entries if not (9.0 <= e[0] < 9.5 and _is_pose(e[1]))]
    check_flight(measure(read_recording(paused.write(tmp_path / "pause.tlog"))))


def _is_pose(frame: bytes) -> bool:
    number = int.from_bytes(frame[7:10], "little")
    return bool(number == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)


def test_what_px4_asked_of_itself_before_is_not_followed(tmp_path: Path) -> None:
    check_flight(measure(read_recording(ulog(tmp_path / "taken.ulg", taken_s=3.0))))


@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=50))
def test_times_run_forward_but_for_what_is_reordered(steps_s: list[float]) -> None:
    timeline, raw_s, previous_s = Timeline(), 0.0, timeline_start()
    for step_s in steps_s:
        raw_s += step_s
        time_s = timeline.at(raw_s)
        assert time_s >= previous_s - 0.021
        if -0.02 <= step_s <= 1.0 and not math.isinf(previous_s):
            assert time_s - previous_s == pytest.approx(step_s, abs=1e-5)
        previous_s = time_s


def timeline_start() -> float:
    return -math.inf


# ---------------------------------------------------------------------- several vehicles


def test_of_two_vehicles_the_one_that_flies_on_set_points_is_measured(tmp_path: Path) -> None:
    log = Tlog().fly().fly(system=2, told=False, mode=4 << 16, offset_m=100.0)
    found = measure(read_recording(log.write(tmp_path / "two.tlog")))
    check_flight(found)
    assert found.source.endswith("vehicle 1")


def test_of_two_that_fly_one_has_to_be_asked_for(clearway: Clearway, tmp_path: Path) -> None:
    path = Tlog().fly().fly(system=7, offset_m=100.0).write(tmp_path / "two.tlog")
    ran = clearway("identify", path)
    assert ran.code == 2
    assert ran.err.count("\n") == 1
    assert "vehicles 1, 7 fly" in ran.err
    assert "--system-id" in ran.err
    ran = clearway("identify", path, "--system-id", "7", "--format", "json")
    assert ran.code == 0
    (flight,) = json.loads(ran.out)["flights"]
    assert flight["tracking_error_m"] == pytest.approx(BESIDE_M, abs=2e-3)
    assert flight["source"].endswith("vehicle 7")


@pytest.mark.parametrize(
    ("asked", "words"), [("3", "no vehicle 3, only 1, 2"), ("0", "0"), ("x", "x")]
)
def test_a_vehicle_that_is_not_there(
    clearway: Clearway, tmp_path: Path, asked: str, words: str
) -> None:
    path = Tlog().fly().fly(system=2).write(tmp_path / "two.tlog")
    ran = clearway("identify", path, "--system-id", asked)
    assert ran.code == 2
    assert words in ran.err


def test_a_set_point_for_all_is_one_for_each(tmp_path: Path) -> None:
    log = Tlog().fly(target=0)
    check_flight(measure(read_recording(log.write(tmp_path / "all.tlog"))))


def test_other_components_are_not_the_vehicle(tmp_path: Path) -> None:
    """A ground station, a gimbal and a companion speak, too, of themselves."""
    log = Tlog().fly(autopilot=ARDUPILOT, mode=GUIDED)
    for time_s in TIMES_S[::10].tolist():
        gimbal = mavlink.MAVLink_heartbeat_message(26, ARDUPILOT, 0, 0, 4, 3)
        log.add(time_s + 0.001, gimbal, 1, 154)
        tilted = mavlink.MAVLink_attitude_message(0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
        log.add(time_s + 0.001, tilted, 1, 154)
        station = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        log.add(time_s + 0.001, station, 255, 190)
        elsewhere = mavlink.MAVLink_local_position_ned_message(0, 9.0, 9.0, 9.0, 0.0, 0.0, 0.0)
        log.add(time_s + 0.001, elsewhere, 1, 197)
    check_flight(measure(read_recording(log.write(tmp_path / "busy.tlog"))))


def test_of_two_commanders_the_one_that_sent_most_counts(tmp_path: Path) -> None:
    log = Tlog().fly()
    for time_s in TIMES_S[::20].tolist():
        far = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0, *(50.0,) * 9, 0.0, 0.0
        )
        log.add(time_s, far, 255, 190)
    found = measure(read_recording(log.write(tmp_path / "rival.tlog")))
    check_flight(found)
    assert any("several commanders sent setpoints" in note for note in found.notes)


# ---------------------------------------------------------------------- the autopilot's own words


def test_px4_tells_where_it_was_asked_to_be_but_not_how_fast(tmp_path: Path) -> None:
    path = Tlog().fly(told=False, echo_every=2).write(tmp_path / "station.tlog")
    found = measure(read_recording(path))
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=2e-3)
    assert found.tracking_error_z_m == pytest.approx(LOW_M, abs=1e-3)
    assert found.heading_error_deg == pytest.approx(math.degrees(LOOK_RAD), abs=0.01)
    # Its controller's velocity and acceleration are not what we asked for.
    assert found.velocity_error_mps == (None, None)
    assert found.attitude_lag_s is None
    assert found.tilt_asked_deg is None
    assert any("velocity error" in note for note in found.notes)


def test_what_is_not_identified_is_said(clearway: Clearway, tmp_path: Path) -> None:
    path = Tlog().fly(told=False, echo_every=2).write(tmp_path / "station.tlog")
    ran = clearway("identify", path)
    assert ran.code == 0
    assert "its controller's velocity" in ran.out
    assert "vehicle.velocity_error_mps.0: not in these logs" in ran.out


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_set_points_that_come_too_slowly(tmp_path: Path, autopilot: int) -> None:
    mode = GUIDED if autopilot == ARDUPILOT else 6 << 16
    log = Tlog().fly(autopilot=autopilot, mode=mode, told=False, echo_every=50)
    with pytest.raises(CommandError, match=r"at 1\.0 Hz, expected at least 4 Hz"):
        read_recording(log.write(tmp_path / "slow.tlog"))


@pytest.mark.parametrize("every", [2, 5, 12, 13])
def test_what_ardupilot_repeats_is_usable_down_to_4_hz(tmp_path: Path, every: int) -> None:
    log = Tlog().fly(autopilot=ARDUPILOT, mode=GUIDED, told=False, echo_every=every)
    found = measure(read_recording(log.write(tmp_path / "station.tlog")))
    # A parabola of 2.25 m/s² is so far off its chord.
    chord_m = SWAY_M * SWAY_RADPS**2 * (0.02 * every) ** 2 / 8.0
    assert found.tracking_error_m == pytest.approx(BESIDE_M, abs=chord_m + 2e-3)


def test_set_points_are_preferred_to_what_the_autopilot_says_of_them(tmp_path: Path) -> None:
    found = measure(read_recording(Tlog().fly(echo_every=5).write(tmp_path / "both.tlog")))
    check_flight(found)
    assert found.notes == ()


# ---------------------------------------------------------------------- our own


def test_our_own_log_reproduces_the_result_of_the_flight(
    clearway: Clearway, tmp_path: Path
) -> None:
    assert clearway("fly", "--virtual", "--out", tmp_path).code == 0
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    ran = clearway("identify", tmp_path / "flight.mcap", "--format", "json")
    assert ran.code == 0
    document = json.loads(ran.out)
    (flight,) = document["flights"]
    # The reference is interpolated between ticks, the monitor evaluates it: at 2.6 m/s² and 20 ms
    # a parabola is 0.13 mm off its chord.
    assert flight["tracking_error_m"] == pytest.approx(result["tracking_error_max_m"], abs=5e-4)
    declared_m = document["contract"]["vehicle.tracking_error_m"]
    assert 1.25 * flight["tracking_error_m"] <= declared_m
    assert declared_m < 1.25 * flight["tracking_error_m"] + 0.01
    assert 0.05 <= flight["reaction_time_s"] <= 0.15
    assert " of front/" in flight["worst"] or flight["worst"].endswith("cruising")
    table = clearway("identify", tmp_path / "flight.mcap", "--margin", "0.5").out
    assert "50 % above" in table
    assert "vehicle.tracking_error_z_m" in table
    assert "vehicle.heading_error_deg" in table


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"phase": "standby"}, "0 poses"),
        ({"reference_position_ned_m": None}, "the daemon did not fly in it"),
        ({"position_ned_m": None}, "no position"),
        ({"position_ned_m": [1.0, None, 2.0]}, "another version"),
        ({"leg_heading_rad": "north"}, "another version"),
        ({"velocity_ned_mps": [1.0]}, "another version"),
    ],
)
def test_states_that_are_not_of_a_flight(
    clearway: Clearway, tmp_path: Path, said: dict[str, Any], words: str
) -> None:
    ran = clearway("identify", mcap(tmp_path / "flight.mcap", said=said))
    assert (ran.code, ran.err.count("\n")) == (2, 1)
    assert words in ran.err


def weaving(asked_mps2: FloatArray, rolled_rad: FloatArray, time_s: FloatArray) -> Recording:
    still = np.zeros(len(time_s))
    return Recording(
        source="weave",
        time_s=time_s,
        position_error_m=still,
        height_error_m=still,
        velocity_error_mps=np.zeros((0, 2)),
        heading_error_rad=still,
        asked_ned_mps2=np.column_stack((still, asked_mps2)),
        roll_rad=rolled_rad,
        pitch_rad=still,
        yaw_rad=still,
        reaction_s=None,
        doing=lambda _: "weaving",
    )


@pytest.mark.parametrize("apart_s", [0.0, 30.0, 1e9])
@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.35])
def test_the_attitude_lag_is_found_in_wind(lag_s: float, apart_s: float) -> None:
    asked_mps2 = 2.0 * np.sin(2.0 * TIMES_S) + np.sin(5.3 * TIMES_S)
    late_mps2 = 2.0 * np.sin(2.0 * (TIMES_S - lag_s)) + np.sin(5.3 * (TIMES_S - lag_s)) + 0.7
    time_s = TIMES_S + apart_s * (TIMES_S > 10.0)
    recording = weaving(asked_mps2, np.arctan(late_mps2 / GRAVITY_MPS2), time_s)
    assert attitude_lag_s(recording) == pytest.approx(lag_s, abs=0.011)


@pytest.mark.parametrize("asked_mps2", [0.0, math.nan])
def test_a_vehicle_that_flies_straight_shows_no_lag(asked_mps2: float) -> None:
    still = np.zeros(len(TIMES_S))
    assert attitude_lag_s(weaving(still + asked_mps2, still, TIMES_S)) is None


def test_the_worst_of_several_flights_is_declared() -> None:
    def flight(error_m: float, reaction_s: float | None) -> Measured:
        return Measured(
            source="f",
            tracking_error_m=error_m,
            tracking_error_z_m=error_m / 2.0,
            velocity_error_mps=(None, 0.04),
            reaction_time_s=reaction_s,
            attitude_lag_s=0.1,
            heading_error_deg=2.0,
            roll_max_deg=9.0,
            pitch_max_deg=9.0,
            tilt_max_deg=9.0,
            tilt_asked_deg=9.0,
            worst="cruising",
        )

    declared = contract_values([flight(0.2, None), flight(0.1, 0.08)], 0.25)
    assert declared == {
        "vehicle.tracking_error_m": 0.25,
        "vehicle.tracking_error_z_m": 0.13,
        "vehicle.velocity_error_mps.0": None,
        "vehicle.velocity_error_mps.1": 0.05,
        "vehicle.reaction_time_s": 0.1,
        "vehicle.attitude_lag_s": 0.13,
        "vehicle.heading_error_deg": 2.5,
    }


# ---------------------------------------------------------------------- what cannot be used

LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0" * 64 + b"\nsize 123456\n"
DATAFLASH_FORMAT = b"\xa3\x95\x80\x80YFMT\x00BBnNZ".ljust(89, b"\x00")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        (b"", "the file is empty"),
        (b"just text\n" * 100, "not a log, expected"),
        (bytes(3000), "not a log, expected"),
        (bytes(range(256)) * 20, "not a log, expected"),
        (LFS, "Git LFS"),
        (b"\x1f\x8b\x08\x00" + bytes(50), "gzip"),
        (b"".join(frame for _, frame in Tlog().fly().entries[:200]), "without times"),
        (b"PK\x03\x04" + bytes(50), "ZIP"),
        (b"\x28\xb5\x2f\xfd" + bytes(50), "zstd"),
        (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", "give the .BIN"),
        (b"\x89MCAP0\r\n nonsense", "not a flight log"),
        (b"\x89MCAP0\r\n", "not a flight log"),
        (b"ULog\x01\x12\x35\x01", "ULog"),
        (b"ULog\x01\x12\x35\x01" + bytes(200), "log"),
        (DATAFLASH_FORMAT, "no GUIP"),
        (b"\xa3\x95\x80", "no GUIP"),
        (DATAFLASH_FORMAT + bytes(5000), "no GUIP"),
        (DATAFLASH_FORMAT + b"\xa3\x95\x07" * 500, "no GUIP"),
    ],
)
def test_what_is_not_a_log(clearway: Clearway, tmp_path: Path, content: Any, words: str) -> None:
    path = tmp_path / "log"
    if content is not None:
        path.write_bytes(content)
    ran = clearway("identify", path)
    assert ran.code == 2
    assert ran.err.count("\n") == 1
    assert str(path) in ran.err
    assert words in ran.err


def without(kind: str) -> Tlog:
    """A flight whose log lacks one kind of message."""
    log = Tlog().fly()
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{kind}")
    log.entries = [e for e in log.entries if int.from_bytes(e[1][7:10], "little") != number]
    return log


@pytest.mark.parametrize(
    "kind", ["LOCAL_POSITION_NED", "SET_POSITION_TARGET_LOCAL_NED", "ATTITUDE", "HEARTBEAT"]
)
def test_what_is_missing_is_named(tmp_path: Path, kind: str) -> None:
    path = without(kind).write(tmp_path / "some.tlog")
    with pytest.raises(CommandError, match=f"no {kind}"):
        read_recording(path)


def test_flights_that_follow_no_setpoints(clearway: Clearway, tmp_path: Path) -> None:
    for path in (
        Tlog().fly(mode=3 << 16).write(tmp_path / "loiter.tlog"),
        Tlog().fly(mask=0x1C7).write(tmp_path / "velocity.tlog"),
        ulog(tmp_path / "loiter.ulg", nav_state=4),
        dataflash(tmp_path / "loiter.BIN", mode=5),
        dataflash(tmp_path / "velocity.BIN", sub_mode=4),
    ):
        ran = clearway("identify", path)
        assert (ran.code, str(path) in ran.err) == (2, True)
        assert ran.err.count("\n") == 1


# ---------------------------------------------------------------------- directories


def test_every_log_of_a_directory_is_measured(clearway: Clearway, tmp_path: Path) -> None:
    (tmp_path / "deeper").mkdir()
    tlog(tmp_path / "one.tlog")
    ulog(tmp_path / "deeper" / "two")
    (tmp_path / "notes.txt").write_text("not a log\n", encoding="utf-8")
    (tmp_path / "empty.tlog").touch()
    Tlog().fly(mode=3 << 16).write(tmp_path / "loiter.tlog")
    ran = clearway("identify", tmp_path, "--format", "json")
    assert ran.code == 0
    document = json.loads(ran.out)
    sources = {Path(flight["source"]).name for flight in document["flights"]}
    assert sources == {"one.tlog", "two"}
    (skipped,) = document["skipped"]
    assert "loiter.tlog" in skipped
    assert "skipped: " in clearway("identify", tmp_path).out


@pytest.mark.parametrize("loitered", [False, True])
def test_a_directory_without_a_flight(
    clearway: Clearway, tmp_path: Path, *, loitered: bool
) -> None:
    if loitered:
        Tlog().fly(mode=3 << 16).write(tmp_path / "loiter.tlog")
    ran = clearway("identify", tmp_path)
    assert ran.code == 2
    assert ran.err.count("\n") == 1
    assert str(tmp_path) in ran.err
    assert ("loiter.tlog" in ran.err) == loitered


def test_a_file_that_is_not_a_log_is_passed_over_only_in_a_directory(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a log\n", encoding="utf-8")
    with pytest.raises(NotALogError):
        read_recording(path)


@pytest.mark.parametrize("margin", ["-1", "nan", "some"])
def test_the_margin_is_a_number(clearway: Clearway, margin: str) -> None:
    assert clearway("identify", "any.mcap", "--margin", margin).code == 2
