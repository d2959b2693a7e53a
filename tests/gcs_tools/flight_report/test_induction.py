"""The induction in a report: avoidances with their conditions, and clauses over time."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.flight_report.induction import clause_shares, induction_steps, margins_since
from gcs_tools.logs.flight_log import Log
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import ClauseMargin, Margins
from tests.gcs_tools.logs.raw_log import json_log

BEGAN_S = 1_000.0


def phase(offset_s: float, to: str) -> dict[str, Any]:
    return {"time_s": BEGAN_S + offset_s, "name": "phase", "data": {"to": to}}


def violation(offset_s: float, assumption: str) -> dict[str, Any]:
    time_s = BEGAN_S + offset_s
    return {"time_s": time_s, "name": "violation", "data": {"assumption": assumption}}


def log(*events: dict[str, Any], plans: tuple[dict[str, Any], ...] = ()) -> Log:
    return json_log({"/events": events, "/plan": plans})


AVOIDED = (phase(0.0, "cruise"), phase(2.0, "avoid"), phase(5.0, "cruise"))


def test_an_avoidance_that_ends_in_cruise_has_held_both_conditions() -> None:
    plan = {
        "time_s": BEGAN_S + 2.0, "obstacle": "a", "kind": "qp", "side": "left", "plan_time_ms": 5.0
    }  # fmt: skip
    (step,) = induction_steps(log(*AVOIDED, plans=(plan,)), [], BEGAN_S)
    assert step == {
        "time_s": 2.0, "end_s": 5.0, "obstacle": "a", "kind": "qp", "side": "left",
        "plan_time_ms": 5.0, "pre_condition": True, "post_condition": True, "clearance_m": None,
    }  # fmt: skip


@pytest.mark.parametrize("after", [(), (phase(5.0, "hold"),)])
def test_an_avoidance_that_does_not_end_in_cruise_never_reached_its_end(
    after: tuple[dict[str, Any], ...],
) -> None:
    (step,) = induction_steps(log(*AVOIDED[:2], *after), [], BEGAN_S)
    assert (step["end_s"], step["post_condition"]) == (None, False)


def test_a_late_first_sight_breaks_the_pre_condition_of_its_step_alone() -> None:
    more = (*AVOIDED, phase(7.0, "avoid"), phase(9.0, "cruise"))
    steps = induction_steps(log(*more, violation(2.0, "late_first_sight")), [], BEGAN_S)
    assert [step["pre_condition"] for step in steps] == [False, True]


def test_a_missed_post_condition_is_said() -> None:
    (step,) = induction_steps(log(*AVOIDED, violation(5.0, "post_condition")), [], BEGAN_S)
    assert (step["pre_condition"], step["post_condition"]) == (True, False)
    other = induction_steps(log(*AVOIDED, violation(4.0, "tracking_error")), [], BEGAN_S)
    assert other[0]["post_condition"]


def test_a_step_without_its_plan_is_shown_with_question_marks() -> None:
    late = {"time_s": BEGAN_S + 2.5, "obstacle": "a"}
    (step,) = induction_steps(log(*AVOIDED, plans=(late,)), [], BEGAN_S)
    assert (step["obstacle"], step["kind"], step["side"]) == ("?", "?", None)


def test_clearance_is_the_least_of_the_step() -> None:
    truths = [
        TruthRecord(
            time_unix_s=BEGAN_S + offset_s,
            position_ned_m=(0.0, 0.0, 0.0),
            clearance_m=clearance_m,
        )
        for offset_s, clearance_m in ((1.9, 0.1), (2.0, 0.9), (3.0, 0.4), (4.0, None), (5.1, 0.2))
    ]
    (step,) = induction_steps(log(*AVOIDED), truths, BEGAN_S)
    assert step["clearance_m"] == 0.4


# ---------------------------------------------------------------------------- clauses


def clause(name: str, required: float, declared: float = 10.0) -> ClauseMargin:
    margin = declared - required
    return ClauseMargin(
        name=name, required=required, declared=declared, margin=margin, unit="m", holds=margin > 0.0
    )


def test_margins_of_before_the_shown_time_begin_with_it() -> None:
    records = [Margins(time_s=BEGAN_S + at_s, clauses=[]) for at_s in (-50.0, -1.0, 3.0)]
    found = margins_since(Log(margins=records), BEGAN_S, -1.0)
    assert [each.time_s for each in found] == [-1.0, -1.0, 3.0]


def test_shares_are_steps_that_last_until_the_next_record() -> None:
    margins = [
        Margins(time_s=0.0, clauses=[clause("thrust", 5.0), clause("stop", 2.0)]),
        Margins(time_s=4.0, clauses=[clause("thrust", 7.5), clause("stop", 2.0)]),
    ]
    document = clause_shares(margins, 10.0)
    assert document["clause_times_s"] == [0.0, 4.0, 4.0, 10.0]
    assert document["clauses"] == [
        {"name": "thrust", "values": [50.0, 50.0, 75.0, 75.0]},
        {"name": "stop", "values": [20.0, 20.0, 20.0, 20.0]},
    ]


def test_a_clause_that_comes_or_goes_has_gaps() -> None:
    margins = [
        Margins(time_s=0.0, clauses=[clause("stop", 2.0)]),
        Margins(time_s=4.0, clauses=[clause("wind", 3.0)]),
    ]
    document = clause_shares(margins, 5.0)
    assert document["clauses"] == [
        {"name": "stop", "values": [20.0, 20.0, None, None]},
        {"name": "wind", "values": [None, None, 30.0, 30.0]},
    ]


def test_nothing_declared_has_no_share() -> None:
    margins = [Margins(time_s=0.0, clauses=[clause("stop", 2.0, 0.0)])]
    assert clause_shares(margins, 1.0)["clauses"] == []
    assert clause_shares([], 1.0) == {"clause_times_s": [], "clauses": []}
