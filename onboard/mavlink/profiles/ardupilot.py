"""ArduPilot Copter: modes, EKF3, and the parameters that it obeys in GUIDED.

Parameter names and units follow the lists that the project publishes for each release.  Flags and
texts are those of Copter 4.7-dev, from recordings of GPS losses and from the message definitions.
"""

from __future__ import annotations

import re
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles.parameter_rules import (
    BATTERY_LOW,
    BEFORE_FAILSAFE,
    FENCE_BREACHED,
    GROUND_STATION_LOSS,
    POSITION_LOST,
    RADIO_LOSS,
    SETPOINT_LOSS,
    WITHIN_FENCE,
    Condition,
    ContractDemands,
    Failsafe,
    MissionDemands,
    ParameterName,
    ParameterRule,
    ReportedParameters,
    at_least,
    at_most,
    bit_clear,
    bit_set,
    names_in,
    one_of,
    rules_of_renamed,
)
from onboard.mavlink.profiles.profile import (
    CONSTANT_POSITION,
    EKF_STATUS_REPORT,
    AutopilotProfile,
    EstimatorFacts,
    Firmware,
    Measured,
    Mode,
    Modes,
    ParameterFacts,
    TakeOff,
    TakeOver,
)

# COPTER_MODE of the ardupilotmega dialect.
_PREFIX: Final = "COPTER_MODE_"
_MODES: Final[dict[int, str]] = {
    number: entry.name.removeprefix(_PREFIX)
    for number, entry in mavlink.enums["COPTER_MODE"].items()
    if entry.name.startswith(_PREFIX) and not entry.name.endswith("_ENUM_END")
}

_FIRMWARE: Final = Firmware(
    Measured((4, 7), ("dev",), "4.7-dev of July 2025"), oldest=(4, 5), newest=(4, 7)
)
_KNOWN: Final = (_FIRMWARE.oldest, _FIRMWARE.newest)
# 4.7 renames; its development versions have the old names until shortly before the release.
_TILT_LIMIT: Final = (
    ParameterName("ANGLE_MAX", "cdeg", 100.0, (4, 5), (4, 7)),
    ParameterName("ATC_ANGLE_MAX", "deg", 1.0, (4, 7), (4, 7)),
)
_GUIDED_ACCELERATION: Final = (
    ParameterName("WPNAV_ACCEL", "cm/s²", 100.0, (4, 5), (4, 7)),
    ParameterName("WP_ACC", "m/s²", 1.0, (4, 7), (4, 7)),
)
# Public sources contradict each other about the new name.
_POSITION_JERK: Final = (
    ParameterName("PSC_JERK_XY", "m/s³", 1.0, (4, 5), (4, 7)),
    ParameterName("PSC_NE_JERK", "m/s³", 1.0, (4, 7), (4, 7)),
    ParameterName("PSC_JERK_NE", "m/s³", 1.0, (4, 7), (4, 7)),
)
_DEAD_RECKONING: Final = "FS_DR_ENABLE"
# Of each battery; those after the first are numbered.
_BATTERY_ACTION: Final = re.compile(r"BATT[0-9A-F]?_FS_(?:LOW|CRT)_ACT")
_CHECKS_RUN: Final = (ParameterName("ARMING_CHECK", "", 1.0, (4, 5), (4, 7)),)
_CHECKS_SKIPPED: Final = (ParameterName("ARMING_SKIPCHK", "", 1.0, (4, 7), (4, 7)),)
# Bits of both of these.
_ALL_CHECKS_BIT, _INERTIAL_CHECK_BIT = 0, 4
# Jerk that the position controller needs beyond a plan's, or tracking is metres off.
_JERK_FACTOR: Final = 2.0


def mode_name(custom_mode: int) -> str:
    """Return the name of a HEARTBEAT.custom_mode."""
    return _MODES.get(custom_mode, f"COPTER {custom_mode}")


