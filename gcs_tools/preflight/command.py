"""``clearway preflight``: checks contract, field, vehicle and detections before a flight."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from gcs_tools.console.keys import mavlink_key
from gcs_tools.console.output import Format, write_document
from gcs_tools.console.progress import progress_bar
from gcs_tools.contract.document import contract_document
from gcs_tools.preflight import report as preflight_report
from gcs_tools.preflight.field_check import check_field, legs_of
from gcs_tools.preflight.field_placement import check_placement
from gcs_tools.preflight.files import LiveTargets, PreflightFiles, check_options, daemon_key
from gcs_tools.preflight.finding import VEHICLE_IDENTITY, VIRTUAL, Finding, Verdict
from gcs_tools.preflight.offline.fences import fence_rules
from gcs_tools.preflight.offline.heights import obstacles_in_way
from gcs_tools.preflight.offline.sensors import check_sources, rings_of
from gcs_tools.preflight.remedy import Remedy, remedies
from gcs_tools.preflight.rule import Rule
from gcs_tools.preflight.speed import fastest_speed_mps
from gcs_tools.preflight.tier import Tier, seen_free_rules, words_on_movers
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract, InputSet, load_contract
from onboard.files.daemon_config import load_daemon_config
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.sensor_sources import only_adds_movers
from onboard.files.yaml_file import load_yaml
from onboard.perception.movers.permitted_sources import check_permitted

if TYPE_CHECKING:
    from gcs_tools.preflight.rehearsal.prediction import Rehearsal


@dataclass(frozen=True)
class Preflight:
    """The results of a pre-flight check.

    Attributes:
        assessment: the contract's clauses.
        field_rules: the obstacle field's, where one was given.
        safety_rules: what safety needs where a clause about progress fails.
        start_rules: what the operator has to vouch for in any case.
        fence_rules: the geofence's and the fleet's, where they were given.
        fastest_mps: fastest cruise that contract and field allow; None without a field, or if no
            speed complies.
        findings: of the live check, and of what is read in its place.
        sensors: names of those of the daemon's file.
        rings: those of them that see all round.
        accept_no_progress: accept for this run that arrival is not guaranteed.
        rehearsal: of the mission in the known field, where arrival is not guaranteed; a prediction,
            which no verdict depends on.
    """

    assessment: Assessment
    field_rules: tuple[Rule, ...] = ()
    safety_rules: tuple[Rule, ...] = ()
    start_rules: tuple[Rule, ...] = ()
    fence_rules: tuple[Rule, ...] = ()
    fastest_mps: float | None = None
    findings: tuple[Finding, ...] = ()
    sensors: tuple[str, ...] = ()
    rings: tuple[str, ...] = ()
    accept_no_progress: bool = False
    rehearsal: Rehearsal | None = None

    @property
    def compliant(self) -> bool:
        """Whether contract and field comply in everything, without regard to live findings."""
        rules = (*self.field_rules, *self.fence_rules, *self.start_rules)
        return self.assessment.compliant and all(rule.holds for rule in rules)

    @property
    def safe(self) -> bool:
        """Whether contract and field comply in what safety needs."""
        if not self.assessment.terms.stop:
            return self.compliant
        clauses = self.assessment.clauses
        rules = (*self.field_rules, *self.fence_rules, *self.start_rules, *self.safety_rules)
        broken = [each.concerns for each in clauses if not each.holds]
        broken += [each.concerns for each in rules if not each.holds]
        return "safety" not in broken

    @property
    def accepted(self) -> bool:
        """Whether contract or operator accept that arrival is not guaranteed."""
        requirements = self.assessment.contract.requirements
        return self.accept_no_progress or requirements.progress == "best_effort"

    @property
    def may_fly(self) -> bool:
        """Whether contract and field permit the flight, without regard to live findings."""
        return self.compliant or (self.safe and self.accepted)

    @property
    def tier(self) -> Tier:
        """Verdict on contract, field and live findings together."""
        live = Verdict.worst(each.verdict for each in self.findings)
        if live is Verdict.BROKEN or not (self.compliant or self.safe):
            return Tier.DO_NOT_FLY
        if live is Verdict.UNKNOWN:
            return Tier.UNKNOWN
        return Tier.PROGRESS_GUARANTEED if self.compliant else Tier.SAFE

    @property
    def verdict(self) -> Verdict:
        """Whether to fly, by contract, field, acceptance and live findings together."""
        return Verdict.worst(
            [Verdict.of(holds=self.may_fly), *(each.verdict for each in self.findings)]
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
    def broken_safety_rules(self) -> tuple[Rule, ...]:
        """The broken ones of the safety rules; none counts where all clauses hold."""
        broken = tuple(rule for rule in self.safety_rules if not rule.holds)
        return () if self.compliant else broken

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons for a verdict other than that progress is guaranteed."""
        clauses = tuple(
            f"{c.name}: requires {c.required:.2f} {c.unit}, declared {c.declared:.2f} {c.unit}"
            for c in self.assessment.clauses
            if not c.holds
        )
        checked = (*self.field_rules, *self.fence_rules, *self.start_rules)
        rules = tuple(
            f"{rule.name}: {rule.reason}{preflight_report.named(rule.offenders)}"
            for rule in (*checked, *self.broken_safety_rules)
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
            "verdict": self.tier.value,
            "may_fly": self.verdict is Verdict.HOLDS,
            "accepted": self.accepted,
            "vehicle": self.vehicle,
            "compliant": self.compliant,
            "refusals": list(self.refusals),
            "contract": contract_document(self.assessment),
            "remedies": [vars(remedy) for remedy in self.remedies],
            "field": [rule.document() for rule in self.field_rules],
            "safety": [rule.document() for rule in self.safety_rules],
            "start": [rule.document() for rule in self.start_rules],
            "geofence": [rule.document() for rule in self.fence_rules],
            "fastest_compliant_speed_mps": self.fastest_mps,
            "rehearsal": None if self.rehearsal is None else self.rehearsal.document(),
            "live": [finding.document() for finding in self.findings],
        }


