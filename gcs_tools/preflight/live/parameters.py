"""The autopilot's parameters against the contract: those that it obeys in OFFBOARD or GUIDED."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.live.conditions import (
    Condition,
    ParameterRule,
    at_least,
    at_most,
    bit_clear,
    bit_set,
    one_of,
)
from gcs_tools.preflight.live.firmware import (
    CHECKS_RUN,
    CHECKS_SKIPPED,
    GUIDED_ACCELERATION,
    POSITION_JERK,
    TILT_LIMIT,
    ParameterName,
    Version,
    names_in,
)
from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import Assessment
from onboard.files.models import Mission

# Roll used by both autopilots in a swerve, as a multiple of what was commanded.
TILT_RESERVE = 1.4
# Beyond this a tilt stands for no acceleration.
_TILT_MAX_RAD = math.radians(89.0)
_FENCE_PREFIXES = ("GF_", "FENCE_")
# Bits of ArduPilot's ARMING_CHECK and ARMING_SKIPCHK.
_ALL_CHECKS_BIT, _INERTIAL_CHECK_BIT = 0, 4


@dataclass(frozen=True)
class ReportedParameters:
    """The parameters of a vehicle as it reported them.

    Attributes:
        flavour: ``px4`` or ``ardupilot``.
        values: by name, in the autopilot's own units.
        version: of the firmware; None where it reported none.
        complete: whether ``values`` are all that the vehicle has.
    """

    flavour: str
    values: Mapping[str, float]
    version: Version | None = None
    complete: bool = True


def check_parameters(
    reported: ReportedParameters, assessment: Assessment, mission: Mission | None
) -> list[Finding]:
    """Check an autopilot's parameters against a contract and a mission.

    Args:
        reported: what the vehicle said.
        assessment: the contract.
        mission: whose legs the geofence must contain; None leaves the geofence unchecked.
    """
    values = reported.values
    findings = [rule.finding(values) for rule in _RULES[reported.flavour](assessment, reported)]
    if mission is None:
        return findings
    if reported.complete and not any(name.startswith(_FENCE_PREFIXES) for name in values):
        text = "none: the complete list of parameters has no geofence"
        return [*findings, Finding("vehicle", "geofence", Verdict.HOLDS, text)]
    height_m = mission.altitude_m + mission.climb_max_m
    fence = _FENCES[reported.flavour](reach_m(assessment, mission), height_m, values)
    return findings + [rule.finding(values) for rule in fence]


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


def _named(
    reason: str,
    names: tuple[ParameterName, ...],
    reported: ReportedParameters,
    condition: Callable[[ParameterName], Condition],
) -> list[ParameterRule]:
    """Return one rule for each name that the vehicle reports; one of all names if it has none."""
    known = names_in(names, reported.version)
    present = [[each] for each in known if each.name in reported.values]
    return [ParameterRule(reason, tuple(map(condition, group))) for group in present or [known]]


def _px4_rules(assessment: Assessment, reported: ReportedParameters) -> list[ParameterRule]:
    vehicle, terms = assessment.contract.vehicle, assessment.terms
    speed_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
    gain_per_s = 1.0 / max(vehicle.attitude_lag_s, 1e-3)
    slow = "a lower gain takes longer than the contract's attitude lag"
    return [
        ParameterRule(
            _tilt_reason(assessment),
            (at_least("MPC_TILTMAX_AIR", tilt_required_deg(assessment), "deg"),),
        ),
        ParameterRule(
            "the autopilot caps the speed in every mode",
            (at_least("MPC_XY_VEL_MAX", speed_mps, "m/s"),),
        ),
        ParameterRule(slow, (at_least("MC_ROLL_P", gain_per_s, "1/s"),)),
        ParameterRule(slow, (at_least("MC_PITCH_P", gain_per_s, "1/s"),)),
        ParameterRule(
            "the contract's setpoint_loss_timeout_s",
            (at_most("COM_OF_LOSS_T", vehicle.setpoint_loss_timeout_s, "s"),),
        ),
        ParameterRule(
            "only 5 holds when the setpoints stop; 0 sinks to the ground without a radio",
            (one_of("COM_OBL_RC_ACT", 5),),
        ),
        *_px4_link_rules(reported),
    ]


def _px4_link_rules(reported: ReportedParameters) -> list[ParameterRule]:
    # Recent releases have exceptions for the ground station too.
    ground_exception = [bit_set("COM_DLL_EXCEPT", 2)] * ("COM_DLL_EXCEPT" in reported.values)
    return [
        ParameterRule(
            "the loss of the radio must not fly the vehicle home through obstacles",
            (
                one_of("COM_RC_IN_MODE", 4),
                one_of("NAV_RCL_ACT", 1, 3),
                bit_set("COM_RCL_EXCEPT", 2),
            ),
        ),
        ParameterRule(
            "the loss of the ground station must not fly the vehicle home through obstacles",
            (one_of("NAV_DLL_ACT", 0, 1, 3), *ground_exception),
        ),
    ]


def _tilt_reason(assessment: Assessment) -> str:
    wind_mps = assessment.terms.wind_max_mps
    against_wind = "" if wind_mps is None else f", and against wind of {wind_mps:g} m/s"
    return f"the tilt of the contract, with reserve for control{against_wind}"


def _ardupilot_rules(assessment: Assessment, reported: ReportedParameters) -> list[ParameterRule]:
    tilt_deg, reason = tilt_required_deg(assessment), _tilt_reason(assessment)
    timeout_s = assessment.contract.vehicle.setpoint_loss_timeout_s
    return [
        *_named(
            reason,
            TILT_LIMIT,
            reported,
            lambda name: at_least(name.name, tilt_deg * name.per_unit, name.unit),
        ),
        ParameterRule(
            reason, (one_of("PSC_ANGLE_MAX", 0), at_least("PSC_ANGLE_MAX", tilt_deg, "deg"))
        ),
        *_ardupilot_motion_rules(assessment, reported),
        ParameterRule(
            "the contract's setpoint_loss_timeout_s", (at_most("GUID_TIMEOUT", timeout_s, "s"),)
        ),
        # 0 does nothing, 3 (5) lands, 7 brakes or lands; all others return.
        ParameterRule(
            "the loss of the radio must not fly the vehicle home through obstacles",
            (one_of("FS_THR_ENABLE", 0, 3, 7), bit_set("FS_OPTIONS", 2)),
        ),
        ParameterRule(
            "the loss of the ground station must not fly the vehicle home through obstacles",
            (one_of("FS_GCS_ENABLE", 0, 5, 7),),
        ),
        _arming_rule(reported),
    ]


def _ardupilot_motion_rules(
    assessment: Assessment, reported: ReportedParameters
) -> list[ParameterRule]:
    terms = assessment.terms
    greatest_rad = TILT_RESERVE * max(terms.roll_max_rad, terms.pitch_max_rad)
    greatest_rad = min(greatest_rad, _TILT_MAX_RAD)
    acceleration_mps2 = GRAVITY_MPS2 * math.tan(greatest_rad)
    limits, lag_s = assessment.limits, max(terms.attitude_lag_s, 1e-3)
    # A plan builds its acceleration up within the attitude lag.
    plan_jerk_mps3 = max(vars(limits).values()) / lag_s
    return [
        *_named(
            "twice the jerk of a plan, or tracking is metres off",
            POSITION_JERK,
            reported,
            lambda name: at_least(name.name, 2.0 * plan_jerk_mps3 * name.per_unit, name.unit),
        ),
        *_named(
            "the acceleration of the contract, with reserve for control",
            GUIDED_ACCELERATION,
            reported,
            lambda name: at_least(name.name, acceleration_mps2 * name.per_unit, name.unit),
        ),
    ]


def _arming_rule(reported: ReportedParameters) -> ParameterRule:
    """Return the demand that arming checks the inertial sensors; 4.7 names what it skips."""
    skipped = [each.name for each in names_in(CHECKS_SKIPPED, reported.version)]
    run = [each.name for each in names_in(CHECKS_RUN, reported.version)]
    if any(name in reported.values for name in skipped):
        run = []
    elif any(name in reported.values for name in run):
        skipped = []
    alternatives = [bit_clear(name, _INERTIAL_CHECK_BIT) for name in skipped]
    for name in run:
        alternatives += [bit_set(name, _ALL_CHECKS_BIT), bit_set(name, _INERTIAL_CHECK_BIT)]
    return ParameterRule("arming must check the inertial sensors", tuple(alternatives))


def _px4_fence(
    radius_m: float, height_m: float, _values: Mapping[str, float]
) -> list[ParameterRule]:
    reason = "the mission must lie within the geofence"
    off = one_of("GF_ACTION", 0, 1)  # 1 only warns
    sideways, up = "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"
    return [
        ParameterRule(reason, (off, one_of(sideways, 0), at_least(sideways, radius_m, "m"))),
        ParameterRule(reason, (off, one_of(up, 0), at_least(up, height_m, "m"))),
    ]


def _ardupilot_fence(
    radius_m: float, height_m: float, values: Mapping[str, float]
) -> list[ParameterRule]:
    """Return the demands on height and circle; polygons are compared item by item elsewhere."""
    reason = "the mission must lie within the geofence"
    # Since 4.6 a vehicle may switch its fence on by itself when it arms or takes off.
    by_itself = values.get("FENCE_AUTOENABLE", 0.0) != 0.0
    off = () if by_itself else (one_of("FENCE_ENABLE", 0),)
    height = (bit_clear("FENCE_TYPE", 0), at_least("FENCE_ALT_MAX", height_m, "m"))
    circle = (bit_clear("FENCE_TYPE", 1), at_least("FENCE_RADIUS", radius_m, "m"))
    return [ParameterRule(reason, (*off, *height)), ParameterRule(reason, (*off, *circle))]


_RULES = {"px4": _px4_rules, "ardupilot": _ardupilot_rules}
_FENCES = {"px4": _px4_fence, "ardupilot": _ardupilot_fence}
