"""Plant and controller together: what happens between two decisions of the autopilot.

The loop is compiled where Numba is installed.  Named tuples take ten times as long as plain ones on
their way into compiled code and out of it, longer than what happens there: so they are unnamed at
the border and named again behind it.
"""

from __future__ import annotations

from typing import NamedTuple

from sitl.controller import (
    ControllerGains,
    ControllerMemory,
    Setpoint,
    ahead,
    control,
    trimmed,
)
from sitl.jit import compiled
from sitl.multirotor import (
    MultirotorParameters,
    MultirotorState,
    RotorSpeeds,
    Wind,
    derivative,
    step,
)

Plain = tuple[float, ...]


class Flight(NamedTuple):
    """State of plant and controller, and the acceleration at that instant, NED."""

    state: MultirotorState
    memory: ControllerMemory
    acceleration_north_mps2: float
    acceleration_east_mps2: float
    acceleration_down_mps2: float


def fly(
    state: MultirotorState,
    memory: ControllerMemory,
    setpoint: Setpoint,
    gains: ControllerGains,
    parameters: MultirotorParameters,
    rotor_shares: RotorSpeeds,
    wind: Wind,
    step_s: float,
    steps: int,
) -> Flight:
    """Advance plant and controller by ``steps`` steps of ``step_s`` under one moving setpoint.

    ``rotor_shares`` is what each rotor makes of its command: 1, or 0 when it has failed, of which
    the controller knows nothing.
    """
    return _named(
        _fly_plain(
            tuple(state),
            tuple(memory),
            tuple(setpoint),
            tuple(gains),
            tuple(parameters),
            tuple(rotor_shares),
            tuple(wind),
            step_s,
            steps,
        )
    )


def spin(
    state: MultirotorState,
    command: RotorSpeeds,
    parameters: MultirotorParameters,
    wind: Wind,
    step_s: float,
    steps: int,
) -> Flight:
    """Advance the plant alone, rotors at fixed commands: off, or idling on the ground."""
    return _named(
        _spin_plain(tuple(state), tuple(command), tuple(parameters), tuple(wind), step_s, steps)
    )


def _named(values: Plain) -> Flight:
    north_mps2, east_mps2, down_mps2 = values[20:]
    return Flight(
        MultirotorState._make(values[:17]),
        ControllerMemory._make(values[17:20]),
        north_mps2,
        east_mps2,
        down_mps2,
    )


_ahead = compiled(ahead)


@compiled
def _fly(
    state: MultirotorState,
    memory: ControllerMemory,
    setpoint: Setpoint,
    gains: ControllerGains,
    parameters: MultirotorParameters,
    rotor_shares: RotorSpeeds,
    wind: Wind,
    step_s: float,
    steps: int,
) -> Flight:
    command = RotorSpeeds(0.0, 0.0, 0.0, 0.0)
    for index in range(steps):
        target = _ahead(setpoint, index * step_s)
        wanted = control(state, memory, target, gains, parameters)
        command = RotorSpeeds(
            wanted.rotor1_rpm * rotor_shares.rotor1_rpm,
            wanted.rotor2_rpm * rotor_shares.rotor2_rpm,
            wanted.rotor3_rpm * rotor_shares.rotor3_rpm,
            wanted.rotor4_rpm * rotor_shares.rotor4_rpm,
        )
        moved = step(state, command, wind, parameters, step_s)
        memory = trimmed(memory, state, moved, gains, parameters, step_s)
        state = moved
    rate = derivative(state, command, wind, parameters)
    return Flight(
        state,
        memory,
        rate.velocity_north_mps,
        rate.velocity_east_mps,
        rate.velocity_down_mps,
    )


@compiled
def _spin(
    state: MultirotorState,
    command: RotorSpeeds,
    parameters: MultirotorParameters,
    wind: Wind,
    step_s: float,
    steps: int,
) -> Flight:
    for _ in range(steps):
        state = step(state, command, wind, parameters, step_s)
    rate = derivative(state, command, wind, parameters)
    return Flight(
        state,
        ControllerMemory(0.0, 0.0, 0.0),
        rate.velocity_north_mps,
        rate.velocity_east_mps,
        rate.velocity_down_mps,
    )


@compiled
def _fly_plain(
    state: Plain,
    memory: Plain,
    setpoint: Plain,
    gains: Plain,
    parameters: Plain,
    rotor_shares: Plain,
    wind: Plain,
    step_s: float,
    steps: int,
) -> Plain:
    flight = _fly(
        MultirotorState(*state),
        ControllerMemory(*memory),
        Setpoint(*setpoint),
        ControllerGains(*gains),
        MultirotorParameters(*parameters),
        RotorSpeeds(*rotor_shares),
        Wind(*wind),
        step_s,
        steps,
    )
    return flight.state[0:17] + flight.memory[0:3] + flight[2:5]


@compiled
def _spin_plain(
    state: Plain, command: Plain, parameters: Plain, wind: Plain, step_s: float, steps: int
) -> Plain:
    flight = _spin(
        MultirotorState(*state),
        RotorSpeeds(*command),
        MultirotorParameters(*parameters),
        Wind(*wind),
        step_s,
        steps,
    )
    return flight.state[0:17] + flight.memory[0:3] + flight[2:5]
