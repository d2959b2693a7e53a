"""The vehicle's own answers, by MAVSDK: parameters, health, link, clock, battery."""

from __future__ import annotations

from gcs_tools.doctor.diagnosis import Diagnosis
from gcs_tools.preflight.finding import Finding
from gcs_tools.preflight.live.check import LiveRequest, check_live
from gcs_tools.vehicle.survey import COUNTED
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission

_CURES = {
    "connection": "check the URL, and that the autopilot or a router sends to it",
    "health": "wait for GNSS and estimator; the ground station shows what is not ready",
    "firmware": "docs/vehicles.md says which versions were measured",
    "link delay": "shorten the link, or state its time in reaction_time_s",
    "clock": "a clock that jumps makes stamps useless; take what sets it off the link",
    "battery": "charge it, or state the hover time: clearway preflight --endurance S",
    "start": "carry the vehicle to the start of the mission, or change the mission",
    "home": "start the estimator where the vehicle stands: reboot the autopilot there",
}


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
    cure = ""
    if not finding.holds:
        cure = _CURES.get(finding.name, "docs/vehicles.md")
        if finding.name in COUNTED:
            cure = "raise this message's rate on the link, or its baud rate"
        elif finding.name.isupper() and "_" in finding.name:
            cure = f"set {finding.name} as it says, in the ground station or by `param set`"
    return Diagnosis(f"vehicle {finding.name}", finding.verdict, finding.text, cure)
