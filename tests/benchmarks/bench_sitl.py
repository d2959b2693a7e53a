"""Benchmarks of the simulator: how many seconds it simulates in one, beside RotorPy."""

from __future__ import annotations

from pathlib import Path

from gcs_tools.scenario import load_scenario
from sitl.plant.controller import ControllerGains, ControllerMemory
from sitl.plant.inner_loop import fly
from sitl.plant.multirotor import (
    INTACT,
    RotorSpeeds,
    Wind,
    hover_speed_rpm,
    quadrotor,
    standing_state,
)
from sitl.plant.setpoint import Setpoint
from sitl.virtual.simulation import SimulatedFlight, Simulation, without_cycle_collection
from tests.benchmarks.measurement import Measurement, seconds_of
from tests.benchmarks.rotorpy_peer import command, rotorpy_state, rotorpy_vehicle

PAPER = Path(__file__).parents[2] / "config" / "paper.yaml"
STEP_S = 1.0 / 400.0
UNIT = "x real time"


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

    vehicle, peer_start = rotorpy_vehicle(body), rotorpy_state(start)
    vehicle.integrator_kwargs = {"method": "RK45"}  # RotorPy's own default accuracy
    hover = command(RotorSpeeds(*(hover_speed_rpm(body),) * 4))

    def peers_second() -> None:
        state = peer_start
        for _ in range(400):
            state = vehicle.step(state, hover, STEP_S)

    return Measurement(
        value=10.0 / seconds_of(ten_seconds),
        unit=UNIT,
        peer=1.0 / seconds_of(peers_second, repeat=3),
        peer_name="RotorPy, plant only",
        more_is_better=True,
    )


def bench_sitl_whole_system() -> Measurement:
    """The paper's flight in virtual time: onboard service, bytes, plant, sensor, operator."""
    scenario = load_scenario(PAPER)
    flown_s = 0.0

    def flight() -> None:
        nonlocal flown_s
        simulation = Simulation(
            SimulatedFlight(
                contract=scenario.contract,
                mission=scenario.mission,
                sitl=scenario.sitl_config(),
                obstacles=scenario.obstacles,
            )
        )
        with without_cycle_collection():  # as every virtual flight
            while not simulation.over:
                simulation.advance()
                simulation.autonomy.events()  # the journal would take them in a real flight
        flown_s = simulation.now_s

    wall_s = seconds_of(flight, repeat=3)
    return Measurement(value=flown_s / wall_s, unit=UNIT)
