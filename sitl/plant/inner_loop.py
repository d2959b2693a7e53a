"""Plant and controller together: what happens between two decisions of the autopilot.

The loop is compiled where Numba is installed.  Named tuples take ten times as long as plain ones to
enter and leave compiled code, longer than the physics itself: so only plain ones cross the border.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.plant.controller import ControllerGains, ControllerMemory, control, trimmed
from sitl.plant.estimator import EstimateError
from sitl.plant.jit import compiled
from sitl.plant.multirotor import (
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
    Wind,
    derivative,
    step,
)
from sitl.plant.setpoint import Setpoint, ahead

Plain = tuple[float, ...]

# Where a flight's values are.
STATE, MEMORY, ACCELERATION = slice(0, 17), slice(17, 20), slice(20, 23)
UNTRIMMED = (0.0, 0.0, 0.0)
_UNACCELERATED = (0.0, 0.0, 0.0)
_EXACT = tuple(EstimateError())


class Flight(NamedTuple):
    """Plant and controller at one instant, as plain floats.

    Attributes:
        values: the state (17), the controller's memory (3), and the acceleration, NED (3).
    """

    values: Plain

    @classmethod
    def of(cls, state: MultirotorState) -> Flight:
        """Begin in a state, with nothing trimmed out, and not accelerating."""
        return cls(tuple(state) + UNTRIMMED + _UNACCELERATED)

    @property
    def state(self) -> MultirotorState:
        """State of the plant."""
        return MultirotorState._make(self.values[STATE])

    @property
    def memory(self) -> ControllerMemory:
        """Memory of the controller."""
        return ControllerMemory._make(self.values[MEMORY])


def fly(
    state: Plain,
    memory: Plain,
    setpoint: Setpoint,
    gains: ControllerGains,
    parameters: MultirotorParameters,
    rotor_shares: RotorSpeeds,
    wind: Wind,
    step_s: float,
    steps: int,
    age_s: float = 0.0,
    error: Plain = _EXACT,
) -> Flight:
    """Advance plant and controller by ``steps`` steps of ``step_s`` under one moving setpoint.

    ``age_s`` is how long the setpoint has been moving when the first step begins.
    ``rotor_shares`` is the share of its command that each rotor reaches: 1, or 0 when it has
    failed; the controller does not take it into account.  ``error`` is the `EstimateError` that
    separates the controller's input from the state.
    """
    return Flight(
        _fly(
            tuple(state),
            tuple(memory),
            tuple(setpoint),
            tuple(gains),
            tuple(parameters),
            tuple(rotor_shares),
            tuple(wind),
            step_s,
            steps,
            age_s,
            tuple(error),
        )
    )


def spin(
    state: Plain,
    command: RotorSpeeds,
    parameters: MultirotorParameters,
    wind: Wind,
    step_s: float,
    steps: int,
) -> Flight:
    """Advance the plant alone, rotors at fixed commands: off, or idling on the ground."""
    return Flight(
        _spin(tuple(state), tuple(command), tuple(parameters), tuple(wind), step_s, steps)
    )


_ahead = compiled(ahead)


@compiled
def _sensed(
    state: MultirotorState, error: EstimateError, cosine: float, sine: float
) -> MultirotorState:
    """Return the estimated state; ``cosine`` and ``sine`` are those of half the heading error.

    Body rates and rotor speeds are exact; the heading error turns the attitude about the vertical.
    """
    w, x, y, z = state.qw, state.qx, state.qy, state.qz
    return MultirotorState(
        state.north_m + error.north_m,
        state.east_m + error.east_m,
        state.down_m + error.down_m,
        state.velocity_north_mps + error.velocity_north_mps,
        state.velocity_east_mps + error.velocity_east_mps,
        state.velocity_down_mps + error.velocity_down_mps,
        cosine * w - sine * z,
        cosine * x - sine * y,
        cosine * y + sine * x,
        cosine * z + sine * w,
        state.roll_rate_radps,
        state.pitch_rate_radps,
        state.yaw_rate_radps,
        state.rotor1_rpm,
        state.rotor2_rpm,
        state.rotor3_rpm,
        state.rotor4_rpm,
    )


@compiled
def _fly(
    start: Plain,
    trim: Plain,
    wanted: Plain,
    limits: Plain,
    body: Plain,
    rotor_shares: Plain,
    air: Plain,
    step_s: float,
    steps: int,
    age_s: float,
    wrong: Plain,
) -> Plain:
    state, memory, setpoint = MultirotorState(*start), ControllerMemory(*trim), Setpoint(*wanted)
    gains, parameters, wind = ControllerGains(*limits), MultirotorParameters(*body), Wind(*air)
    shares, error = RotorSpeeds(*rotor_shares), EstimateError(*wrong)
    cosine, sine = math.cos(error.yaw_rad / 2.0), math.sin(error.yaw_rad / 2.0)
    sensed = _sensed(state, error, cosine, sine)
    command = RotorSpeeds(0.0, 0.0, 0.0, 0.0)
    for index in range(steps):
        moved_on = _ahead(setpoint, age_s + index * step_s)
        rotors = control(sensed, memory, moved_on, gains, parameters)
        command = RotorSpeeds(
            rotors.rotor1_rpm * shares.rotor1_rpm,
            rotors.rotor2_rpm * shares.rotor2_rpm,
            rotors.rotor3_rpm * shares.rotor3_rpm,
            rotors.rotor4_rpm * shares.rotor4_rpm,
        )
        moved = step(state, command, wind, parameters, step_s)
        sensed_before, sensed = sensed, _sensed(moved, error, cosine, sine)
        memory = trimmed(memory, sensed_before, sensed, gains, parameters, step_s)
        state = moved
    return state[0:17] + memory[0:3] + derivative(state, command, wind, parameters)[3:6]


@compiled
def _spin(start: Plain, speeds: Plain, body: Plain, air: Plain, step_s: float, steps: int) -> Plain:
    state, command = MultirotorState(*start), RotorSpeeds(*speeds)
    parameters, wind = MultirotorParameters(*body), Wind(*air)
    for _ in range(steps):
        state = step(state, command, wind, parameters, step_s)
    return state[0:17] + UNTRIMMED + derivative(state, command, wind, parameters)[3:6]
