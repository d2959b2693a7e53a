"""The report's document: verdict, facts, limits and origin, with as much as the log has."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import pytest

from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Document, Flight
from gcs_tools.logs.flight_log import Log
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from tests.gcs_tools.campaign.oracles.evidence import result
from tests.gcs_tools.logs.raw_log import json_log
from tests.gcs_tools.running import CONFIG

BEGAN_S = 1_790_000_000.0
CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
MISSION = load_yaml(CONFIG / "paper_mission.yaml", Mission)
METADATA = {
    "clearway": {
        "contract": CONTRACT.model_dump_json(),
        "mission": MISSION.model_dump_json(),
        "version_clearway": "0.1.0",
    }
}


def document(
    *,
    metadata: Any = METADATA,
    written: Document | None = None,
    problems: tuple[str, ...] = (),
    events: list[dict[str, Any]] | None = None,
) -> Document:
    states = [
        {"time_s": BEGAN_S + n / 50, "phase": "standby" if n < 50 else "cruise"} for n in range(100)
    ]
    log = replace(
        json_log({"/state": states, "/events": events or []}, metadata), problems=problems
    )
    return document_of(Flight("paper-1", log, Log(), written))


def facts(**changes: Any) -> dict[str, str]:
    written = asdict(result(plan_time_ms={"p50": None, "p99": None, "max": None}, **changes))
    return dict(document(written=written)["facts"])


def test_any_document_is_json_without_surprises() -> None:
    for each in (document(), document(metadata={}), document(written=asdict(result()))):
        again = json.loads(json.dumps(each, allow_nan=False))
        assert again.keys() == each.keys()


def test_time_begins_with_the_departure() -> None:
    assert document()["span_s"] == (-1.0, 0.98)
    assert [phase["phase"] for phase in document()["phases"]] == ["standby", "cruise"]


@pytest.mark.parametrize(
    ("changes", "succeeded"),
    [
        ({}, True),
        ({"outcome": "held"}, False),
        ({"collisions": 1}, False),
        ({"violations": ("wind",)}, False),
    ],
)
def test_a_success_is_an_arrival_without_collision_or_violation(
    changes: dict[str, Any], *, succeeded: bool
) -> None:
    written = asdict(result(plan_time_ms={}, **changes))
    assert document(written=written)["succeeded"] is succeeded


def test_facts_are_beside_what_the_contract_allows() -> None:
    found = facts(tracking_error_max_m=0.0291, velocity_error_max_mps=(0.036, 0.011))
    vehicle = CONTRACT.vehicle
    assert found["tracking error"] == f"0.029 of {vehicle.tracking_error_m} m"
    assert found["velocity error along the leg"] == f"0.036 of {vehicle.velocity_error_mps[0]} m/s"
    assert found["plans"] == "1 qp"
    assert found["plan time"] == "not measured in virtual time"
    assert found["violations"] == "none"
    assert (found["mean speed"], found["pauses"]) == ("0.00 m/s", "0")
    paused = facts(pauses=3, mean_speed_mps=1.234)
    assert (paused["mean speed"], paused["pauses"]) == ("1.23 m/s", "3")


def test_what_is_not_known_is_said() -> None:
    assert facts(clearance_min_m=None)["least clearance"] == "unknown"
    assert facts(plans={"qp": 0})["plans"] == "none"
    assert facts(violations=("a", "b"))["violations"] == "a; b"


def test_without_a_contract_there_are_no_limits() -> None:
    found = document(metadata={}, written=asdict(result(plan_time_ms={})))
    assert set(found["limits"].values()) == {None}
    assert found["legs_ned_m"] == []
    assert dict(found["facts"])["tracking error"] == "0.000 m"
    assert found["radius_m"] == 0.3


@pytest.mark.parametrize("text", ["", "{}", "not json", '{"vehicle": 3}'])
def test_a_contract_of_another_version_is_left_out(text: str) -> None:
    found = document(metadata={"clearway": {"contract": text, "mission": text}})
    assert set(found["limits"].values()) == {None}
    assert found["legs_ned_m"] == []


def test_limits_legs_and_size_are_those_of_contract_and_mission() -> None:
    found = document()
    assert found["limits"]["cruise_speed_mps"] == CONTRACT.vehicle.cruise_speed_mps
    assert found["limits"]["frame_age_max_s"] == CONTRACT.sensor.frame_age_max_s
    assert found["legs_ned_m"] == [MISSION.start_ned_m, *(leg.end_ned_m for leg in MISSION.legs)]
    assert found["radius_m"] == CONTRACT.vehicle.radius_m


def test_the_origin_names_versions_and_every_term() -> None:
    origin = dict(document()["origin"])
    assert origin["log began"] == "2026-09-21 14:13:20 UTC"
    assert origin["version clearway"] == "0.1.0"
    assert origin["vehicle.roll_max_deg"] == json.dumps(CONTRACT.vehicle.roll_max_deg)
    assert not {"contract", "mission"} & origin.keys()


def test_events_have_a_time_a_severity_and_a_text() -> None:
    events: list[dict[str, Any]] = [
        {"time_s": BEGAN_S + 1.5, "name": "x", "severity": "error", "text": "what"},
        {"time_s": BEGAN_S},
    ]
    assert document(events=events)["events"] == [
        {"time_s": 0.5, "severity": "error", "text": "what"},
        {"time_s": -1.0, "severity": "", "text": ""},
    ]


def test_problems_of_the_log_are_handed_on() -> None:
    assert "3 records are odd" in document(problems=("3 records are odd",))["problems"]


def test_a_verdict_that_the_log_cannot_give_is_a_problem() -> None:
    found = document(metadata={})
    if found["outcome"] == "unknown":
        assert any("which the verdict needs" in problem for problem in found["problems"])
    assert not found["succeeded"]
