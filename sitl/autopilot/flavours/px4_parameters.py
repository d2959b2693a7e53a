"""PX4's parameters: names, defaults and ranges, and what they mean for a flight."""

from __future__ import annotations

import math
from typing import Any

from sitl.autopilot.flavours.parameters import GainNames, ParameterSpec, ParameterStore
from sitl.autopilot.settings import FlightSettings, Reaction

# Defaults are PX4's, except where a comment says otherwise.
PARAMETERS = (
    ParameterSpec("BAT_CRIT_THR", 0.07, 0.05, 0.5, "remaining charge: critical"),
    ParameterSpec("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "remaining charge: emergency"),
    ParameterSpec("BAT_LOW_THR", 0.15, 0.0, 0.5, "remaining charge: low"),
    ParameterSpec("COM_ARM_AUTH_ID", 10, 0, 255, "system that authorizes arming"),
    ParameterSpec("COM_ARM_AUTH_REQ", 0, 0, 1, "arming needs authorization"),
    ParameterSpec("COM_ARM_AUTH_TO", 0.4, 0.1, 5.0, "authorization unanswered to denied [s]"),
    ParameterSpec("COM_DISARM_LAND", 2.0, -1.0, 20.0, "landed to disarmed [s]; negative: never"),
    ParameterSpec("COM_DISARM_PRFLT", 10.0, -1.0, 120.0, "armed without take-off to disarmed [s]"),
    ParameterSpec("COM_DL_LOSS_T", 10, 5, 300, "ground station silent to lost [s]"),
    ParameterSpec("COM_LOW_BAT_ACT", 0, 0, 3, "low battery: 0 warn, 2 land, 3 return, then land"),
    # PX4's own default, 0, descends without remote control; 5 holds.
    ParameterSpec("COM_OBL_RC_ACT", 5, 0, 7, "after loss of offboard: 3 return, 4 land, 5 hold"),
    ParameterSpec("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "offboard setpoints missing to failsafe [s]"),
    ParameterSpec("COM_DLL_EXCEPT", 0, 0, 15, "bits: modes without ground station; not simulated"),
    ParameterSpec("COM_RCL_EXCEPT", 0, 0, 31, "bits: modes without manual control; not simulated"),
    ParameterSpec("COM_RC_IN_MODE", 3, 0, 4, "manual control: 0 radio only, 4 none, else MAVLink"),
    ParameterSpec("COM_RC_LOSS_T", 0.5, 0.0, 35.0, "manual control silent to lost [s]"),
    ParameterSpec("EKF2_HGT_REF", 1, 0, 3, "height from: 0 barometer, 1 GPS; simulated alike"),
    ParameterSpec("GF_ACTION", 2, 0, 5, "geofence: 1 warn, 2 hold, 3 return, 4 stop, 5 land"),
    ParameterSpec("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "geofence radius [m]; 0: none"),
    ParameterSpec("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "geofence height [m]; 0: none"),
    ParameterSpec("MC_PITCH_P", 6.5, 1.0, 12.0, "pitch feedback [1/s]"),
    ParameterSpec("MC_PITCHRATE_MAX", 400.0, 0.0, 1800.0, "pitch rate limit [deg/s]"),
    ParameterSpec("MC_ROLL_P", 6.5, 1.0, 12.0, "roll feedback [1/s]"),
    ParameterSpec("MC_ROLLRATE_MAX", 400.0, 0.0, 1800.0, "roll rate limit [deg/s]"),
    ParameterSpec("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "default take-off altitude [m]"),
    ParameterSpec("MPC_ACC_DOWN_MAX", 3.0, 2.0, 15.0, "autonomous acceleration downwards [m/s^2]"),
    ParameterSpec("MPC_ACC_HOR", 5.0, 2.0, 15.0, "autonomous horizontal acceleration [m/s^2]"),
    ParameterSpec("MPC_ACC_UP_MAX", 4.0, 2.0, 15.0, "autonomous acceleration upwards [m/s^2]"),
    # Higher than PX4's 4 m/s^3 so that hold brakes like the plans do.
    ParameterSpec("MPC_JERK_AUTO", 30.0, 1.0, 80.0, "autonomous jerk [m/s^3]"),
    ParameterSpec("MPC_LAND_SPEED", 0.7, 0.6, 5.0, "sink rate when landing [m/s]"),
    ParameterSpec("MPC_THR_HOVER", 0.5, 0.1, 0.8, "share of full thrust that carries the vehicle"),
    ParameterSpec("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "tilt limit in flight [deg]"),
    ParameterSpec("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "climb rate at take-off [m/s]"),
    ParameterSpec("MPC_VEL_MANUAL", 10.0, 3.0, 20.0, "speed at full stick [m/s]"),
    ParameterSpec("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "autonomous speed [m/s]"),
    ParameterSpec("MPC_XY_P", 0.95, 0.0, 2.0, "horizontal position feedback [1/s]"),
    ParameterSpec("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "speed limit in every mode [m/s]"),
    ParameterSpec("MPC_XY_VEL_P_ACC", 1.8, 1.2, 5.0, "horizontal velocity feedback [1/s]"),
    ParameterSpec("MPC_Z_V_AUTO_DN", 1.5, 0.5, 4.0, "autonomous sink rate [m/s]"),
    ParameterSpec("MPC_Z_V_AUTO_UP", 3.0, 0.5, 8.0, "autonomous climb rate [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "sink rate limit in every mode [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "climb rate limit in every mode [m/s]"),
    # Smaller than PX4's 10 m: missions among obstacles.
    ParameterSpec("NAV_ACC_RAD", 2.0, 0.05, 200.0, "waypoint acceptance radius [m]"),
    ParameterSpec(
        "NAV_DLL_ACT", 0, 0, 6, "ground station lost: 0 nothing, 1 hold, 2 return, 3 land"
    ),
    ParameterSpec("NAV_RCL_ACT", 2, 1, 6, "manual control lost: 1 hold, 2 return, 3 land"),
    ParameterSpec("RTL_RETURN_ALT", 60.0, 0.0, 150.0, "least altitude of the return [m]"),
    ParameterSpec("SYS_FAILURE_EN", 0, 0, 1, "accept MAV_CMD_INJECT_FAILURE"),
)


GAINS = GainNames("MC_ROLL_P", "MC_PITCH_P", "MPC_XY_P", "MPC_XY_VEL_P_ACC")


_LINK_LOSS = (
    Reaction.NONE,
    Reaction.HOLD,
    Reaction.RETURN,
    Reaction.LAND,
    Reaction.NONE,
    Reaction.DISARM,
    Reaction.DISARM,
)


_FENCE = (None, Reaction.NONE, Reaction.HOLD, Reaction.RETURN, Reaction.DISARM, Reaction.LAND)


_OFFBOARD_LOSS = (
    Reaction.MANUAL,
    Reaction.MANUAL,
    Reaction.MANUAL,
    Reaction.RETURN,
    Reaction.LAND,
    Reaction.HOLD,
    Reaction.DISARM,
    Reaction.DISARM,
)


def flight_settings(p: ParameterStore) -> FlightSettings:
    """Return what the parameters mean."""
    critical_reaction, emergency_reaction = _battery_reactions(int(p["COM_LOW_BAT_ACT"]))
    return FlightSettings(
        tilt_max_rad=math.radians(p["MPC_TILTMAX_AIR"]),
        body_rate_max_radps=math.radians(min(p["MC_ROLLRATE_MAX"], p["MC_PITCHRATE_MAX"])),
        roll_gain_per_s=p[GAINS.roll],
        pitch_gain_per_s=p[GAINS.pitch],
        position_gain_per_s=p[GAINS.position],
        velocity_gain_per_s=p[GAINS.velocity],
        speed_max_mps=p["MPC_XY_VEL_MAX"],
        climb_max_mps=p["MPC_Z_VEL_MAX_UP"],
        sink_max_mps=p["MPC_Z_VEL_MAX_DN"],
        cruise_speed_mps=p["MPC_XY_CRUISE"],
        climb_speed_mps=min(p["MPC_Z_V_AUTO_UP"], p["MPC_Z_VEL_MAX_UP"]),
        sink_speed_mps=min(p["MPC_Z_V_AUTO_DN"], p["MPC_Z_VEL_MAX_DN"]),
        take_off_speed_mps=p["MPC_TKO_SPEED"],
        landing_speed_mps=p["MPC_LAND_SPEED"],
        stick_speed_mps=min(p["MPC_VEL_MANUAL"], p["MPC_XY_VEL_MAX"]),
        acceleration_mps2=p["MPC_ACC_HOR"],
        acceleration_vertical_mps2=min(p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"]),
        jerk_mps3=p["MPC_JERK_AUTO"],
        take_off_height_m=p["MIS_TAKEOFF_ALT"],
        return_height_m=p["RTL_RETURN_ALT"],
        acceptance_radius_m=p["NAV_ACC_RAD"],
        setpoint_timeout_s=p["COM_OF_LOSS_T"],
        setpoint_loss=_OFFBOARD_LOSS[int(p["COM_OBL_RC_ACT"])],
        manual_timeout_s=p["COM_RC_LOSS_T"],
        manual_loss=_LINK_LOSS[int(p["NAV_RCL_ACT"])],
        manual_allowed=int(p["COM_RC_IN_MODE"]) not in {0, 4},
        ground_timeout_s=p["COM_DL_LOSS_T"],
        ground_loss=_LINK_LOSS[int(p["NAV_DLL_ACT"])],
        battery_low=p["BAT_LOW_THR"],
        battery_critical=p["BAT_CRIT_THR"],
        battery_emergency=p["BAT_EMERGEN_THR"],
        low_reaction=Reaction.NONE,
        critical_reaction=critical_reaction,
        emergency_reaction=emergency_reaction,
        disarm_landed_s=p["COM_DISARM_LAND"],
        disarm_grounded_s=p["COM_DISARM_PRFLT"],
        failure_injection=bool(p["SYS_FAILURE_EN"]),
        arm_authorizer=int(p["COM_ARM_AUTH_ID"]) if p["COM_ARM_AUTH_REQ"] else None,
        arm_authorization_timeout_s=p["COM_ARM_AUTH_TO"],
        **_fence_and_thrust(p),
    )


def _fence_and_thrust(p: ParameterStore) -> dict[str, Any]:
    """Return the settings of the fence, and the thrust at hover."""
    return {
        "hover_thrust": p["MPC_THR_HOVER"],
        "fence_reaction": _FENCE[int(p["GF_ACTION"])],
        "fence_radius_m": p["GF_MAX_HOR_DIST"] or math.inf,
        "fence_height_m": p["GF_MAX_VER_DIST"] or math.inf,
    }


def _battery_reactions(action: int) -> tuple[Reaction, Reaction]:
    """Return what follows at critical and at emergency charge, by COM_LOW_BAT_ACT."""
    lands = Reaction.LAND if action in {2, 3} else Reaction.NONE
    return Reaction.RETURN if action == 3 else lands, lands
