"""Benchmarks of the simulator: how many seconds it simulates in one, beside RotorPy."""

from __future__ import annotations

from sitl.plant.controller import ControllerGains, ControllerMemory
from sitl.plant.inner_loop import fly, spin
from sitl.plant.multirotor import (
    INTACT,
    RotorSpeeds,
    Wind,
    hover_speed_rpm,
    quadrotor,
    standing_state,
)
from sitl.plant.setpoint import Setpoint
from tests.benchmarks.measurement import Measurement, seconds_of, sized
from tests.benchmarks.rotorpy_peer import command, rotorpy_state, rotorpy_vehicle

STEP_S = 1.0 / 400.0
TIMES_FASTER_THAN_ROTORPY_MIN = 1000.0


def bench_sitl_plant_and_controller() -> Measurement:
    """Plant and controller alone at 400 Hz on one core; RotorPy's plant alone at the same rate."""
    body = quadrotor()
    start = standing_state(0.0, 0.0, -4.0, 0.0, hover_speed_rpm(body))
    setpoint = Setpoint(0.0, 0.0, -4.0, 0.0, 0.0, 0.0)
    still = Wind(0.0, 0.0, 0.0)

    def ten_seconds() -> None:
        state, memory = start, ControllerMemory()
        for _ in range(1000):  # as the autopilot does: four steps for each of its ticks
            flight = fly(state, memory, setpoint, ControllerGains(), body, INTACT, still, STEP_S, 4)
            state, memory = flight.state, flight.memory

    return _beside_rotorpy(10.0 / seconds_of(ten_seconds))


def bench_sitl_plant() -> Measurement:
    """The plant alone at 400 Hz on one core, beside RotorPy's single vehicle, which is that too."""
    body = quadrotor()
    hover_rpm = hover_speed_rpm(body)
    start, rotors = standing_state(0.0, 0.0, -4.0, 0.0, hover_rpm), RotorSpeeds(*(hover_rpm,) * 4)

    def hundred_seconds() -> None:
        spin(start, rotors, body, Wind(0.0, 0.0, 0.0), STEP_S, 40_000)

    speed = 100.0 / seconds_of(hundred_seconds)
    return _beside_rotorpy(speed, ratio_min=TIMES_FASTER_THAN_ROTORPY_MIN)


def _beside_rotorpy(speed: float, ratio_min: float | None = None) -> Measurement:
    body = quadrotor()
    start = standing_state(0.0, 0.0, -4.0, 0.0, hover_speed_rpm(body))
    vehicle, peer_start = rotorpy_vehicle(body), rotorpy_state(start)
    vehicle.integrator_kwargs = {"method": "RK45"}  # RotorPy's own default accuracy
    hover = command(RotorSpeeds(*(hover_speed_rpm(body),) * 4))

    steps = sized(400, 40)

    def peers_flight() -> None:
        state = peer_start
        for _ in range(steps):
            state = vehicle.step(state, hover, STEP_S)

    return Measurement(
        value=speed,
        unit="x real time",
        peer=steps * STEP_S / seconds_of(peers_flight, repeat=3),
        peer_name="RotorPy, plant only",
        more_is_better=True,
        ratio_min=ratio_min,
    )