def check(
    contract: Contract,
    obstacles: ObstacleField | None,
    mission: Mission | None,
    input_set: InputSet = "inner",
    *,
    accept_no_progress: bool = False,
) -> Preflight:
    """Check contract, field and mission; needs no vehicle.

    Args:
        contract: the contract.
        obstacles: the field as far as it is known; None if it is not.
        mission: what is to be flown.
        input_set: ``"inner"`` (sound) or ``"paper"`` (Eq. 7 as printed).
        accept_no_progress: accept for this run that arrival is not guaranteed.
    """
    altitude_m = None if mission is None else mission.altitude_m
    assessment = assess(contract, input_set, mission_altitude_m=altitude_m)
    met = None if obstacles is None else obstacles_in_way(obstacles, contract, mission)
    rules = () if met is None else check_field(assessment, met, mission)
    if obstacles is not None and mission is not None:
        rules += (check_placement(obstacles, mission, contract.sensor.detection_range_m),)
    safety_rules = seen_free_rules(assessment, met, mission)
    start_rules = () if mission is None else words_on_movers(assessment, mission)
    return Preflight(
        assessment, rules, safety_rules, start_rules, accept_no_progress=accept_no_progress
    )


def run_preflight(
    files: PreflightFiles,
    *,
    vehicle_url: str | None,
    system_id: int | None,
    zenoh_config: Path | None,
    endurance_s: float | None,
    authorize_s: float | None,
    input_set: InputSet,
    accept_no_progress: bool = False,
    mavlink_key_file: Path | None = None,
    operator_key_file: Path | None = None,
    form: Format,
    output: Path | None,
) -> Verdict:
    """Check, write the result, return the verdict; then answer arm requests if requested.

    Raises:
        FileError: a file cannot be used.
        CommandError: no Zenoh session, or the output or the picture cannot be written.
        VehicleError: no vehicle answers whose requests to arm could be answered.
    """
    check_options(files, vehicle_url, system_id, authorize_s)
    signing_key = mavlink_key(mavlink_key_file, vehicle_url)
    keys = (signing_key, daemon_key(operator_key_file, zenoh_config))
    contract = load_contract(files.contract, files.overrides)
    obstacles = None if files.field is None else load_field(files.field)
    mission = None if files.mission is None else load_yaml(files.mission, Mission)
    result = check(contract, obstacles, mission, input_set, accept_no_progress=accept_no_progress)
    result = _with_files(result, mission, files)
    if obstacles is not None:
        met = obstacles_in_way(obstacles, contract, mission)
        result = _with_field(result, met, mission, input_set)
        if files.picture is not None:
            _draw(files.picture, result, met, mission)
    if vehicle_url is not None or zenoh_config is not None:
        targets = LiveTargets(vehicle_url, system_id, zenoh_config, endurance_s, *keys)
        findings = _check_live(result, mission, targets)
        result = replace(result, findings=(*result.findings, *findings))
    table = partial(print_preflight, result, str(files.contract))
    write_document(result.document(), table, form=form, path=output)
    if authorize_s is not None and vehicle_url is not None:
        _authorize(vehicle_url, system_id, result.verdict, authorize_s, signing_key)
    return result.verdict


def _with_field(
    result: Preflight, obstacles: ObstacleField, mission: Mission | None, input_set: InputSet
) -> Preflight:
    """Add what the obstacles in the way allow: the fastest speed, and how it may be flown."""
    contract = result.assessment.contract
    fastest_mps = fastest_speed_mps(contract, obstacles, mission, input_set)
    rehearsal = _rehearsed(result, obstacles, mission)
    return replace(result, fastest_mps=fastest_mps, rehearsal=rehearsal)


