"""ArduPilot's parameters: names, defaults and ranges, and what they mean for a flight."""

from __future__ import annotations

import math
from typing import Any

from sitl.autopilot.flavours.parameters import GainNames, ParameterSpec, ParameterStore
from sitl.autopilot.settings import FlightSettings, Reaction

# Defaults are ArduPilot's, except where a comment says otherwise.
PARAMETERS = (
    ParameterSpec("ANGLE_MAX", 3000, 1000, 8000, "tilt limit [cdeg]"),
    ParameterSpec("ARMING_CHECK", 1, 0, 0x7FFFFF, "0: arm without checks"),
    ParameterSpec("ATC_ANG_PIT_P", 4.5, 3.0, 12.0, "pitch feedback [1/s]"),
    ParameterSpec("ATC_ANG_RLL_P", 4.5, 3.0, 12.0, "roll feedback [1/s]"),
    ParameterSpec("ATC_RATE_P_MAX", 0.0, 0.0, 1080.0, "pitch rate limit [deg/s]; 0: none"),
    ParameterSpec("ATC_RATE_R_MAX", 0.0, 0.0, 1080.0, "roll rate limit [deg/s]; 0: none"),
    ParameterSpec("BATT_CAPACITY", 5000, 0, 100_000, "pack [mAh]"),
    ParameterSpec("BATT_CRT_MAH", 0.0, 0.0, 100_000.0, "remaining charge: critical [mAh]"),
    ParameterSpec("BATT_FS_CRT_ACT", 0, 0, 5, "critical battery: 1 land, 2 return, 5 terminate"),
    ParameterSpec("BATT_FS_LOW_ACT", 0, 0, 5, "low battery: 1 land, 2 return, 5 terminate"),
    ParameterSpec("BATT_LOW_MAH", 0.0, 0.0, 100_000.0, "remaining charge: low [mAh]"),
    ParameterSpec("DISARM_DELAY", 10, 0, 127, "armed on the ground to disarmed [s]; 0: never"),
    ParameterSpec("FENCE_ACTION", 1, 0, 8, "breach: 0 report, 1 return, 2 land, 4 brake"),
    ParameterSpec("FENCE_ALT_MAX", 100.0, 10.0, 1000.0, "fence height [m]"),
    ParameterSpec("FENCE_ENABLE", 0, 0, 1, "whether fences are enforced"),
    ParameterSpec("FENCE_RADIUS", 150.0, 30.0, 10000.0, "fence radius [m]"),
    ParameterSpec("FENCE_TOTAL", 0, 0, 20, "points of the fence"),
    ParameterSpec("FENCE_TYPE", 7, 0, 15, "bits: 1 height, 2 circle, 4 polygon, 8 floor"),
    ParameterSpec("FRAME_CLASS", 1, 0, 17, "1: quadrotor", read_only=True),
    ParameterSpec("FS_GCS_ENABLE", 0, 0, 7, "ground station lost: 0 nothing, 1 return, 5 land"),
    ParameterSpec("FS_GCS_TIMEOUT", 5.0, 2.0, 120.0, "ground station silent to lost [s]"),
    ParameterSpec("FS_OPTIONS", 16, 0, 255, "bits: when failsafes do not act; not simulated"),
    ParameterSpec("FS_THR_ENABLE", 1, 0, 7, "manual control lost: 0 nothing, 1 return, 3 land"),
    ParameterSpec("GUID_TIMEOUT", 3.0, 0.1, 5.0, "velocity targets missing to stop [s]"),
    ParameterSpec("LAND_SPEED", 50, 30, 200, "sink rate near the ground [cm/s]"),
    ParameterSpec("LOIT_SPEED", 1250.0, 20.0, 3500.0, "speed at full stick [cm/s]"),
    ParameterSpec(
        "PSC_ANGLE_MAX", 0.0, 0.0, 45.0, "tilt limit of autonomous flight; 0: ANGLE_MAX [deg]"
    ),
    ParameterSpec("PSC_POSXY_P", 1.0, 0.5, 4.0, "horizontal position feedback [1/s]"),
    ParameterSpec("PSC_VELXY_P", 2.0, 0.1, 6.0, "horizontal velocity feedback [1/s]"),
    ParameterSpec("PSC_JERK_XY", 5.0, 1.0, 20.0, "horizontal jerk limit [m/s^3]"),
    ParameterSpec("RALLY_INCL_HOME", 0, 0, 1, "whether a return may prefer home to a rally point"),
    ParameterSpec("RALLY_LIMIT_KM", 0.3, 0.0, 100.0, "farther rally points do not count; 0: all"),
    ParameterSpec("RTL_ALT", 1500, 30, 300_000, "least altitude of the return [cm]"),
    ParameterSpec("SCR_USER1", 0.0, -1e9, 1e9, "for scripts"),
    ParameterSpec(
        "SIM_FAILURE_EN", 0, 0, 1, "accept MAV_CMD_INJECT_FAILURE; only in this simulator"
    ),
    ParameterSpec(
        "WPNAV_ACCEL", 250.0, 50.0, 1000.0, "autonomous horizontal acceleration [cm/s^2]"
    ),
    ParameterSpec("WPNAV_ACCEL_Z", 100.0, 50.0, 500.0, "autonomous vertical acceleration [cm/s^2]"),
    ParameterSpec("WPNAV_RADIUS", 200.0, 5.0, 1000.0, "waypoint acceptance radius [cm]"),
    ParameterSpec("WPNAV_SPEED", 1000.0, 10.0, 2000.0, "autonomous speed [cm/s]"),
    ParameterSpec("WPNAV_SPEED_DN", 150.0, 10.0, 500.0, "autonomous sink rate [cm/s]"),
    ParameterSpec("WPNAV_SPEED_UP", 250.0, 10.0, 1000.0, "autonomous climb rate [cm/s]"),
)


