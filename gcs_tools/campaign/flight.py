"""Flies one flight of a campaign in memory, checks it with every oracle, returns one table row."""

from __future__ import annotations

import shlex
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from gcs_tools.campaign.adversary.genes import genes_text
from gcs_tools.campaign.adversary.margins import Margin, least_margin
from gcs_tools.campaign.adversary.shares import ErrorMeter, shares_text, used_shares
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.held_ways import HeldWays
from gcs_tools.campaign.oracles.evidence import ROUND_OFF, Evidence
from gcs_tools.campaign.oracles.registry import findings
from gcs_tools.campaign.sources import Source
from gcs_tools.logs.flight_log import Log, log_of
from gcs_tools.logs.result import Result, result_of
from gcs_tools.preflight.command import Preflight, check
from gcs_tools.scenario import Scenario
from onboard.contract.assessment import Assessment
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import EventRecord, PlanRecord, Record, StateRecord
from sitl.environment.truth_log import truth_record
from sitl.virtual.scripted_operator import Step
from sitl.virtual.simulation import (
    EPOCH_UNIX_S,
    SimulatedFlight,
    Simulation,
    ticks,
    without_cycle_collection,
)

# A flight may take this long for take-off and alignment, and then fly the leg at this share of the
# cruise speed.
_OVERHEAD_S: Final = 90.0
_PACE_MIN: Final = 0.25
# Where it pauses, it may also look round so often that it gives up, or wait for its sensor until
# the operator's patience ends.
_LOOKING_S: Final = 400.0
_AT_REST_MPS: Final = 0.1
# Records that results and oracles read; the rest of the flight log is for people.
_USED: Final = (StateRecord, EventRecord, PlanRecord)


@dataclass(frozen=True)
class FlightRow:
    """One row of the campaign's table.

    Attributes:
        source, campaign_seed, number: identify the flight; these three replay it.
        seed: of its simulation.
        variant, trigger: breach or kind of fault, and when it began.
        covered: whether the contract promises that the flight has no collision.
        refused: the pre-flight check refused, so it was not flown.
        outcome, reason, collisions, clearance_min_m, obstacles_avoided: as in ``result.json``.
        true_tracking_error_m: from ground truth, against the reference.
        tracking_share: of the declared tracking error that was used.
        plans_qp, plans_vertex, plans_brake: number of plans of each kind.
        violations: assumptions that the service reported as violated, one per line.
        findings: what the oracles found, one per line; empty for a good flight.
        progress: ``guaranteed`` or ``best_effort``, as the contract requires it.
        threaded: whether a part was flown with best effort.
        pauses: how often the vehicle stopped to look for another way.
        rest_margin_min_m: least margin of the way to rest that was held; null where none was.
        csb_shape: of the collision set boundary, ``flat`` or ``pointed``.
        genes: that a search has moved, as the argument ``--genes``; adversary only, as are:
        least_margin_m, least_margin_of: least margin of a promise, and which one.
        shares: used of each allowance, JSON.
        cruise_speed_mps ... passive_safety: of the drawn contract.
        virtual_s, wall_s: simulated time, and the processor time that it took.
    """

    source: str
    campaign_seed: int
    number: int
    seed: int
    variant: str
    trigger: str
    covered: bool
    refused: bool
    outcome: str
    reason: str
    collisions: int
    clearance_min_m: float | None
    obstacles: int
    obstacles_avoided: int
    true_tracking_error_m: float
    tracking_share: float
    plans_qp: int
    plans_vertex: int
    plans_brake: int
    violations: str
    findings: str
    progress: str
    threaded: bool
    pauses: int
    rest_margin_min_m: float | None
    genes: str
    least_margin_m: float | None
    least_margin_of: str
    shares: str
    csb_shape: str
    cruise_speed_mps: float
    roll_max_deg: float
    pitch_max_deg: float
    obstacle_size_max_m: float
    separation_m: float
    passive_safety: bool
    virtual_s: float
    wall_s: float

    @property
    def fell_back(self) -> bool:
        """Whether the service used a fallback: a violation, a hold or a brake plan."""
        return bool(self.violations) or self.outcome == "held" or self.plans_brake > 0

    @property
    def good(self) -> bool:
        """Whether no oracle has a finding."""
        return not self.findings


