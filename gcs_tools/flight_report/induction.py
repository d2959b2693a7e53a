"""The induction of a flight: each avoidance with its conditions, and the margin of each clause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_tools.flight_report.flight import Document
from gcs_tools.flight_report.timeline import since
from gcs_tools.logs.flight_log import Log
from onboard.events import EventName
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import Margins, PlanRecord


def induction_steps(log: Log, truths: Sequence[TruthRecord], start_s: float) -> list[Document]:
    """Return each avoidance: its obstacle, its plan, and whether its conditions held."""
    phases = [event for event in log.events if event.name == EventName.PHASE]
    steps = []
    for number, event in enumerate(phases):
        if event.data.get("to") != "avoid":
            continue
        after = phases[number + 1 :]
        recovered = bool(after) and after[0].data.get("to") == "cruise"
        begin_s, end_s = event.time_s, after[0].time_s if after else math.inf
        late = _happened(log, begin_s, end_s, "late_first_sight")
        missed = _happened(log, begin_s, end_s, "post_condition")
        steps.append(
            {
                "time_s": since(event, start_s),
                "end_s": since(after[0], start_s) if recovered else None,
                **_planned(log.plans, begin_s),
                "pre_condition": not late,
                "post_condition": recovered and not missed,
                "clearance_m": _clearance_m(truths, begin_s, end_s),
            }
        )
    return steps


def _planned(plans: Sequence[PlanRecord], time_s: float) -> Document:
    """Return the plan that an avoidance began with, logged in the same tick as its event."""
    unknown = PlanRecord(time_s=time_s)
    plan = next((plan for plan in plans if abs(plan.time_s - time_s) < 1e-3), unknown)
    return {
        "obstacle": plan.obstacle or "?",
        "kind": plan.kind or "?",
        "side": plan.side,
        "plan_time_ms": plan.plan_time_ms,
    }


def _happened(log: Log, begin_s: float, end_s: float, what: str) -> bool:
    return any(
        begin_s <= event.time_s <= end_s and what in (event.name, event.data.get("assumption"))
        for event in log.events
    )


def _clearance_m(truths: Sequence[TruthRecord], begin_s: float, end_s: float) -> float | None:
    known = [
        truth.clearance_m
        for truth in truths
        if begin_s <= truth.time_unix_s <= end_s and truth.clearance_m is not None
    ]
    return min(known, default=None)


def margins_since(log: Log, start_s: float, shown_from_s: float) -> list[Margins]:
    """Return the clauses each time they changed; earlier ones apply from ``shown_from_s`` on."""
    return [
        replace(record, time_s=max(since(record, start_s), shown_from_s)) for record in log.margins
    ]


def clause_shares(margins: Sequence[Margins], end_s: float) -> Document:
    """Return each clause's required share of what is declared, in percent, as steps over time."""
    times_s: list[float] = []
    values: dict[str, list[float | None]] = {}
    ends_s = [record.time_s for record in margins[1:]] + [end_s]
    for record, until_s in zip(margins, ends_s, strict=True) if margins else ():
        found = {
            clause.name: round(100.0 * clause.required / clause.declared, 2)
            for clause in record.clauses
            if clause.declared
        }
        for name in found.keys() - values.keys():
            values[name] = [None] * len(times_s)
        for name, column in values.items():
            column.extend([found.get(name)] * 2)
        times_s += [record.time_s, until_s]
    names = [clause.name for clause in margins[0].clauses] if margins else []
    ordered = sorted(values, key=lambda name: names.index(name) if name in names else len(names))
    return {
        "clause_times_s": times_s,
        "clauses": [{"name": name, "values": values[name]} for name in ordered],
    }
