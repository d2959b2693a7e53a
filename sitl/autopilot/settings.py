"""What the autopilot's parameters mean for a flight, in SI units and under neutral names.

Each flavour fills these in from its own parameters; only the flavours read parameters.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass


class Reaction(enum.Enum):
    """What a failsafe does."""

    NONE = enum.auto()
    HOLD = enum.auto()
    RETURN = enum.auto()
    LAND = enum.auto()
    MANUAL = enum.auto()
    DISARM = enum.auto()


@dataclass(frozen=True)
class FlightSettings:
    """Limits, speeds, delays and failsafes.

    Attributes:
        tilt_max_rad, body_rate_max_radps: attitude limits, in every mode.
        roll_gain_per_s, pitch_gain_per_s: attitude feedback.
        position_gain_per_s, velocity_gain_per_s: horizontal feedback.
        speed_max_mps, climb_max_mps, sink_max_mps: velocity limits, in every mode.
        cruise_speed_mps, climb_speed_mps, sink_speed_mps: of the autonomous modes.
        take_off_speed_mps, landing_speed_mps: vertical speeds near the ground.
        stick_speed_mps: horizontal speed at full stick.
        acceleration_mps2, acceleration_vertical_mps2, jerk_mps3: of the autonomous modes.
        take_off_height_m: when the command does not say.
        return_height_m: least height of the return.
        acceptance_radius_m: distance at which a waypoint counts as reached.
        setpoint_timeout_s, setpoint_loss: silence of the setpoint stream, and what follows.
        manual_timeout_s, manual_loss: the same of manual control, in modes that need it.
        manual_allowed: whether MANUAL_CONTROL is accepted.
        ground_timeout_s, ground_loss: the same of the ground station's heartbeats.
        battery_low, battery_critical, battery_emergency: remaining shares.
        low_reaction, critical_reaction, emergency_reaction: what follows below them.
        disarm_landed_s, disarm_grounded_s: delay after landing, or without take-off; negative:
            never.
        failure_injection: whether MAV_CMD_INJECT_FAILURE is accepted.
        arm_authorizer: system id that must authorize arming; None if arming needs no authorization.
        arm_authorization_timeout_s: how long its answer may take.
        hover_thrust: share of full thrust that carries the vehicle, in attitude setpoints.
        fence_reaction: what follows a breach of the geofence; None if the fence is not watched.
        fence_radius_m, fence_height_m: limits from home, besides the polygons and circles.
        rally_limit_m: a return ends only at rally points within this distance.
        rally_or_home: whether a return prefers home to a rally point that is farther away.
    """

    tilt_max_rad: float
    body_rate_max_radps: float
    roll_gain_per_s: float
    pitch_gain_per_s: float
    position_gain_per_s: float
    velocity_gain_per_s: float
    speed_max_mps: float
    climb_max_mps: float
    sink_max_mps: float
    cruise_speed_mps: float
    climb_speed_mps: float
    sink_speed_mps: float
    take_off_speed_mps: float
    landing_speed_mps: float
    stick_speed_mps: float
    acceleration_mps2: float
    acceleration_vertical_mps2: float
    jerk_mps3: float
    take_off_height_m: float
    return_height_m: float
    acceptance_radius_m: float
    setpoint_timeout_s: float
    setpoint_loss: Reaction
    manual_timeout_s: float
    manual_loss: Reaction
    manual_allowed: bool
    ground_timeout_s: float
    ground_loss: Reaction
    battery_low: float
    battery_critical: float
    battery_emergency: float
    low_reaction: Reaction
    critical_reaction: Reaction
    emergency_reaction: Reaction
    disarm_landed_s: float
    disarm_grounded_s: float
    failure_injection: bool
    arm_authorizer: int | None = None
    arm_authorization_timeout_s: float = 0.0
    hover_thrust: float = 0.5
    fence_reaction: Reaction | None = None
    fence_radius_m: float = math.inf
    fence_height_m: float = math.inf
    rally_limit_m: float = math.inf
    rally_or_home: bool = True
