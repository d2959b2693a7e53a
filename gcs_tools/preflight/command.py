"""``clearway preflight``: checks contract, field, vehicle and detections before a flight."""

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
from onboard.files.contract_file import Contract, InputSet, load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.yaml_file import load_yaml

_SYSTEM_ID_MAX: Final = 255


@dataclass(frozen=True)
class Preflight:
    """The results of a pre-flight check.

    Attributes:
        assessment: the contract's clauses.
        field_rules: the obstacle field's, where one was given.
        fastest_mps: fastest cruise that contract and field allow; None without a field, or if no
            speed complies.
        findings: of the live check.
    """

    assessment: Assessment
    field_rules: tuple[FieldRule, ...] = ()
    fastest_mps: float | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def compliant(self) -> bool:
        """Whether contract and field comply, without regard to live findings."""
        return self.assessment.compliant and all(rule.holds for rule in self.field_rules)

    @property
    def verdict(self) -> Verdict:
        """Verdict on contract, field and live findings together."""
        return Verdict.worst(
            [Verdict.of(holds=self.compliant), *(each.verdict for each in self.findings)]
        )

    @property
    def vehicle(self) -> str | None:
        """The vehicle that was checked, in words; None without one."""
        named = (each.text for each in self.findings if each.name == VEHICLE_IDENTITY)
        return next(named, None)

    @cached_property
    def remedies(self) -> tuple[Remedy, ...]:
        """Single changes that satisfy broken clauses."""
        return remedies(self.assessment)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons for a verdict other than holds."""
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
    """Check contract, field and mission; needs no vehicle."""
    altitude_m = None if mission is None else mission.altitude_m
    assessment = assess(contract, input_set, mission_altitude_m=altitude_m)
    rules = () if obstacles is None else check_field(assessment, obstacles, mission)
    if obstacles is not None and mission is not None:
        rules += (check_placement(obstacles, mission, contract.sensor.detection_range_m),)
    return Preflight(assessment, rules)


@dataclass(frozen=True)
class PreflightFiles:
    """Files that a check reads.

    Attributes:
        contract, field, mission: the last two may be None.
        overrides: of the contract, as given to ``--set``.
        picture: to draw the field to; None for no picture.
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
    """Check, write the result, return the verdict; then answer arm requests if requested.

    Raises:
        FileError: a file cannot be used.
        CommandError: no Zenoh session, or the output or the picture cannot be written.
        VehicleError: no vehicle answers whose requests to arm could be answered.
    """
    if authorize_s is not None and vehicle_url is None:
        raise CommandError("--authorize needs --vehicle: it answers the vehicle's requests to arm")
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
        raise CommandError("--picture needs --field: it draws the obstacle field")
    if vehicle_url is not None or zenoh_config is not None:
        targets = _LiveTargets(vehicle_url, system_id, zenoh_config, endurance_s)
        findings = _check_live(result, mission, targets)
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
        raise CommandError("--system-id needs --vehicle: it selects one of a connection's vehicles")


def _authorize(
    vehicle_url: str, system_id: int | None, verdict: Verdict, duration_s: float
) -> None:
    from gcs_tools.preflight.arm_authorization import answer_arm_requests  # noqa: PLC0415  as in `_check_live`

    console = Console(stderr=True, highlight=False)
    answer_arm_requests(vehicle_url, verdict, duration_s, console.print, system_id=system_id)


class _LiveTargets(NamedTuple):
    """What a live check connects to."""

    vehicle_url: str | None
    system_id: int | None
    zenoh_config: Path | None
    endurance_s: float | None


def _check_live(
    result: Preflight, mission: Mission | None, targets: _LiveTargets
) -> tuple[Finding, ...]:
    # MAVSDK and Zenoh are large native libraries: load them only for a live check.
    from gcs_tools.preflight.live.bus import load_bus  # noqa: PLC0415
    from gcs_tools.preflight.live.check import STEPS, LiveRequest, check_live  # noqa: PLC0415

    path = targets.zenoh_config
    request = LiveRequest(
        targets.vehicle_url,
        None if path is None else load_bus(path),
        targets.endurance_s,
        system_id=targets.system_id,
    )
    done = itertools.count()
    with progress_bar("checking", STEPS) as bar:
        return check_live(
            request,
            result.assessment,
            mission,
            paper_compliant=result.compliant,
            report=lambda step: bar.show(next(done), f"checking: {step}"),
        )


def _draw(path: Path, result: Preflight, obstacles: ObstacleField, mission: Mission | None) -> None:
    # Matplotlib takes long to load: load it only to draw.
    from gcs_tools.preflight.picture import draw_field  # noqa: PLC0415

    broken = [rule.name for rule in result.field_rules if not rule.holds]
    title = f"{len(obstacles)} obstacles: " + (", ".join(broken) + " broken" if broken else "clear")
    draw_field(legs_of(result.assessment, obstacles, mission), title, path)


def print_preflight(result: Preflight, title: str, console: Console) -> None:
    """Print the verdict, then every clause, rule and finding."""
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
    """Return None for infinity, which JSON lacks: a single obstacle has no nearest neighbour."""
    return value if abs(value) < float("inf") else None
