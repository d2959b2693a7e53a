"""Rigid-body dynamics of a quadrotor: a pure derivative and a Runge-Kutta step.

Frames: NED (inertial, down positive) and FRD (body).  The attitude quaternion is Hamilton's,
scalar first, and turns body vectors into inertial ones (v_ned = q v_frd q*).

Model: one rigid body; four rotors in an X, thrust k_T n^2 along -z_frd and drag torque k_Q n^2,
n in rpm following its command as a first-order lag; rotor drag linear in the air-relative body
velocity across the rotor axis; parasitic drag quadratic in air speed; four legs as damped springs
with Coulomb friction.  Not modelled: gyroscopic torque and inertia of the rotors, blade flapping
moments, ground effect.

| symbol | code | meaning |
|---|---|---|
| m, J | ``mass_kg``, ``inertia_*_kgm2`` | mass, principal moments of inertia |
| k_T, k_Q | ``thrust_coefficient_n_per_rpm2``, ``torque_coefficient_nm_per_rpm2`` | rotor |
| omega = (p, q, r) | ``roll_rate_radps`` ... | body rates, FRD |
| n_i | ``rotor1_rpm`` ... | rotor speeds: front right, rear left, front left, rear right |

Rotors 1 and 2 turn counter-clockwise seen from above, so that their drag yaws the body clockwise
(+z_frd).  This is PX4's numbering of a quad X.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.plant.jit import compiled

GRAVITY_MPS2 = 9.80665
AIR_DENSITY_KGPM3 = 1.225
_SLIDING_SPEED_MPS = 0.05  # below it Coulomb friction fades out, which keeps it integrable


class MultirotorState(NamedTuple):
    """State of the body and its rotors; also the type of its time derivative.

    Position and velocity are NED, the quaternion turns FRD into NED, body rates are FRD.
    """

    north_m: float
    east_m: float
    down_m: float
    velocity_north_mps: float
    velocity_east_mps: float
    velocity_down_mps: float
    qw: float
    qx: float
    qy: float
    qz: float
    roll_rate_radps: float
    pitch_rate_radps: float
    yaw_rate_radps: float
    rotor1_rpm: float
    rotor2_rpm: float
    rotor3_rpm: float
    rotor4_rpm: float


class MultirotorParameters(NamedTuple):
    """Physical properties of the vehicle and of the ground below it."""

    mass_kg: float
    inertia_x_kgm2: float
    inertia_y_kgm2: float
    inertia_z_kgm2: float
    arm_x_m: float
    arm_y_m: float
    thrust_coefficient_n_per_rpm2: float
    torque_coefficient_nm_per_rpm2: float
    rotor_time_constant_s: float
    rotor_speed_min_rpm: float
    rotor_speed_max_rpm: float
    rotor_drag_n_per_mps: float
    drag_area_m2: float
    leg_height_m: float
    ground_stiffness_n_per_m: float
    ground_damping_ns_per_m: float
    ground_friction: float


class RotorSpeeds(NamedTuple):
    """One speed for each rotor, in the order of the module's table."""

    rotor1_rpm: float
    rotor2_rpm: float
    rotor3_rpm: float
    rotor4_rpm: float


# `RotorSpeeds` as shares of the commanded speed, of rotors without a failure.
INTACT = RotorSpeeds(1.0, 1.0, 1.0, 1.0)


class Wind(NamedTuple):
    """Velocity of the air, NED."""

    north_mps: float
    east_mps: float
    down_mps: float


