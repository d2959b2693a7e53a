"""An autopilot's parameters against contract and mission, by the rules of its profile."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from gcs_tools.preflight.finding import Finding, Verdict
from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.mavlink.profiles.parameter_rules import (
    ContractDemands,
    MissionDemands,
    ParameterRule,
    ReportedParameters,
)
from onboard.mavlink.profiles.profile import ParameterFacts

# Roll that both measured autopilots use in a swerve, as a multiple of what was commanded.
TILT_RESERVE = 1.4
# Beyond this a tilt stands for no acceleration.
_TILT_MAX_RAD = math.radians(89.0)
# A plan builds its acceleration up within the attitude lag; a shorter lag counts as this.
_ATTITUDE_LAG_MIN_S = 1e-3


def check_parameters(
    facts: ParameterFacts,
    reported: ReportedParameters,
    assessment: Assessment,
    mission: Mission | None,
) -> list[Finding]:
    """Check an autopilot's parameters against a contract and a mission.

    Args:
        facts: from the autopilot's profile.
        reported: what the vehicle said.
        assessment: the contract.
        mission: whose legs the geofence must contain; None leaves the geofence unchecked.
    """
    values = reported.values
    rules = facts.rules(contract_demands(assessment), reported)
    findings = [rule_finding(rule, values) for rule in rules]
    findings += _failsafes(facts, values)
    if mission is None:
        return findings
    if mission.energy is not None and facts.energy_rules is not None:
        demanded = facts.energy_rules(mission.energy.reserve_fraction, reported)
        findings += [rule_finding(rule, values) for rule in demanded]
    if reported.complete and not any(name.startswith(facts.fence_prefixes) for name in values):
        text = "none: the complete list of parameters has no geofence"
        return [*findings, Finding("vehicle", "geofence", Verdict.HOLDS, text)]
    fence = facts.fence_rules(mission_demands(assessment, mission), reported)
    return findings + [rule_finding(rule, values) for rule in fence]


def _failsafes(facts: ParameterFacts, values: Mapping[str, float]) -> list[Finding]:
    """Say what the autopilot's failsafes do; the rules judge it."""
    texts = [each.in_words(values) for each in facts.failsafes]
    said = "; ".join(text for text in texts if text is not None)
    return [Finding("vehicle", "failsafes", Verdict.HOLDS, said)] if said else []


def rule_finding(rule: ParameterRule, parameters: Mapping[str, float]) -> Finding:
    """Check a rule against the parameters that were read from the vehicle.

    It holds if any of its alternatives does, is broken if none does, and cannot be checked if one
    that might hold is missing.  The settings that cure it are of reported parameters only; those
    that change no more than a limit come before those that change what the autopilot does.
    """
    known = [each for each in rule.alternatives if each.parameter in parameters]
    missing = _unique(each.parameter for each in rule.alternatives if each not in known)
    holding = next((each for each in known if each.holds(parameters[each.parameter])), None)
    shown = [holding.parameter] if holding else _unique(each.parameter for each in known)
    values = ", ".join(f"{each} = {parameters[each]:g}" for each in shown)
    if holding is not None:
        verdict, text, cures = Verdict.HOLDS, f"{values} ({holding.demand})", []
    else:
        cures = sorted(known, key=lambda each: not each.bounds)
        needed = " or ".join(map(str, rule.alternatives))
        verdict = Verdict.UNKNOWN if missing else Verdict.BROKEN
        absent = f"{', '.join(missing)} not reported" if missing else ""
        found = "; ".join(filter(None, (values, absent)))
        text = f"{found}; needs {needed}: {rule.reason}"
    name = (holding or rule.alternatives[0]).parameter
    settings: dict[str, float] = {}
    for each in cures:
        settings.setdefault(each.parameter, each.cured(parameters[each.parameter]))
    return Finding("vehicle", name, verdict, text, tuple(settings.items()))


def contract_demands(assessment: Assessment) -> ContractDemands:
    """Return what a contract demands of any autopilot."""
    vehicle, terms = assessment.contract.vehicle, assessment.terms
    control_rad = TILT_RESERVE * max(terms.roll_max_rad, terms.pitch_max_rad)
    wind_mps = terms.wind_max_mps
    against_wind = "" if wind_mps is None else f", and against wind of {wind_mps:g} m/s"
    return ContractDemands(
        tilt_deg=tilt_required_deg(assessment),
        tilt_reason=f"the tilt of the contract, with reserve for control{against_wind}",
        speed_mps=terms.cruise_speed_mps + terms.velocity_error_x_mps,
        acceleration_mps2=GRAVITY_MPS2 * math.tan(min(control_rad, _TILT_MAX_RAD)),
        plan_jerk_mps3=max(vars(assessment.limits).values())
        / max(terms.attitude_lag_s, _ATTITUDE_LAG_MIN_S),
        attitude_lag_s=vehicle.attitude_lag_s,
        setpoint_timeout_s=vehicle.setpoint_loss_timeout_s,
    )


def mission_demands(assessment: Assessment, mission: Mission) -> MissionDemands:
    """Return what a mission demands of the geofence."""
    height_m = mission.altitude_m + mission.climb_max_m
    return MissionDemands(reach_m(assessment, mission), height_m)


def reach_m(assessment: Assessment, mission: Mission) -> float:
    """Return how far from its start a mission may take the vehicle, avoidances included."""
    ends = [leg.end_ned_m for leg in mission.legs]
    beside_m = corridor_m(assessment, mission)
    return max(math.dist(mission.start_ned_m, at) + beside_m for at in ends)


def corridor_m(assessment: Assessment, mission: Mission) -> float:
    """Return how far beside its legs a mission may take the vehicle."""
    targets_m = (leg.target_half_width_m for leg in mission.legs)
    return max(assessment.inflated.manoeuvre_width_m / 2.0, *targets_m)


def tilt_required_deg(assessment: Assessment) -> float:
    """Return the tilt that the autopilot must allow.

    It covers roll and pitch with a reserve, both limits together, and the trim against the
    strongest wind on top of them: where the declared wind turns round, plan and trim add up.
    """
    terms = assessment.terms
    greatest_rad = max(terms.roll_max_rad, terms.pitch_max_rad)
    together = math.hypot(math.tan(terms.roll_max_rad), math.tan(terms.pitch_max_rad))
    trim = terms.drag_per_s * (terms.wind_max_mps or 0.0) / GRAVITY_MPS2
    against_wind_rad = math.atan(max(math.tan(greatest_rad) + trim, together))
    return math.degrees(max(TILT_RESERVE * greatest_rad, against_wind_rad))


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))