def _rules(demands: ContractDemands, reported: ReportedParameters) -> list[ParameterRule]:
    tilt_deg, reason = demands.tilt_deg, demands.tilt_reason
    return [
        *_quantity_rules(reason, _TILT_LIMIT, reported, tilt_deg),
        ParameterRule(
            reason, (one_of("PSC_ANGLE_MAX", 0), at_least("PSC_ANGLE_MAX", tilt_deg, "deg"))
        ),
        *_quantity_rules(
            "twice the jerk of a plan, or tracking is metres off",
            _POSITION_JERK,
            reported,
            _JERK_FACTOR * demands.plan_jerk_mps3,
        ),
        *_quantity_rules(
            "the acceleration of the contract, with reserve for control",
            _GUIDED_ACCELERATION,
            reported,
            demands.acceleration_mps2,
        ),
        ParameterRule(SETPOINT_LOSS, (at_most("GUID_TIMEOUT", demands.setpoint_timeout_s, "s"),)),
        # 0 does nothing, 3 (5) lands, 7 brakes or lands; all others return.
        ParameterRule(RADIO_LOSS, (one_of("FS_THR_ENABLE", 0, 3, 7), bit_set("FS_OPTIONS", 2))),
        ParameterRule(GROUND_STATION_LOSS, (one_of("FS_GCS_ENABLE", 0, 5, 7),)),
        *_battery_rules(reported),
        *_dead_reckoning_rules(reported),
        _arming_rule(reported),
    ]


def _dead_reckoning_rules(reported: ReportedParameters) -> list[ParameterRule]:
    """Demand that it lands or does nothing where only wind and airspeed tell the position.

    Copter has this failsafe since 4.3; by default it returns.
    """
    if reported.complete and _DEAD_RECKONING not in reported.values:
        return []
    return [ParameterRule(POSITION_LOST, (one_of(_DEAD_RECKONING, 0, 1),))]


def _battery_rules(reported: ReportedParameters) -> list[ParameterRule]:
    """Demand of each battery's failsafe that it does not return: 1 lands, 7 brakes or lands."""
    actions = [name for name in sorted(reported.values) if _BATTERY_ACTION.fullmatch(name)]
    # Where none is monitored the vehicle has no such parameters.
    unmonitored = () if actions else (one_of("BATT_MONITOR", 0),)
    if not actions and not reported.complete:
        actions = ["BATT_FS_CRT_ACT", "BATT_FS_LOW_ACT"]
    return [ParameterRule(BATTERY_LOW, (one_of(name, 0, 1, 7), *unmonitored)) for name in actions]


def _energy_rules(reserve: float, reported: ReportedParameters) -> list[ParameterRule]:
    """Demand that the charges at which the failsafes of the first battery act are below it.

    The voltages at which they act (BATT_LOW_VOLT, BATT_CRT_VOLT) say nothing of a charge.
    """
    capacity_mah = reported.values.get("BATT_CAPACITY")
    if capacity_mah is None or reported.values.get("BATT_MONITOR") == 0.0:
        return []
    return [
        ParameterRule(
            BEFORE_FAILSAFE,
            (
                one_of(f"BATT_FS_{level}_ACT", 0),
                at_most(f"BATT_{level}_MAH", reserve * capacity_mah, "mAh"),
            ),
        )
        for level in ("LOW", "CRT")
    ]


def _quantity_rules(
    reason: str, names: tuple[ParameterName, ...], reported: ReportedParameters, least: float
) -> list[ParameterRule]:
    """Demand at least a quantity, in SI units (angles: degrees), under each of its names."""

    def enough(name: ParameterName) -> Condition:
        return at_least(name.name, least * name.per_unit, name.unit)

    known = names_in(names, reported.version, _KNOWN)
    return rules_of_renamed(reason, known, reported, enough)


def _arming_rule(reported: ReportedParameters) -> ParameterRule:
    """Demand that arming checks the inertial sensors; 4.7 names the checks that it skips."""
    skipped = [each.name for each in names_in(_CHECKS_SKIPPED, reported.version, _KNOWN)]
    run = [each.name for each in names_in(_CHECKS_RUN, reported.version, _KNOWN)]
    if any(name in reported.values for name in skipped):
        run = []
    elif any(name in reported.values for name in run):
        skipped = []
    alternatives = [bit_clear(name, _INERTIAL_CHECK_BIT) for name in skipped]
    for name in run:
        alternatives += [bit_set(name, _ALL_CHECKS_BIT), bit_set(name, _INERTIAL_CHECK_BIT)]
    return ParameterRule("arming must check the inertial sensors", tuple(alternatives))


def _fence_rules(demands: MissionDemands, reported: ReportedParameters) -> list[ParameterRule]:
    """Return the demands on height and circle; the ground checks polygons item by item."""
    # Since 4.6 a vehicle may switch its fence on by itself when it arms or takes off.
    by_itself = reported.values.get("FENCE_AUTOENABLE", 0.0) != 0.0
    off = () if by_itself else (one_of("FENCE_ENABLE", 0),)
    height = (bit_clear("FENCE_TYPE", 0), at_least("FENCE_ALT_MAX", demands.height_m, "m"))
    circle = (bit_clear("FENCE_TYPE", 1), at_least("FENCE_RADIUS", demands.radius_m, "m"))
    # 0 only reports, 2 lands, 4 brakes or lands; all others return.
    breached = ParameterRule(FENCE_BREACHED, (one_of("FENCE_ACTION", 0, 2, 4), *off))
    has_action = not reported.complete or "FENCE_ACTION" in reported.values
    return [
        *([breached] if has_action else []),
        ParameterRule(WITHIN_FENCE, (*off, *height)),
        ParameterRule(WITHIN_FENCE, (*off, *circle)),
    ]