def replay_command(row: FlightRow) -> str:
    """Return the command that repeats one flight of a campaign exactly."""
    return (
        f"clearway campaign {shlex.quote(row.source)} --seed {row.campaign_seed} "
        f"--only {row.number}" + (f" --genes {row.genes}" if row.genes else "")
    )


@without_cycle_collection()
def fly_numbered(source: Source, campaign_seed: int, number: int) -> FlightRow:
    """Fly one flight of a campaign; an exception is a finding, not the end of the campaign."""
    began_s = time.process_time()
    case = source.case(campaign_seed, number)
    checked = _checked(case.scenario)
    which = {"source": source.name, "campaign_seed": campaign_seed, "number": number}
    if not (checked.may_fly or case.scenario.fly_outside_contract):
        return _row(which, case, checked.assessment, _refused(case, checked), time_s=(0.0, 0.0))
    try:
        meter = ErrorMeter()
        evidence = fly_case(case, meter)
        margin = None if case.adversary is None else least_margin(evidence)
        found = findings(evidence) | _broken(margin)
    except Exception:  # noqa: BLE001  campaigns exist to find exceptions of any kind
        crashed = _aborted(case, traceback.format_exc().strip().splitlines()[-1])
        found = {"exception": "\n".join(traceback.format_exc().strip().splitlines()[-5:])}
        return _row(which, case, checked.assessment, crashed, found=found, time_s=(0.0, 0.0))
    virtual_s = evidence.states[-1].time_s - EPOCH_UNIX_S
    return _row(
        which,
        case,
        checked.assessment,
        evidence.result,
        found=found,
        tracking_m=evidence.true_tracking_error_m,
        margin=margin,
        shares={} if case.adversary is None else used_shares(evidence, meter),
        time_s=(virtual_s, time.process_time() - began_s),
    )


def _broken(margin: Margin | None) -> dict[str, str]:
    """Return the finding that a negative margin is."""
    if margin is None or margin.metres >= -ROUND_OFF:
        return {}
    return {"margin": f"{margin.promise} is broken by {-margin.metres:.4f} m"}


def fly_case(case: FlightCase, meter: ErrorMeter | None = None) -> Evidence:
    """Fly until the vehicle is at rest after its mission and landing, or the time limit.

    Args:
        case: to fly.
        meter: observes every tick.
    """
    scenario = case.scenario
    simulation = Simulation(
        SimulatedFlight(
            contract=scenario.contract,
            mission=scenario.mission,
            sitl=scenario.sitl_config(seed=case.seed),
            obstacles=scenario.obstacles,
            seed=case.seed,
            faults=scenario.faults,
            sources=scenario.sources,
            fly_outside_contract=scenario.fly_outside_contract,
            time_limit_s=case.time_limit_s or _time_limit_s(scenario),
        )
    )
    scene = simulation.scene
    vehicle, world, movers = scene.vehicle, scene.world, scene.movers
    flown: list[Record] = []
    truths: list[TruthRecord] = []
    held = HeldWays()
    at_rest = False
    for records in ticks(simulation, shown=False):
        flown += [record for record in records if isinstance(record, _USED)]
        truths.append(truth_record(vehicle.truth, world, EPOCH_UNIX_S, movers))
        held.follow(simulation.autonomy.navigator, simulation.now_s)
        if meter is not None:
            meter.observe(simulation)
        landing = simulation.operator.step in (Step.LAND, Step.DONE)
        at_rest = landing and vehicle.truth.ground_speed_mps < _AT_REST_MPS
        if at_rest:
            break
    metadata = {"clearway": {"contract_sha256": scenario.contract.sha256}}
    flight, truth = log_of(flown, metadata=metadata), log_of(truths)
    aborted = simulation.operator.gave_up
    if not at_rest:
        aborted = "the vehicle did not come to rest within the time limit"
    progress = scenario.contract.requirements.progress
    result = result_of(flight, truth, seed=case.seed, aborted=aborted, progress=progress)
    return Evidence(case, result, flight, truth, at_rest, held.ways)


