"""Three verdicts: progress guaranteed, safe without a guarantee to arrive, do not fly."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from gcs_tools.contract.keys import contract_key
from gcs_tools.fly.command import best_effort
from gcs_tools.preflight.command import Preflight, check, print_preflight
from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.rule import Rule
from gcs_tools.preflight.tier import (
    START_ROOM_M,
    Tier,
    seen_free_rules,
    start_clear_radius_m,
)
from onboard.contract.assessment import Clause, assess
from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from tests.gcs_tools.running import CONFIG, Clearway

DEFAULT = CONFIG / "default_contract.yaml"
NEAR = "environment.obstacle_separation_min_m=3.0"
WEAK = "vehicle.thrust_to_weight=1.001"
BEST_EFFORT = "requirements.progress=best_effort"
NO_STOP = "requirements.stop=false"
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": [{"end_ned_m": (40.0, 0.0)}]})


def checked(*overrides: str, accept: bool = False) -> Preflight:
    return check(load_contract(DEFAULT, overrides), None, None, accept_no_progress=accept)


def obstacle(
    center_ned_m: tuple[float, float], *, yaw_deg: float = 0.0, name: str = "o"
) -> Obstacle:
    return Obstacle(id=name, center_ned_m=center_ned_m, size_m=(1.0, 1.0), yaw_deg=yaw_deg)


@pytest.mark.parametrize(
    ("overrides", "accept", "tier", "code"),
    [
        ((), False, "progress guaranteed", 0),
        ((BEST_EFFORT,), False, "progress guaranteed", 0),
        ((NEAR,), False, "safe, arrival not guaranteed", 1),
        ((NEAR,), True, "safe, arrival not guaranteed", 0),
        ((NEAR, BEST_EFFORT), False, "safe, arrival not guaranteed", 0),
        ((WEAK,), True, "do not fly", 1),
        ((NEAR, "sensor.field_of_view_deg=60.0"), True, "do not fly", 1),
        ((NEAR, NO_STOP), True, "do not fly", 1),
        ((NEAR, NO_STOP, BEST_EFFORT), False, "do not fly", 1),
    ],
)
def test_verdict_and_exit_code(
    clearway: Clearway, overrides: tuple[str, ...], accept: bool, tier: str, code: int
) -> None:
    changes = ("--set", *overrides) if overrides else ()
    acceptance = ("--accept-no-progress",) if accept else ()
    ran = clearway("preflight", "--contract", DEFAULT, *changes, *acceptance, "--format", "json")
    document = json.loads(ran.out)
    assert (document["verdict"], ran.code) == (tier, code)
    assert document["may_fly"] is (code == 0)
    assert document["accepted"] is (accept or BEST_EFFORT in overrides)


def test_what_cannot_be_checked_stays_2(clearway: Clearway) -> None:
    ran = clearway("preflight", "--contract", "nowhere.yaml", "--accept-no-progress")
    assert ran.code == 2


@pytest.mark.parametrize("clause", assess(load_contract(DEFAULT)).clauses, ids=lambda c: c.name)
def test_a_broken_clause_costs_progress_or_safety_as_it_says(clause: Clause[float]) -> None:
    good = checked()
    broken = clause._replace(declared=clause.required)
    others = [each for each in good.assessment.clauses if each.name != clause.name]
    bad = replace(good, assessment=replace(good.assessment, clauses=(*others, broken)))
    expected = Tier.SAFE if broken.concerns == "progress" else Tier.DO_NOT_FLY
    assert bad.tier is expected


findings = st.lists(st.sampled_from(Verdict), max_size=3)


@given(st.booleans(), st.booleans(), st.booleans(), findings)
def test_nothing_flies_that_is_not_safe_accepted_and_checked(
    near: bool, weak: bool, accept: bool, live: list[Verdict]
) -> None:
    overrides = tuple(text for text, wanted in ((NEAR, near), (WEAK, weak)) if wanted)
    result = replace(
        checked(*overrides, accept=accept),
        findings=tuple(Finding("vehicle", str(n), each, "") for n, each in enumerate(live)),
    )
    flies = not weak and (accept or not near) and all(each is Verdict.HOLDS for each in live)
    assert (result.verdict is Verdict.HOLDS) is flies
    if Verdict.BROKEN in live or weak:
        assert result.tier is Tier.DO_NOT_FLY
    elif Verdict.UNKNOWN in live:
        assert result.tier is Tier.UNKNOWN
    else:
        assert result.tier is (Tier.SAFE if near else Tier.PROGRESS_GUARANTEED)


def rules(*overrides: str) -> dict[str, Rule]:
    found = seen_free_rules(assess(load_contract(DEFAULT, overrides)), None, None)
    return {rule.name: rule for rule in found}


def test_the_range_must_hold_the_front_at_half_a_metre_per_second() -> None:
    exact = "vehicle.heading_error_deg=0.0"  # else the face error depends on the range
    contract = load_contract(DEFAULT, (exact,))
    slow = assess(contract_key("vehicle.cruise_speed_mps").changed(contract, 0.5))
    vehicle, sensor = contract.vehicle, contract.sensor
    body_m = vehicle.radius_m + vehicle.tracking_error_m
    least_m = slow.inflated.region.front_m + body_m + slow.face_error_m
    assert least_m < sensor.detection_range_m
    for range_m, holds in ((least_m + 0.01, True), (least_m - 0.01, False)):
        found = rules(exact, f"sensor.detection_range_m={range_m}")["seen_free_range"]
        assert found.holds is holds
        assert found.required == pytest.approx(slow.inflated.region.front_m)


def test_a_slower_cruise_than_half_a_metre_per_second_counts_as_it_is() -> None:
    slow = rules("vehicle.cruise_speed_mps=0.2")["seen_free_range"]
    assert slow.required < rules()["seen_free_range"].required
    assert "at 0.2 m/s" in slow.reason


def test_without_the_clause_stop_there_is_no_second_tier() -> None:
    assert rules(NO_STOP) == {}


@pytest.mark.parametrize(("center_m", "yaw_deg"), [((0.0, 1.0), 0.0), ((0.7, 0.7), 45.0)])
def test_no_known_obstacle_may_stand_where_the_vehicle_first_hovers(
    center_m: tuple[float, float], yaw_deg: float
) -> None:
    assessment = assess(load_contract(DEFAULT))
    radius_m = start_clear_radius_m(assessment)
    assert radius_m == pytest.approx(math.sqrt(2.0) * assessment.terms.body_m + START_ROOM_M)
    away_m = radius_m + 0.5  # half of the obstacle's size
    scale = away_m / math.hypot(*center_m)
    for more, holds in ((1.001, True), (0.99, False)):
        place = (center_m[0] * scale * more, center_m[1] * scale * more)
        field = ObstacleField.of([obstacle(place, yaw_deg=yaw_deg)])
        room = seen_free_rules(assessment, field, MISSION)[-1]
        assert room.name == "start_room"
        assert room.holds is holds
        assert bool(room.offenders) is not holds


def test_a_crowded_field_of_a_compliant_contract_is_safe_only() -> None:
    field = ObstacleField.of([obstacle((20.0, 0.0)), obstacle((20.0, 4.0), name="p")])
    result = check(load_contract(DEFAULT), field, MISSION)
    assert result.assessment.compliant
    assert (result.tier, result.verdict) == (Tier.SAFE, Verdict.BROKEN)


def test_a_field_of_another_site_is_not_flown() -> None:
    field = ObstacleField.of([obstacle((5000.0, 0.0))])
    result = check(load_contract(DEFAULT), field, MISSION, accept_no_progress=True)
    assert result.tier is Tier.DO_NOT_FLY


def printed(result: Preflight) -> str:
    text = io.StringIO()
    print_preflight(result, "c.yaml", Console(file=text, width=160))
    return text.getvalue()


def test_the_operator_reads_what_a_flight_without_guarantee_does() -> None:
    text = printed(checked(NEAR))
    assert text.startswith("SAFE, ARRIVAL NOT GUARANTEED  c.yaml\n  • separation: ")
    assert "not accepted: --accept-no-progress accepts that once" in text
    assert "to guarantee arrival, satisfy separation: keep to obstacles apart by ≥ " in text
    assert "to satisfy" not in text
    assert "not kept" in text
    assert "BROKEN" not in text
    assert "seen_free_range" in text
    assert "\naccepted\n" in printed(checked(NEAR, accept=True))


def test_what_safety_needs_is_broken_in_so_many_words() -> None:
    text = printed(checked(NEAR, "sensor.field_of_view_deg=60.0", accept=True))
    assert text.startswith("DO NOT FLY")
    assert "• seen_free_view: requires 94.00 °, declared 60.00 °\n" in text
    assert "BROKEN" in text


def test_a_contract_without_stop_says_what_it_lacks() -> None:
    assert "no way to rest is held in flight" in printed(checked(NO_STOP))
    assert "no way to rest is held in flight" not in printed(checked())


def test_a_guaranteed_flight_shows_no_second_tier() -> None:
    assert "seen_free_range" not in printed(checked())


def test_rules_that_are_not_finite_are_null_in_json() -> None:
    document = Rule("r", math.nan, math.inf, "m", "why").document()
    assert (document["required"], document["declared"], document["margin"]) == (None, None, None)
    assert not document["holds"]


def test_acceptance_changes_the_hash_of_what_is_flown() -> None:
    contract: Contract = load_contract(DEFAULT)
    accepted = best_effort(contract)
    assert accepted.requirements.progress == "best_effort"
    assert accepted == load_contract(DEFAULT, (BEST_EFFORT,))
    assert accepted.sha256 != contract.sha256


@pytest.mark.parametrize(("more_m", "holds"), [(0.01, True), (-0.01, False)])
def test_the_operators_word_has_to_cover_the_start(more_m: float, *, holds: bool) -> None:
    assessment = assess(load_contract(DEFAULT))
    clear_m = start_clear_radius_m(assessment) + more_m
    mission = MISSION.model_copy(update={"start_clear_m": clear_m})
    (rule,) = (r for r in seen_free_rules(assessment, None, mission) if r.name == "start_clear")
    assert rule.holds is holds
    assert "operator's word" in str(rule)


# ---------------------------------------------------------------------- movers

PERSON = "{class: person, speed_max_mps: 0.5, size_max_m: 1.0}"
DRONE = "{class: drone, speed_max_mps: 15.0, size_max_m: 1.0}"
DECLARED = (
    "vehicle.rest_settle_s=0.4",
    "vehicle.setpoint_loss_run_time_s=2.0",
    "vehicle.velocity_error_mps=[0.3, 0.1]",
)
MOVERS = (*DECLARED, f"environment.movers=[{PERSON}, {DRONE}]")
PEOPLE = (*DECLARED, f"environment.movers=[{PERSON}]")
# Movers may step behind obstacles out of view: beside these more room is kept.
IN_VIEW = (
    *PEOPLE,
    "requirements.movers=passive_in_view",
    "environment.obstacle_separation_min_m=40.0",
)


def test_the_level_of_each_class_is_said_and_repeated_above_the_last_verdict() -> None:
    text = printed(checked(*MOVERS))
    *_, levels, verdict = text.splitlines()
    assert levels.startswith(
        "movers (none enforced): person 0.5 m/s: passive in view; drone 15 m/s: NOT COVERED, needs "
    )
    assert verdict.startswith("PROGRESS GUARANTEED")
    assert "  drone 15 m/s: NOT COVERED, needs " in text
    document = json.loads(json.dumps(checked(*MOVERS).document()))
    assert [each["level"] for each in document["contract"]["movers"]] == ["passive in view", None]
    assert "movers" not in printed(checked())


@pytest.mark.parametrize(("stated_m", "holds"), [(None, False), (3.0, False), (12.0, True)])
def test_without_a_ring_the_operators_word_is_needed_in_any_case(
    stated_m: float | None, *, holds: bool
) -> None:
    mission = MISSION.model_copy(update={"start_clear_of_movers_m": stated_m})
    result = check(load_contract(DEFAULT, IN_VIEW), None, mission, accept_no_progress=True)
    assert result.assessment.compliant
    (rule,) = result.start_rules
    assert (rule.name, rule.holds) == ("start_clear_of_movers", holds)
    assert (result.tier is Tier.PROGRESS_GUARANTEED) == holds
    assert (result.tier is Tier.DO_NOT_FLY) != holds
    assert any("start_clear_of_movers" in reason for reason in result.refusals) != holds
    text = printed(result)
    assert "Start" in text
    assert "movers: person 0.5 m/s: passive in view" in text.splitlines()
    assert [each["name"] for each in result.document()["start"]] == ["start_clear_of_movers"]


def test_with_a_ring_no_word_is_asked_for() -> None:
    ringed = ("requirements.movers=passive", "sensor.all_round_range_m=12.0")
    result = check(load_contract(DEFAULT, (*PEOPLE, *ringed)), None, MISSION)
    assert result.start_rules == ()
    assert "Start" not in printed(result)
