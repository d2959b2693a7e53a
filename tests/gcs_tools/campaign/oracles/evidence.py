"""A short synthetic flight without findings, and ways to spoil it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.logs.flight_log import log_of
from gcs_tools.logs.result import Result
from gcs_tools.scenario import Scenario, load_scenario
from onboard.contract.assessment import TICK_S
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.logs.raw_log import record, truth_record
from tests.gcs_tools.running import CONFIG

BEGAN_S = 1_790_000_000.0
SPEED_MPS = 1.0
# Ticks of each phase: standby, cruise, avoid, cruise, arrived.
PHASES = ("standby",) * 10 + ("cruise",) * 100 + ("avoid",) * 50 + ("cruise",) * 50
AVOIDS = PHASES.index("avoid")


@cache
def scenario() -> Scenario:
    """The paper's: one leg, heading north."""
    return load_scenario(CONFIG / "paper.yaml")


def state(tick: int, **changes: Any) -> dict[str, Any]:
    """The service's state: north along the leg at constant speed."""
    return {
        "time_s": BEGAN_S + tick * TICK_S,
        "phase": PHASES[tick],
        "reference_position_ned_m": [tick * TICK_S * SPEED_MPS, 0.0, -4.0],
        "reference_velocity_ned_mps": [SPEED_MPS, 0.0, 0.0],
        "reference_acceleration_ned_mps2": [0.0, 0.0, 0.0],
        "leg_heading_rad": 0.0,
        "obstacles_known": 1,
        "rest_certified": True,
        **changes,
    }


def plan(**changes: Any) -> dict[str, Any]:
    """The avoidance's plan; it ends 1 s after the avoidance, and its region in the middle of it."""
    begins_m, ends_m = AVOIDS * TICK_S * SPEED_MPS, (AVOIDS + 50) * TICK_S * SPEED_MPS
    return {
        "time_s": BEGAN_S + AVOIDS * TICK_S,
        "end_s": BEGAN_S + (AVOIDS + 100) * TICK_S,
        "kind": "qp",
        "obstacle": "1",
        "certificate": {"valid": True},
        "path_ned_m": [[begins_m, 0.0, -4.0], [ends_m - 0.01, 0.0, -4.0]],
        "region_ned_m": rectangle(begins_m - 0.01, ends_m - 0.01, 3.0),
        "keep_out_ned_m": rectangle(begins_m + 90.0, begins_m + 91.0, 0.5),
        **changes,
    }


def rectangle(from_m: float, to_m: float, half_m: float) -> list[list[float]]:
    """Corners in order, north and east."""
    return [[from_m, -half_m], [to_m, -half_m], [to_m, half_m], [from_m, half_m]]


def event(name: str, tick: int = 0, **data: Any) -> dict[str, Any]:
    return {"time_s": BEGAN_S + tick * TICK_S, "name": name, "text": "the text", "data": data}


def result(**changes: Any) -> Result:
    good = Result(
        outcome="arrived",
        reason="",
        collisions=0,
        clearance_min_m=1.0,
        tracking_error_max_m=0.0,
        velocity_error_max_mps=(0.0, 0.0),
        duration_s=4.2,
        obstacles_avoided=1,
        plans={"qp": 1, "vertex": 0, "brake": 0},
        plan_time_ms={},
        violations=(),
        final_position_ned_m=(4.2, 0.0, -4.0),
        contract_sha256="",
        seed=1,
    )
    return replace(good, **changes)


def flown(
    *,
    states: list[dict[str, Any]] | None = None,
    plans: list[dict[str, Any]] | None = None,
    events: list[dict[str, Any]] | None = None,
    truths: list[dict[str, Any]] | None = None,
    faults: tuple[Fault, ...] = (),
    ended: Result | None = None,
    at_rest: bool = True,
    **case: Any,
) -> Evidence:
    """The flight, with what is given in place of its own."""
    states = [state(tick) for tick in range(len(PHASES))] if states is None else states
    if truths is None:
        truths = [
            {"position_ned_m": each["reference_position_ned_m"] or [0.0] * 3, "collisions": 0}
            for each in states
        ]
    flight = [
        *(record("state", each) for each in states),
        *(record("plan", each) for each in ([plan()] if plans is None else plans)),
        *(record("events", each) for each in events or []),
    ]
    return Evidence(
        FlightCase(replace(scenario(), faults=faults), seed=1, **case),
        ended or result(),
        log_of(flight),
        log_of(truth_record({"time_unix_s": BEGAN_S, **each}) for each in truths),
        at_rest,
    )


def changed(tick: int, **changes: Any) -> list[dict[str, Any]]:
    """The flight's states with one of them changed."""
    return [state(n, **(changes if n == tick else {})) for n in range(len(PHASES))]
