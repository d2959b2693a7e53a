"""A flight as one JSON document, which the report's page draws.

Times are in seconds since departure.  A log of another version may lack records or keys: the
document then omits what depends on them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime

from pydantic import ValidationError

from gcs_tools.flight_report.flight import Document, Flight
from gcs_tools.flight_report.induction import clause_shares, induction_steps, margins_since
from gcs_tools.flight_report.moments import marks, opening_s
from gcs_tools.flight_report.movers import (
    mover_moments,
    mover_summary,
    movers_during,
    true_movers,
)
from gcs_tools.flight_report.timeline import (
    departure_s,
    flight_states,
    height_m,
    known_columns,
    monitors_during,
    obstacle_spans,
    path_columns,
    phase_spans,
    plan_paths,
    seen_spaces,
    since,
    truth_columns,
    truths_during,
)
from gcs_tools.flight_report.true_field import true_outlines_ned_m
from gcs_tools.logs.flight_log import Log
from gcs_tools.logs.result import MissingValueError, Result, result_of, touches_at_rest
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.recording.messages import StateRecord


def document_of(flight: Flight) -> Document:
    """Return everything that the page shows of a flight."""
    states = flight_states(flight.log.states)
    start_s = departure_s(states)
    contract, mission = _contract(flight.log), _mission(flight.log)
    truths = truths_during(flight.truth.truths, states)
    monitors = monitors_during(flight.log.monitors, states)
    span_s = (since(states[0], start_s), since(states[-1], start_s))
    margins = margins_since(flight.log, start_s, span_s[0])
    marked = marks(flight.log.events, truths, states, start_s)
    vehicle = None if contract is None else contract.vehicle
    moving = movers_during(flight.log.movers, states)
    return {
        "name": flight.name,
        **_verdict(flight, contract),
        "span_s": span_s,
        "opens_at_s": opening_s(marked, states, start_s),
        "marks": marked,
        "radius_m": 0.3 if vehicle is None else vehicle.radius_m,
        "height_m": height_m(states),
        "limits": _limits(contract),
        "legs_ned_m": _legs(mission),
        "path": path_columns(states, start_s),
        "truth": truth_columns(truths, start_s),
        "known": known_columns(monitors, start_s),
        "phases": phase_spans(states, start_s),
        "field_ned_m": true_outlines_ned_m(flight.truth, states),
        "obstacles": obstacle_spans(flight.log.obstacles, start_s),
        "plans": plan_paths(flight.log.plans, start_s),
        "seen_spaces": seen_spaces(flight.log.seen_spaces, start_s),
        "mover_moments": mover_moments(moving, start_s),
        "movers": mover_summary(moving, start_s),
        "true_movers": true_movers(flight.truth.true_movers, states, start_s),
        "steps": induction_steps(flight.log, truths, start_s),
        "margins": [
            {"time_s": record.time_s, "clauses": [asdict(clause) for clause in record.clauses]}
            for record in margins
        ],
        **clause_shares(margins, span_s[1]),
        "events": _events(flight.log, start_s),
        "origin": list(_origin(flight, flight.log.states[0], contract)),
    }


def _verdict(flight: Flight, contract: Contract | None) -> Document:
    result, problems = _result(flight)
    return {
        "outcome": result.get("outcome", "unknown"),
        "reason": result.get("reason", ""),
        "succeeded": _succeeded(result),
        "problems": [
            *_virtual(flight.log),
            *flight.log.problems,
            *flight.truth.problems,
            *problems,
        ],
        "facts": list(_facts(result, contract, touches_at_rest(flight.truth))),
    }


def _events(log: Log, start_s: float) -> list[Document]:
    return [
        {
            "time_s": since(event, start_s),
            "severity": event.severity,
            "text": event.text,
        }
        for event in log.events
    ]


def _virtual(log: Log) -> Iterator[str]:
    if any(state.virtual_obstacles for state in log.states):
        yield "VIRTUAL OBSTACLES: what was avoided was not there, and real ones were not seen"


def _result(flight: Flight) -> tuple[Document, list[str]]:
    if flight.result is not None:
        return flight.result, []
    seed = flight.log.metadata.get("clearway", {}).get("seed", "")
    try:
        result = result_of(flight.log, flight.truth, seed=int(seed) if seed.isdecimal() else 0)
    except MissingValueError as error:
        return {}, [f"the log lacks {error}, which the verdict needs"]
    return {name: getattr(result, name) for name in Result.__dataclass_fields__}, []


def _succeeded(result: Document) -> bool:
    return (
        result.get("outcome") == "arrived"
        and not result.get("collisions")
        and not result.get("violations")
    )


def _facts(result: Document, contract: Contract | None, touches: int) -> Iterator[tuple[str, str]]:
    if not result:
        return
    vehicle = None if contract is None else contract.vehicle

    def allowed(number: float | None, unit: str) -> str:
        return f" {unit}" if number is None else f" of {number} {unit}"

    clearance_m = result["clearance_min_m"]
    along_mps, across_mps = result["velocity_error_max_mps"]
    limits_mps = (None, None) if vehicle is None else vehicle.velocity_error_mps
    yield "obstacles avoided", str(result["obstacles_avoided"])
    yield "collisions", str(result["collisions"])
    if touches:
        yield "touched at rest by a mover", f"{touches}, which is no collision"
    wish_m = 0.0 if vehicle is None else vehicle.clearance_wish_m
    wish = f" (wish {wish_m:g} m)" if wish_m else ""
    yield "least clearance", "unknown" if clearance_m is None else f"{clearance_m:.2f} m{wish}"
    yield (
        "tracking error",
        f"{result['tracking_error_max_m']:.3f}"
        + allowed(None if vehicle is None else vehicle.tracking_error_m, "m"),
    )
    yield "velocity error along the leg", f"{along_mps:.3f}" + allowed(limits_mps[0], "m/s")
    yield "velocity error across the leg", f"{across_mps:.3f}" + allowed(limits_mps[1], "m/s")
    yield "plans", ", ".join(f"{n} {kind}" for kind, n in result["plans"].items() if n) or "none"
    times = [f"{name} {ms:.1f}" for name, ms in result["plan_time_ms"].items() if ms is not None]
    yield "plan time", f"{', '.join(times)} ms" if times else "not measured in virtual time"
    yield "mission time", f"{result['duration_s']:.1f} s"
    if "mean_speed_mps" in result:  # a result of an older version lacks both
        yield "mean speed", f"{result['mean_speed_mps']:.2f} m/s"
        yield "pauses", str(result["pauses"])
    yield "violations", "; ".join(result["violations"]) or "none"


def _contract(log: Log) -> Contract | None:
    try:
        return Contract.model_validate_json(log.metadata.get("clearway", {}).get("contract", ""))
    except ValidationError:
        return None


def _mission(log: Log) -> Mission | None:
    try:
        return Mission.model_validate_json(log.metadata.get("clearway", {}).get("mission", ""))
    except ValidationError:
        return None


def _legs(mission: Mission | None) -> list[tuple[float, float]]:
    return (
        [] if mission is None else [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
    )


def _limits(contract: Contract | None) -> dict[str, float | None]:
    if contract is None:
        names = (
            *("tracking_error_m", "velocity_error_along_mps", "velocity_error_across_mps"),
            *("cruise_speed_mps", "roll_max_deg", "frame_age_max_s"),
        )
        return dict.fromkeys(names)
    vehicle = contract.vehicle
    along_mps, across_mps = vehicle.velocity_error_mps
    return {
        "tracking_error_m": vehicle.tracking_error_m,
        "velocity_error_along_mps": along_mps,
        "velocity_error_across_mps": across_mps,
        "cruise_speed_mps": vehicle.cruise_speed_mps,
        "roll_max_deg": vehicle.roll_max_deg,
        "frame_age_max_s": contract.sensor.frame_age_max_s,
    }


def _origin(
    flight: Flight, first: StateRecord, contract: Contract | None
) -> Iterator[tuple[str, str]]:
    began = datetime.fromtimestamp(first.time_s, UTC)
    yield "log began", f"{began:%Y-%m-%d %H:%M:%S} UTC"
    said = dict(flight.log.metadata.get("clearway", {}))
    for name in ("contract", "mission"):
        said.pop(name, None)
    yield from ((name.replace("_", " "), value) for name, value in said.items())
    if contract is not None:
        for section, terms in contract.model_dump(mode="json").items():
            for term, value in terms.items():
                yield f"{section}.{term}", json.dumps(value)
