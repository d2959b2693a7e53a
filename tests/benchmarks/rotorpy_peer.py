"""RotorPy as an independent model of the same vehicle: parameters and states, there and back.

RotorPy's axes are up and to the left (z up, body x forward, y left), its rotor speeds rad/s, its
quaternions scalar-last.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rotorpy.vehicles.multirotor import Multirotor

from sitl.plant.multirotor import (
    AIR_DENSITY_KGPM3,
    GRAVITY_MPS2,
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
)

_RADPS_PER_RPM = 2.0 * math.pi / 60.0


def rotorpy_vehicle(body: MultirotorParameters) -> Any:
    """Return RotorPy's model with the properties of ours."""
    x, y = body.arm_x_m, body.arm_y_m
    speed_max = body.rotor_speed_max_rpm * _RADPS_PER_RPM
    drag = 0.5 * AIR_DENSITY_KGPM3 * body.drag_area_m2
    properties = {
        "mass": body.mass_kg,
        "Ixx": body.inertia_x_kgm2,
        "Iyy": body.inertia_y_kgm2,
        "Izz": body.inertia_z_kgm2,
        **dict.fromkeys(("Ixy", "Iyz", "Ixz"), 0.0),
        **dict.fromkeys(("c_Dx", "c_Dy", "c_Dz"), drag),
        "num_rotors": 4,
        "rotor_pos": {
            "r1": np.array([x, -y, 0.0]),
            "r2": np.array([-x, y, 0.0]),
            "r3": np.array([x, y, 0.0]),
            "r4": np.array([-x, -y, 0.0]),
        },
        # Signs of the drag torque about z up: the first two turn counter-clockwise.
        "rotor_directions": np.array([-1, -1, 1, 1]),
        "rI": np.zeros(3),
        "k_eta": body.thrust_coefficient_n_per_rpm2 / _RADPS_PER_RPM**2,
        "k_m": body.torque_coefficient_nm_per_rpm2 / _RADPS_PER_RPM**2,
        # Ours is the drag of all rotors at full speed, theirs of one per rad/s.
        "k_d": body.rotor_drag_n_per_mps / (4.0 * speed_max),
        "k_z": 0.0,
        "k_h": 0.0,
        "k_flap": 0.0,
        "tau_m": body.rotor_time_constant_s,
        "rotor_speed_min": 0.0,
        "rotor_speed_max": speed_max,
        "motor_noise_std": 0.0,
    }
    # Its wind component is a stray derivative of zero, which does not disturb the step control.
    tolerances = {"method": "RK45", "rtol": 1e-9, "atol": 1e-9}
    vehicle = Multirotor(properties, integrator_kwargs=tolerances)
    vehicle.g = GRAVITY_MPS2
    vehicle.weight = np.array([0.0, 0.0, -body.mass_kg * GRAVITY_MPS2])
    return vehicle


def rotorpy_state(state: MultirotorState) -> dict[str, Any]:
    """Return our state in RotorPy's terms."""
    return {
        "x": np.array([state.north_m, -state.east_m, -state.down_m]),
        "v": np.array(
            [state.velocity_north_mps, -state.velocity_east_mps, -state.velocity_down_mps]
        ),
        "q": np.array([state.qx, -state.qy, -state.qz, state.qw]),
        "w": np.array([state.roll_rate_radps, -state.pitch_rate_radps, -state.yaw_rate_radps]),
        "wind": np.zeros(3),
        "rotor_speeds": np.array(state[13:17]) * _RADPS_PER_RPM,
    }


def our_state(state: dict[str, Any]) -> MultirotorState:
    """Return RotorPy's state in our terms."""
    north, west, up = state["x"]
    v_north, v_west, v_up = state["v"]
    i, j, k, w = state["q"]
    p, q, r = state["w"]
    speeds = state["rotor_speeds"] / _RADPS_PER_RPM
    return MultirotorState(
        *(north, -west, -up),
        *(v_north, -v_west, -v_up),
        *(w, i, -j, -k),
        *(p, -q, -r),
        *speeds,
    )


def command(speeds: RotorSpeeds) -> dict[str, Any]:
    """Return commanded rotor speeds in RotorPy's terms."""
    return {"cmd_motor_speeds": np.array(speeds) * _RADPS_PER_RPM}
