"""Flights of real autopilots, replayed: what was not wrong raises no alarm, what was wrong does."""

from __future__ import annotations

import math
import re
import struct
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.guidance.phases import Phase
from onboard.mavlink.transmitter import COMPONENT_ID
from tests.recordings.cut import SIZE_MAX_BYTES, excerpt
from tests.recordings.flights import EXCERPTS, FLIGHTS
from tests.recordings.replay import (
    Recording,
    Replayed,
    main,
    replay_excerpt,
    replay_flight,
)
from tests.recordings.sightings import HullRow, Sightings
from tests.recordings.synthetic import synthetic_ardupilot_gps, with_ardupilot_gps
from tests.recordings.tlog import Decoder, read_tlog

REPORT_S = 1.0
# From 2.8 m/s the vehicle stops within this, and a doubt of 2 s comes before.
STOP_S, NOTICE_S = 1.5, 3.5
# A plan around a box of 2 m at 2.8 m/s takes some 5 s; from rest and back to rest a few times that.
PLAN_MAX_S = 60.0
REFUSAL_PERIOD_S = 5.0
# ArduPilot, second commander at 20 Hz: the vehicle leaves its reference here, by its speed.
SECOND_COMMANDER_BEGINS_S = 7.1
# In cruise, in the nominal flights; what the tests change in a recording, they change from here on.
BEGINS_S = 5.0


@cache
def replayed(name: str) -> tuple[Recording, Replayed]:
    return replay_excerpt(name)


# What the flights really violated; of other violations there must be none.
UNDISTURBED = {
    "px4_nominal": set(),
    "px4_nominal_tracking_1.2m": {"tracking_error"},
    "px4_false_second_commander": set(),
    "ardupilot_nominal": set(),
    "ardupilot_tail_wind_false_tilt_response": set(),
    "ardupilot_wind_8mps": {"tracking_error"},
}


@pytest.mark.parametrize("name", UNDISTURBED)
def test_a_flight_violates_nothing_that_it_did_not(name: str) -> None:
    _, service = replayed(name)
    assert {event.data["assumption"] for event in service.violations()} == UNDISTURBED[name]
    assert not service.named("suspicion")


@pytest.mark.parametrize("name", UNDISTURBED)
def test_an_undisturbed_flight_is_flown(name: str) -> None:
    recording, service = replayed(name)
    departed_s = service.first_s(Phase.CRUISE)
    assert departed_s < recording.duration_s / 2.0
    assert math.isinf(service.first_s(Phase.HOLD))


ONE_COMMANDER = [name for name in FLIGHTS if name != "ardupilot_second_commander_20hz"]


@pytest.mark.parametrize("name", ONE_COMMANDER)
def test_one_commander_is_not_taken_for_two(name: str) -> None:
    _, service = replayed(name)
    assert not service.violations("second_commander")


def test_a_second_commander_at_20_hz_is_noticed() -> None:
    _, service = replayed("ardupilot_second_commander_20hz")
    noticed = [*service.violations(), *service.named("suspicion")]
    assert noticed
    assert SECOND_COMMANDER_BEGINS_S < noticed[0].time_s < SECOND_COMMANDER_BEGINS_S + 1.5
    assert service.first_s(Phase.HOLD) < SECOND_COMMANDER_BEGINS_S + 2.5


@pytest.mark.parametrize("name", ["px4_nominal_tracking_1.2m", "ardupilot_nominal"])
def test_a_target_that_is_not_ours_is_another_commanders(name: str) -> None:
    """The recorded autopilot says that it goes 2 m beside what it was asked for."""

    def change(time_s: float, message: Any) -> None:
        if time_s >= BEGINS_S:
            message.y += 2.0

    recording, _ = replayed(name)
    service = replay_flight(FLIGHTS[name], recording.changed("POSITION_TARGET_LOCAL_NED", change))
    noticed = service.violations("second_commander")
    assert noticed
    assert BEGINS_S < noticed[0].time_s < BEGINS_S + 2.5
    assert service.first_s(Phase.HOLD) == pytest.approx(noticed[0].time_s, abs=0.03)


