"""A flight as the report's page reads it: one JSON document from the logs.

Times are in seconds since departure.  A log of another version may lack what this one expects: the
document then has less in it, never something wrong.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gcs_tools.console.errors import CommandError
from gcs_tools.flight_report.columns import Columns
from gcs_tools.logs.flight_log import Log, read_log
from gcs_tools.logs.result import MissingValueError, Result, result_of
from onboard.events import EventName
from onboard.files.models import Contract, Mission
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import (
    KnownObstacle,
    Margins,
    Monitors,
    Obstacles,
    PlanRecord,
    Record,
    StateRecord,
)

Document = dict[str, Any]

# Before arming and after disarming, this much is shown.
_GROUND_S = 1.0
# Detections age from one to the next: shown is the oldest of this many ticks, 0.4 s.
_AGE_TICKS = 20
_CORNER_DIGITS = 3


@dataclass(frozen=True)
class Flight:
    """The logs of one flight.

    Attributes:
        name: for the headline.
        log: the daemon's.
        truth: the simulation's; empty of a real flight.
        result: ``result.json`` beside the log, if there is one.
    """

    name: str
    log: Log
    truth: Log
    result: Document | None


def read_flight(path: Path, watch: Callable[[int], None] = lambda _: None) -> Flight:
    """Read a flight log, and ground truth and result beside it.

    Args:
        path: the log, or the directory that `clearway fly` left.
        watch: told now and then how many bytes of `logs_of` have been read.

    Raises:
        CommandError: there is no flight in it.
    """
    path, *beside = logs_of(path)
    log = read_log(path, watch)
    if not log.states:
        began = "clearway" in log.metadata
        reason = "nothing was recorded" if began else "it is not a log of Clearway"
        raise CommandError(f"{path}: there is no flight in it: {reason}")
    if beside:
        before = path.stat().st_size
        truth = _ground_truth(beside[0], lambda read: watch(before + read))
    else:
        truth = Log(truths=log.truths)
    name = path.resolve().parent.name if path.name == "flight.mcap" else path.stem
    return Flight(name, log, truth, _written_result(path.with_name("result.json"), log))


def logs_of(path: Path) -> list[Path]:
    """Return the log that is meant, and after it the simulation's, if that lies beside it."""
    log = path / "flight.mcap" if path.is_dir() else path
    truth = log.with_name("truth.mcap")
    return [log, truth] if log.name == "flight.mcap" and truth.exists() else [log]


def _ground_truth(path: Path, watch: Callable[[int], None]) -> Log:
    """Read the simulation's log; a report without it still tells most."""
    try:
        return read_log(path, watch)
    except CommandError as error:
        return Log(complete=False, problems=(str(error),))


def _written_result(path: Path, log: Log) -> Document | None:
    """Read the result of this flight; it knows what the log does not, such as who gave up."""
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    flown = log.metadata.get("clearway", {}).get("contract_sha256")
    return (
        written if isinstance(written, dict) and written.get("contract_sha256") == flown else None
    )


def document_of(flight: Flight) -> Document:
    """Return everything that the page shows of a flight."""
    states = _around_the_flight(flight.log.states)
    start_s = _departure_s(states)
    contract, mission = _contract(flight.log), _mission(flight.log)
    truths = [
        t for t in flight.truth.truths if states[0].time_s <= t.time_unix_s <= states[-1].time_s
    ]
    result, problems = _result(flight)
    span_s = (_since(states[0], start_s), _since(states[-1], start_s))
    margins = [
        # What was said before the time that is shown holds from its beginning.
        replace(record, time_s=max(_since(record, start_s), span_s[0]))
        for record in flight.log.margins
    ]
    vehicle = None if contract is None else contract.vehicle
    return {
        "name": flight.name,
        "outcome": result.get("outcome", "unknown"),
        "reason": result.get("reason", ""),
        "succeeded": _succeeded(result),
        "problems": [*flight.log.problems, *flight.truth.problems, *problems],
        "facts": list(_facts(result, contract)),
        "span_s": span_s,
        "radius_m": 0.3 if vehicle is None else vehicle.radius_m,
        "height_m": _height_m(states),
        "limits": _limits(contract),
        "legs_ned_m": _legs(mission),
        "path": _path(states, start_s),
        "truth": _truth(truths, start_s),
        "known": _known(_between(flight.log.monitors, states), start_s),
        "phases": _phases(states, start_s),
        "obstacles": _obstacles(flight.log.obstacles, start_s),
        "plans": _plans(flight.log.plans, start_s),
        "steps": _steps(flight.log, truths, start_s),
        "margins": [
            {"time_s": record.time_s, "clauses": [asdict(clause) for clause in record.clauses]}
            for record in margins
        ],
        **_clauses(margins, span_s[1]),
        "events": [
            {
                "time_s": _since(event, start_s),
                "severity": event.severity,
                "text": event.text,
            }
            for event in flight.log.events
        ],
        "origin": list(_origin(flight, flight.log.states[0], contract)),
    }


