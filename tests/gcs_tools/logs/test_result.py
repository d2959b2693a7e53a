"""`result.json` and the picture from logs whose content is known."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.image import imread

from gcs_tools.console.errors import CommandError
from gcs_tools.fly.picture import draw_flight
from gcs_tools.logs.flight_log import Log, read_log
from gcs_tools.logs.result import MissingValueError, Result, plan_time_ms, result_of
from gcs_tools.scenario import Expectation, load_scenario
from onboard.files.truth_record import TruthRecord
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import (
    EventRecord,
    KnownObstacle,
    Obstacles,
    PlanRecord,
    StateRecord,
)
from tests.gcs_tools.running import CONFIG

KEYS = {
    "outcome", "reason", "collisions", "clearance_min_m", "tracking_error_max_m",
    "velocity_error_max_mps", "duration_s", "obstacles_avoided", "plans", "plan_time_ms",
    "violations", "final_position_ned_m", "contract_sha256", "seed",
    "pauses", "mean_speed_mps", "progress", "threaded", "rest_margin_min_m", "speed_at_contact_mps",
    "contacts_at_rest",
}  # fmt: skip
MISSION = ("standby", "cruise", "avoid", "avoid", "cruise", "avoid", "cruise", "arrived")


def state(time_s: float, phase: str, **more: Any) -> StateRecord:
    speed_mps = 2.0 if phase in {"cruise", "avoid"} else 0.0
    given: dict[str, Any] = {
        "position_ned_m": (2.0 * time_s, 0.1, -4.0),
        "velocity_ned_mps": (speed_mps, 0.0, 0.0),
        "reference_position_ned_m": None if phase == "standby" else (2.0 * time_s, 0.0, -4.0),
        "tracking_error_m": 0.05,
        "velocity_error_mps": (0.02, 0.01),
        "cruising": phase == "cruise",
        **more,
    }
    return StateRecord(time_s=time_s, phase=phase, mode="OFFBOARD", **given)


def truth(time_s: float, collisions: int = 0, clearance_min_m: float = 0.4) -> TruthRecord:
    return TruthRecord(
        time_unix_s=time_s,
        position_ned_m=(2.0 * time_s, 0.1, -4.0),
        clearance_m=1.0,
        clearance_min_m=clearance_min_m,
        collisions=collisions,
    )


def logs(
    phases: Sequence[str] = MISSION,
    *,
    events: Sequence[EventRecord] = (),
    truths: Sequence[TruthRecord] = (),
) -> tuple[Log, Log]:
    states = [state(float(number), phase) for number, phase in enumerate(phases)]
    plans = [PlanRecord(time_s=0.0, kind=kind) for kind in ("qp", "qp", "vertex")]
    metadata = {"clearway": {"contract_sha256": "abc"}}
    flight = Log(states=states, plans=plans, events=events, metadata=metadata)
    return flight, Log(truths=truths or [truth(7.0)])


def event(name: str, text: str) -> EventRecord:
    return EventRecord(time_s=0.0, name=name, text=text)


def test_a_touch_at_rest_is_counted_and_no_collision() -> None:
    states = [state(float(n), phase) for n, phase in enumerate(MISSION)]
    truths = [replace(truth(float(n)), contacts_at_rest=int(n > 3)) for n in range(8)]
    found = result_of(Log(states=states), Log(truths=truths), seed=1)
    assert (found.outcome, found.collisions, found.contacts_at_rest) == ("arrived", 0, 1)
    assert found.succeeded


def test_a_mission_flown() -> None:
    result = result_of(*logs(), seed=3, plan_times_s=(0.001, 0.003, 0.002))
    assert result.succeeded
    assert result == Result(
        outcome="arrived",
        reason="mission flown",
        collisions=0,
        clearance_min_m=0.4,
        tracking_error_max_m=0.05,
        velocity_error_max_mps=(0.02, 0.01),
        duration_s=5.0,
        obstacles_avoided=2,
        plans={"qp": 2, "vertex": 1, "brake": 0},
        plan_time_ms={"p50": 2.0, "p99": 3.0, "max": 3.0},
        violations=(),
        final_position_ned_m=(14.0, 0.1, -4.0),
        contract_sha256="abc",
        seed=3,
        pauses=0,
        mean_speed_mps=2.0,
        progress="guaranteed",
        rest_margin_min_m=None,
        speed_at_contact_mps=None,
        contacts_at_rest=0,
    )


def test_a_flight_through_a_dense_field() -> None:
    phases = ("standby", "thread", "pause", "pause", "thread", "pause", "thread", "arrived")
    flight, truths = logs(phases)
    states = [
        replace(each, cruising=False, rest_margin_m=0.3 + abs(each.time_s - 4.0))
        for each in flight.states
    ]
    result = result_of(replace(flight, states=states), truths, seed=1, progress="best_effort")
    assert (result.outcome, result.pauses, result.progress) == ("arrived", 2, "best_effort")
    assert (result.duration_s, result.mean_speed_mps) == (5.0, 2.0)
    assert result.rest_margin_min_m == pytest.approx(0.3)


def test_contacts_are_counted_with_their_speed() -> None:
    speeds = [(0, 2.0), (1, 1.5), (1, 0.0), (2, 0.05), (3, 0.7), (3, 9.0)]
    truths = [
        replace(truth(float(n), collisions=count), velocity_ned_mps=(mps, 0.0, 0.0))
        for n, (count, mps) in enumerate(speeds)
    ]
    result = result_of(*logs(truths=truths), seed=1)
    assert (result.outcome, result.collisions) == ("collided", 3)
    assert (result.speed_at_contact_mps, result.contacts_at_rest) == (1.5, 1)


def test_the_file_has_the_published_keys(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    result_of(*logs(), seed=3).write(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert set(document) == KEYS
    assert document["plan_time_ms"] == {"p50": None, "p99": None, "max": None}
    with pytest.raises(CommandError, match="cannot be written"):
        result_of(*logs(), seed=3).write(tmp_path / "nowhere" / "result.json")


def test_a_collision_beats_an_arrival() -> None:
    hit = [truth(3.0), truth(4.0, collisions=1, clearance_min_m=-0.1), truth(5.0, collisions=1)]
    result = result_of(*logs(truths=hit), seed=1)
    assert (result.outcome, result.collisions, result.succeeded) == ("collided", 1, False)


def test_a_hold_says_why() -> None:
    events = [
        event("violation", "detection_age: 0.40, limit 0.30 s"),
        event("phase", "holding: detection_age: 0.40, limit 0.30 s; braking to hover"),
        event("phase", "standby (control taken)"),
    ]
    result = result_of(*logs(("standby", "cruise", "hold"), events=events), seed=1)
    assert result.outcome == "held"
    assert result.reason.startswith("holding: detection_age")
    assert result.violations == ("detection_age: 0.40, limit 0.30 s",)
    assert not result.succeeded


def test_an_arrival_with_a_violation_is_no_success() -> None:
    result = result_of(*logs(events=[event("violation", "tracking_error")]), seed=1)
    assert result.outcome == "arrived"
    assert not result.succeeded


def test_a_mission_without_an_end_is_aborted() -> None:
    refused = [event("refused", "staying standby: no fresh telemetry")]
    flown = logs(("standby", "standby"), events=refused)
    result = result_of(*flown, seed=1, aborted="given up")
    assert result.outcome == "aborted"
    assert result.reason == "given up; staying standby: no fresh telemetry"
    assert result.duration_s == 0.0
    nothing = result_of(Log(complete=False), Log(complete=False), seed=1)
    assert (nothing.outcome, nothing.final_position_ned_m) == ("aborted", None)


def test_errors_count_only_while_the_daemon_flies() -> None:
    flight, flown = logs()
    states = list(flight.states)
    states[0] = replace(states[0], tracking_error_m=9.0)
    states[-1] = replace(states[-1], tracking_error_m=9.0)
    states[1] = replace(states[1], velocity_error_mps=(0.3, 0.0))
    # Avoiding: the plan bounds it, not this.
    states[2] = replace(states[2], velocity_error_mps=(9.0, 9.0))
    result = result_of(replace(flight, states=states), flown, seed=1)
    assert result.tracking_error_max_m == 0.05
    assert result.velocity_error_max_mps == (0.3, 0.01)


@pytest.mark.parametrize("name", ["tracking_error_m", "velocity_error_mps", "cruising"])
def test_a_value_that_the_log_lacks_is_named_and_not_replaced_by_zero(name: str) -> None:
    flight, flown = logs()
    missing: dict[str, Any] = {name: None}
    states = list(flight.states)
    states[1] = replace(states[1], **missing)
    with pytest.raises(MissingValueError, match=name):
        result_of(replace(flight, states=states), flown, seed=1)
    # On the ground it is not needed.
    grounded = [replace(states[0], **missing), *flight.states[1:]]
    assert result_of(replace(flight, states=grounded), flown, seed=1).succeeded


def test_an_unfinished_avoidance_is_none() -> None:
    assert result_of(*logs(("cruise", "avoid", "hold")), seed=1).obstacles_avoided == 0


def test_expectations() -> None:
    arrived = result_of(*logs(), seed=1)
    assert arrived.meets(Expectation.model_validate({"obstacles_avoided": 2}))
    assert not arrived.meets(Expectation.model_validate({"obstacles_avoided": 3}))
    assert not arrived.meets(Expectation.model_validate({"outcome": "held"}))
    assert arrived.meets(Expectation.model_validate({"reason": "flown"}))
    assert not arrived.meets(Expectation.model_validate({"reason": "wind"}))


def test_plan_times_are_nearest_rank_percentiles() -> None:
    times_s = [number / 1e3 for number in range(200, 0, -1)]
    assert plan_time_ms(times_s) == pytest.approx({"p50": 100.0, "p99": 198.0, "max": 200.0})


def write_log(path: Path, states: int) -> None:
    with FlightLog(path, {"contract_sha256": "abc"}) as log:
        for number in range(states):
            phase = "cruise" if number % 2 else "avoid"
            # Incompressible, so that the file has several chunks.
            noise = " ".join(str(math.sin(number * 1e3 + k)) for k in range(100))
            log.write([state(float(number), phase, position_doubt=noise)])


def test_a_log_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    write_log(path, states=200)
    log = read_log(path)
    assert log.complete
    assert [state.time_s for state in log.states] == list(range(200))
    assert log.metadata["clearway"]["contract_sha256"] == "abc"


def test_a_log_that_breaks_off_is_read_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    write_log(path, states=200)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    log = read_log(path)
    times_s = [state.time_s for state in log.states]
    assert not log.complete
    assert 20 < len(times_s) < 200
    assert times_s == list(range(len(times_s)))


@pytest.mark.parametrize("content", [b"", b"not a log at all"])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    with pytest.raises(CommandError, match="is not a flight log"):
        read_log(path)
    with pytest.raises(CommandError, match="No such file"):
        read_log(tmp_path / "nowhere.mcap")


@pytest.mark.parametrize("phases", [MISSION, ("standby",), ()])
def test_any_flight_can_be_drawn(tmp_path: Path, phases: tuple[str, ...]) -> None:
    flight, flown = logs(phases)
    corners = [(20.0, -2.0), (26.0, -2.0), (26.0, 2.0), (20.0, 2.0)]
    known = Obstacles(time_s=0.0, obstacles=[KnownObstacle(id="1", region_ned_m=corners)])
    flight = replace(flight, obstacles=[known])
    path = tmp_path / "flight.png"
    scenario = load_scenario(CONFIG / "paper.yaml")
    draw_flight(scenario, flight, flown, result_of(flight, flown, seed=1), path)
    height, width, _ = imread(path).shape
    assert (width, height) == (1320, 792)
