"""Whether the vehicle's firmware was measured, is known by its parameters only, or neither."""

from __future__ import annotations

from gcs_tools.preflight.finding import Finding, Verdict
from onboard.mavlink.profiles.parameter_rules import Version
from onboard.mavlink.profiles.profile import AutopilotProfile


def firmware_finding(profile: AutopilotProfile, version: Version | None, stage: str) -> Finding:
    """Check a firmware against those that its profile knows.

    Args:
        profile: of the autopilot.
        version: from AUTOPILOT_VERSION.
        stage: of development, from the same; empty if it states none.
    """
    if version is None:
        return Finding("vehicle", "firmware", Verdict.UNKNOWN, "no version reported")
    found = " ".join(filter(None, (profile.name, ".".join(map(str, version)), stage)))
    firmware = profile.firmware
    if firmware is None:
        text = f"{found}: no firmware of this autopilot is known"
        return Finding("vehicle", "firmware", Verdict.UNKNOWN, text)
    oldest, newest = firmware.oldest, firmware.newest
    span = f"{oldest[0]}.{oldest[1]} to {newest[0]}.{newest[1]}"
    if version[:2] < oldest:
        text = f"{found}, needs {oldest[0]}.{oldest[1]} or later"
        return Finding("vehicle", "firmware", Verdict.BROKEN, text)
    if version[:2] > newest:
        text = f"{found}: not tested, and newer than the known parameters ({span})"
        return Finding("vehicle", "firmware", Verdict.UNKNOWN, text)
    measured = firmware.measured
    if version[:2] == measured.release and stage in measured.stages:
        return Finding("vehicle", "firmware", Verdict.HOLDS, f"{found}, measured: {measured.text}")
    text = f"{found}: not tested (measured: {measured.text}), checked by the parameters of {span}"
    return Finding("vehicle", "firmware", Verdict.HOLDS, text)
