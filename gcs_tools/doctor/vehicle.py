"""The vehicle's own answers, by MAVSDK: parameters, health, link, clock, battery."""

from __future__ import annotations

from gcs_tools.cures.checks import cure_of_finding
from gcs_tools.doctor.diagnosis import Diagnosis
from gcs_tools.preflight.finding import Finding
from gcs_tools.preflight.live.check import LiveRequest, check_live
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission


def diagnose_vehicle(
    url: str,
    contract: Contract,
    mission: Mission | None,
    system_id: int | None,
    mavlink_key: bytes | None = None,
) -> list[Diagnosis]:
    """Ask a vehicle everything that the pre-flight check asks; takes up to a minute.

    Raises:
        CommandError: the URL cannot be opened, or several vehicles are on it.
        Interrupted: the operator gave up.
    """
    altitude_m = None if mission is None else mission.altitude_m
    assessment = assess(contract, mission_altitude_m=altitude_m)
    request = LiveRequest(url, system_id=system_id, mavlink_key=mavlink_key)
    findings = check_live(request, assessment, mission, paper_compliant=True)
    return [diagnosis_of(each) for each in findings]


def diagnosis_of(finding: Finding) -> Diagnosis:
    """Return a finding of the pre-flight check with its cure."""
    cure = "" if finding.holds else cure_of_finding(finding.name)
    return Diagnosis(f"vehicle {finding.name}", finding.verdict, finding.text, cure)