def _checked(scenario: Scenario) -> Preflight:
    known = scenario.obstacles if scenario.field_known else None
    return check(scenario.contract, known, scenario.mission)


def _time_limit_s(scenario: Scenario) -> float:
    way_m, (north_m, east_m) = 0.0, scenario.mission.start_ned_m
    for leg in scenario.mission.legs:
        end_north_m, end_east_m = leg.end_ned_m
        way_m += abs(end_north_m - north_m) + abs(end_east_m - east_m)
        north_m, east_m = leg.end_ned_m
    pauses = scenario.contract.requirements.stop  # best effort requires it
    overhead_s = _OVERHEAD_S + (_LOOKING_S if pauses else 0.0)
    return overhead_s + way_m / (_PACE_MIN * scenario.contract.vehicle.cruise_speed_mps)


def _refused(case: FlightCase, checked: Preflight) -> Result:
    return _aborted(case, f"refused: {'; '.join(checked.refusals)}")


def _aborted(case: FlightCase, reason: str) -> Result:
    """Return the result of a flight without a log."""
    nothing = Log()
    return result_of(nothing, nothing, seed=case.seed, aborted=reason)


def _row(
    which: Mapping[str, Any],
    case: FlightCase,
    assessment: Assessment,
    result: Result,
    *,
    time_s: tuple[float, float],
    found: Mapping[str, str] | None = None,
    tracking_m: float = 0.0,
    margin: Margin | None = None,
    shares: Mapping[str, float] | None = None,
) -> FlightRow:
    declared_m = case.scenario.contract.vehicle.tracking_error_m
    refused = result.outcome == "aborted" and result.reason.startswith("refused: ")
    if refused and not case.refusable and "aborted" not in case.outcomes:
        found = {"outcome": result.reason}
    return FlightRow(
        **which,
        seed=case.seed,
        variant=case.variant,
        trigger=case.trigger,
        covered=case.covered,
        refused=refused,
        outcome=result.outcome,
        reason=result.reason,
        collisions=result.collisions,
        clearance_min_m=result.clearance_min_m,
        obstacles=len(case.scenario.obstacles),
        obstacles_avoided=result.obstacles_avoided,
        true_tracking_error_m=tracking_m,
        tracking_share=tracking_m / max(declared_m, 1e-9),
        plans_qp=result.plans["qp"],
        plans_vertex=result.plans["vertex"],
        plans_brake=result.plans["brake"],
        violations="\n".join(result.violations),
        findings="\n".join(f"{name}: {text}" for name, text in (found or {}).items()),
        threaded=result.threaded,
        pauses=result.pauses,
        rest_margin_min_m=result.rest_margin_min_m,
        **_adversary_columns(case, margin, shares or {}),
        **_contract_columns(case, assessment),
        virtual_s=time_s[0],
        wall_s=time_s[1],
    )


def _adversary_columns(
    case: FlightCase, margin: Margin | None, shares: Mapping[str, float]
) -> dict[str, Any]:
    """Return the columns about an adversary; empty without one."""
    return {
        "genes": "" if case.adversary is None else genes_text(case.adversary.genes),
        "least_margin_m": None if margin is None else margin.metres,
        "least_margin_of": "" if margin is None else margin.promise,
        "shares": shares_text(shares) if shares else "",
    }


def _contract_columns(case: FlightCase, assessment: Assessment) -> dict[str, Any]:
    """Return the columns about the contract that was drawn."""
    contract = case.scenario.contract
    vehicle, environment = contract.vehicle, contract.environment
    return {
        "progress": contract.requirements.progress,
        "csb_shape": "flat" if assessment.nominal.region.flat else "pointed",
        "cruise_speed_mps": vehicle.cruise_speed_mps,
        "roll_max_deg": vehicle.roll_max_deg,
        "pitch_max_deg": vehicle.pitch_max_deg,
        "obstacle_size_max_m": environment.obstacle_size_max_m,
        "separation_m": environment.separation_any_way_m,
        "passive_safety": contract.requirements.passive_safety,
    }
