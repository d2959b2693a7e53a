"""Records: what they look like on the wire, and that their schemas describe it."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, fields
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from onboard.files.record_schema import record_schema
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import (
    ADAPTERS,
    LASTING,
    TOPICS,
    ZENOH_KEYS,
    CertificateRecord,
    ClauseMargin,
    DropCounters,
    EventRecord,
    KnownObstacle,
    Margins,
    Monitors,
    Obstacles,
    PlanRecord,
    Reading,
    Record,
    SeenSpace,
    SensorRecord,
    StateRecord,
    as_json,
    schema_of,
)
from onboard.recording.mover_record import KnownMover, MoversRecord
from tests.onboard.recording.json_schema import complaints

T = 1_790_000_000.25
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)]
SAMPLES: list[Record] = [
    StateRecord(time_s=T),
    StateRecord(
        time_s=T, phase="cruise", mode="OFFBOARD", armed=True, airborne=True,
        position_ned_m=(1.0, 2.0, -4.0), velocity_ned_mps=(2.0, 0.0, 0.0), roll_rad=0.1,
        reference_position_ned_m=(1.0, 2.1, -4.0), tracking_error_m=0.1,
        velocity_error_mps=(0.01, 0.02), cruising=True, leg_heading_rad=0.0,
        sensors={"front": SensorRecord(age_s=0.05, heard_age_s=0.04, stamp_ahead_s=-0.01)},
        position_doubt="no GPS", cleared=False, obstacles_known=3,
        dropped=DropCounters(frames_malformed=2),
    ),
    Margins(time_s=T, clauses=[]),
    Margins(
        time_s=T, compliant=True, binding="stop",
        clauses=[ClauseMargin(name="stop", required=1.0, declared=2.0, margin=1.0, unit="m",
                              holds=True)],
    ),
    Monitors(time_s=T),
    Monitors(time_s=T, clearance=Reading(measured=0.4, limit=0.0, unit="m")),
    Obstacles(time_s=T, obstacles=[]),
    Obstacles(time_s=T, height_m=4.0, obstacles=[KnownObstacle(id="a", measured_ned_m=SQUARE)]),
    PlanRecord(time_s=T),
    PlanRecord(
        time_s=T, obstacle="a", kind="qp", side="left", cost=3.0, plan_time_ms=1.5, start_s=T,
        end_s=T + 3.0, certificate=CertificateRecord(valid=False, failures=["thrust"]),
        keep_out_ned_m=SQUARE, path_ned_m=[(0.0, 0.0, -4.0), (1.0, 0.0, -4.0)],
    ),
    SeenSpace(time_s=T),
    SeenSpace(
        time_s=T, height_m=4.0, corner_ned_m=(1.0, 2.0), heading_rad=0.5, cell_m=0.2, row=[0, 1],
        column_from=[1, 1], column_to=[3, 2], way_to_rest_ned_m=[(0.0, 0.0), (1.0, 0.0)],
        guide_ned_m=[(0.0, 0.0), (9.0, 0.0)], pause="nothing better certifies",
    ),
    MoversRecord(time_s=T),
    MoversRecord(
        time_s=T, height_m=3.0, until_s=T + 1.5, stamp_error_s=0.02, left_out=1,
        movers=[
            KnownMover(id="ring/1", seen_s=T - 0.1),
            KnownMover(id="ring/2", kind="person", seen_s=T, speed_max_mps=1.2, yields_for=True,
                       velocity_ned_mps=(0.5, 1.0), box_ned_m=SQUARE, reach_ned_m=SQUARE),
        ],
        yielding="mover ring/2 may be on the way", missing="frames", corner_ned_m=(1.0, 2.0),
        cell_m=0.4, row=[0, 1], column_from=[1, 1], column_to=[3, 2],
    ),
    EventRecord(time_s=T),
    EventRecord(time_s=T, name="phase", severity="info", text="cruise",
                data={"from": "standby", "to": "cruise", "trigger": "control_taken"}),
    EventRecord(time_s=T, name="refused",
                data={"reasons": [{"kind": "wind", "subject": "", "text": "windy"}]}),
]  # fmt: skip


@pytest.mark.parametrize("record", SAMPLES)
def test_a_record_comes_back_as_it_was_written(record: Record) -> None:
    assert ADAPTERS[type(record)].validate_json(as_json(record), strict=True) == record


@pytest.mark.parametrize("record", SAMPLES)
def test_a_record_follows_the_schema_under_which_it_is_announced(record: Record) -> None:
    schema = schema_of(type(record))
    assert schema["title"] == f"clearway.{TOPICS[type(record)]}"
    assert complaints(json.loads(as_json(record)), schema) == []


@pytest.mark.parametrize("record_type", TOPICS)
def test_a_schema_describes_every_field(record_type: type[Record]) -> None:
    schema = schema_of(record_type)
    hidden = {name.strip("^$") for name in schema.get("patternProperties", {})}
    assert schema["properties"].keys() | hidden == {each.name for each in fields(record_type)}
    assert not schema["properties"].keys() & hidden


def test_a_schema_notices_what_does_not_follow_it() -> None:
    wrong: dict[str, Any] = {
        "time_s": "noon", "armed": 3, "position_ned_m": [1.0, 2.0], "sensors": [], "mode": None,
    }  # fmt: skip
    found = complaints(wrong, schema_of(StateRecord))
    assert [each.split(":")[0] for each in sorted(found)] == [
        "$.armed", "$.position_ned_m", "$.sensors", "$.time_s",
    ]  # fmt: skip


@pytest.mark.parametrize("record_type", [*TOPICS, TruthRecord])
def test_viewers_can_parse_every_schema(record_type: type[Any]) -> None:
    """Lichtblick loses the whole topic for a null, a reference, or an array of arrays."""

    def check(schema: dict[str, Any]) -> None:
        assert "$ref" not in schema
        assert schema["type"] in {"object", "array", "string", "number", "integer", "boolean"}
        for child in schema.get("properties", {}).values():
            check(child)
        if schema["type"] == "array":
            assert schema["items"]["type"] != "array"
            check(schema["items"])

    check(record_schema(record_type, "clearway.anything"))


@pytest.mark.parametrize("record_type", TOPICS)
def test_only_what_makes_sense_of_a_record_must_be_there(record_type: type[Record]) -> None:
    """A log of an older version lacks fields, one of a newer version has others."""
    needed = {
        each.name
        for each in fields(record_type)
        if each.default is MISSING and each.default_factory is MISSING
    }
    assert needed <= {"time_s", "clauses", "obstacles"}
    old: dict[str, Any] = {"time_s": T, **{name: [] for name in needed - {"time_s"}}}
    read = ADAPTERS[record_type].validate_json(json.dumps({**old, "warp_factor": 9}), strict=True)
    assert read.time_s == T


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"[]", b"{}", b"null", b"\xff",
        b'{"time_s": "noon"}', b'{"time_s": -1.0}', b'{"time_s": 1e300}',
        b'{"time_s": 1.0, "tracking_error_m": "0.1"}',
        b'{"time_s": 1.0, "tracking_error_m": Infinity}',
        b'{"time_s": 1.0, "velocity_error_mps": [0.1]}',
        b'{"time_s": 1.0, "position_ned_m": [1.0, 2.0, null]}',
        b'{"time_s": 1.0, "obstacles_known": 1.5}',
        b'{"time_s": 1.0, "sensors": {"front": 3}}',
    ],
)  # fmt: skip
def test_a_malformed_state_is_refused(payload: bytes) -> None:
    with pytest.raises(ValidationError):
        ADAPTERS[StateRecord].validate_json(payload, strict=True)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_number_that_json_lacks_is_null(value: float) -> None:
    state = StateRecord(
        time_s=T, tracking_error_m=value, sensors={"front": SensorRecord(age_s=value)}
    )
    said = json.loads(as_json(state))
    assert said["tracking_error_m"] is None
    assert said["sensors"]["front"]["age_s"] is None
    event = EventRecord(time_s=T, data={"measured": value})
    assert json.loads(as_json(event))["data"] == {"measured": None}


@given(st.text(), st.text())
def test_any_text_survives(name: str, text: str) -> None:
    try:
        name.encode()
        text.encode()
    except UnicodeEncodeError:  # a lone surrogate is not text
        return
    event = EventRecord(time_s=T, name=name, text=text)
    data = as_json(event)
    assert b"\n" not in data
    assert ADAPTERS[EventRecord].validate_json(data, strict=True) == event


def test_every_type_has_a_topic_and_a_key_of_its_own() -> None:
    assert TOPICS.keys() == ZENOH_KEYS.keys() == ADAPTERS.keys()
    assert len(set(TOPICS.values())) == len(set(ZENOH_KEYS.values())) == len(TOPICS)
    assert set(LASTING) < set(TOPICS)