# ---------------------------------------------------------------------------- the verdict


def _result(flight: Flight) -> tuple[Document, list[str]]:
    if flight.result is not None:
        return flight.result, []
    seed = flight.log.metadata.get("clearway", {}).get("seed", "")
    try:
        result = result_of(flight.log, flight.truth, seed=int(seed) if seed.isdecimal() else 0)
    except MissingValueError as error:
        return {}, [f"there is no verdict: the log does not say {error}"]
    return {name: getattr(result, name) for name in Result.__dataclass_fields__}, []


def _succeeded(result: Document) -> bool:
    return (
        result.get("outcome") == "arrived"
        and not result.get("collisions")
        and not result.get("violations")
    )


def _facts(result: Document, contract: Contract | None) -> Iterator[tuple[str, str]]:
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
    yield "least clearance", "not known" if clearance_m is None else f"{clearance_m:.2f} m"
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
    yield "violations", "; ".join(result["violations"]) or "none"


# ---------------------------------------------------------------------------- over time


def _since(record: Record, start_s: float) -> float:
    return round(record.time_s - start_s, 3)


def _around_the_flight(states: Sequence[StateRecord]) -> Sequence[StateRecord]:
    """Leave out the waiting on the ground; all of it where the vehicle never left."""
    # Autopilots call themselves airborne only once they have climbed.
    flown = [state for state in states if state.armed or state.airborne]
    if not flown:
        return states
    begin_s, end_s = flown[0].time_s - _GROUND_S, flown[-1].time_s + _GROUND_S
    # Times that run backwards leave nothing between.
    return [state for state in states if begin_s <= state.time_s <= end_s] or states


def _between(records: Sequence[Monitors], states: Sequence[StateRecord]) -> list[Monitors]:
    begin_s, end_s = states[0].time_s, states[-1].time_s
    return [record for record in records if begin_s <= record.time_s <= end_s]


def _departure_s(states: Sequence[StateRecord]) -> float:
    """Time of day when the daemon took control, or of the first state."""
    flying = (state.time_s for state in states if state.phase != "standby")
    return next(flying, states[0].time_s)


def _height_m(states: Sequence[StateRecord]) -> float:
    known = [state.position_ned_m[2] for state in states if state.position_ned_m]
    return -min(known, default=0.0)


def _path(states: Sequence[StateRecord], start_s: float) -> Document:
    columns = Columns(states)
    return {
        "time_s": columns.of(lambda state: state.time_s - start_s, 2),
        "north_m": columns.vector(lambda s: s.position_ned_m, 0),
        "east_m": columns.vector(lambda s: s.position_ned_m, 1),
        "height_m": columns.vector(lambda s: s.position_ned_m, 2, scale=-1.0),
        "yaw_rad": columns.of(lambda state: state.yaw_rad),
        "north_mps": columns.vector(lambda s: s.velocity_ned_mps, 0),
        "east_mps": columns.vector(lambda s: s.velocity_ned_mps, 1),
        "up_mps": columns.vector(lambda s: s.velocity_ned_mps, 2, scale=-1.0),
        "roll_deg": columns.angle_deg(lambda s: s.roll_rad),
        "pitch_deg": columns.angle_deg(lambda s: s.pitch_rad),
        "yaw_deg": columns.angle_deg(lambda s: s.yaw_rad),
        "reference_north_m": columns.vector(lambda s: s.reference_position_ned_m, 0),
        "reference_east_m": columns.vector(lambda s: s.reference_position_ned_m, 1),
        "reference_height_m": columns.vector(lambda s: s.reference_position_ned_m, 2, scale=-1.0),
        "reference_north_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 0),
        "reference_east_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 1),
        "reference_up_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 2, scale=-1.0),
        "velocity_error_along_mps": columns.peaks(_velocity_error(0), 4),
        "velocity_error_across_mps": columns.peaks(_velocity_error(1), 4),
        # Outside the flight it is what it last was.
        "tracking_error_m": columns.peaks(
            lambda state: state.tracking_error_m if state.phase in {"cruise", "avoid"} else None,
            4,
        ),
        "detection_age_s": columns.peaks(lambda state: state.detection_age_s, back=_AGE_TICKS),
    }