@pytest.mark.parametrize("jump_m", [-3.5, 3.5])
@pytest.mark.parametrize("name", ["px4_nominal", "ardupilot_nominal"])
def test_a_height_that_jumps_is_answered(name: str, jump_m: float) -> None:
    """From one pose to the next, the recorded estimator says, the vehicle is higher, or lower."""

    def change(time_s: float, message: Any) -> None:
        if time_s >= BEGINS_S:
            message.z += jump_m

    recording, _ = replayed(name)
    service = replay_flight(FLIGHTS[name], recording.changed("LOCAL_POSITION_NED", change))
    noticed = service.violations("estimator_reset", "tracking_error_z")
    assert noticed
    assert BEGINS_S < noticed[0].time_s < BEGINS_S + 0.2
    assert service.first_s(Phase.HOLD) < BEGINS_S + 0.2


# ArduPilot says nothing of its GPS for 4 s after the last fix; that silence is a sign, too.
@pytest.mark.parametrize(
    ("name", "fix_type", "sooner_s"),
    [("px4_gps_lost_contact", 0, 0.0), ("ardupilot_gps_lost_contact", 0, 4.1)],
)
def test_a_lost_gps_is_answered_in_time(name: str, fix_type: int, sooner_s: float) -> None:
    recording, service = replayed(name)
    sign_s = recording.first("GPS_RAW_INT", fix_type=fix_type)
    (first, *_) = service.violations("position_quality")
    assert sign_s - sooner_s < first.time_s <= sign_s + REPORT_S
    assert service.first_s(Phase.HOLD) == pytest.approx(first.time_s, abs=0.03)
    # The autopilot left the flight to its failsafe later: the answer came while it could be flown.
    assert first.time_s < service.first_s(Phase.STANDBY, after_s=first.time_s)


@pytest.mark.parametrize("name", ["px4_gps_lost_contact", "ardupilot_gps_lost_contact"])
def test_a_lost_gps_is_not_noticed_before_it_is_lost(name: str) -> None:
    recording, service = replayed(name)
    fixes_s = [time_s for time_s, m in recording.messages("GPS_RAW_INT") if m.fix_type >= 3]
    assert all(event.time_s > fixes_s[-1] for event in service.violations("position_quality"))


def test_refusals_are_said_when_they_change_in_kind() -> None:
    _, service = replayed("px4_refused_every_tick")
    refused = service.named("refused")
    assert refused
    for earlier, later in pairwise(refused):
        assert later.time_s - earlier.time_s >= REFUSAL_PERIOD_S - 1e-6
        assert _kind(earlier.text) != _kind(later.text)


def _kind(text: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "#", text)


def test_a_hand_over_at_rest_before_a_region_makes_no_endless_plan() -> None:
    recording, service = replayed("px4_handback_vertex_6383s")
    back_s = recording.first_text("avoiding front/o1 (vertex)")
    assert all(lasts_s < PLAN_MAX_S for lasts_s in service.plan_times_s)
    # It is answered all the same: by a plan, or by not flying on.
    assert math.isfinite(service.first_s(Phase.CRUISE, after_s=back_s - 6.0))
    planned = [phase for t, phase in service.phases if back_s - 6.0 < t < back_s + 3.0]
    assert Phase.AVOID in planned or Phase.HOLD in planned


def test_a_heading_that_wanders_is_noticed_before_the_contact() -> None:
    recording, service = replayed("px4_body_frame_heading_wander_contact")
    # 0.4 m before the front of the obstacle as it was first seen.
    contact_s = next(t for t, m in recording.messages("LOCAL_POSITION_NED") if m.x > 24.73 - 0.4)
    noticed = service.violations("detection_consistency", "heading_error")
    assert noticed
    assert noticed[0].time_s < contact_s - NOTICE_S
    assert service.first_s(Phase.HOLD) < contact_s - STOP_S


# ---------------------------------------------------------------------- the harness itself


@pytest.mark.parametrize("name", FLIGHTS)
def test_an_excerpt_is_small_and_whole(name: str) -> None:
    path = FLIGHTS[name].excerpt
    assert path.stat().st_size <= SIZE_MAX_BYTES
    entries = list(read_tlog(path))
    sizes = sum(8 + len(entry.frame) for entry in entries)
    assert sizes == path.stat().st_size
    begin_s, end_s = FLIGHTS[name].window_s
    lasting_s = entries[-1].time_unix_s - entries[0].time_unix_s
    assert lasting_s == pytest.approx(end_s - begin_s, abs=0.3)
    assert any(entry.sender[1] == COMPONENT_ID for entry in entries)