def quadrotor(
    *,
    mass_kg: float = 1.5,
    thrust_to_weight: float = 2.0,
    arm_length_m: float = 0.22,
    inertia_kgm2: tuple[float, float, float] = (0.022, 0.022, 0.040),
    rotor_time_constant_s: float = 0.035,
    rotor_speed_max_rpm: float = 9000.0,
    rotor_drag_n_per_mps: float = 0.15,
    drag_area_m2: float = 0.015,
) -> MultirotorParameters:
    """Return the parameters of an X quadrotor whose full thrust is ``thrust_to_weight`` m g."""
    thrust_max_n = thrust_to_weight * mass_kg * GRAVITY_MPS2 / 4.0
    thrust_coefficient = thrust_max_n / rotor_speed_max_rpm**2
    leg_stiffness_n_per_m = 400.0 * mass_kg  # natural frequency 40 rad/s: soft beside the step
    return MultirotorParameters(
        mass_kg=mass_kg,
        inertia_x_kgm2=inertia_kgm2[0],
        inertia_y_kgm2=inertia_kgm2[1],
        inertia_z_kgm2=inertia_kgm2[2],
        arm_x_m=arm_length_m * math.sqrt(0.5),
        arm_y_m=arm_length_m * math.sqrt(0.5),
        thrust_coefficient_n_per_rpm2=thrust_coefficient,
        torque_coefficient_nm_per_rpm2=0.016 * thrust_coefficient,
        rotor_time_constant_s=rotor_time_constant_s,
        rotor_speed_min_rpm=0.1 * rotor_speed_max_rpm,
        rotor_speed_max_rpm=rotor_speed_max_rpm,
        rotor_drag_n_per_mps=rotor_drag_n_per_mps,
        drag_area_m2=drag_area_m2,
        # Standing at rest the centre of mass is at down = 0: the legs yield by their static sag.
        leg_height_m=mass_kg * GRAVITY_MPS2 / (4.0 * leg_stiffness_n_per_m),
        ground_stiffness_n_per_m=leg_stiffness_n_per_m,
        ground_damping_ns_per_m=12.0 * mass_kg,
        ground_friction=0.6,
    )


def standing_state(
    north_m: float, east_m: float, down_m: float, yaw_rad: float, rotor_speed_rpm: float = 0.0
) -> MultirotorState:
    """Return a level state at rest with all rotors at one speed."""
    return MultirotorState(
        north_m, east_m, down_m,
        0.0, 0.0, 0.0,
        math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0),
        0.0, 0.0, 0.0,
        rotor_speed_rpm, rotor_speed_rpm, rotor_speed_rpm, rotor_speed_rpm,
    )  # fmt: skip


def hover_speed_rpm(parameters: MultirotorParameters) -> float:
    """Return the rotor speed at which thrust equals weight."""
    weight_n = parameters.mass_kg * GRAVITY_MPS2
    return math.sqrt(weight_n / (4.0 * parameters.thrust_coefficient_n_per_rpm2))


