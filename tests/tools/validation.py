"""``python -m tests.tools.validation -o DIR``: is the simulated vehicle's physics to be trusted?

Draws and prints: how the paper's flight is tracked (as its Fig. 16 and 17), how far RotorPy's
independent model departs under the same rotor speeds, and how the attitude in flight fits the
flatness relations (Eq. 2-4).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gcs_tools.scenario import load_scenario
from sitl.autopilot.modes import Mode
from sitl.plant.controller import ControllerGains, ControllerMemory
from sitl.plant.inner_loop import fly
from sitl.plant.multirotor import (
    GRAVITY_MPS2,
    INTACT,
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
    Wind,
    hover_speed_rpm,
    quadrotor,
    standing_state,
    step,
)
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import VehicleTruth
from sitl.virtual.simulation import SimulatedFlight, Simulation

FloatArray = NDArray[np.float64]

SCENARIO = Path(__file__).parents[2] / "config" / "paper.yaml"
STEP_S = 0.0025
STILL = Wind(0.0, 0.0, 0.0)
_HOLD_STEPS = 40  # each open-loop command is held for 0.1 s


# --- RotorPy ----------------------------------------------------------------------------------


def disturbed(body: MultirotorParameters) -> MultirotorState:
    """Return a state in which every axis matters."""
    start = standing_state(1.0, 2.0, -50.0, 0.4, hover_speed_rpm(body))
    return start._replace(
        velocity_north_mps=2.0,
        velocity_east_mps=-1.0,
        velocity_down_mps=0.5,
        qx=0.05,
        qy=-0.08,
        qw=math.sqrt(1.0 - 0.05**2 - 0.08**2 - start.qz**2),
        roll_rate_radps=0.3,
        pitch_rate_radps=-0.2,
        yaw_rate_radps=0.4,
    )


def open_loop_commands(body: MultirotorParameters, duration_s: float) -> list[RotorSpeeds]:
    """Return seeded rotor speeds around hover, one for each step."""
    random = np.random.default_rng(7)
    hover_rpm = hover_speed_rpm(body)
    holds = round(duration_s / STEP_S / _HOLD_STEPS)
    changes = 1.0 + 0.03 * random.standard_normal((holds, 4))
    return [RotorSpeeds(*(hover_rpm * row)) for row in changes for _ in range(_HOLD_STEPS)]


def open_loop_pair(
    body: MultirotorParameters, commands: Sequence[RotorSpeeds]
) -> tuple[FloatArray, FloatArray]:
    """Fly both models under the same commands; (N, 17) states each, in our terms."""
    # A development tool, and slow to import: only this comparison needs it.
    from tests.benchmarks.rotorpy_peer import (  # noqa: PLC0415
        command,
        our_state,
        rotorpy_state,
        rotorpy_vehicle,
    )

    vehicle, state = rotorpy_vehicle(body), disturbed(body)
    peer = rotorpy_state(state)
    ours, theirs = [], []
    for speeds in commands:
        state = step(state, speeds, STILL, body, STEP_S)
        peer = vehicle.step(peer, command(speeds), STEP_S)
        ours.append(state)
        theirs.append(our_state(peer))
    return np.array(ours), np.array(theirs)


# --- flatness ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """A flight as arrays over N instants; (N,) or (N, 3).

    Attributes:
        mass_kg: of the vehicle.
        time_s, velocity_ned_mps, roll_rad, pitch_rad, yaw_rad, thrust_n: what it did.
    """

    mass_kg: float
    time_s: FloatArray
    velocity_ned_mps: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    thrust_n: FloatArray


def swerve(body: MultirotorParameters) -> Motion:
    """Fly a smooth lateral and vertical weave at 2.8 m/s with the SITL's controller."""
    frequency = 2.0 * math.pi / 4.0
    state = standing_state(0.0, 0.0, -20.0, 0.5, hover_speed_rpm(body))
    state = state._replace(velocity_north_mps=2.8)
    memory = ControllerMemory()
    rows = []
    for tick in range(1200):
        t = 0.01 * tick
        rise = min(t / 3.0, 1.0) ** 3  # the amplitude grows smoothly
        east, down = 1.2 * rise, 0.3 * rise
        phase = frequency * t
        target = Setpoint(
            yaw_rad=0.5,
            velocity_north_mps=2.8,
            velocity_east_mps=east * frequency * math.cos(phase),
            velocity_down_mps=down * frequency * math.sin(phase),
            acceleration_east_mps2=-east * frequency**2 * math.sin(phase),
            acceleration_down_mps2=down * frequency**2 * math.cos(phase),
        )
        flight = fly(state, memory, target, ControllerGains(), body, INTACT, STILL, STEP_S, 4)
        state, memory = flight.state, flight.memory
        truth = _truth_of(state)
        thrust_n = body.thrust_coefficient_n_per_rpm2 * sum(rpm**2 for rpm in state[13:17])
        attitude = (truth.roll_rad, truth.pitch_rad, truth.yaw_rad)
        rows.append((t, *state[3:6], *attitude, thrust_n))
    table = np.array(rows)[400:]
    return Motion(body.mass_kg, table[:, 0], table[:, 1:4], *table[:, 4:8].T)