def _with_files(result: Preflight, mission: Mission | None, files: PreflightFiles) -> Preflight:
    """Add what geofence, daemon's file and saved parameters say."""
    result = replace(result, fence_rules=fence_rules(result.assessment, mission, files))
    if files.daemon is not None:
        sources = load_daemon_config(files.daemon).sources
        check_permitted(sources, result.assessment.contract, str(files.daemon))
        findings = check_sources(sources, result.assessment, mission)
        relied_on = tuple(each.name for each in sources if not only_adds_movers(each))
        rings = rings_of(sources)
        result = replace(result, findings=findings, sensors=relied_on, rings=rings)
    if files.parameters is None:
        return result
    # Loads the profiles of the autopilots.
    from gcs_tools.preflight.offline.parameter_file import check_parameter_file  # noqa: PLC0415  on use

    found = check_parameter_file(files.parameters, result.assessment, mission)
    return replace(result, findings=(*result.findings, *found))


def _authorize(
    vehicle_url: str,
    system_id: int | None,
    verdict: Verdict,
    duration_s: float,
    signing_key: bytes | None,
) -> None:
    from gcs_tools.preflight.arm_authorization import answer_arm_requests  # noqa: PLC0415  loads MAVSDK

    console = Console(stderr=True, highlight=False)
    answer_arm_requests(
        vehicle_url,
        verdict,
        duration_s,
        console.print,
        system_id=system_id,
        mavlink_key=signing_key,
    )


def _check_live(
    result: Preflight, mission: Mission | None, targets: LiveTargets
) -> tuple[Finding, ...]:
    # MAVSDK and Zenoh are large native libraries: load them only for a live check.
    from gcs_tools.preflight.live.bus import load_bus  # noqa: PLC0415  loads Zenoh
    from gcs_tools.preflight.live.check import STEPS, LiveRequest, check_live  # noqa: PLC0415  MAVSDK

    path = targets.zenoh_config
    request = LiveRequest(
        targets.vehicle_url,
        None if path is None else load_bus(path),
        targets.endurance_s,
        system_id=targets.system_id,
        sensors=result.sensors,
        rings=result.rings,
        mavlink_key=targets.mavlink_key,
        operator_key=targets.operator_key,
        # Where the contract complies, nothing has to be accepted.
        accept_no_progress=result.accept_no_progress and not result.compliant,
    )
    done = itertools.count()
    with progress_bar("checking", STEPS) as bar:
        return check_live(
            request,
            result.assessment,
            mission,
            paper_compliant=result.may_fly,
            report=lambda step: bar.show(next(done), f"checking: {step}"),
        )


def _rehearsed(
    result: Preflight, obstacles: ObstacleField, mission: Mission | None
) -> Rehearsal | None:
    """Rehearse the mission where it may be flown without a guarantee to arrive."""
    if mission is None or result.compliant or not result.safe:
        return None
    # Loads the planner for dense fields and its solver.
    from gcs_tools.preflight.rehearsal.rehearse import rehearse  # noqa: PLC0415

    return rehearse(result.assessment, obstacles, mission, confined=True)


def _draw(path: Path, result: Preflight, obstacles: ObstacleField, mission: Mission | None) -> None:
    # Matplotlib takes long to load: load it only to draw.
    from gcs_tools.preflight.picture import draw_field, draw_rehearsal  # noqa: PLC0415

    legs = legs_of(result.assessment, obstacles, mission)
    if result.rehearsal is not None:
        draw_rehearsal(legs, result.rehearsal, path)
        return
    broken = [rule.name for rule in result.field_rules if not rule.holds]
    title = f"{len(obstacles)} obstacles: " + (", ".join(broken) + " broken" if broken else "clear")
    draw_field(legs, title, path)


def print_preflight(result: Preflight, title: str, console: Console) -> None:
    """Print the verdict, then every clause, rule and finding, then the verdict again."""
    assessment = result.assessment
    if result.vehicle is not None:
        title = f"{title}, {result.vehicle}"
    preflight_report.print_title(result.tier, title, result.refusals, console)
    if any(VIRTUAL in each.name for each in result.findings):
        preflight_report.print_virtual(console)
    if result.tier is Tier.SAFE:
        preflight_report.print_acceptance(console, accepted=result.accepted)
    if not assessment.terms.stop:
        preflight_report.print_no_way_to_rest(console)
    preflight_report.print_contract(assessment, result.remedies, console)
    preflight_report.print_rules("Start", result.start_rules, console)
    if not result.compliant and result.safety_rules:
        preflight_report.print_rules(
            "Safety where arrival is not guaranteed", result.safety_rules, console
        )
    if result.field_rules:
        preflight_report.print_field(
            result.field_rules, result.fastest_mps, assessment.terms.cruise_speed_mps, console
        )
    if result.fence_rules:
        preflight_report.print_rules("Geofence", result.fence_rules, console)
    if result.rehearsal is not None:
        preflight_report.print_rehearsal(result.rehearsal.sentence(), console)
    if result.findings:
        preflight_report.print_findings(result.findings, console)
        preflight_report.print_settings(result.findings, console)
    preflight_report.print_levels(assessment, console)
    preflight_report.print_verdict(result.tier, title, len(result.refusals), console)
