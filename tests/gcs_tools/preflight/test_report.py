"""What the operator reads of a pre-flight check."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from rich.console import Console

from gcs_tools.preflight import report
from gcs_tools.preflight.command import Preflight, check, print_preflight
from gcs_tools.preflight.finding import VEHICLE_IDENTITY, Finding, Verdict
from gcs_tools.preflight.remedy import Remedy
from gcs_tools.preflight.rule import Rule
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG

PAPER = CONFIG / "paper_contract.yaml"
GOOD = check(load_contract(PAPER), None, None)
BAD = check(load_contract(PAPER, ("vehicle.thrust_to_weight=1.001",)), None, None)
OFFENDERS = tuple(f"o{number}" for number in range(9))
RULE = Rule("roi_disjoint", 9.0, 0.0, "pairs", "must not intersect", OFFENDERS, "a note")


def printed(result: Preflight) -> str:
    text = io.StringIO()
    print_preflight(result, "c.yaml", Console(file=text, width=150))
    return text.getvalue()


def test_a_compliant_contract_is_a_yes_with_its_tightest_clause() -> None:
    text = printed(GOOD)
    assert text.startswith("PROGRESS GUARANTEED  c.yaml\ntightest: ")
    assert "to satisfy" not in text
    assert "BROKEN" not in text


def test_a_broken_clause_is_a_no_with_what_would_satisfy_it() -> None:
    text = printed(BAD)
    assert text.startswith("DO NOT FLY  c.yaml\n  • ")
    assert "most violated: " in text
    for clause in BAD.assessment.clauses:
        assert (f"to satisfy {clause.name}: " in text) is not clause.holds


def test_offenders_are_cut_short_and_notes_are_shown() -> None:
    text = printed(replace(GOOD, field_rules=(RULE,), fastest_mps=1.234))
    assert "o0; o1; o2; o3; o4; …" in text
    assert "o5" not in text
    assert "roi_disjoint: a note" in text
    assert "fastest compliant cruise here: 1.23 m/s (declared 2.8 m/s)" in text


def test_no_speed_at_all_is_said() -> None:
    assert "no cruise speed makes this field compliant" in printed(
        replace(GOOD, field_rules=(RULE,))
    )


def test_live_findings_are_listed_and_name_the_vehicle() -> None:
    findings = (
        Finding("vehicle", VEHICLE_IDENTITY, Verdict.HOLDS, "px4, system 1"),
        Finding("vehicle", "battery", Verdict.UNKNOWN, "no [bold]BATTERY_STATUS"),
    )
    text = printed(replace(GOOD, findings=findings))
    assert text.startswith("COULD NOT BE CHECKED  c.yaml, px4, system 1\n")
    assert "  • vehicle battery: could not be checked: no [bold]BATTERY_STATUS" in text
    assert "UNKNOWN" in text


def test_the_verdict_is_said_again_at_the_end() -> None:
    assert printed(GOOD).splitlines()[-1] == "PROGRESS GUARANTEED  c.yaml"
    findings = (Finding("vehicle", "battery", Verdict.UNKNOWN, "?"),)
    *_, last = printed(replace(GOOD, findings=findings)).splitlines()
    assert last == "COULD NOT BE CHECKED  c.yaml: 1 reason, see above"
    *_, last = printed(BAD).splitlines()
    assert last == "DO NOT FLY  c.yaml: 1 reason, see above"
    many = replace(GOOD, findings=findings * 3)
    assert printed(many).splitlines()[-1].endswith(": 3 reasons, see above")


def test_parameters_are_cured_by_lines_to_type() -> None:
    findings = (
        Finding("vehicle", "A", Verdict.BROKEN, "", (("A", 3.125),)),
        Finding("vehicle", "B", Verdict.BROKEN, "", (("B", 4.0), ("C", 1.0), ("D", 20.0))),
        Finding("vehicle", "E", Verdict.BROKEN, "slow"),
    )
    *_, before, a, b, instead, _ = printed(replace(GOOD, findings=findings)).splitlines()
    assert before.startswith("to cure the parameters")
    assert (a, b) == ("  param set A 3.125", "  param set B 4")
    assert instead == "    (or instead: set C to 1, or D to 20)"
    assert "param set" not in printed(replace(GOOD, findings=findings[2:]))


def test_broken_findings_come_before_unknown_ones() -> None:
    findings = (
        Finding("vehicle", "battery", Verdict.UNKNOWN, "?"),
        Finding("daemon", "version", Verdict.BROKEN, "old"),
    )
    assert replace(GOOD, findings=findings).refusals == (
        "daemon version: broken: old",
        "vehicle battery: could not be checked: ?",
    )


def remedy(key: str, value: float, *, settles_all: bool = True) -> Remedy:
    return Remedy("stop", key, 3.0, value, "m/s", settles_all)


def test_advice_is_at_most_three_changes() -> None:
    speed = remedy("vehicle.cruise_speed_mps", 2.5)
    lag = remedy("vehicle.attitude_lag_s", 0.1, settles_all=False)
    assert report.advice("stop", (speed,)) == "cruise at ≤ 2.5 m/s"
    assert report.advice("stop", (speed, lag)) == (
        "cruise at ≤ 2.5 m/s, or tilt in ≤ 0.1 m/s (not enough alone)"
    )
    assert report.advice("stop", (speed,) * 5).count("cruise") == 3
    assert report.advice("thrust", (speed,)) == "no single key satisfies it"


@pytest.mark.parametrize("clause", BAD.assessment.clauses, ids=lambda clause: clause.name)
def test_a_bar_passes_its_mark_if_and_only_if_the_clause_is_broken(clause: object) -> None:
    bar = report._bar(clause).plain  # type: ignore[arg-type]
    filled, _, beyond = bar.partition("|")
    assert len(filled) == 16
    assert beyond.startswith("█") is not clause.holds  # type: ignore[attr-defined]
    assert bar.endswith(" %")


def test_a_field_without_a_neighbour_is_null_in_json() -> None:
    lonely = Rule("separation", 5.0, float("inf"), "m", "why")
    (document,) = replace(GOOD, field_rules=(lonely,)).document()["field"]
    assert (document["declared"], document["margin"], document["holds"]) == (None, None, True)
