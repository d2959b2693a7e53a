from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.plant.multirotor import (
    AIR_DENSITY_KGPM3,
    GRAVITY_MPS2,
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
    Wind,
    derivative,
    hover_speed_rpm,
    quadrotor,
    rotate_frd_from_ned,
    rotate_ned_from_frd,
    standing_state,
    step,
)

STILL = Wind(0.0, 0.0, 0.0)
OFF = RotorSpeeds(0.0, 0.0, 0.0, 0.0)
STEP_S = 1.0 / 400.0
HIGH_DOWN_M = -1000.0

VACUUM = quadrotor(rotor_drag_n_per_mps=0.0, drag_area_m2=0.0)


def fly(
    state: MultirotorState,
    command: RotorSpeeds,
    time_s: float,
    *,
    parameters: MultirotorParameters = VACUUM,
    wind: Wind = STILL,
    step_s: float = STEP_S,
) -> MultirotorState:
    for _ in range(round(time_s / step_s)):
        state = step(state, command, wind, parameters, step_s)
    return state


def all_rotors(speed_rpm: float) -> RotorSpeeds:
    return RotorSpeeds(speed_rpm, speed_rpm, speed_rpm, speed_rpm)


def tumbling() -> MultirotorState:
    state = standing_state(0.0, 0.0, HIGH_DOWN_M, 0.3)
    return state._replace(
        velocity_north_mps=1.0, roll_rate_radps=4.0, pitch_rate_radps=-3.0, yaw_rate_radps=2.0
    )


def test_free_fall_follows_gravity_alone() -> None:
    state = fly(standing_state(0.0, 0.0, HIGH_DOWN_M, 0.0), OFF, 2.0)
    assert state.down_m - HIGH_DOWN_M == pytest.approx(GRAVITY_MPS2 * 2.0, rel=1e-12)
    assert state.velocity_down_mps == pytest.approx(GRAVITY_MPS2 * 2.0, rel=1e-12)
    assert (state.north_m, state.east_m) == (0.0, 0.0)


def test_fall_ends_at_the_terminal_velocity_of_its_drag_area() -> None:
    parameters = quadrotor(drag_area_m2=0.05)
    state = fly(standing_state(0.0, 0.0, -5000.0, 0.0), OFF, 60.0, parameters=parameters)
    weight_n = parameters.mass_kg * GRAVITY_MPS2
    terminal_mps = math.sqrt(2.0 * weight_n / (AIR_DENSITY_KGPM3 * 0.05))
    assert state.velocity_down_mps == pytest.approx(terminal_mps, rel=1e-3)


def test_hover_speed_balances_weight() -> None:
    speed_rpm = hover_speed_rpm(VACUUM)
    start = standing_state(1.0, 2.0, -10.0, 0.5, speed_rpm)
    state = fly(start, all_rotors(speed_rpm), 5.0)
    assert state == pytest.approx(start, abs=1e-9)


def test_full_thrust_gives_the_configured_thrust_to_weight() -> None:
    parameters = quadrotor(thrust_to_weight=2.0, rotor_drag_n_per_mps=0.0, drag_area_m2=0.0)
    full_rpm = parameters.rotor_speed_max_rpm
    state = standing_state(0.0, 0.0, HIGH_DOWN_M, 0.0, full_rpm)
    rate = derivative(state, all_rotors(full_rpm), STILL, parameters)
    assert rate.velocity_down_mps == pytest.approx(-GRAVITY_MPS2)


@pytest.mark.parametrize(
    ("faster", "roll", "pitch", "yaw"),
    [
        ((0, 3), -1, 0, 0),  # right rotors: left roll
        ((1, 2), 1, 0, 0),
        ((0, 2), 0, 1, 0),  # front rotors: nose up
        ((1, 3), 0, -1, 0),
        ((0, 1), 0, 0, 1),  # counter-clockwise rotors: the body turns clockwise
        ((2, 3), 0, 0, -1),
    ],
)
def test_rotor_layout(faster: tuple[int, int], roll: int, pitch: int, yaw: int) -> None:
    speeds = [5000.0 + (100.0 if rotor in faster else 0.0) for rotor in range(4)]
    state = standing_state(0.0, 0.0, HIGH_DOWN_M, 0.0)._replace(
        rotor1_rpm=speeds[0], rotor2_rpm=speeds[1], rotor3_rpm=speeds[2], rotor4_rpm=speeds[3]
    )
    rate = derivative(state, OFF, STILL, VACUUM)
    turned = (rate.roll_rate_radps, rate.pitch_rate_radps, rate.yaw_rate_radps)
    assert tuple(round(value, 9) and math.copysign(1, value) for value in turned) == (
        roll,
        pitch,
        yaw,
    )


def test_rotor_speed_follows_its_command_as_a_first_order_lag() -> None:
    start = standing_state(0.0, 0.0, HIGH_DOWN_M, 0.0, 4000.0)
    state = fly(start, all_rotors(5000.0), 0.07, step_s=0.0025)
    assert state.rotor1_rpm == pytest.approx(5000.0 - 1000.0 * math.exp(-0.07 / 0.035), rel=1e-6)


