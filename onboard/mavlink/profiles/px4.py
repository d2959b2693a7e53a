"""PX4: modes of its commander, EKF2, and the parameters that it obeys in OFFBOARD.

Parameter names and units follow the lists that the project publishes for each release.  Flags and
texts are those of PX4 1.15, from recordings of GPS losses and from the message definitions.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles.parameter_rules import (
    BATTERY_LOW,
    BEFORE_FAILSAFE,
    FENCE_BREACHED,
    FLIGHT_TIME_OVER,
    GROUND_STATION_LOSS,
    RADIO_LOSS,
    SETPOINT_LOSS,
    WIND_TOO_STRONG,
    WITHIN_FENCE,
    Condition,
    ContractDemands,
    Failsafe,
    MissionDemands,
    ParameterRule,
    ReportedParameters,
    at_least,
    at_most,
    bit_set,
    one_of,
)
from onboard.mavlink.profiles.profile import (
    CONSTANT_POSITION,
    ESTIMATOR_STATUS,
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

# HEARTBEAT.custom_mode: main mode in the third byte, sub mode of AUTO in the fourth.
_MAIN_MODES: Final = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
}
_AUTO_MODES: Final = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND"}

# Greatest gain from position error to velocity that PX4 accepts: MPC_XY_P (default 0.95), MPC_Z_P.
GAIN_MAX_PER_S: Final = 2.0
# COM_RC_IN_MODE: stick input disabled.
_NO_STICKS: Final = ("COM_RC_IN_MODE", 4.0)
_BATTERY_ACTION: Final = "COM_LOW_BAT_ACT"
_ATTITUDE_LAG_MIN_S: Final = 1e-3


def mode_name(custom_mode: int) -> str:
    """Return the name of a HEARTBEAT.custom_mode."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    name = _MAIN_MODES.get(main, f"PX4 {main}")
    return _AUTO_MODES.get(sub, f"AUTO {sub}") if name == "AUTO" else name


def _rules(demands: ContractDemands, reported: ReportedParameters) -> list[ParameterRule]:
    gain_per_s = 1.0 / max(demands.attitude_lag_s, _ATTITUDE_LAG_MIN_S)
    slow = "a lower gain takes longer than the contract's attitude lag"
    timeout_s = demands.setpoint_timeout_s
    return [
        ParameterRule(demands.tilt_reason, (at_least("MPC_TILTMAX_AIR", demands.tilt_deg, "deg"),)),
        ParameterRule(
            "the autopilot caps the speed in every mode",
            (at_least("MPC_XY_VEL_MAX", demands.speed_mps, "m/s"),),
        ),
        ParameterRule(slow, (at_least("MC_ROLL_P", gain_per_s, "1/s"),)),
        ParameterRule(slow, (at_least("MC_PITCH_P", gain_per_s, "1/s"),)),
        ParameterRule(SETPOINT_LOSS, (at_most("COM_OF_LOSS_T", timeout_s, "s"),)),
        ParameterRule(
            "only 5 holds when the setpoints stop; 0 sinks to the ground without a radio",
            (one_of("COM_OBL_RC_ACT", 5),),
        ),
        *_link_rules(reported),
    ]


def _link_rules(reported: ReportedParameters) -> list[ParameterRule]:
    # Recent releases have exceptions for the ground station too.
    ground_exception = [bit_set("COM_DLL_EXCEPT", 2)] * ("COM_DLL_EXCEPT" in reported.values)
    return [
        ParameterRule(
            RADIO_LOSS,
            (
                one_of(_NO_STICKS[0], int(_NO_STICKS[1])),
                one_of("NAV_RCL_ACT", 1, 3),
                bit_set("COM_RCL_EXCEPT", 2),
            ),
        ),
        ParameterRule(GROUND_STATION_LOSS, (one_of("NAV_DLL_ACT", 0, 1, 3), *ground_exception)),
        *_rule_if_known(BATTERY_LOW, one_of(_BATTERY_ACTION, 0, 2), reported),
        # By default it returns when the charge just suffices for a straight way home.
        *_rule_if_known(BATTERY_LOW, one_of("COM_FLTT_LOW_ACT", 0, 1), reported),
        *_rule_if_known(FLIGHT_TIME_OVER, at_most("COM_FLT_TIME_MAX", 0.0, "s"), reported),
        *_wind_rules(reported),
    ]


def _wind_rules(reported: ReportedParameters) -> list[ParameterRule]:
    action = "COM_WIND_MAX_ACT"
    if action not in reported.values:
        return _rule_if_known(WIND_TOO_STRONG, one_of(action, 0, 1, 2, 5), reported)
    harmless = (one_of(action, 0, 1, 2, 5), at_most("COM_WIND_MAX", 0.0, "m/s"))
    return [ParameterRule(WIND_TOO_STRONG, harmless)]