_BATTERY_REACTIONS: Final = MappingProxyType(
    {
        0: "nothing",
        1: "land",
        2: "return in a straight line",
        3: "return along its track, or in a straight line",
        4: "return along its track, or land",
        5: "terminate the flight",
        6: "fly to its landing sequence, or return in a straight line",
        7: "brake, or land",
    }
)
_LINK_REACTIONS: Final = MappingProxyType(
    {
        0: "nothing",
        1: "return in a straight line",
        2: "return in a straight line",
        3: "return along its track, or in a straight line",
        4: "return along its track, or land",
        5: "land",
        6: "fly to its landing sequence, or return in a straight line",
        7: "brake, or land",
    }
)
_FAILSAFES: Final = (
    Failsafe("low battery", "BATT_FS_LOW_ACT", _BATTERY_REACTIONS),
    Failsafe("critical battery", "BATT_FS_CRT_ACT", _BATTERY_REACTIONS),
    # Of the radio's, 3 lands, and 4 and 5 are 3 and 4 of the ground station's.
    Failsafe(
        "radio lost",
        "FS_THR_ENABLE",
        MappingProxyType(
            {**_LINK_REACTIONS, 3: "land", 4: _LINK_REACTIONS[3], 5: _LINK_REACTIONS[4]}
        ),
    ),
    Failsafe("ground station lost", "FS_GCS_ENABLE", _LINK_REACTIONS),
    # Its 1 lands; the others are the battery's.
    Failsafe("position by dead reckoning only", _DEAD_RECKONING, _BATTERY_REACTIONS),
    Failsafe(
        "geofence left",
        "FENCE_ACTION",
        MappingProxyType(
            {
                0: "report",
                1: "return in a straight line, or land",
                2: "land",
                3: "return along its track, or land",
                4: "brake, or land",
                5: "return along its track, or land",
            }
        ),
    ),
)


ARDUPILOT: Final = AutopilotProfile(
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    key="ardupilot",
    name="ArduPilot",
    modes=Modes(
        mode_name,
        external_control=Mode("GUIDED", mavlink.COPTER_MODE_GUIDED),
        hold=Mode("BRAKE", mavlink.COPTER_MODE_BRAKE),
    ),
    estimator=EstimatorFacts(
        message=EKF_STATUS_REPORT,
        made_up_flags=MappingProxyType(
            {**CONSTANT_POSITION, mavlink.EKF_UNINITIALIZED: "estimator not initialized"}
        ),
        doubt_flags=MappingProxyType({mavlink.EKF_GPS_GLITCHING: "GPS glitch"}),
        # Its own failsafe acts on variances from FS_EKF_THRESH = 0.8 on.
        ratio_max=0.8,
        position_health=mavlink.MAV_SYS_STATUS_AHRS,
        texts=(
            "lane switch",
            "ekf primary changed",
            "ekf variance",
            "ekf failsafe",
            "stopped aiding",
            "dead reckoning",
            "gps glitch",
            "gps: no fix",
            "gps lost",
            "no gps",
            "bad ahrs",
            "ahrs: not healthy",
            "vibration compensation on",
        ),
    ),
    take_off=TakeOff(in_external_control=True),
    take_over=TakeOver(
        "its mode switch (LOITER), or BRAKE and LAND from the ground station",
        "take over from the ground station with BRAKE or LAND",
    ),
    # It echoes the setpoint that it took last.
    target_gain_max_per_s=0.0,
    # GUIDED integrates the last velocity and acceleration until GUID_TIMEOUT, then stops.
    after_setpoint_loss="coast",
    needs_health_request=True,
    firmware=_FIRMWARE,
    parameters=ParameterFacts(
        setpoint_timeout="GUID_TIMEOUT",
        no_radio=("FS_THR_ENABLE", 0.0),
        fence_prefixes=("FENCE_",),
        rules=_rules,
        fence_rules=_fence_rules,
        failsafes=_FAILSAFES,
        energy_rules=_energy_rules,
        fence_count="FENCE_TOTAL",
    ),
)