def _velocity_error(axis: int) -> Callable[[StateRecord], float | None]:
    def read(state: StateRecord) -> float | None:
        # The contract limits it where a vehicle may meet its next obstacle, not while it avoids.
        error_mps = state.velocity_error_mps if state.cruising else None
        return None if error_mps is None else abs(error_mps[axis])

    return read


def _known(monitors: Sequence[Monitors], start_s: float) -> Document:
    """Return what the daemon itself made of its clearance."""
    columns = Columns(monitors)
    return {
        "time_s": columns.of(lambda record: record.time_s - start_s, 2),
        "clearance_m": columns.of(lambda record: record.clearance.measured),
    }


def _truth(truths: Sequence[TruthRecord], start_s: float) -> Document:
    columns = Columns(truths)
    return {
        "time_s": columns.of(lambda truth: truth.time_unix_s - start_s, 2),
        "clearance_m": columns.of(lambda truth: truth.clearance_m),
        "rpm": [columns.of(_rotor(index), 0) for index in range(4)] if truths else [],
    }


def _rotor(index: int) -> Callable[[TruthRecord], float | None]:
    def read(truth: TruthRecord) -> float | None:
        return truth.rpm[index] if index < len(truth.rpm) else None

    return read


def _phases(states: Sequence[StateRecord], start_s: float) -> list[Document]:
    found: list[Document] = []
    for phase, group in groupby(states, key=lambda state: state.phase):
        begin_s = _since(next(group), start_s)
        if found:
            found[-1]["end_s"] = begin_s
        found.append({"start_s": begin_s, "end_s": _since(states[-1], start_s), "phase": phase})
    return found


def _obstacles(messages: Sequence[Obstacles], start_s: float) -> list[Document]:
    """Return every obstacle as it was known, and from when until when (null: to the end)."""
    every: list[Document] = []
    current: dict[str, Document] = {}
    for message in messages:
        time_s = _since(message, start_s)
        known = {obstacle.id: _corners(obstacle) for obstacle in message.obstacles}
        for obstacle_id, before in list(current.items()):
            if known.get(obstacle_id) != before["corners"]:
                before["until_s"] = time_s
                del current[obstacle_id]
        for obstacle_id, corners in known.items():
            if obstacle_id not in current:
                current[obstacle_id] = {
                    "id": obstacle_id,
                    "since_s": time_s,
                    "until_s": None,
                    "corners": corners,
                }
                every.append(current[obstacle_id])
    return [{**obstacle.pop("corners"), **obstacle} for obstacle in every]


def _corners(obstacle: KnownObstacle) -> dict[str, list[list[float]]]:
    return {
        "measured_ned_m": _rounded_points(obstacle.measured_ned_m),
        "keep_out_ned_m": _rounded_points(obstacle.keep_out_ned_m),
        "region_ned_m": _rounded_points(obstacle.region_ned_m),
        "lane_ned_m": _rounded_points(obstacle.lane_ned_m),
        "boundary_ned_m": _rounded_points(obstacle.boundary_ned_m),
    }


def _rounded_points(points_m: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[round(value, _CORNER_DIGITS) for value in point] for point in points_m]


def _plans(plans: Sequence[PlanRecord], start_s: float) -> list[Document]:
    return [
        {
            "time_s": _since(plan, start_s),
            "end_s": (plan.end_s or plan.time_s) - start_s,
            "plan_time_ms": plan.plan_time_ms,
            "path_ned_m": _rounded_points(plan.path_ned_m),
        }
        for plan in plans
    ]


# ---------------------------------------------------------------------------- the induction


def _steps(log: Log, truths: Sequence[TruthRecord], start_s: float) -> list[Document]:
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
                "time_s": _since(event, start_s),
                "end_s": _since(after[0], start_s) if recovered else None,
                **_planned(log.plans, begin_s),
                "pre_condition": not late,
                "post_condition": recovered and not missed,
                "clearance_m": _clearance_m(truths, begin_s, end_s),
            }
        )
    return steps


def _planned(plans: Sequence[PlanRecord], time_s: float) -> Document:
    """Return the plan that an avoidance began with: logged in the tick of its event."""
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


def _clauses(margins: Sequence[Margins], end_s: float) -> Document:
    """Return how much of every clause is used up, in percent, as steps over time."""
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


# ---------------------------------------------------------------------------- what flew


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
