"""Flight controller by non-linear dynamic inversion (the idea of the paper's Ref. 14).

Each loop asks for a derivative and inverts the model to get it:

1. position: wanted velocity = feed-forward + feedback on position, limited; wanted acceleration =
   feed-forward + feedback on velocity + the trim against wind, which is what the accelerometer
   measures beyond the model's thrust and drag;
2. attitude: the thrust vector f = a - g - drag/m that gives this acceleration (tilt-limited) fixes
   the thrust axis, the wanted yaw the rest; the wanted jerk fixes the rate of the thrust axis;
3. body rates: wanted angular acceleration = feedback on attitude and rate; torque by Euler's
   equation (J alpha + omega x J omega);
4. rotors: thrust and torque -> thrust of each rotor -> rpm, with thrust for roll and pitch first,
   then lift, then yaw.

| symbol | code | meaning |
|---|---|---|
| a, j | ``acceleration_*_mps2``, ``jerk_*_mps3`` | wanted acceleration and jerk, NED |
| f | ``specific_force`` | thrust per mass, NED |
| x_b, y_b, z_b | ``x_axis_*`` ... | wanted body axes, NED |
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.plant.jit import compiled
from sitl.plant.multirotor import (
    GRAVITY_MPS2,
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
    rotate_frd_from_ned,
    rotate_ned_from_frd,
)
from sitl.plant.setpoint import Setpoint

_THRUST_MIN_MPS2 = 0.15 * GRAVITY_MPS2  # keeps the thrust axis defined and the rotors turning
_YAW_SHARE_MAX = 0.12  # of full thrust: yaw must never starve roll and pitch


class ControllerGains(NamedTuple):
    """Feedback gains and limits, most of which follow the autopilot's parameters.

    The defaults are those of an ideal controller.  A real one has lower gains (``position_per_s``
    and ``velocity_per_s`` horizontally, ``height_per_s`` and ``climb_per_s`` vertically), trims out
    disturbances more slowly, turns only a share of the wanted jerk into body rates, so that the
    attitude lags (``jerk_share``), and compensates only a share of the drag (``drag_share``).
    """

    position_per_s: float = 1.3
    velocity_per_s: float = 4.5
    height_per_s: float = 1.3
    climb_per_s: float = 4.5
    jerk_share: float = 1.0
    drag_share: float = 1.0
    trim_time_s: float = 0.3
    trim_max_mps2: float = 5.0
    roll_per_s: float = 11.0
    pitch_per_s: float = 11.0
    yaw_per_s: float = 3.0
    rate_per_s: float = 25.0
    yaw_rate_per_s: float = 8.0
    rotor_lead: float = 2.0
    tilt_max_rad: float = math.radians(45.0)
    body_rate_max_radps: float = math.radians(400.0)
    feedback_max_mps2: float = 6.0
    speed_max_mps: float = 12.0
    climb_max_mps: float = 3.0
    sink_max_mps: float = 1.5


class ControllerMemory(NamedTuple):
    """What the controller carries from step to step: the disturbance that it trims out, NED."""

    trim_north_mps2: float = 0.0
    trim_east_mps2: float = 0.0
    trim_down_mps2: float = 0.0


@compiled
def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled
def _wanted_velocity(
    setpoint: Setpoint, state: MultirotorState, gains: ControllerGains
) -> tuple[float, float, float]:
    """Velocity [m/s], NED, that closes the position error; limited; ``nan`` = not controlled."""
    north = _toward(
        setpoint.north_m, setpoint.velocity_north_mps, state.north_m, gains.position_per_s
    )
    east = _toward(setpoint.east_m, setpoint.velocity_east_mps, state.east_m, gains.position_per_s)
    down = _toward(setpoint.down_m, setpoint.velocity_down_mps, state.down_m, gains.height_per_s)
    speed = math.sqrt(north * north + east * east)
    if speed > gains.speed_max_mps:  # nan compares false: nothing to limit
        north *= gains.speed_max_mps / speed
        east *= gains.speed_max_mps / speed
    if not math.isnan(down):
        down = min(max(down, -gains.climb_max_mps), gains.sink_max_mps)
    return north, east, down


@compiled
def _toward(wanted_m: float, wanted_mps: float, actual_m: float, gain_per_s: float) -> float:
    """Velocity [m/s] of one axis: feed-forward plus correction of the position."""
    if math.isnan(wanted_m):
        return wanted_mps
    feed_forward = 0.0 if math.isnan(wanted_mps) else wanted_mps
    return feed_forward + gain_per_s * (wanted_m - actual_m)


@compiled
def _feedback(
    wanted_mps: float,
    actual_mps: float,
    trim_mps2: float,
    gain_per_s: float,
    gains: ControllerGains,
) -> float:
    """Acceleration [m/s^2] that closes the velocity error of one axis, without feed-forward."""
    if math.isnan(wanted_mps):
        return trim_mps2
    error = gain_per_s * (wanted_mps - actual_mps)
    return _clipped(error, gains.feedback_max_mps2) + trim_mps2


@compiled
def _drag_inverse(
    state: MultirotorState, parameters: MultirotorParameters, share: float
) -> tuple[float, float, float]:
    """Acceleration [m/s^2], NED, that cancels this share of the rotor drag in still air."""
    u, v, _ = rotate_frd_from_ned(
        state.qw,
        state.qx,
        state.qy,
        state.qz,
        state.velocity_north_mps,
        state.velocity_east_mps,
        state.velocity_down_mps,
    )
    turning = (state.rotor1_rpm + state.rotor2_rpm + state.rotor3_rpm + state.rotor4_rpm) / (
        4.0 * parameters.rotor_speed_max_rpm
    )
    gain = share * parameters.rotor_drag_n_per_mps * turning / parameters.mass_kg
    return rotate_ned_from_frd(state.qw, state.qx, state.qy, state.qz, gain * u, gain * v, 0.0)


@compiled
def _tilt_limited(
    north: float, east: float, down: float, tilt_max_rad: float
) -> tuple[float, float, float]:
    """Limit a thrust vector (per mass, NED) to the tilt limit: lift first, then the horizontal."""
    lift = max(-down, _THRUST_MIN_MPS2)
    horizontal = math.sqrt(north * north + east * east)
    horizontal_max = lift * math.tan(tilt_max_rad)
    scale = 1.0 if horizontal <= horizontal_max else horizontal_max / horizontal
    return scale * north, scale * east, -lift


@compiled
def _body_rates(
    state: MultirotorState,
    force_north: float,
    force_east: float,
    force_down: float,
    setpoint: Setpoint,
    gains: ControllerGains,
) -> tuple[float, float, float]:
    """Body rates [rad/s], FRD, that turn the thrust axis onto the wanted specific force."""
    force = math.sqrt(force_north**2 + force_east**2 + force_down**2)
    # z_b points against thrust; x_b is the yaw direction made perpendicular to it.
    zn, ze, zd = -force_north / force, -force_east / force, -force_down / force
    cosine, sine = math.cos(setpoint.yaw_rad), math.sin(setpoint.yaw_rad)
    yn, ye, yd = -zd * sine, zd * cosine, zn * sine - ze * cosine  # z_b x yaw direction
    norm = math.sqrt(yn * yn + ye * ye + yd * yd)
    yn, ye, yd = yn / norm, ye / norm, yd / norm
    xn, xe, xd = ye * zd - yd * ze, yd * zn - yn * zd, yn * ze - ye * zn

    # Small-angle-exact attitude error: the rotation from the body to the wanted axes, FRD.
    qw, qx, qy, qz = state.qw, state.qx, state.qy, state.qz
    zx, zy, zz = rotate_frd_from_ned(qw, qx, qy, qz, zn, ze, zd)
    tilt_error = math.atan2(math.sqrt(zx * zx + zy * zy), zz)
    stretch = tilt_error / max(math.sin(tilt_error), 1e-6)
    yx, yy, _ = rotate_frd_from_ned(qw, qx, qy, qz, yn, ye, yd)
    yaw_error = math.atan2(-yx, yy)

    # Feed-forward: j = -(df/dt) z_b - f dz_b/dt, so dz_b/dt is the part of -j/f across z_b.
    jn = gains.jerk_share * setpoint.jerk_north_mps3
    je = gains.jerk_share * setpoint.jerk_east_mps3
    jd = gains.jerk_share * setpoint.jerk_down_mps3
    roll_rate = (jn * yn + je * ye + jd * yd) / force
    pitch_rate = -(jn * xn + je * xe + jd * xd) / force
    return (
        _clipped(roll_rate - gains.roll_per_s * stretch * zy, gains.body_rate_max_radps),
        _clipped(pitch_rate + gains.pitch_per_s * stretch * zx, gains.body_rate_max_radps),
        _clipped(setpoint.yaw_rate_radps * zd + gains.yaw_per_s * yaw_error, 1.5),
    )


@compiled
def _rotor_speeds(
    thrust_n: float,
    torque_x_nm: float,
    torque_y_nm: float,
    torque_z_nm: float,
    parameters: MultirotorParameters,
) -> RotorSpeeds:
    """Invert the rotor layout; on saturation give up yaw first, then lift, then roll and pitch."""
    k_t = parameters.thrust_coefficient_n_per_rpm2
    thrust_min = k_t * parameters.rotor_speed_min_rpm**2
    thrust_max = k_t * parameters.rotor_speed_max_rpm**2
    roll = torque_x_nm / (4.0 * parameters.arm_y_m)
    pitch = torque_y_nm / (4.0 * parameters.arm_x_m)
    room = 0.5 * (thrust_max - thrust_min)
    excess = (abs(roll) + abs(pitch)) / room
    if excess > 1.0:
        roll, pitch = roll / excess, pitch / excess
    yaw = _clipped(
        torque_z_nm * k_t / (4.0 * parameters.torque_coefficient_nm_per_rpm2),
        min(_YAW_SHARE_MAX * thrust_max, max(0.0, room - abs(roll) - abs(pitch))),
    )
    reach = abs(roll) + abs(pitch) + abs(yaw)
    lift = min(max(0.25 * thrust_n, thrust_min + reach), thrust_max - reach)
    return RotorSpeeds(
        math.sqrt(max(thrust_min, lift - roll + pitch + yaw) / k_t),
        math.sqrt(max(thrust_min, lift + roll - pitch + yaw) / k_t),
        math.sqrt(max(thrust_min, lift + roll + pitch - yaw) / k_t),
        math.sqrt(max(thrust_min, lift - roll - pitch - yaw) / k_t),
    )


@compiled
def _led(
    command_rpm: float, speed_rpm: float, lead: float, parameters: MultirotorParameters
) -> float:
    """Overdrive a rotor command so that the first-order lag looks ``lead`` times faster."""
    driven = speed_rpm + lead * (command_rpm - speed_rpm)
    return min(max(driven, parameters.rotor_speed_min_rpm), parameters.rotor_speed_max_rpm)


@compiled
def _turned_onto(
    state: MultirotorState,
    force_north: float,
    force_east: float,
    force_down: float,
    setpoint: Setpoint,
    gains: ControllerGains,
    parameters: MultirotorParameters,
) -> RotorSpeeds:
    """Rotor speeds [rpm], before the lead, that turn the thrust onto a specific force [m/s^2]."""
    p, q, r = state.roll_rate_radps, state.pitch_rate_radps, state.yaw_rate_radps
    wanted_p, wanted_q, wanted_r = _body_rates(
        state, force_north, force_east, force_down, setpoint, gains
    )
    j_x, j_y, j_z = (
        parameters.inertia_x_kgm2,
        parameters.inertia_y_kgm2,
        parameters.inertia_z_kgm2,
    )
    # Thrust acts at once along the actual thrust axis only; the rest of the force needs a turn.
    _, _, along = rotate_frd_from_ned(
        state.qw, state.qx, state.qy, state.qz, force_north, force_east, force_down
    )
    return _rotor_speeds(
        parameters.mass_kg * max(-along, _THRUST_MIN_MPS2),
        j_x * gains.rate_per_s * (wanted_p - p) + (j_z - j_y) * q * r,
        j_y * gains.rate_per_s * (wanted_q - q) + (j_x - j_z) * r * p,
        j_z * gains.yaw_rate_per_s * (wanted_r - r) + (j_y - j_x) * p * q,
        parameters,
    )


@compiled
def control(
    state: MultirotorState,
    memory: ControllerMemory,
    setpoint: Setpoint,
    gains: ControllerGains,
    parameters: MultirotorParameters,
) -> RotorSpeeds:
    """Return the rotor speeds [rpm] that fly ``setpoint`` from ``state``."""
    drag_north, drag_east, drag_down = _drag_inverse(state, parameters, gains.drag_share)
    velocity_north, velocity_east, velocity_down = _wanted_velocity(setpoint, state, gains)
    gain_per_s = gains.velocity_per_s
    north = setpoint.acceleration_north_mps2 + _feedback(
        velocity_north, state.velocity_north_mps, memory.trim_north_mps2, gain_per_s, gains
    )
    east = setpoint.acceleration_east_mps2 + _feedback(
        velocity_east, state.velocity_east_mps, memory.trim_east_mps2, gain_per_s, gains
    )
    down = setpoint.acceleration_down_mps2 + _feedback(
        velocity_down, state.velocity_down_mps, memory.trim_down_mps2, gains.climb_per_s, gains
    )
    force_north, force_east, force_down = _tilt_limited(
        north + drag_north, east + drag_east, down + drag_down - GRAVITY_MPS2, gains.tilt_max_rad
    )
    command = _turned_onto(state, force_north, force_east, force_down, setpoint, gains, parameters)
    return RotorSpeeds(
        _led(command.rotor1_rpm, state.rotor1_rpm, gains.rotor_lead, parameters),
        _led(command.rotor2_rpm, state.rotor2_rpm, gains.rotor_lead, parameters),
        _led(command.rotor3_rpm, state.rotor3_rpm, gains.rotor_lead, parameters),
        _led(command.rotor4_rpm, state.rotor4_rpm, gains.rotor_lead, parameters),
    )


@compiled
def trimmed(
    memory: ControllerMemory,
    before: MultirotorState,
    after: MultirotorState,
    gains: ControllerGains,
    parameters: MultirotorParameters,
    step_s: float,
) -> ControllerMemory:
    """Follow the disturbance: measured acceleration less the one that the model explains."""
    k_t = parameters.thrust_coefficient_n_per_rpm2
    thrust = (k_t / parameters.mass_kg) * (
        before.rotor1_rpm**2 + before.rotor2_rpm**2 + before.rotor3_rpm**2 + before.rotor4_rpm**2
    )
    force_north, force_east, force_down = rotate_ned_from_frd(
        before.qw, before.qx, before.qy, before.qz, 0.0, 0.0, -thrust
    )
    drag_north, drag_east, drag_down = _drag_inverse(before, parameters, gains.drag_share)
    north = (after.velocity_north_mps - before.velocity_north_mps) / step_s
    east = (after.velocity_east_mps - before.velocity_east_mps) / step_s
    down = (after.velocity_down_mps - before.velocity_down_mps) / step_s - GRAVITY_MPS2
    share = step_s / gains.trim_time_s
    kept = 1.0 - share
    limit = gains.trim_max_mps2
    return ControllerMemory(
        _clipped(kept * memory.trim_north_mps2 + share * (force_north - drag_north - north), limit),
        _clipped(kept * memory.trim_east_mps2 + share * (force_east - drag_east - east), limit),
        _clipped(kept * memory.trim_down_mps2 + share * (force_down - drag_down - down), limit),
    )
