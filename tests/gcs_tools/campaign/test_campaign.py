"""`clearway campaign`: what is drawn, what is judged, and what is counted."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from distributed import LocalCluster
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import bdtr, bdtrc

from gcs_tools.campaign import flight as campaign_flight
from gcs_tools.campaign.command import scenario_document
from gcs_tools.campaign.flight import FlightRow, fly_case, fly_numbered, replay_command
from gcs_tools.campaign.forest import ForestSource
from gcs_tools.campaign.generator.faults import FAULT_KINDS
from gcs_tools.campaign.generator.generators import GENERATORS, generated
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.campaign.oracles.registry import ORACLES, findings
from gcs_tools.campaign.shrink import shrink
from gcs_tools.campaign.sources import GeneratedSource
from gcs_tools.campaign.statistics import failure_rate_bounds, summarize
from gcs_tools.campaign.table import read_table, write_table
from gcs_tools.campaign.workers import FlightJob, fly_on_cluster
from gcs_tools.preflight.command import check
from gcs_tools.scenario import load_scenario
from onboard.contract import region
from onboard.contract.arithmetic import Arithmetic
from onboard.contract.assessment import assess
from onboard.contract.region import Encounter
from onboard.events import EventData, EventName
from onboard.geometry.frames import wrap_angle
from onboard.guidance.phases import Phase
from onboard.recording.messages import CertificateRecord, EventRecord, PlanRecord, StateRecord
from sitl.virtual import simulation
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.running import Clearway, is_alive, until

NOMINAL = GeneratedSource("nominal")
QUICK = GeneratedSource("quick")
SEED = 1
# Short: two obstacles, fast, and an ideal vehicle.
SHORT = 112


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return fly_case(NOMINAL.case(SEED, SHORT))


@pytest.fixture(scope="module")
def row() -> FlightRow:
    return fly_numbered(NOMINAL, SEED, SHORT)


# ---------------------------------------------------------------------------- what is drawn


@pytest.mark.parametrize("generator", GENERATORS)
def test_a_number_determines_the_flight(generator: str) -> None:
    for number in range(5):
        once, again = (generated(generator, SEED, number) for _ in range(2))
        assert scenario_document(once.scenario) == scenario_document(again.scenario)
        assert once.seed == again.seed
    seeds = {generated(generator, seed, number).seed for seed in (1, 2) for number in range(10)}
    assert len(seeds) == 20


def test_nominal_fields_keep_their_contract_and_cover_both_shapes() -> None:
    scenarios = [generated("nominal", SEED, number).scenario for number in range(150)]
    assert all(check(s.contract, s.obstacles, s.mission).compliant for s in scenarios)
    shapes = {bool(assess(s.contract).nominal.region.flat) for s in scenarios}
    assert shapes == {True, False}
    speeds_mps = [s.contract.vehicle.cruise_speed_mps for s in scenarios]
    assert min(speeds_mps) < 1.8
    assert max(speeds_mps) > 4.4
    assert {len(s.obstacles) for s in scenarios} >= {1, 2, 3}
    # Most begin in hover, nose to the end; every tenth or so takes off, and turns.
    from_ground = [s for s in scenarios if s.plant.start.position_ned_m[2] == 0.0]
    assert 5 <= len(from_ground) <= 30
    turns_rad = [
        abs(wrap_angle(math.radians(s.plant.start.yaw_deg) - math.atan2(east_m, north_m)))
        for s in scenarios
        if s not in from_ground
        for north_m, east_m in (s.mission.legs[0].end_ned_m,)
    ]
    assert 0.3 < max(turns_rad) < math.radians(20.1)
    # Up to S_max, and not much farther apart than D_sep.
    filled = [
        max(rule.required for rule in _rules(s, "obstacle_size_max"))
        / s.contract.environment.obstacle_size_max_m
        for s in scenarios
    ]
    assert max(filled) == pytest.approx(1.0, abs=1e-9)
    spread = [
        rule.declared / rule.required
        for s in scenarios
        for rule in _rules(s, "separation")
        if math.isfinite(rule.declared)
    ]
    assert 1.0 <= min(spread) < 1.1


def _rules(scenario: Any, name: str) -> list[Any]:
    rules = check(scenario.contract, scenario.obstacles, scenario.mission).field_rules
    return [rule for rule in rules if rule.name == name]


def test_violating_scenarios_break_a_rule() -> None:
    for number in range(60):
        scenario = generated("violating", SEED, number).scenario
        assert not check(scenario.contract, scenario.obstacles, scenario.mission).compliant


def test_faults_of_every_kind_are_drawn_at_times_and_on_transitions() -> None:
    faults = [generated("faults", SEED, number).scenario.faults[-1] for number in range(600)]
    assert {fault.kind for fault in faults} == set(FAULT_KINDS)
    # Every transition of the automaton leads into one of these.
    phases = {"cruise", "avoid", "arrived", "hold", "standby"}
    assert {fault.phase for fault in faults} == {None, *phases}
    assert {fault.phase for fault in faults if fault.start_s == 0.0} >= phases
    assert any(fault.phase == "avoid" and fault.start_s == 0.0 for fault in faults)


def test_a_drawn_scenario_is_a_scenario_file(written: Callable[[str, Any], Path]) -> None:
    drawn = generated("faults", SEED, 0).scenario
    read = load_scenario(written("drawn.yaml", scenario_document(drawn)))
    assert read.contract == drawn.contract
    assert read.mission == drawn.mission
    assert read.plant == drawn.plant
    assert read.faults == drawn.faults
    assert read.obstacles.center_ned_m == pytest.approx(drawn.obstacles.center_ned_m)


# ---------------------------------------------------------------------------- what is judged


def test_a_nominal_flight_passes_every_oracle(evidence: Evidence) -> None:
    assert evidence.result.outcome == "arrived"
    assert evidence.result.obstacles_avoided == 1
    assert evidence.undisturbed
    assert findings(evidence) == {}


def _with_states(evidence: Evidence, change: Callable[[StateRecord], dict[str, Any]]) -> Evidence:
    """Return the evidence with every state changed; `change` returns the new values."""
    states = [dataclasses.replace(state, **change(state)) for state in evidence.states]
    return dataclasses.replace(evidence, flight=dataclasses.replace(evidence.flight, states=states))


def _with_plans(evidence: Evidence, change: Callable[[PlanRecord], dict[str, Any]]) -> Evidence:
    plans = [dataclasses.replace(plan, **change(plan)) for plan in evidence.flight.plans]
    return dataclasses.replace(evidence, flight=dataclasses.replace(evidence.flight, plans=plans))


def _moved(key: str, axis: int, by: float) -> Callable[[StateRecord], dict[str, Any]]:
    def change(state: StateRecord) -> dict[str, Any]:
        before = getattr(state, key)
        if before is None:
            return {}
        vector = list(before)
        vector[axis] += by
        return {key: tuple(vector)}

    return change


def _jumping(state: StateRecord) -> dict[str, Any]:
    if state.reference_position_ned_m is None:
        return {}
    north_m, east_m, down_m = state.reference_position_ned_m
    north_m += 5.0 * (state.time_s % 4.0 > 2.0)
    return {"reference_position_ned_m": (north_m, east_m, down_m)}


def _short(plan: PlanRecord) -> dict[str, Any]:
    return {"path_ned_m": [(n + 100.0, e, d) for n, e, d in plan.path_ned_m]}


def _with_event(evidence: Evidence, **data: Any) -> Evidence:
    event = EventRecord(time_s=0.0, name=EventName.VIOLATION, data=cast("EventData", data))
    flight = dataclasses.replace(evidence.flight, events=[event])
    return dataclasses.replace(evidence, flight=flight)


def _with_fault(evidence: Evidence, fault: Fault) -> Evidence:
    scenario = dataclasses.replace(evidence.case.scenario, faults=(fault,))
    return dataclasses.replace(evidence, case=dataclasses.replace(evidence.case, scenario=scenario))


def _pushed_without_alarm(evidence: Evidence) -> Evidence:
    truths = [dataclasses.replace(truth, collisions=1) for truth in evidence.truth.truths]
    return dataclasses.replace(
        evidence,
        case=dataclasses.replace(evidence.case, covered=False, variant="gust"),
        result=dataclasses.replace(evidence.result, collisions=1),
        truth=dataclasses.replace(evidence.truth, truths=truths),
    )


BROKEN: dict[str, Callable[[Evidence], Evidence]] = {
    "no_surprise": _pushed_without_alarm,
    "no_exception": lambda e: _with_event(e, assumption="self_check", unit="exceptions"),
    "plan_not_expired": lambda e: _with_plans(e, lambda plan: {"end_s": plan.start_s}),
    "no_collision": lambda e: dataclasses.replace(
        e, result=dataclasses.replace(e.result, collisions=1)
    ),
    "defined_end": lambda e: dataclasses.replace(e, at_rest=False),
    "outcome": lambda e: dataclasses.replace(
        e, result=dataclasses.replace(e.result, outcome="held")
    ),
    "expectation": lambda e: dataclasses.replace(
        e,
        case=dataclasses.replace(e.case, expectation=True),
        result=dataclasses.replace(e.result, outcome="held"),
    ),
    "certified_plans": lambda e: _with_plans(
        e, lambda _: {"certificate": CertificateRecord(valid=False)}
    ),
    "plans_in_region": lambda e: _with_plans(e, _short),
    "tracking": lambda e: _with_states(e, _moved("reference_position_ned_m", 1, 0.5)),
    "setpoints_in_limits": lambda e: _with_states(
        e, _moved("reference_acceleration_ned_mps2", 0, 6.0)
    ),
    "continuous_reference": lambda e: _with_states(e, _jumping),
    "entry_condition": lambda e: _with_states(e, _moved("reference_velocity_ned_mps", 0, 9.0)),
    "entered_in_time": lambda e: _with_plans(e, lambda plan: {"region_ned_m": plan.keep_out_ned_m}),
    "exit_condition": lambda e: _with_states(e, _moved("reference_velocity_ned_mps", 0, 9.0)),
    "rest_held": lambda e: _with_states(
        e, lambda state: {"rest_certified": False} if state.phase == "cruise" else {}
    ),
    "bounded_memory": lambda e: _with_states(e, lambda _: {"obstacles_known": 10_000}),
    "detected_in_time": lambda e: _with_fault(
        e, Fault(kind="detections_off", phase=Phase.CRUISE, start_s=2.0)
    ),
}


def test_a_ghost_in_every_frame_may_be_remembered(evidence: Evidence) -> None:
    full = _with_states(evidence, lambda _: {"obstacles_known": 201})
    assert "bounded_memory" in findings(full)
    haunted = Fault(kind="detections_ghost", start_s=0.0)
    assert "bounded_memory" not in findings(_with_fault(full, haunted))
    assert "bounded_memory" in findings(_with_fault(BROKEN["bounded_memory"](evidence), haunted))


def test_a_push_after_the_alarm_is_excused(evidence: Evidence) -> None:
    pushed = _pushed_without_alarm(evidence)
    assert findings(_with_event(pushed, assumption="tracking_error", unit="m")) == {}


@pytest.mark.parametrize("name", ORACLES)
def test_an_oracle_finds_what_it_is_for(name: str, evidence: Evidence) -> None:
    assert name in findings(BROKEN[name](evidence))


def test_an_exception_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("in the middle of a flight")

    monkeypatch.setattr(campaign_flight, "fly_case", fail)
    flown = fly_numbered(NOMINAL, SEED, SHORT)
    assert not flown.good
    assert "ZeroDivisionError: in the middle of a flight" in flown.findings


def test_refusals_are_counted_apart() -> None:
    refused = next(
        number for number in range(50) if generated("violating", SEED, number).variant == "range"
    )
    flown = fly_numbered(GeneratedSource("violating"), SEED, refused)
    assert flown.refused
    assert flown.good
    (summary,) = summarize([flown])
    assert (summary.flights, summary.refused) == (1, 1)
    assert summary.collision_rate == (0.0, 1.0)


# ---------------------------------------------------------------------------- what is counted


@given(st.integers(1, 400), st.data())
def test_bounds_are_exact(trials: int, data: st.DataObject) -> None:
    failures = data.draw(st.integers(0, trials))
    lower, upper = failure_rate_bounds(failures, trials)
    assert lower <= failures / trials <= upper
    tail = 0.05 if failures in (0, trials) else 0.025
    if failures < trials:
        assert bdtr(failures, trials, upper) == pytest.approx(tail, rel=1e-6)
    if failures:
        assert bdtrc(failures - 1, trials, lower) == pytest.approx(tail, rel=1e-6)


def test_no_failure_gives_the_rule_of_three() -> None:
    _, upper = failure_rate_bounds(0, 10_000)
    assert upper == pytest.approx(3.0 / 10_000, rel=0.002)


def test_the_table_gives_back_its_rows(row: FlightRow, tmp_path: Path) -> None:
    rows = [row, dataclasses.replace(row, number=999, clearance_min_m=None, findings="a\nb")]
    write_table(rows, tmp_path / "flights.parquet")
    assert read_table(tmp_path / "flights.parquet") == rows


def test_a_campaign_goes_on_where_it_was(
    clearway: Clearway, row: FlightRow, tmp_path: Path
) -> None:
    marked = dataclasses.replace(row, number=0, findings="outcome: marked", reason="flown before")
    write_table([marked], tmp_path / "flights.parquet")
    flown = ("campaign", "nominal", "--flights", 2, "--seed", SEED, "--jobs", 1, "--shrink", 0)
    ran = clearway(*flown, "--out", tmp_path)
    assert ran.code == 1, ran
    assert replay_command(marked) in ran.out
    first, second = read_table(tmp_path / "flights.parquet")
    assert first == marked
    assert second.outcome == "arrived"
    failed = yaml.safe_load((tmp_path / "failed" / "nominal-1-0.yaml").read_text(encoding="utf-8"))
    assert failed == scenario_document(generated("nominal", SEED, 0).scenario)
    assert "1 of 2 flights failed" in (tmp_path / "summary.html").read_text(encoding="utf-8")
    other = clearway("campaign", "nominal", "--flights", 2, "--seed", 7, "--out", tmp_path)
    assert other.code == 2
    assert "another campaign" in other.err


def test_a_scenario_file_is_held_to_its_expectation(
    clearway: Clearway, written: Callable[[str, Any], Path], tmp_path: Path
) -> None:
    document = scenario_document(generated("nominal", SEED, SHORT).scenario)
    path = written("wrong.yaml", {**document, "expect": {"outcome": "held"}})
    flown = ("campaign", path, "--flights", 1, "--jobs", 1, "--shrink", 0)
    ran = clearway(*flown, "--out", tmp_path / "out")
    assert ran.code == 1
    assert "expectation: arrived" in ran.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("absent",), "expected a scenario file, a stem map (CSV) or one of nominal"),
        (("absent.yaml",), "absent.yaml"),
    ],
)
def test_bad_input_is_one_clear_error(
    clearway: Clearway, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    ran = clearway("campaign", *arguments, "--out", tmp_path)
    assert ran.code == 2
    assert message in ran.err


# ---------------------------------------------------------------------------- where it is flown


def test_workers_do_not_outlive_a_campaign_that_is_killed(tmp_path: Path) -> None:
    command = ["campaign", "quick", "--flights", "40", "--jobs", "2", "--out", str(tmp_path)]
    with subprocess.Popen(
        [sys.executable, "-m", "gcs_tools", *command],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as campaign:  # fmt: skip
        listed = Path(f"/proc/{campaign.pid}/task/{campaign.pid}/children")
        until(lambda: len(listed.read_text(encoding="utf-8").split()) >= 3)
        workers = [int(pid) for pid in listed.read_text(encoding="utf-8").split()]
        until(lambda: all("spawn_main" in command_of(pid) for pid in workers[-2:]))
        campaign.kill()
    until(lambda: not any(map(is_alive, workers)))


def command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")


def test_a_cluster_that_loses_a_worker_flies_the_same_flights() -> None:
    jobs = [FlightJob(QUICK, SEED, number) for number in range(4)]
    here = {number: fly_numbered(QUICK, SEED, number) for number in (0, 3)}
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        rows: list[FlightRow] = []
        for row in fly_on_cluster(jobs, cluster.scheduler_address):
            if not rows:
                os.kill(cluster.workers[0].pid, signal.SIGKILL)
            rows.append(row)
    assert sorted(row.number for row in rows) == list(range(4))
    for number, alone in here.items():
        (flown,) = (row for row in rows if row.number == number)
        assert dataclasses.replace(flown, wall_s=alone.wall_s) == alone


# ---------------------------------------------------------------------------- the campaign of CI


# Flights without a fault: with passive safety and without, with a way to rest and without.
QUICK_FLIGHTS = (0, 2, 5, 10, 16, 21, 25)
# Each kind of fault once that is drawn among the first, from a moment that comes in flight.
FAULTY_FLIGHTS = (
    *(1, 3, 5, 10, 13, 14, 15, 16, 20, 22, 24, 25, 26, 30, 31),
    *(32, 34, 35, 36, 40, 41, 44, 46, 51, 54, 55, 56, 83, 123),
)


def test_the_flights_of_ci_have_a_fault_of_each_kind() -> None:
    cases = [generated("quick-faults", SEED, number) for number in FAULTY_FLIGHTS]
    assert len({case.variant for case in cases}) == len(FAULTY_FLIGHTS)
    assert not any(case.trigger.startswith("hold") for case in cases)
    passive = [generated("quick", SEED, n).scenario.contract.requirements for n in QUICK_FLIGHTS]
    assert {(each.passive_safety, each.stop) for each in passive} >= {
        *((True, True), (False, True), (False, False)),
    }


@pytest.mark.parametrize("number", QUICK_FLIGHTS)
def test_a_short_flight_arrives_and_hits_nothing(number: int) -> None:
    """Fixed seeds, one obstacle or two, from hover."""
    row = fly_numbered(QUICK, SEED, number)
    assert row.good, f"{replay_command(row)}\n{row.findings}"
    assert row.outcome == "arrived"


@pytest.mark.parametrize("number", FAULTY_FLIGHTS)
def test_a_short_flight_with_a_fault_hits_nothing(number: int) -> None:
    row = fly_numbered(GeneratedSource("quick-faults"), SEED, number)
    assert row.good, f"{replay_command(row)}\n{row.findings}"


# ---------------------------------------------------------------------------- fields of others


def test_competition_fields_keep_its_rules_and_are_flown_or_refused() -> None:
    cases = [generated("competition", SEED, number) for number in range(30)]
    for case in cases:
        assert 1 <= len(case.scenario.obstacles) <= 3
        sides_m = 2.0 * case.scenario.obstacles.half_size_m
        assert sides_m.min() >= 2.0
        assert sides_m.max() <= 20.0
    compliant = {
        check(c.scenario.contract, c.scenario.obstacles, c.scenario.mission).compliant
        for c in cases
    }
    assert compliant == {True, False}


def test_a_stem_map_is_flown_through_a_path(tmp_path: Path, clearway: Clearway) -> None:
    stems = tmp_path / "stems.csv"
    rows = [f"{30.0 * x},{30.0 * y},{20 + x}" for x in range(5) for y in range(5)]
    stems.write_text("\n".join(["x_m,y_m,dbh_cm", *rows]) + "\n", encoding="utf-8")
    out = tmp_path / "out"
    ran = clearway("campaign", stems, "--flights", 4, "--jobs", 1, "--out", out)
    assert ran.code == 0, ran
    flown = read_table(out / "flights.parquet")
    assert {row.variant for row in flown} <= {"mapped", "unmapped"}
    assert any(row.outcome == "arrived" for row in flown)
    drawn = ForestSource(str(stems)).case(SEED, 0)
    assert scenario_document(drawn.scenario) == scenario_document(
        ForestSource(str(stems)).case(SEED, 0).scenario
    )


# ---------------------------------------------------------------------------- is it vacuous?


def test_far_outside_the_contract_flights_collide_and_just_outside_they_fall_back() -> None:
    far, near = _outside("range x 0.3", 3), _outside("range x 0.9", 3)
    assert sum(row.collisions > 0 for row in far) >= 2
    assert not any(row.collisions for row in near)
    assert any(row.fell_back for row in near)
    (summary,) = summarize(far)
    assert summary.fell_back == 3
    assert not summary.covered


def _outside(variant: str, count: int) -> list[FlightRow]:
    source = GeneratedSource("outside")
    numbers = (n for n in range(200) if source.case(SEED, n).variant == variant)
    return [fly_numbered(source, SEED, next(numbers)) for _ in range(count)]


# ---------------------------------------------------------------------------- what is left of it


def test_a_failing_flight_shrinks_to_what_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two faults and a windy field only what makes the flight wait for ever is left."""
    monkeypatch.setattr(simulation, "PAUSE_PATIENCE_S", 15.0)  # for ever takes a minute otherwise
    case = QUICK.case(SEED, 0)
    document = scenario_document(case.scenario)
    document["faults"] = [
        {"kind": "detections_shifted", "amount": 0.001},
        {"kind": "detections_off", "phase": "cruise", "start_s": 1.23},
    ]
    shrunk = shrink(document, frozenset({"outcome"}), case.seed, flights_max=12)
    assert shrunk is not None
    assert [fault["kind"] for fault in shrunk.document["faults"]] == ["detections_off"]
    assert len(shrunk.document["field"]) == 1
    assert "wind" not in shrunk.document["sitl"]
    assert "outcome: aborted (the mission did not end)" in shrunk.findings
    assert shrunk.flights <= 12
    assert shrink(document, frozenset({"tracking"}), case.seed, flights_max=2) is None


# ---------------------------------------------------------------------------- does it catch bugs?


def meets_a_pointed_set(number: int) -> bool:
    """Whether a flight meets one obstacle, with nothing that passive safety adds."""
    scenario = NOMINAL.case(SEED, number).scenario
    assessment = assess(scenario.contract)
    pointed = not assessment.inflated.region.flat
    return pointed and not assessment.terms.passive_safety and len(scenario.obstacles) == 1


def test_the_printed_eq_9_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Erratum 3: without the factor 2 under the root, the region begins too near."""

    def printed(e: Encounter[float], ops: Arithmetic[float]) -> float:
        return ops.sqrt(e.size_across_m / (e.right_mps2 + e.left_mps2))

    number = next(filter(meets_a_pointed_set, range(600)))
    assert fly_numbered(NOMINAL, SEED, number).good
    monkeypatch.setattr(region, "time_to_clear", printed)
    assert "entered_in_time" in fly_numbered(NOMINAL, SEED, number).findings
