"""What came of a flight, from its two logs: the daemon's and the simulation's ground truth."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import Log
from gcs_tools.scenario import Expectation, Outcome

_FLYING = frozenset({"cruise", "avoid"})
_OVER = frozenset({"arrived", "hold"})
_STILL_MPS = 0.1
_PLAN_KINDS = ("qp", "vertex", "brake")


@dataclass(frozen=True)
class Result:
    """``result.json``, key by key.

    Attributes:
        outcome: ``collided`` beats all others; ``aborted`` if the mission came to no end.
        reason: why it ended so.
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

    @property
    def succeeded(self) -> bool:
        """Mission complete, no collision, no violated assumption."""
        return self.outcome == "arrived" and self.collisions == 0 and not self.violations

    def meets(self, expected: Expectation) -> bool:
        """Tell whether the flight came out as its scenario expects."""
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
) -> Result:
    """Return what came of a flight.

    Args:
        flight: the daemon's log.
        truth: the simulation's log.
        seed: of the simulation.
        aborted: why the operator gave the flight up, if so.
        plan_times_s: wall time of each plan; by default what the log says, which a flight in
            virtual time does not.
    """
    states = flight.topic("/state")
    flown = [state for state in states if state["phase"] in _FLYING]
    truths = truth.topic("/truth")
    collisions = max((record["collisions"] for record in truths), default=0)
    outcome, reason = _outcome(flight, collisions, aborted)
    return Result(
        outcome=outcome,
        reason=reason,
        collisions=collisions,
        clearance_min_m=truths[-1]["clearance_min_m"] if truths else None,
        tracking_error_max_m=max((state["tracking_error_m"] for state in flown), default=0.0),
        velocity_error_max_mps=_velocity_error(flown),
        duration_s=flown[-1]["time_s"] - flown[0]["time_s"] if flown else 0.0,
        obstacles_avoided=_avoided(states),
        plans=_plans(flight),
        plan_time_ms=plan_time_ms(plan_times_s or _logged_plan_times_s(flight)),
        violations=tuple(
            event["text"] for event in flight.topic("/events") if event["name"] == "violation"
        ),
        final_position_ned_m=_final_position(states),
        contract_sha256=flight.metadata.get("clearway", {}).get("contract_sha256", ""),
        seed=seed,
    )


def plan_time_ms(times_s: Sequence[float]) -> dict[str, float | None]:
    """Return percentiles (nearest rank) of the time that plans took, in milliseconds."""
    ranked = sorted(times_s)
    if not ranked:
        return {"p50": None, "p99": None, "max": None}

    def percentile(share: float) -> float:
        return ranked[max(0, math.ceil(share * len(ranked)) - 1)] * 1e3

    return {"p50": percentile(0.50), "p99": percentile(0.99), "max": percentile(1.0)}


def _logged_plan_times_s(flight: Log) -> list[float]:
    times_ms = (plan.get("plan_time_ms") for plan in flight.topic("/plan"))
    return [time_ms * 1e-3 for time_ms in times_ms if time_ms is not None]


def _outcome(flight: Log, collisions: int, aborted: str | None) -> tuple[Outcome, str]:
    phases = [state["phase"] for state in flight.topic("/state")]
    last_words = _phase_texts(flight)
    if collisions:
        return "collided", f"{collisions} collision(s); {'; '.join(last_words)}"
    if "hold" in phases:
        return "held", next((t for t in reversed(last_words) if "holding" in t), "holding")
    if "arrived" in phases:
        return "arrived", "mission flown"
    refused = [event["text"] for event in flight.topic("/events") if event["name"] == "refused"]
    return "aborted", "; ".join(filter(None, (aborted, *refused))) or "the mission came to no end"


def _phase_texts(flight: Log) -> list[str]:
    return [event["text"] for event in flight.topic("/events") if event["name"] == "phase"]


def _velocity_error(flown: list[dict[str, Any]]) -> tuple[float, float]:
    errors = [state["velocity_error_mps"] for state in flown if state["cruising"]]
    return (
        max((error[0] for error in errors), default=0.0),
        max((error[1] for error in errors), default=0.0),
    )


def _avoided(states: list[dict[str, Any]]) -> int:
    phases = (state["phase"] for state in states)
    return sum(before == "avoid" and after == "cruise" for before, after in pairwise(phases))


def _plans(flight: Log) -> dict[str, int]:
    kinds = Counter(plan["kind"] for plan in flight.topic("/plan"))
    return {kind: kinds[kind] for kind in (*_PLAN_KINDS, *sorted(kinds.keys() - set(_PLAN_KINDS)))}


def _final_position(states: list[dict[str, Any]]) -> tuple[float, float, float] | None:
    """Where the vehicle last stood still after its mission; else where it was last."""
    known = [s for s in states if s["position_ned_m"] is not None]
    over = [s for s in known if s["phase"] in _OVER]
    still = [s for s in over if math.hypot(*s["velocity_ned_mps"]) < _STILL_MPS]
    known = still or over or known
    if not known:
        return None
    north_m, east_m, down_m = known[-1]["position_ned_m"]
    return north_m, east_m, down_m