@compiled
def rotate_ned_from_frd(
    qw: float, qx: float, qy: float, qz: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the FRD vector (x, y, z) in NED; the quaternion need not be exactly of unit length."""
    tx = 2.0 * (qy * z - qz * y)
    ty = 2.0 * (qz * x - qx * z)
    tz = 2.0 * (qx * y - qy * x)
    return (
        x + qw * tx + qy * tz - qz * ty,
        y + qw * ty + qz * tx - qx * tz,
        z + qw * tz + qx * ty - qy * tx,
    )


@compiled
def rotate_frd_from_ned(
    qw: float, qx: float, qy: float, qz: float, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """Return the NED vector in FRD: the inverse of :func:`rotate_ned_from_frd`."""
    return rotate_ned_from_frd(qw, -qx, -qy, -qz, north, east, down)


@compiled
def _aerodynamic_force_frd(
    state: MultirotorState, wind: Wind, parameters: MultirotorParameters
) -> tuple[float, float, float]:
    """Return rotor drag plus parasitic drag [N], FRD."""
    u, v, w = rotate_frd_from_ned(
        state.qw,
        state.qx,
        state.qy,
        state.qz,
        state.velocity_north_mps - wind.north_mps,
        state.velocity_east_mps - wind.east_mps,
        state.velocity_down_mps - wind.down_mps,
    )
    parasitic = 0.5 * AIR_DENSITY_KGPM3 * parameters.drag_area_m2 * math.sqrt(u * u + v * v + w * w)
    rotor_speed = (state.rotor1_rpm + state.rotor2_rpm + state.rotor3_rpm + state.rotor4_rpm) / (
        4.0 * parameters.rotor_speed_max_rpm
    )
    across = parasitic + parameters.rotor_drag_n_per_mps * rotor_speed
    return -across * u, -across * v, -parasitic * w


@compiled
def _ground_reaction(
    state: MultirotorState, parameters: MultirotorParameters
) -> tuple[float, float, float, float, float, float]:
    """Return force (NED) [N] and torque (FRD) [N m] of the four legs on the body."""
    force_north = force_east = force_down = 0.0
    torque_x = torque_y = torque_z = 0.0
    qw, qx, qy, qz = state.qw, state.qx, state.qy, state.qz
    for leg in range(4):
        x = parameters.arm_x_m if leg % 2 == 0 else -parameters.arm_x_m
        y = parameters.arm_y_m if leg < 2 else -parameters.arm_y_m
        z = parameters.leg_height_m
        _north, _east, down = rotate_ned_from_frd(qw, qx, qy, qz, x, y, z)
        depth = state.down_m + down
        if depth <= 0.0:
            continue
        sweep_x = state.pitch_rate_radps * z - state.yaw_rate_radps * y
        sweep_y = state.yaw_rate_radps * x - state.roll_rate_radps * z
        sweep_z = state.roll_rate_radps * y - state.pitch_rate_radps * x
        sweep_n, sweep_e, sweep_d = rotate_ned_from_frd(qw, qx, qy, qz, sweep_x, sweep_y, sweep_z)
        velocity_north = state.velocity_north_mps + sweep_n
        velocity_east = state.velocity_east_mps + sweep_e
        velocity_down = state.velocity_down_mps + sweep_d
        support = max(
            0.0,
            parameters.ground_stiffness_n_per_m * depth
            + parameters.ground_damping_ns_per_m * velocity_down,
        )
        slip = math.sqrt(velocity_north * velocity_north + velocity_east * velocity_east)
        friction = parameters.ground_friction * support / max(slip, _SLIDING_SPEED_MPS)
        leg_north, leg_east, leg_down = (
            -friction * velocity_north,
            -friction * velocity_east,
            -support,
        )
        force_north += leg_north
        force_east += leg_east
        force_down += leg_down
        fx, fy, fz = rotate_frd_from_ned(qw, qx, qy, qz, leg_north, leg_east, leg_down)
        torque_x += y * fz - z * fy
        torque_y += z * fx - x * fz
        torque_z += x * fy - y * fx
    return force_north, force_east, force_down, torque_x, torque_y, torque_z


@compiled
def _rotor_thrust_and_torque(
    state: MultirotorState, parameters: MultirotorParameters
) -> tuple[float, float, float, float]:
    """Return the total thrust [N] and the torque (FRD) [N m] of the four rotors on the body."""
    n1, n2, n3, n4 = state.rotor1_rpm, state.rotor2_rpm, state.rotor3_rpm, state.rotor4_rpm
    k_t = parameters.thrust_coefficient_n_per_rpm2
    t1, t2, t3, t4 = k_t * n1 * n1, k_t * n2 * n2, k_t * n3 * n3, k_t * n4 * n4
    return (
        t1 + t2 + t3 + t4,
        parameters.arm_y_m * (t2 + t3 - t1 - t4),
        parameters.arm_x_m * (t1 + t3 - t2 - t4),
        parameters.torque_coefficient_nm_per_rpm2 * (n1 * n1 + n2 * n2 - n3 * n3 - n4 * n4),
    )


@compiled
def derivative(
    state: MultirotorState, command: RotorSpeeds, wind: Wind, parameters: MultirotorParameters
) -> MultirotorState:
    """Time derivative of ``state`` under commanded rotor speeds [rpm] and wind (Newton-Euler)."""
    p, q, r = state.roll_rate_radps, state.pitch_rate_radps, state.yaw_rate_radps
    qw, qx, qy, qz = state.qw, state.qx, state.qy, state.qz
    thrust, torque_x, torque_y, torque_z = _rotor_thrust_and_torque(state, parameters)
    drag_x, drag_y, drag_z = _aerodynamic_force_frd(state, wind, parameters)
    force_north, force_east, force_down = rotate_ned_from_frd(
        qw, qx, qy, qz, drag_x, drag_y, drag_z - thrust
    )

    # Far above the reach of a leg at any attitude there is nothing to compute.
    if state.down_m > -(parameters.arm_x_m + parameters.arm_y_m + parameters.leg_height_m):
        ground = _ground_reaction(state, parameters)
        force_north += ground[0]
        force_east += ground[1]
        force_down += ground[2]
        torque_x += ground[3]
        torque_y += ground[4]
        torque_z += ground[5]

    j_x = parameters.inertia_x_kgm2
    j_y = parameters.inertia_y_kgm2
    j_z = parameters.inertia_z_kgm2
    lag = 1.0 / parameters.rotor_time_constant_s
    return MultirotorState(
        state.velocity_north_mps,
        state.velocity_east_mps,
        state.velocity_down_mps,
        force_north / parameters.mass_kg,
        force_east / parameters.mass_kg,
        force_down / parameters.mass_kg + GRAVITY_MPS2,
        0.5 * (-qx * p - qy * q - qz * r),
        0.5 * (qw * p + qy * r - qz * q),
        0.5 * (qw * q + qz * p - qx * r),
        0.5 * (qw * r + qx * q - qy * p),
        (torque_x + (j_y - j_z) * q * r) / j_x,
        (torque_y + (j_z - j_x) * r * p) / j_y,
        (torque_z + (j_x - j_y) * p * q) / j_z,
        lag * (command.rotor1_rpm - state.rotor1_rpm),
        lag * (command.rotor2_rpm - state.rotor2_rpm),
        lag * (command.rotor3_rpm - state.rotor3_rpm),
        lag * (command.rotor4_rpm - state.rotor4_rpm),
    )


@compiled
def _moved(state: MultirotorState, rate: MultirotorState, time_s: float) -> MultirotorState:
    """``state + time_s * rate``, element by element."""
    return MultirotorState(
        state.north_m + time_s * rate.north_m,
        state.east_m + time_s * rate.east_m,
        state.down_m + time_s * rate.down_m,
        state.velocity_north_mps + time_s * rate.velocity_north_mps,
        state.velocity_east_mps + time_s * rate.velocity_east_mps,
        state.velocity_down_mps + time_s * rate.velocity_down_mps,
        state.qw + time_s * rate.qw,
        state.qx + time_s * rate.qx,
        state.qy + time_s * rate.qy,
        state.qz + time_s * rate.qz,
        state.roll_rate_radps + time_s * rate.roll_rate_radps,
        state.pitch_rate_radps + time_s * rate.pitch_rate_radps,
        state.yaw_rate_radps + time_s * rate.yaw_rate_radps,
        state.rotor1_rpm + time_s * rate.rotor1_rpm,
        state.rotor2_rpm + time_s * rate.rotor2_rpm,
        state.rotor3_rpm + time_s * rate.rotor3_rpm,
        state.rotor4_rpm + time_s * rate.rotor4_rpm,
    )


@compiled
def _normalized(state: MultirotorState) -> MultirotorState:
    """Return ``state`` with its quaternion scaled back to unit length."""
    qw, qx, qy, qz = state.qw, state.qx, state.qy, state.qz
    scale = 1.0 / math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    return MultirotorState(
        state.north_m,
        state.east_m,
        state.down_m,
        state.velocity_north_mps,
        state.velocity_east_mps,
        state.velocity_down_mps,
        scale * qw,
        scale * qx,
        scale * qy,
        scale * qz,
        state.roll_rate_radps,
        state.pitch_rate_radps,
        state.yaw_rate_radps,
        state.rotor1_rpm,
        state.rotor2_rpm,
        state.rotor3_rpm,
        state.rotor4_rpm,
    )


@compiled
def step(
    state: MultirotorState,
    command: RotorSpeeds,
    wind: Wind,
    parameters: MultirotorParameters,
    step_s: float,
) -> MultirotorState:
    """Advance by ``step_s`` with the classical fourth-order Runge-Kutta rule.

    Commands must be within the rotors' speed range; the controller saturates them.
    """
    k1 = derivative(state, command, wind, parameters)
    k2 = derivative(_moved(state, k1, 0.5 * step_s), command, wind, parameters)
    k3 = derivative(_moved(state, k2, 0.5 * step_s), command, wind, parameters)
    k4 = derivative(_moved(state, k3, step_s), command, wind, parameters)
    end = _moved(state, k1, step_s / 6.0)
    end = _moved(end, k2, step_s / 3.0)
    end = _moved(end, k3, step_s / 3.0)
    return _normalized(_moved(end, k4, step_s / 6.0))