def test_torque_free_tumbling_keeps_energy_and_angular_momentum() -> None:
    start = tumbling()
    state = fly(start, OFF, 5.0)
    energy_j, momentum = rotation_invariants(state)
    energy_start_j, momentum_start = rotation_invariants(start)
    assert energy_j == pytest.approx(energy_start_j, rel=1e-6)
    assert momentum == pytest.approx(
        momentum_start, abs=1e-6 * float(np.linalg.norm(momentum_start))
    )
    assert math.hypot(*state[6:10]) == pytest.approx(1.0, abs=1e-12)


def rotation_invariants(state: MultirotorState) -> tuple[float, np.ndarray]:
    """Kinetic energy [J] of rotation and angular momentum, NED, from first principles."""
    inertia = np.diag([VACUUM.inertia_x_kgm2, VACUUM.inertia_y_kgm2, VACUUM.inertia_z_kgm2])
    rates = np.array(state[10:13])
    momentum_frd = inertia @ rates
    return float(rates @ momentum_frd / 2.0), rotation_matrix(*state[6:10]) @ momentum_frd


def rotation_matrix(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Textbook matrix of a unit quaternion, independent of the code under test."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_runge_kutta_converges_with_the_fourth_order() -> None:
    command = RotorSpeeds(5200.0, 4900.0, 5000.0, 5100.0)
    exact = np.array(fly(tumbling(), command, 0.4, step_s=0.4 / 3200))
    errors = [
        np.linalg.norm(np.array(fly(tumbling(), command, 0.4, step_s=0.4 / steps)) - exact)
        for steps in (25, 50, 100)
    ]
    orders = [math.log2(errors[i] / errors[i + 1]) for i in range(2)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.3)


components = st.floats(-1.0, 1.0)


@given(
    st.tuples(components, components, components, components).filter(
        lambda q: math.hypot(*q) > 0.1
    ),
    st.tuples(components, components, components),
)
@settings(max_examples=200)
def test_rotations_agree_with_the_matrix_and_invert_each_other(
    quaternion: tuple[float, float, float, float], vector: tuple[float, float, float]
) -> None:
    norm = math.hypot(*quaternion)
    w, x, y, z = (component / norm for component in quaternion)
    rotated = rotate_ned_from_frd(w, x, y, z, *vector)
    assert rotated == pytest.approx(rotation_matrix(w, x, y, z) @ np.array(vector), abs=1e-12)
    assert rotate_frd_from_ned(w, x, y, z, *rotated) == pytest.approx(vector, abs=1e-12)


def test_wind_drags_the_vehicle_along() -> None:
    parameters = quadrotor()
    speed_rpm = hover_speed_rpm(parameters)
    start = standing_state(0.0, 0.0, HIGH_DOWN_M, 0.7, speed_rpm)
    state = fly(
        start, all_rotors(speed_rpm), 60.0, parameters=parameters, wind=Wind(2.0, -3.0, 0.0)
    )
    assert state.velocity_north_mps == pytest.approx(2.0, abs=0.05)
    assert state.velocity_east_mps == pytest.approx(-3.0, abs=0.05)


def test_the_ground_carries_a_dropped_vehicle() -> None:
    tilted = standing_state(3.0, 4.0, -0.5, 0.0)._replace(
        qw=math.cos(0.1), qx=math.sin(0.1), velocity_north_mps=1.0
    )
    state = fly(tilted, OFF, 4.0)
    assert state.down_m == pytest.approx(0.0, abs=1e-3)
    assert state[3:6] == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert abs(state.qx) < 1e-3
    assert 3.0 < state.north_m < 4.0  # it slid, and friction stopped it


INTERPRETED = """
import sys
sys.modules["numba"] = None
from sitl.plant.jit import compiled
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.config import VehicleConfig, StartConfig
assert compiled(len) is len
vehicle = SimulatedVehicle(VehicleConfig(start=StartConfig(position_ned_m=(0.0, 0.0, -2.0))))
vehicle.advance(0.5)
print(*vehicle.truth.position_ned_m, *vehicle.truth.rotor_speeds_rpm)
"""


def test_without_numba_the_same_code_runs_interpreted() -> None:
    from sitl.config import StartConfig, VehicleConfig  # noqa: PLC0415  beside its twin above
    from sitl.vehicle.vehicle import SimulatedVehicle  # noqa: PLC0415

    vehicle = SimulatedVehicle(VehicleConfig(start=StartConfig(position_ned_m=(0.0, 0.0, -2.0))))
    vehicle.advance(0.5)
    run = subprocess.run(
        [sys.executable, "-c", INTERPRETED], check=True, capture_output=True, text=True
    )
    interpreted = [float(value) for value in run.stdout.split()]
    truth = vehicle.truth
    assert interpreted == pytest.approx(
        (*truth.position_ned_m, *truth.rotor_speeds_rpm), rel=1e-9, abs=1e-9
    )
