"""The autopilot's parameters against the contract: only those that it obeys in OFFBOARD or GUIDED.

A rule names alternatives, for instance "no radio is listened to, or its loss is ignored, or the
answer to its loss is harmless": it holds if any of them does, is broken if none does, and cannot be
checked if one that might is missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcs_tools.preflight_finding import Finding, Verdict
from onboard.agility import GRAVITY_MPS2
from onboard.config import Mission
from onboard.contract import Assessment

# Roll used by both autopilots in a swerve, as a multiple of what was commanded.
TILT_RESERVE = 1.4
_FENCE_PREFIXES = ("GF_", "FENCE_")


@dataclass(frozen=True)
class Condition:
    """What one parameter has to be.

    Attributes:
        parameter: its name.
        holds: decides on its value.
        demand: the same in words.
    """

    parameter: str
    holds: Callable[[float], bool]
    demand: str

    def __str__(self) -> str:
        return f"{self.parameter} {self.demand}"


def at_least(parameter: str, limit: float, unit: str = "") -> Condition:
    """Return the condition that a parameter is no lower."""
    return Condition(
        parameter, lambda value: value >= limit - 1e-6, f"≥ {limit:.4g} {unit}".strip()
    )


def at_most(parameter: str, limit: float, unit: str = "") -> Condition:
    """Return the condition that a parameter is no higher."""
    return Condition(
        parameter, lambda value: value <= limit + 1e-6, f"≤ {limit:.4g} {unit}".strip()
    )


def one_of(parameter: str, *values: int) -> Condition:
    """Return the condition that a parameter has one of these values."""
    return Condition(parameter, lambda value: value in values, f"= {' or '.join(map(str, values))}")


def bit_set(parameter: str, mask: int) -> Condition:
    """Return the condition that a bit of a parameter is set."""
    return Condition(parameter, lambda value: bool(int(value) & mask), f"with bit {mask}")


def bit_clear(parameter: str, mask: int) -> Condition:
    """Return the condition that a bit of a parameter is not set."""
    return Condition(parameter, lambda value: not int(value) & mask, f"without bit {mask}")


@dataclass(frozen=True)
class ParameterRule:
    """One demand on the parameters.

    Attributes:
        reason: why.
        alternatives: any of them will do.
    """

    reason: str
    alternatives: tuple[Condition, ...]

    def finding(self, parameters: Mapping[str, float]) -> Finding:
        """Hold the rule against what was read from the vehicle."""
        known = [each for each in self.alternatives if each.parameter in parameters]
        missing = [each.parameter for each in self.alternatives if each not in known]
        holding = next((each for each in known if each.holds(parameters[each.parameter])), None)
        shown = [holding] if holding else known
        values = ", ".join(f"{each.parameter} = {parameters[each.parameter]:g}" for each in shown)
        if holding is not None:
            verdict, text = Verdict.HOLDS, f"{values} ({holding.demand})"
        else:
            needed = " or ".join(map(str, self.alternatives))
            verdict = Verdict.UNKNOWN if missing else Verdict.BROKEN
            absent = f"{', '.join(missing)} not reported" if missing else ""
            found = "; ".join(filter(None, (values, absent)))
            text = f"{found}; needs {needed}: {self.reason}"
        return Finding("vehicle", (holding or self.alternatives[0]).parameter, verdict, text)


def check_parameters(
    flavour: str,
    parameters: Mapping[str, float],
    assessment: Assessment,
    mission: Mission | None,
    *,
    complete: bool,
) -> list[Finding]:
    """Hold an autopilot's parameters against a contract and a mission.

    Args:
        flavour: ``px4`` or ``ardupilot``.
        parameters: values by name, in the autopilot's own units.
        assessment: the contract.
        mission: whose legs the geofence must contain; None leaves the geofence unchecked.
        complete: whether ``parameters`` are all that the vehicle has.
    """
    rules = _RULES[flavour](assessment)
    findings = [rule.finding(parameters) for rule in rules]
    if mission is None:
        return findings
    if complete and not any(name.startswith(_FENCE_PREFIXES) for name in parameters):
        text = "none: the complete list of parameters has no geofence"
        return [*findings, Finding("vehicle", "geofence", Verdict.HOLDS, text)]
    fence = _FENCES[flavour](reach_m(assessment, mission), mission.altitude_m + mission.climb_max_m)
    return findings + [rule.finding(parameters) for rule in fence]


def reach_m(assessment: Assessment, mission: Mission) -> float:
    """Return how far from its start a mission may take the vehicle, avoidances included."""
    ends = [leg.end_ned_m for leg in mission.legs]
    beside_m = corridor_m(assessment, mission)
    return max(math.dist(mission.start_ned_m, at) + beside_m for at in ends)


def corridor_m(assessment: Assessment, mission: Mission) -> float:
    """Return how far beside its legs a mission may take the vehicle."""
    targets_m = (leg.target_half_width_m for leg in mission.legs)
    return max(assessment.inflated.roi_width_m / 2.0, *targets_m)


def tilt_required_deg(assessment: Assessment) -> float:
    """Return the tilt that the autopilot must allow: with reserve, and at both limits together."""
    terms = assessment.terms
    greatest_rad = max(terms.roll_max_rad, terms.pitch_max_rad)
    corner_rad = math.atan(math.hypot(math.tan(terms.roll_max_rad), math.tan(terms.pitch_max_rad)))
    return math.degrees(max(TILT_RESERVE * greatest_rad, corner_rad))


def _px4_rules(assessment: Assessment) -> list[ParameterRule]:
    vehicle, terms = assessment.contract.vehicle, assessment.terms
    speed_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
    gain_per_s = 1.0 / max(vehicle.attitude_lag_s, 1e-3)
    return [
        ParameterRule(
            "the tilt of the contract, with reserve for control",
            (at_least("MPC_TILTMAX_AIR", tilt_required_deg(assessment), "deg"),),
        ),
        ParameterRule(
            "the autopilot caps the speed in every mode",
            (at_least("MPC_XY_VEL_MAX", speed_mps, "m/s"),),
        ),
        ParameterRule(
            "a lower gain takes longer than the contract's attitude lag",
            (at_least("MC_ROLL_P", gain_per_s, "1/s"),),
        ),
        ParameterRule(
            "a lower gain takes longer than the contract's attitude lag",
            (at_least("MC_PITCH_P", gain_per_s, "1/s"),),
        ),
        ParameterRule(
            "the contract's setpoint_loss_timeout_s",
            (at_most("COM_OF_LOSS_T", vehicle.setpoint_loss_timeout_s, "s"),),
        ),
        ParameterRule(
            "only 5 holds when the setpoints stop; 0 sinks to the ground without a radio",
            (one_of("COM_OBL_RC_ACT", 5),),
        ),
        ParameterRule(
            "the loss of the radio must not fly the vehicle home through obstacles",
            (
                one_of("COM_RC_IN_MODE", 4),
                one_of("NAV_RCL_ACT", 1, 3),
                bit_set("COM_RCL_EXCEPT", 4),
            ),
        ),
        ParameterRule(
            "the loss of the ground station must not fly the vehicle home through obstacles",
            (one_of("NAV_DLL_ACT", 0, 1, 3),),
        ),
    ]


def _ardupilot_rules(assessment: Assessment) -> list[ParameterRule]:
    vehicle = assessment.contract.vehicle
    tilt_deg = tilt_required_deg(assessment)
    acceleration_mps2 = GRAVITY_MPS2 * math.tan(math.radians(tilt_deg))
    limits, lag_s = assessment.limits, max(assessment.terms.attitude_lag_s, 1e-3)
    # A plan builds its acceleration up within the attitude lag.
    plan_jerk_mps3 = max(vars(limits).values()) / lag_s
    return [
        ParameterRule(
            "the tilt of the contract, with reserve for control",
            (at_least("ANGLE_MAX", 100.0 * tilt_deg, "cdeg"),),
        ),
        ParameterRule(
            "the tilt of the contract, with reserve for control",
            (one_of("PSC_ANGLE_MAX", 0), at_least("PSC_ANGLE_MAX", tilt_deg, "deg")),
        ),
        ParameterRule(
            "twice the jerk of a plan, or tracking is metres off",
            (at_least("PSC_JERK_XY", 2.0 * plan_jerk_mps3, "m/s³"),),
        ),
        ParameterRule(
            "the acceleration of the contract, with reserve for control",
            (at_least("WPNAV_ACCEL", 100.0 * acceleration_mps2, "cm/s²"),),
        ),
        ParameterRule(
            "the contract's setpoint_loss_timeout_s",
            (at_most("GUID_TIMEOUT", vehicle.setpoint_loss_timeout_s, "s"),),
        ),
        ParameterRule(
            "the loss of the radio must not fly the vehicle home through obstacles",
            (one_of("FS_THR_ENABLE", 0, 3), bit_set("FS_OPTIONS", 4)),
        ),
        ParameterRule(
            "the loss of the ground station must not fly the vehicle home through obstacles",
            (one_of("FS_GCS_ENABLE", 0, 5),),
        ),
        ParameterRule("arming without checks checks nothing", (at_least("ARMING_CHECK", 1),)),
    ]


def _px4_fence(radius_m: float, height_m: float) -> list[ParameterRule]:
    reason = "the mission must lie within the geofence"
    off = one_of("GF_ACTION", 0)
    sideways, up = "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"
    return [
        ParameterRule(reason, (off, one_of(sideways, 0), at_least(sideways, radius_m, "m"))),
        ParameterRule(reason, (off, one_of(up, 0), at_least(up, height_m, "m"))),
    ]


def _ardupilot_fence(radius_m: float, height_m: float) -> list[ParameterRule]:
    reason = "the mission must lie within the geofence"
    off = one_of("FENCE_ENABLE", 0)
    height = (bit_clear("FENCE_TYPE", 1), at_least("FENCE_ALT_MAX", height_m, "m"))
    circle = (bit_clear("FENCE_TYPE", 2), at_least("FENCE_RADIUS", radius_m, "m"))
    polygon = (bit_clear("FENCE_TYPE", 4), one_of("FENCE_TOTAL", 0))
    return [
        ParameterRule(reason, (off, *height)),
        ParameterRule(reason, (off, *circle)),
        ParameterRule("polygons are not compared with the mission", (off, *polygon)),
    ]


_RULES = {"px4": _px4_rules, "ardupilot": _ardupilot_rules}
_FENCES = {"px4": _px4_fence, "ardupilot": _ardupilot_fence}
