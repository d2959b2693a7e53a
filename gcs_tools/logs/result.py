"""Evaluates a flight from its two logs: the daemon's and the simulation's ground truth."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import Log
from gcs_tools.scenario import Expectation, Outcome
from onboard.events import EventName
from onboard.files.contract_file import Progress
from onboard.files.truth_record import TruthRecord
from onboard.guidance.phases import FLYING_PHASES
from onboard.recording.messages import StateRecord

_OVER = frozenset({"arrived", "hold"})
_STILL_MPS = 0.1
_PLAN_KINDS = ("qp", "vertex", "brake")


_Value = TypeVar("_Value")


class MissingValueError(ValueError):
    """A log lacks a value that the result needs; the message is its name."""


@dataclass(frozen=True)
class Result:
    """``result.json``, key by key.

    Attributes:
        outcome: ``collided`` takes precedence; ``aborted`` if the mission did not end.
        reason: of the outcome.
        collisions: how often contact with an obstacle began.
        clearance_min_m: vehicle centre to nearest face, less the radius; null in open space.
        tracking_error_max_m: horizontal, while the daemon flew.
        velocity_error_max_mps: along and across the leg, while cruising outside all regions.
        duration_s: from taking control to the end of the mission.
        obstacles_avoided: avoidances that reached their post-condition.
        plans: how many of each kind.
        plan_time_ms: ``p50``, ``p99``, ``max``; null where no times were kept.
        violations: assumptions that failed, in the operator's words.
        final_position_ned_m: where the mission ended, before landing.
        contract_sha256: of the contract that was flown.
        seed: of the simulation.
        pauses: how often the vehicle stopped to look for another way.
        mean_speed_mps: way flown over ``duration_s``, pauses included.
        progress: ``guaranteed`` or ``best_effort``, as the contract requires it.
        threaded: whether a part was flown with best effort, in the space seen free.
        rest_margin_min_m: least margin of the way to rest that was held; null where none was.
        speed_at_contact_mps: greatest speed at which contact began; null without contact.
        contacts_at_rest: how many contacts began at rest; those with movers are no collisions.
    """

    outcome: Outcome
    reason: str
    collisions: int
    clearance_min_m: float | None
    tracking_error_max_m: float
    velocity_error_max_mps: tuple[float, float]
    duration_s: float
    obstacles_avoided: int
    plans: dict[str, int]
    plan_time_ms: dict[str, float | None]
    violations: tuple[str, ...]
    final_position_ned_m: tuple[float, float, float] | None
    contract_sha256: str
    seed: int
    pauses: int = 0
    mean_speed_mps: float = 0.0
    progress: Progress = "guaranteed"
    threaded: bool = False
    rest_margin_min_m: float | None = None
    speed_at_contact_mps: float | None = None
    contacts_at_rest: int = 0

    @property
    def succeeded(self) -> bool:
        """Mission complete, no collision, no violated assumption."""
        return self.outcome == "arrived" and self.collisions == 0 and not self.violations

    def meets(self, expected: Expectation) -> bool:
        """Tell whether the flight ended as its scenario expects."""
        avoided = expected.obstacles_avoided
        return (
            self.outcome == expected.outcome
            and self.collisions == expected.collisions
            and (expected.reason is None or expected.reason in self.reason)
            and (avoided is None or self.obstacles_avoided == avoided)
        )

    def write(self, path: Path) -> None:
        """Write the result as JSON.

        Raises:
            CommandError: the file cannot be written.
        """
        text = json.dumps(asdict(self), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error


def result_of(
    flight: Log,
    truth: Log,
    *,
    seed: int,
    aborted: str | None = None,
    plan_times_s: Sequence[float] = (),
    progress: Progress = "guaranteed",
) -> Result:
    """Return the result of a flight.

    Args:
        flight: the daemon's log.
        truth: the simulation's.
        seed: of the simulation.
        aborted: why the operator gave the flight up, if so.
        plan_times_s: wall time of each plan; by default that of the log (none in virtual time).
        progress: as the contract requires it.

    Raises:
        MissingValueError: a log of another version lacks a value.
    """
    flown = [state for state in flight.states if state.phase in FLYING_PHASES]
    collisions, duration_s = _collisions(truth), _duration_s(flown)
    outcome, reason = _outcome(flight, collisions, aborted)
    return Result(
        outcome=outcome,
        reason=reason,
        collisions=collisions,
        tracking_error_max_m=_tracking_error_max_m(flown),
        velocity_error_max_mps=_velocity_error_max_mps(flown),
        duration_s=duration_s,
        obstacles_avoided=_avoided(flight.states),
        plans=_plans(flight),
        plan_time_ms=plan_time_ms(plan_times_s or _logged_plan_times_s(flight)),
        violations=tuple(e.text for e in flight.events if e.name == EventName.VIOLATION),
        final_position_ned_m=_final_position(flight.states),
        contract_sha256=flight.metadata.get("clearway", {}).get("contract_sha256", ""),
        seed=seed,
        mean_speed_mps=_distance_m(flown) / duration_s if duration_s else 0.0,
        progress=progress,
        **_in_seen_space(flown, flight.states),
        **_against_obstacles(truth),
    )


def _collisions(truth: Log) -> int:
    return max((record.collisions for record in truth.truths), default=0)


def touches_at_rest(truth: Log) -> int:
    """Return how often movers have touched the vehicle at rest, which is no collision."""
    return max((record.contacts_at_rest for record in truth.truths), default=0)


def _against_obstacles(truth: Log) -> dict[str, Any]:
    """Return how near obstacles were, and what touching them was like."""
    speeds_mps = _contact_speeds_mps(truth.truths)
    at_rest = sum(speed_mps < _STILL_MPS for speed_mps in speeds_mps)
    return {
        "clearance_min_m": truth.truths[-1].clearance_min_m if truth.truths else None,
        "speed_at_contact_mps": max(speeds_mps, default=None),
        "contacts_at_rest": at_rest + touches_at_rest(truth),
    }


def _duration_s(flown: Sequence[StateRecord]) -> float:
    return flown[-1].time_s - flown[0].time_s if flown else 0.0


def _in_seen_space(flown: Sequence[StateRecord], states: Sequence[StateRecord]) -> dict[str, Any]:
    """Return what was flown with best effort, and how much room the ways to rest had."""
    margins_m = (state.rest_margin_m for state in flown)
    return {
        "pauses": _pauses(states),
        "threaded": any(state.phase == "thread" for state in flown),
        "rest_margin_min_m": min(
            (margin_m for margin_m in margins_m if margin_m is not None), default=None
        ),
    }


def _pauses(states: Sequence[StateRecord]) -> int:
    phases = [state.phase for state in states]
    return sum(after == "pause" != before for before, after in pairwise(phases))


def _distance_m(flown: Sequence[StateRecord]) -> float:
    places_m = [each.position_ned_m[:2] for each in flown if each.position_ned_m is not None]
    return sum(math.dist(before, after) for before, after in pairwise(places_m))


def _contact_speeds_mps(truths: Sequence[TruthRecord]) -> list[float]:
    """Return the speed at each beginning of a contact; a truth without a velocity has none."""
    before = 0
    speeds_mps = []
    for record in truths:
        if record.collisions > before and record.velocity_ned_mps is not None:
            speeds_mps.append(math.hypot(*record.velocity_ned_mps))
        before = record.collisions
    return speeds_mps


def plan_time_ms(times_s: Sequence[float]) -> dict[str, float | None]:
    """Return percentiles (nearest rank) of the time that plans took, in milliseconds."""
    ranked = sorted(times_s)
    if not ranked:
        return {"p50": None, "p99": None, "max": None}

    def percentile(share: float) -> float:
        return ranked[max(0, math.ceil(share * len(ranked)) - 1)] * 1e3

    return {"p50": percentile(0.50), "p99": percentile(0.99), "max": percentile(1.0)}


def _logged_plan_times_s(flight: Log) -> list[float]:
    times_ms = (plan.plan_time_ms for plan in flight.plans)
    return [time_ms * 1e-3 for time_ms in times_ms if time_ms is not None]


def _outcome(flight: Log, collisions: int, aborted: str | None) -> tuple[Outcome, str]:
    phases = {state.phase for state in flight.states}
    changes = _texts(flight, EventName.PHASE)
    if collisions:
        return "collided", f"{collisions} collision(s); {'; '.join(changes)}"
    if _held(flight.states):
        return "held", next((text for text in reversed(changes) if "holding" in text), "holding")
    if "arrived" in phases:
        return "arrived", "mission flown"
    reasons = filter(None, (aborted, *_texts(flight, EventName.REFUSED)))
    return "aborted", "; ".join(reasons) or "the mission did not end"


def _held(states: Sequence[StateRecord]) -> bool:
    """Tell whether the flight held, and the operator did not resume it from there."""
    phases = [state.phase for state in states]
    resumed = sum(before == "hold" and after in FLYING_PHASES for before, after in pairwise(phases))
    holds = sum(before != "hold" == after for before, after in pairwise(["", *phases]))
    return holds > resumed


def _texts(flight: Log, name: EventName) -> list[str]:
    return [event.text for event in flight.events if event.name == name]


def _tracking_error_max_m(flown: Sequence[StateRecord]) -> float:
    errors_m = [state.tracking_error_m for state in flown]
    return max((_present(error_m, "tracking_error_m") for error_m in errors_m), default=0.0)


def _velocity_error_max_mps(flown: Sequence[StateRecord]) -> tuple[float, float]:
    errors_mps = [
        _present(state.velocity_error_mps, "velocity_error_mps")
        for state in flown
        if _present(state.cruising, "cruising")
    ]
    along_mps = max((along for along, _ in errors_mps), default=0.0)
    return along_mps, max((across for _, across in errors_mps), default=0.0)


def _present(value: _Value | None, name: str) -> _Value:
    if value is None:
        raise MissingValueError(name)
    return value


def _avoided(states: Sequence[StateRecord]) -> int:
    phases = (state.phase for state in states)
    return sum(before == "avoid" and after == "cruise" for before, after in pairwise(phases))


def _plans(flight: Log) -> dict[str, int]:
    kinds = Counter(plan.kind for plan in flight.plans)
    return {kind: kinds[kind] for kind in (*_PLAN_KINDS, *sorted(kinds.keys() - set(_PLAN_KINDS)))}


def _final_position(states: Sequence[StateRecord]) -> tuple[float, float, float] | None:
    """Return where the vehicle last stood still after its mission, or else its last position."""
    known = [state for state in states if state.position_ned_m is not None]
    over = [state for state in known if state.phase in _OVER]
    still = [
        state
        for state in over
        if state.velocity_ned_mps is not None and math.hypot(*state.velocity_ned_mps) < _STILL_MPS
    ]
    last = (still or over or known)[-1:]
    return last[0].position_ned_m if last else None