def flatness_attitude(
    acceleration_ned_mps2: FloatArray, yaw_rad: FloatArray, mass_kg: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Roll, pitch and thrust that an acceleration demands (Eq. 4); (N, 3), (N,) -> 3 x (N,)."""
    x, y, z = acceleration_ned_mps2.T
    forward = x * np.cos(yaw_rad) + y * np.sin(yaw_rad)
    right = -x * np.sin(yaw_rad) + y * np.cos(yaw_rad)
    lift = GRAVITY_MPS2 - z
    roll: FloatArray = np.arctan(right / np.hypot(lift, forward))
    pitch: FloatArray = -np.arctan(forward / lift)
    thrust: FloatArray = mass_kg * np.sqrt(x**2 + y**2 + lift**2)
    return roll, pitch, thrust


def _truth_of(state: MultirotorState) -> VehicleTruth:
    nothing = (0.0, 0.0, 0.0)
    return VehicleTruth(0.0, nothing, nothing, nothing, state[6:10], nothing, (0.0,) * 4)


# --- the paper's flight -----------------------------------------------------------------------


@dataclass(frozen=True)
class Tracking:
    """The paper's flight between hand-over and arrival, as arrays over N instants.

    Attributes:
        time_s: (N,).
        planned, flown: (N, 9): position and velocity NED, roll, pitch, yaw.
        rotor_speeds_rpm: (N, 4).
    """

    time_s: FloatArray
    planned: FloatArray
    flown: FloatArray
    rotor_speeds_rpm: FloatArray

    @property
    def error_m(self) -> FloatArray:
        """Horizontal tracking error at each instant, the paper's e_tr."""
        error: FloatArray = np.hypot(*(self.flown - self.planned)[:, 0:2].T)
        return error


def paper_flight() -> Tracking:
    """Fly the paper's example in virtual time; note what is wanted and what is done."""
    scenario = load_scenario(SCENARIO)
    simulation = Simulation(
        SimulatedFlight(
            contract=scenario.contract,
            mission=scenario.mission,
            sitl=scenario.sitl_config(),
            obstacles=scenario.obstacles,
        )
    )
    vehicle = simulation.scene.vehicle
    rows = []
    while not simulation.over:
        decided_s, truth = simulation.now_s, vehicle.truth
        mode = vehicle.autopilot.commander.mode
        simulation.advance()
        simulation.autonomy.events()  # taken by nobody else here
        wanted = vehicle.autopilot.commander.setpoint
        if wanted is None or mode is not Mode.OFFBOARD:
            continue
        # The setpoint was decided on when the step began.
        rows.append((decided_s, *_planned(wanted), *_flown(truth)))
    table = np.array(rows)
    return Tracking(table[:, 0], table[:, 1:10], table[:, 10:19], table[:, 19:23])


def _planned(wanted: Setpoint) -> list[float]:
    acceleration, yaw = np.array([wanted[6:9]]), np.array([wanted.yaw_rad])
    roll, pitch, _ = flatness_attitude(acceleration, yaw, 1.0)
    return [*wanted[0:6], float(roll[0]), float(pitch[0]), wanted.yaw_rad]


def _flown(truth: VehicleTruth) -> list[float]:
    attitude = (truth.roll_rad, truth.pitch_rad, truth.yaw_rad)
    return [*truth.position_ned_m, *truth.velocity_ned_mps, *attitude, *truth.rotor_speeds_rpm]


# --- pictures ---------------------------------------------------------------------------------

_PANELS: tuple[tuple[str, str, int, float], ...] = (
    ("north", "m", 0, 1.0),
    ("east", "m", 1, 1.0),
    ("down", "m", 2, 1.0),
    ("velocity north", "m/s", 3, 1.0),
    ("velocity east", "m/s", 4, 1.0),
    ("velocity down", "m/s", 5, 1.0),
    ("roll", "deg", 6, math.degrees(1.0)),
    ("pitch", "deg", 7, math.degrees(1.0)),
)


def draw_tracking(flight: Tracking) -> Figure:
    """Planned and flown states, as the paper's Fig. 16."""
    figure = Figure(figsize=(13.0, 8.5), layout="constrained")
    for axes, (name, unit, column, scale) in zip(
        figure.subplots(3, 3, sharex=True).flat, _PANELS, strict=False
    ):
        axes.plot(flight.time_s, scale * flight.planned[:, column], "C1", lw=2.5, label="planned")
        axes.plot(flight.time_s, scale * flight.flown[:, column], "C0", lw=1.0, label="flown")
        axes.set(title=f"{name} [{unit}]", xlabel="time [s]")
        axes.grid(alpha=0.3)
    figure.axes[0].legend()
    for number, speeds in enumerate(flight.rotor_speeds_rpm.T, 1):
        figure.axes[-1].plot(flight.time_s, speeds, lw=0.8, label=f"rotor {number}")
    figure.axes[-1].set(title="rotor speeds [rpm]", xlabel="time [s]")
    figure.axes[-1].legend(ncols=2)
    figure.axes[-1].grid(alpha=0.3)
    return figure


def draw_error(flight: Tracking, limit_m: float) -> Figure:
    """Horizontal tracking error over time, as the paper's Fig. 17(a)."""
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axes = figure.subplots()
    largest_m = float(flight.error_m.max())
    axes.plot(flight.time_s, flight.error_m, "C0", label="error $e_{tr}$")
    axes.axhline(largest_m, color="C0", ls=":", label=f"largest $E_{{tr}}$ = {largest_m:.3f} m")
    axes.axhline(limit_m, color="C3", ls="--", label=f"contract: {limit_m:g} m")
    axes.set(xlabel="time [s]", ylabel="horizontal error [m]", ylim=(0.0, None))
    axes.legend(loc="center right")
    axes.grid(alpha=0.3)
    return figure


def draw_open_loop(ours: FloatArray, theirs: FloatArray) -> Figure:
    """Both models' positions under the same rotor speeds, and how far they part."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    time_s = STEP_S * np.arange(1, len(ours) + 1)
    for axis, name in enumerate(("north", "east", "down")):
        left.plot(time_s, theirs[:, axis] - theirs[0, axis], f"C{axis}", lw=3.0, alpha=0.4)
        left.plot(time_s, ours[:, axis] - ours[0, axis], f"C{axis}", lw=1.0, label=name)
    left.set(xlabel="time [s]", title="position [m]: SITL thin, RotorPy broad")
    left.legend()
    right.semilogy(time_s, np.linalg.norm(ours[:, 0:3] - theirs[:, 0:3], axis=1) + 1e-12)
    right.set(xlabel="time [s]", title="distance between the two [m]")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure


def main() -> None:
    """Write the pictures and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("build/validation"))
    directory: Path = parser.parse_args().output
    directory.mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    flight = paper_flight()
    limit_m = load_scenario(SCENARIO).contract.vehicle.tracking_error_m
    body = quadrotor(rotor_drag_n_per_mps=0.0)
    ours, theirs = open_loop_pair(body, open_loop_commands(body, 2.0))
    figures: dict[str, Any] = {
        "tracking": draw_tracking(flight),
        "tracking_error": draw_error(flight, limit_m),
        "rotorpy": draw_open_loop(ours, theirs),
    }
    for name, figure in figures.items():
        figure.savefig(directory / f"{name}.png", dpi=110)
    velocity_error = np.abs(flight.flown - flight.planned)[:, 3:5].max(axis=0)
    print(f"paper's flight   E_tr {flight.error_m.max():.3f} m (contract {limit_m:g} m)")
    print(f"                 dV_x {velocity_error[0]:.3f} m/s, dV_y {velocity_error[1]:.3f} m/s")
    apart_m = np.linalg.norm(ours[:, 0:3] - theirs[:, 0:3], axis=1).max()
    print(f"RotorPy          {apart_m:.1e} m apart after {STEP_S * len(ours):g} s open loop")
    motion = swerve(quadrotor(rotor_drag_n_per_mps=0.0, drag_area_m2=0.0))
    acceleration = np.gradient(motion.velocity_ned_mps, motion.time_s, axis=0)
    roll, pitch, _ = flatness_attitude(acceleration, motion.yaw_rad, motion.mass_kg)
    for name, there, here in (
        ("roll", roll, motion.roll_rad),
        ("pitch", pitch, motion.pitch_rad),
    ):
        apart_deg = np.degrees(np.abs(there - here)[20:-20].max())
        print(f"flatness         {name} within {apart_deg:.4f} deg")
    print(f"pictures in {directory}")


if __name__ == "__main__":
    main()
