"""Each thing that keeps a daemon from flying is named, with its cure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest

from gcs_tools.doctor.diagnosis import Diagnosis, contract_diagnosis, diagnose
from gcs_tools.doctor.observation import Observation
from gcs_tools.doctor.vehicle import diagnosis_of
from gcs_tools.preflight.finding import Finding, Verdict
from onboard.events import EventData
from onboard.files.contract_file import load_contract
from onboard.recording.messages import (
    DropCounters,
    EventRecord,
    SensorRecord,
    StateRecord,
)
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "px4_contract.yaml")
OTHER = load_contract(CONFIG / "px4_contract.yaml", ("vehicle.radius_m=0.41",))
WELL = StateRecord(
    time_s=1.7e9,
    phase="standby",
    mode="LOITER",
    detection_age_s=0.05,
    telemetry_age_s=0.02,
    sensors={"front": SensorRecord(age_s=0.05, heard_age_s=0.02, stamp_ahead_s=-0.02)},
    cleared=True,
)
SEEN = Observation(states=(WELL, WELL), ahead_s=-0.001, contract=CONTRACT)


def seen_with(before: dict[str, int] | None = None, **state: Any) -> Observation:
    """Return what is heard of a daemon in another state; ``before``: counters at the beginning."""
    first = replace(WELL, dropped=DropCounters(**(before or {})))
    return replace(SEEN, states=(first, replace(WELL, **state)))


def not_well(seen: Observation, **known: Any) -> list[Diagnosis]:
    return [each for each in diagnose(seen, **known) if each.verdict is not Verdict.HOLDS]


def test_a_daemon_that_is_well() -> None:
    found = diagnose(SEEN, CONTRACT)
    assert not_well(SEEN, expected=CONTRACT) == []
    assert [each.name for each in found] == [
        "daemon", "daemon's contract", "link", "sensor", "clock", "log", "authorization",
    ]  # fmt: skip
    assert all(each.text and not each.cure for each in found)


def test_what_was_read_from_the_vehicle_and_where_a_flight_was_left_are_said() -> None:
    read: dict[str, Any] = {"mission": "2 legs, 24 m", "resumable": "leg 2 of 3"}
    texts = {each.name: each.text for each in diagnose(seen_with(**read), CONTRACT)}
    assert texts["mission"] == "read from the vehicle: 2 legs, 24 m"
    assert texts["flight left"].startswith("at leg 2 of 3: clearway resume")
    (found,) = not_well(seen_with(mission_doubt="item 3: not known to Clearway"))
    assert (found.name, found.text) == ("mission", "item 3: not known to Clearway")
    assert "upload a mission" in found.cure


def test_a_daemon_that_is_not_heard_is_unknown() -> None:
    (found,) = diagnose(Observation())
    assert found.verdict is Verdict.UNKNOWN
    assert "clearway-onboard" in found.cure


GARBAGE = DropCounters(mavlink_garbage_bytes=500)
FOREIGN = DropCounters(mavlink_foreign=9)
MALFORMED = DropCounters(frames_malformed=3)
LATE = {"front": SensorRecord(age_s=2.0), "left": SensorRecord(age_s=0.1)}
FUTURE = {"front": SensorRecord(age_s=0.0, stamp_ahead_s=3.0)}


@pytest.mark.parametrize(
    ("state", "name", "text", "cure"),
    [
        ({"telemetry_age_s": None}, "link", "no position", "MAV_1_CONFIG"),
        ({"telemetry_age_s": 30.0}, "link", "no position for 30 s", "mavlink.url"),
        ({"telemetry_age_s": 0.6}, "link", "0.60 s old, limit 0.25 s", "baud rate"),
        ({"telemetry_age_s": None, "dropped": GARBAGE}, "link", "500 bytes", "baud rate"),
        ({"telemetry_age_s": None, "dropped": FOREIGN}, "link", "other systems", "system_id"),
        ({"position_doubt": "no GNSS"}, "position", "no GNSS", "docs/position.md"),
        ({"detection_age_s": None, "sensors": {}}, "sensor", "no frame", "zenoh.listen"),
        ({"detection_age_s": 2.0, "sensors": LATE}, "sensor", "limit 0.3 s (front)", "silent"),
        ({"dropped": MALFORMED}, "sensor format", "3 frames", "Publish detections"),
        ({"sensors": FUTURE}, "sensor clock", "front are 3.00 s ahead", "chrony"),
        ({"log_ended": True}, "log", "disk is full", "log_quota_mb"),
        ({"cleared": False}, "authorization", "require_preflight", "clearway preflight"),
        ({"phase": "hold"}, "hold", "assumption", "clearway watch"),
    ],
)
def test_one_thing_is_missing(state: dict[str, Any], name: str, text: str, cure: str) -> None:
    (found,) = not_well(seen_with(**state), expected=CONTRACT)
    assert (found.name, found.verdict) == (name, Verdict.BROKEN)
    assert text in found.text
    assert cure in found.cure


def test_what_was_dropped_long_ago_is_not_missing() -> None:
    counters = {"mavlink_garbage_bytes": 500, "frames_malformed": 3}
    seen = seen_with(counters, dropped=DropCounters(**counters))
    assert not_well(seen) == []


def test_the_daemon_flies_another_contract_than_the_file() -> None:
    (found,) = not_well(SEEN, expected=OTHER)
    assert found.name == "daemon's contract"
    assert CONTRACT.sha256[:12] in found.text
    assert OTHER.sha256[:12] in found.text
    assert "restart" in found.cure


def test_a_daemon_without_a_contract_cannot_be_judged() -> None:
    found = not_well(replace(SEEN, contract=None))
    assert {each.verdict for each in found} == {Verdict.UNKNOWN}
    assert [each.name for each in found] == ["daemon's contract", "sensor"]


def test_a_contract_is_judged_by_what_the_flight_needs() -> None:
    assert contract_diagnosis(CONTRACT, 5.0).verdict is Verdict.HOLDS
    blind = ("sensor.detection_range_m=5", "requirements.progress=best_effort")
    found = contract_diagnosis(load_contract(CONFIG / "px4_contract.yaml", blind), 5.0)
    assert found.verdict is Verdict.BROKEN
    assert "passive_safety" in found.text
    assert "clearway preflight" in found.cure
    dense = ("environment.obstacle_separation_min_m=3",)
    near = load_contract(CONFIG / "px4_contract.yaml", dense)
    assert contract_diagnosis(near, 5.0).text == "does not hold: separation"
    accepted = load_contract(
        CONFIG / "px4_contract.yaml", (*dense, "requirements.progress=best_effort")
    )
    assert contract_diagnosis(accepted, 5.0).verdict is Verdict.HOLDS


@pytest.mark.parametrize(("ahead_s", "word"), [(-400.0, "behind"), (400.0, "ahead of")])
def test_a_clock_that_was_never_set(ahead_s: float, word: str) -> None:
    (found,) = not_well(replace(SEEN, ahead_s=ahead_s))
    assert found.name == "clock"
    assert f"400.00 s {word} this computer's" in found.text
    assert "timedatectl" in found.cure


def heard(name: str, text: str, **data: Any) -> EventRecord:
    return EventRecord(time_s=1.7e9, name=name, text=text, data=cast(EventData, data))


def test_every_reason_for_not_departing_has_its_cure() -> None:
    beside = {"kind": "beside_leg", "subject": "", "text": "4.0 m beside the leg (limit 2 m)"}
    newer = {"kind": "of_a_newer_daemon", "subject": "", "text": "another reason"}
    event = heard("refused", "not leaving standby: …", reasons=[beside, newer])
    found = not_well(replace(SEEN, events=(heard("phase", "x"), event)))
    assert [(each.name, each.text) for each in found] == [
        ("departure", beside["text"]),
        ("departure", newer["text"]),
    ]
    assert "fly back to the line of the leg" in found[0].cure
    assert found[1].cure == "cure what it names"


def test_an_assumption_that_fails_has_its_cure() -> None:
    event = heard("violation", "wind: 9.00, limit 6.00 m/s", assumption="wind")
    (found,) = not_well(replace(SEEN, events=(event, event)))
    assert (found.name, found.text) == ("assumption", event.text)
    assert "wait for less wind" in found.cure


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("MPC_TILTMAX_AIR", "set MPC_TILTMAX_AIR as it says"),
        ("battery", "charge it"),
        ("LOCAL_POSITION_NED", "raise its rate"),
        ("connection", "check the URL"),
        ("geofence areas", "upload it"),
        ("front range_m", "lower the speed"),
        ("front", "clearway sensor check"),
    ],
)
def test_findings_on_the_vehicle_get_a_cure(name: str, cure: str) -> None:
    broken = diagnosis_of(Finding("vehicle", name, Verdict.BROKEN, "found"))
    assert (broken.name, broken.text) == (f"vehicle {name}", "found")
    assert cure in broken.cure
    assert diagnosis_of(Finding("vehicle", name, Verdict.HOLDS, "found")).cure == ""