GAINS = GainNames("ATC_ANG_RLL_P", "ATC_ANG_PIT_P", "PSC_POSXY_P", "PSC_VELXY_P")


_SPEED_MAX_MPS = 35.0  # guided mode has no limit of its own: what LOIT_SPEED allows at most
_BODY_RATE_UNLIMITED_DEGPS = 400.0
_TAKE_OFF_HEIGHT_M = 2.5
_GROUND_LOSS = {1: Reaction.RETURN, 3: Reaction.RETURN, 4: Reaction.RETURN, 5: Reaction.LAND}
_STICK_LOSS = {1: Reaction.RETURN, 3: Reaction.LAND, 4: Reaction.RETURN, 5: Reaction.RETURN}
_FENCE = {
    0: Reaction.NONE,
    2: Reaction.LAND,
    4: Reaction.HOLD,
}
_BATTERY = {
    1: Reaction.LAND,
    2: Reaction.RETURN,
    3: Reaction.RETURN,
    4: Reaction.RETURN,
    5: Reaction.DISARM,
}


def flight_settings(p: ParameterStore) -> FlightSettings:
    """Return what the parameters mean."""
    capacity_mah = max(p["BATT_CAPACITY"], 1.0)
    return FlightSettings(
        tilt_max_rad=_tilt_max_rad(p),
        body_rate_max_radps=_body_rate_max_radps(p),
        roll_gain_per_s=p[GAINS.roll],
        pitch_gain_per_s=p[GAINS.pitch],
        position_gain_per_s=p[GAINS.position],
        velocity_gain_per_s=p[GAINS.velocity],
        speed_max_mps=_SPEED_MAX_MPS,
        climb_max_mps=p["WPNAV_SPEED_UP"] / 100.0,
        sink_max_mps=p["WPNAV_SPEED_DN"] / 100.0,
        cruise_speed_mps=p["WPNAV_SPEED"] / 100.0,
        climb_speed_mps=p["WPNAV_SPEED_UP"] / 100.0,
        sink_speed_mps=p["WPNAV_SPEED_DN"] / 100.0,
        take_off_speed_mps=p["WPNAV_SPEED_UP"] / 100.0,
        landing_speed_mps=p["LAND_SPEED"] / 100.0,
        stick_speed_mps=p["LOIT_SPEED"] / 100.0,
        acceleration_mps2=p["WPNAV_ACCEL"] / 100.0,
        acceleration_vertical_mps2=p["WPNAV_ACCEL_Z"] / 100.0,
        jerk_mps3=p["PSC_JERK_XY"],
        take_off_height_m=_TAKE_OFF_HEIGHT_M,
        return_height_m=p["RTL_ALT"] / 100.0,
        acceptance_radius_m=p["WPNAV_RADIUS"] / 100.0,
        setpoint_timeout_s=p["GUID_TIMEOUT"],
        setpoint_loss=Reaction.NONE,
        manual_timeout_s=0.5,
        manual_loss=_STICK_LOSS.get(int(p["FS_THR_ENABLE"]), Reaction.NONE),
        manual_allowed=True,
        ground_timeout_s=p["FS_GCS_TIMEOUT"],
        ground_loss=_GROUND_LOSS.get(int(p["FS_GCS_ENABLE"]), Reaction.NONE),
        battery_low=p["BATT_LOW_MAH"] / capacity_mah,
        battery_critical=p["BATT_CRT_MAH"] / capacity_mah,
        battery_emergency=0.0,
        low_reaction=_BATTERY.get(int(p["BATT_FS_LOW_ACT"]), Reaction.NONE),
        critical_reaction=_BATTERY.get(int(p["BATT_FS_CRT_ACT"]), Reaction.NONE),
        emergency_reaction=Reaction.NONE,
        disarm_landed_s=0.0,
        disarm_grounded_s=p["DISARM_DELAY"] or -1.0,
        failure_injection=bool(p["SIM_FAILURE_EN"]),
        rally_limit_m=p["RALLY_LIMIT_KM"] * 1000.0 or math.inf,
        rally_or_home=bool(p["RALLY_INCL_HOME"]),
        **_fence(p),
    )


def _fence(p: ParameterStore) -> dict[str, Any]:
    """Return the settings of the fence; its polygons are watched whenever it is enabled."""
    if not p["FENCE_ENABLE"]:
        return {}
    kinds = int(p["FENCE_TYPE"])
    return {
        "fence_reaction": _FENCE.get(int(p["FENCE_ACTION"]), Reaction.RETURN),
        "fence_height_m": p["FENCE_ALT_MAX"] if kinds & 1 else math.inf,
        "fence_radius_m": p["FENCE_RADIUS"] if kinds & 2 else math.inf,
    }


def _tilt_max_rad(p: ParameterStore) -> float:
    angle_max_deg = p["ANGLE_MAX"] / 100.0
    return math.radians(min(p["PSC_ANGLE_MAX"] or angle_max_deg, angle_max_deg))


def _body_rate_max_radps(p: ParameterStore) -> float:
    limits_degps = (p["ATC_RATE_R_MAX"], p["ATC_RATE_P_MAX"])
    return math.radians(min(limit or _BODY_RATE_UNLIMITED_DEGPS for limit in limits_degps))