def _rule_if_known(
    reason: str, condition: Condition, reported: ReportedParameters
) -> list[ParameterRule]:
    """Demand it, unless the complete list shows that the vehicle has no such failsafe."""
    absent = reported.complete and condition.parameter not in reported.values
    return [] if absent else [ParameterRule(reason, (condition,))]


def _energy_rules(reserve: float, _: ReportedParameters) -> list[ParameterRule]:
    silent = one_of(_BATTERY_ACTION, 0)
    return [ParameterRule(BEFORE_FAILSAFE, (silent, at_most("BAT_CRIT_THR", reserve)))]


def _fence_rules(demands: MissionDemands, reported: ReportedParameters) -> list[ParameterRule]:
    off = one_of("GF_ACTION", 0, 1)  # 1 only warns
    limits = {"GF_MAX_HOR_DIST": demands.radius_m, "GF_MAX_VER_DIST": demands.height_m}
    within = [
        ParameterRule(WITHIN_FENCE, (off, one_of(name, 0), at_least(name, limit_m, "m")))
        for name, limit_m in limits.items()
    ]
    breached = one_of("GF_ACTION", 0, 1, 2, 5)
    return [*_rule_if_known(FENCE_BREACHED, breached, reported), *within]


_LINK_REACTIONS: Final = MappingProxyType(
    {
        0: "nothing",
        1: "hold",
        2: "return in a straight line",
        3: "land",
        5: "terminate the flight",
        6: "disarm",
    }
)
# Of the geofence and of the wind's limit.
_LIMIT_REACTIONS: Final = MappingProxyType(
    {
        0: "nothing",
        1: "warn",
        2: "hold",
        3: "return in a straight line",
        4: "terminate the flight",
        5: "land",
    }
)
_FAILSAFES: Final = (
    Failsafe(
        "low battery",
        _BATTERY_ACTION,
        MappingProxyType(
            {
                0: "warn",
                1: "return in a straight line",
                2: "land when critical (BAT_CRIT_THR)",
                3: "return in a straight line when critical (BAT_CRIT_THR)",
            }
        ),
    ),
    Failsafe(
        "charge for the way home only",
        "COM_FLTT_LOW_ACT",
        MappingProxyType({0: "nothing", 1: "warn", 3: "return in a straight line"}),
    ),
    Failsafe("radio lost", "NAV_RCL_ACT", _LINK_REACTIONS),
    Failsafe("ground station lost", "NAV_DLL_ACT", _LINK_REACTIONS),
    Failsafe("geofence left", "GF_ACTION", _LIMIT_REACTIONS),
    Failsafe("strong wind", "COM_WIND_MAX_ACT", _LIMIT_REACTIONS),
)


PX4: Final = AutopilotProfile(
    autopilot=mavlink.MAV_AUTOPILOT_PX4,
    key="px4",
    name="PX4",
    modes=Modes(mode_name, external_control=Mode("OFFBOARD", 6), hold=Mode("LOITER", 4, 3)),
    estimator=EstimatorFacts(
        message=ESTIMATOR_STATUS,
        made_up_flags=CONSTANT_POSITION,
        doubt_flags=MappingProxyType(
            {
                mavlink.ESTIMATOR_GPS_GLITCH: "GPS glitch",
                mavlink.ESTIMATOR_ACCEL_ERROR: "accelerometer error",
            }
        ),
        # Test ratios of 1 and more mean that measurements are rejected.
        ratio_max=1.0,
        # PX4 reports its local position estimate under this bit.
        position_health=mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
        texts=(
            "gps fix lost",
            "gnss fix lost",
            "gps lost",
            "gps fusion timeout",
            "stopped gps fusion",
            "dead reckoning",
            "dead-reckoning",
            "position estimate invalid",
            "position lost",
            "navigation failure",
            "estimator failure",
            "switched to backup estimator",
            "primary ekf changed",
        ),
        constant_at_rest=True,
    ),
    take_off=TakeOff(height_parameter="MIS_TAKEOFF_ALT"),
    take_over=TakeOver(
        "its mode switch (POSCTL), or HOLD and LAND from the ground station",
        "PX4 refuses POSCTL then: take over from the ground station with HOLD or LAND",
        sticks_ignored=_NO_STICKS,
    ),
    target_gain_max_per_s=GAIN_MAX_PER_S,
    # PositionControl.cpp goes on tracking the last position, velocity and acceleration.
    after_setpoint_loss="frozen",
    firmware=Firmware(
        Measured((1, 16), ("dev", "alpha"), "main of February 2025"), oldest=(1, 14), newest=(1, 18)
    ),
    parameters=ParameterFacts(
        setpoint_timeout="COM_OF_LOSS_T",
        no_radio=_NO_STICKS,
        fence_prefixes=("GF_",),
        rules=_rules,
        fence_rules=_fence_rules,
        failsafes=_FAILSAFES,
        energy_rules=_energy_rules,
    ),
)
