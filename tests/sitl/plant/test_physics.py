"""Physics against what others say: RotorPy, and the paper's flatness relations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.plant.multirotor import MultirotorParameters, RotorSpeeds, quadrotor
from tests.benchmarks.rotorpy_peer import rotorpy_state, rotorpy_vehicle
from tests.tools.validation import (
    disturbed,
    flatness_attitude,
    open_loop_commands,
    open_loop_pair,
    swerve,
)

NO_DRAG = quadrotor(rotor_drag_n_per_mps=0.0, drag_area_m2=0.0)


@pytest.mark.parametrize(
    ("body", "position_m", "attitude_rad"),
    [
        (NO_DRAG, 1e-5, 1e-6),
        (quadrotor(rotor_drag_n_per_mps=0.0, drag_area_m2=0.03), 1e-5, 1e-6),
        # RotorPy's rotor drag acts at each rotor, and damps body rates a little; ours does not.
        (quadrotor(rotor_drag_n_per_mps=0.15, drag_area_m2=0.0), 0.02, 0.02),
    ],
    ids=["no drag", "parasitic drag", "rotor drag"],
)
def test_rotorpy_flies_the_same_path_under_the_same_rotor_speeds(
    body: MultirotorParameters, position_m: float, attitude_rad: float
) -> None:
    ours, theirs = open_loop_pair(body, open_loop_commands(body, 1.0))
    assert np.linalg.norm(ours[-1, 0:3] - ours[0, 0:3]) > 1.0  # they went somewhere
    assert np.abs(ours[:, 0:3] - theirs[:, 0:3]).max() < position_m
    assert np.abs(ours[:, 6:10] - theirs[:, 6:10]).max() < attitude_rad
    assert np.abs(ours[:, 13:17] - theirs[:, 13:17]).max() < 0.01


def test_rotorpy_is_told_about_every_axis() -> None:
    body = quadrotor()
    state = disturbed(body)
    theirs = rotorpy_state(state)
    assert all(np.abs(theirs[key]).min() > 0.0 for key in ("x", "v", "q", "w"))
    still = RotorSpeeds(0.0, 0.0, 0.0, 0.0)
    assert rotorpy_vehicle(body).mass == body.mass_kg
    assert open_loop_pair(body, [still] * 3)[1].shape == (3, 17)


def test_attitude_and_thrust_in_flight_are_those_of_the_flatness_relations() -> None:
    """Eq. 4, along a smooth swerve: what the vehicle's motion demands is what it does."""
    flight = swerve(NO_DRAG)
    acceleration = np.gradient(flight.velocity_ned_mps, flight.time_s, axis=0)
    steady = slice(20, -20)
    roll, pitch, thrust = flatness_attitude(acceleration, flight.yaw_rad, flight.mass_kg)
    assert np.degrees(np.ptp(roll)) > 20.0
    assert np.abs(roll - flight.roll_rad)[steady].max() < math.radians(0.15)
    assert np.abs(pitch - flight.pitch_rad)[steady].max() < math.radians(0.15)
    assert np.abs(thrust / flight.thrust_n - 1.0)[steady].max() < 0.005
