"""``clearway preflight``: contract, field, vehicle and detections -> may this be flown?"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, write_document
from gcs_tools.console.progress import progress_bar
from gcs_tools.contract.document import contract_document
from gcs_tools.preflight import report as preflight_report
from gcs_tools.preflight.field_check import FieldRule, check_field, legs_of
from gcs_tools.preflight.field_placement import check_placement
from gcs_tools.preflight.finding import VEHICLE_IDENTITY, Finding, Verdict
from gcs_tools.preflight.remedy import Remedy, remedies
from gcs_tools.preflight.speed import fastest_speed_mps
from onboard.contract.assessment import Assessment, assess
from onboard.files.models import Contract, InputSet, Mission, load_contract
from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.yaml_file import load_yaml

_SYSTEM_ID_MAX: Final = 255


@dataclass(frozen=True)
class Preflight:
    """What was checked before a flight, and how it came out.

    Attributes:
        assessment: the contract's clauses.
        field_rules: the obstacle field's, where one was given.
        fastest_mps: the fastest cruise that contract and field allow; None where no field was
            given, or no speed would do.
        findings: what was looked at live.
    """

    assessment: Assessment
    field_rules: tuple[FieldRule, ...] = ()
    fastest_mps: float | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def compliant(self) -> bool:
        """Whether the flight is covered by the contract, as far as paper can tell."""
        return self.assessment.compliant and all(rule.holds for rule in self.field_rules)

    @property
    def verdict(self) -> Verdict:
        """What came of everything that was looked at."""
        return Verdict.worst(
            [Verdict.of(holds=self.compliant), *(each.verdict for each in self.findings)]
        )

    @property
    def vehicle(self) -> str | None:
        """Which vehicle was looked at, in words; None if none was."""
        named = (each.text for each in self.findings if each.name == VEHICLE_IDENTITY)
        return next(named, None)

    @cached_property
    def remedies(self) -> tuple[Remedy, ...]:
        """Single changes that satisfy the clauses that are broken."""
        return remedies(self.assessment)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why it may not be flown; empty if it may."""
        clauses = tuple(
            f"{c.name}: requires {c.required:.2f} {c.unit}, declared {c.declared:.2f} {c.unit}"
            for c in self.assessment.clauses
            if not c.holds
        )
        rules = tuple(
            f"{rule.name}: {rule.reason} ({preflight_report.some(rule.offenders)})"
            for rule in self.field_rules
            if not rule.holds
        )
        live = tuple(
            f"{each.subject} {each.name}: {each.verdict.value}: {each.text}"
            for each in sorted(self.findings, key=lambda each: each.verdict is Verdict.UNKNOWN)
            if each.verdict is not Verdict.HOLDS
        )
        return clauses + rules + live

    def document(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        return {
            "verdict": self.verdict.value,
            "vehicle": self.vehicle,
            "compliant": self.compliant,
            "refusals": list(self.refusals),
            "contract": contract_document(self.assessment),
            "remedies": [vars(remedy) for remedy in self.remedies],
            "field": [_rule_document(rule) for rule in self.field_rules],
            "fastest_compliant_speed_mps": self.fastest_mps,
            "live": [finding.document() for finding in self.findings],
        }


def check(
    contract: Contract,
    obstacles: ObstacleField | None,
    mission: Mission | None,
    input_set: InputSet = "inner",
) -> Preflight:
    """Check what can be checked on paper."""
    altitude_m = None if mission is None else mission.altitude_m
    assessment = assess(contract, input_set, mission_altitude_m=altitude_m)
    rules = () if obstacles is None else check_field(assessment, obstacles, mission)
    if obstacles is not None and mission is not None:
        rules += (check_placement(obstacles, mission, contract.sensor.detection_range_m),)
    return Preflight(assessment, rules)


@dataclass(frozen=True)
class PreflightFiles:
    """What a check on paper reads.

    Attributes:
        contract, field, mission: files; the last two may be missing.
        overrides: of the contract, as given to ``--set``.
        picture: where to draw the field.
    """

    contract: Path
    field: Path | None
    mission: Path | None
    overrides: tuple[str, ...]
    picture: Path | None


def run_preflight(
    files: PreflightFiles,
    *,
    vehicle_url: str | None,
    system_id: int | None,
    zenoh_config: Path | None,
    endurance_s: float | None,
    authorize_s: float | None,
    input_set: InputSet,
    form: Format,
    output: Path | None,
) -> Verdict:
    """Check, write the result, and return the verdict; answer arm requests by it if so asked.

    Raises:
        FileError: a file is not usable.
        CommandError: no Zenoh session, or the output or the picture cannot be written.
        VehicleError: there is nobody whose requests to arm could be answered.
    """
    if authorize_s is not None and vehicle_url is None:
        raise CommandError("--authorize answers a vehicle that asks: give --vehicle")
    _check_system_id(system_id, vehicle_url)
    contract = load_contract(files.contract, files.overrides)
    obstacles = None if files.field is None else load_field(files.field)
    mission = None if files.mission is None else load_yaml(files.mission, Mission)
    result = check(contract, obstacles, mission, input_set)
    if obstacles is not None:
        fastest_mps = fastest_speed_mps(contract, obstacles, mission, input_set)
        result = replace(result, fastest_mps=fastest_mps)
        if files.picture is not None:
            _draw(files.picture, result, obstacles, mission)
    elif files.picture is not None:
        raise CommandError("--picture draws the obstacle field: give --field")
    if vehicle_url is not None or zenoh_config is not None:
        looked_at = _LookedAt(vehicle_url, system_id, zenoh_config, endurance_s)
        findings = _look(result, mission, looked_at)
        result = replace(result, findings=findings)
    table = partial(print_preflight, result, str(files.contract))
    write_document(result.document(), table, form=form, path=output)
    if authorize_s is not None and vehicle_url is not None:
        _authorize(vehicle_url, system_id, result.verdict, authorize_s)
    return result.verdict


def _check_system_id(system_id: int | None, vehicle_url: str | None) -> None:
    if system_id is None:
        return
    if not 1 <= system_id <= _SYSTEM_ID_MAX:
        raise CommandError(f"--system-id {system_id}: expected 1 to {_SYSTEM_ID_MAX}")
    if vehicle_url is None:
        raise CommandError("--system-id chooses among the vehicles of a connection: give --vehicle")


def _authorize(
    vehicle_url: str, system_id: int | None, verdict: Verdict, duration_s: float
) -> None:
    from gcs_tools.preflight.arm_authorization import answer_arm_requests  # noqa: PLC0415  as in `_look`

    console = Console(stderr=True, highlight=False)
    answer_arm_requests(vehicle_url, verdict, duration_s, console.print, system_id=system_id)


class _LookedAt(NamedTuple):
    """What is looked at live: a vehicle, and what Zenoh tells."""

    vehicle_url: str | None
    system_id: int | None
    zenoh_config: Path | None
    endurance_s: float | None


def _look(result: Preflight, mission: Mission | None, looked_at: _LookedAt) -> tuple[Finding, ...]:
    # MAVSDK and Zenoh are large native libraries: load them for those who have a vehicle.
    from gcs_tools.preflight.live.bus import load_bus  # noqa: PLC0415
    from gcs_tools.preflight.live.check import STEPS, LiveRequest, check_live  # noqa: PLC0415

    path = looked_at.zenoh_config
    request = LiveRequest(
        looked_at.vehicle_url,
        None if path is None else load_bus(path),
        looked_at.endurance_s,
        system_id=looked_at.system_id,
    )
    done = itertools.count()
    with progress_bar("looking", STEPS) as bar:
        return check_live(
            request,
            result.assessment,
            mission,
            paper_compliant=result.compliant,
            report=lambda step: bar.show(next(done), f"looking: {step}"),
        )


def _draw(path: Path, result: Preflight, obstacles: ObstacleField, mission: Mission | None) -> None:
    # Matplotlib takes long to load: only for those who want a picture.
    from gcs_tools.preflight.picture import draw_field  # noqa: PLC0415

    broken = [rule.name for rule in result.field_rules if not rule.holds]
    title = f"{len(obstacles)} obstacles: " + (", ".join(broken) + " broken" if broken else "clear")
    draw_field(legs_of(result.assessment, obstacles, mission), title, path)


def print_preflight(result: Preflight, title: str, console: Console) -> None:
    """Draw the operator's view: verdict, then every rule."""
    assessment = result.assessment
    if result.vehicle is not None:
        title = f"{title}, {result.vehicle}"
    preflight_report.print_title(result.verdict, title, result.refusals, console)
    preflight_report.print_contract(assessment, result.remedies, console)
    if result.field_rules:
        preflight_report.print_field(
            result.field_rules, result.fastest_mps, assessment.terms.cruise_speed_mps, console
        )
    if result.findings:
        preflight_report.print_findings(result.findings, console)


def _rule_document(rule: FieldRule) -> dict[str, Any]:
    return {
        "name": rule.name,
        "required": rule.required,
        "declared": _finite(rule.declared),
        "margin": _finite(rule.margin),
        "unit": rule.unit,
        "holds": rule.holds,
        "reason": rule.reason,
        "offenders": list(rule.offenders),
        "note": rule.note,
    }


def _finite(value: float) -> float | None:
    """JSON knows no infinity: a single obstacle has no nearest neighbour."""
    return value if abs(value) < float("inf") else None