def test_there_is_no_excerpt_that_no_test_knows() -> None:
    assert {path.stem for path in EXCERPTS.glob("*.tlog")} == set(FLIGHTS)


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_recorded_set_points_are_the_services_own(name: str) -> None:
    """Each recorded set-point is found again at its time, and half way to the next."""
    recording, _ = replayed(name)
    for one, other in list(pairwise(recording.sent))[::25]:
        found = recording.setpoint_at(one.time_s)
        assert found is not None
        assert found.position_ned_m == pytest.approx(one.setpoint.position_ned_m)
        if other.time_s - one.time_s < 0.1:
            between = recording.setpoint_at((one.time_s + other.time_s) / 2.0)
            assert between is not None
            expected_m = (one.setpoint.position_ned_m[0] + other.setpoint.position_ned_m[0]) / 2.0
            assert between.position_ned_m[0] == pytest.approx(expected_m, abs=1e-6)


def test_sightings_are_where_hulls_grow() -> None:
    rows = [
        HullRow(0.0, "o1", (10.0, -1.0, 12.0, 1.0)),
        HullRow(1.0, "o1", (9.5, -1.0, 12.0, 1.0)),
        HullRow(2.0, "o1", (9.5, -1.0, 12.0, 2.0)),
        HullRow(3.0, "o1", (9.5, -1.0, 12.5, 2.0)),
    ]
    sightings = Sightings(rows)
    assert sightings.at(-0.1) == []
    centers = [sightings.at(time_s)[0].center_ned_m for time_s in (0.0, 1.0, 2.0, 3.0, 9.0)]
    assert centers == [(11.0, 0.0), (10.5, 0.5), (11.0, 1.0), (11.5, 1.0), (11.5, 1.0)]
    assert sightings.at(0.5)[0].size_m == (2.0, 2.0)


def test_the_synthetic_gps_is_silent_before_it_says_that_it_has_no_fix() -> None:
    decoder = Decoder()
    said = [
        (entry.time_unix_s, message)
        for entry in synthetic_ardupilot_gps(100.0, 106.0, 120.0)
        if (message := decoder.decode(entry)) is not None
    ]
    fixes = [(t, m.fix_type) for t, m in said if m.get_type() == "GPS_RAW_INT"]
    assert all((fix == 3) == (t < 106.0) for t, fix in fixes)
    assert not [t for t, _ in fixes if 106.0 <= t < 110.0]
    flags = [(t, m.flags & 0x10) for t, m in said if m.get_type() == "EKF_STATUS_REPORT"]
    assert all(bool(absolute) == (t < 113.0) for t, absolute in flags)


def test_an_excerpt_keeps_what_the_service_reads_and_when() -> None:
    """Cut once more out of an excerpt: the same messages, of fewer seconds."""
    whole = FLIGHTS["px4_gps_lost_contact"]
    entries = list(read_tlog(whole.excerpt))
    shorter = excerpt(replace(whole, window_s=(5.0, 8.0)), whole.excerpt)
    begin_s = entries[0].time_unix_s
    assert shorter == [e for e in entries if 5.0 <= e.time_unix_s - begin_s <= 8.0]
    decoder = Decoder()
    kinds = {message.get_type() for e in shorter if (message := decoder.decode(e)) is not None}
    assert {"LOCAL_POSITION_NED", "ATTITUDE", "GPS_RAW_INT", "ESTIMATOR_STATUS"} <= kinds


def test_only_ardupilot_without_a_word_of_its_gps_is_given_one() -> None:
    px4 = list(read_tlog(FLIGHTS["px4_nominal"].excerpt))
    assert with_ardupilot_gps(px4, px4[0].time_unix_s, None) is px4
    copter = list(read_tlog(FLIGHTS["ardupilot_nominal"].excerpt))
    assert with_ardupilot_gps(copter, copter[0].time_unix_s, None) is copter
    ids = {mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT}
    mute = [entry for entry in copter if entry.message_id not in ids]
    given = with_ardupilot_gps(mute, mute[0].time_unix_s, None)
    assert {entry.message_id for entry in given if entry not in mute} == ids
    # Added again, it is what was there before.
    assert len(given) == pytest.approx(len(copter), abs=2)


def test_anyone_can_replay_a_recording(capsys: pytest.CaptureFixture[str]) -> None:
    path = FLIGHTS["ardupilot_second_commander_20hz"].excerpt
    assert main([str(path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{path.name}: 14.0 s, ")
    assert "violation" in out
    assert "cruise (control granted)" in out


@pytest.mark.parametrize(
    "content", [None, b"", b"no log", struct.pack(">Q", 1) + b"\xfe\x09broken"]
)
def test_what_cannot_be_replayed(
    content: bytes | None,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path_factory.mktemp("replay") / "some.tlog"
    if content is not None:
        path.write_bytes(content)
    assert main([str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
