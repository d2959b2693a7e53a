"""Plant and controller between two decisions: one long call is many short ones."""

import math

import pytest

from sitl.plant import jit
from sitl.plant.controller import ControllerGains, ControllerMemory
from sitl.plant.estimator import EstimateError
from sitl.plant.inner_loop import ACCELERATION, MEMORY, STATE, Flight, fly, spin
from sitl.plant.multirotor import (
    GRAVITY_MPS2,
    INTACT,
    RotorSpeeds,
    Wind,
    hover_speed_rpm,
    quadrotor,
    standing_state,
)
from sitl.plant.setpoint import Setpoint

BODY = quadrotor()
STILL = Wind(0.0, 0.0, 0.0)
STEP_S = 0.0025
HOVER = Setpoint(0.0, 0.0, -5.0, 0.0, 0.0, 0.0)


def hovering(down_m: float = -5.0) -> Flight:
    return Flight.of(standing_state(0.0, 0.0, down_m, 0.0, hover_speed_rpm(BODY)))


def flown(
    flight: Flight,
    setpoint: Setpoint,
    steps: int,
    *,
    age_s: float = 0.0,
    shares: RotorSpeeds = INTACT,
    error: EstimateError | None = None,
) -> Flight:
    return fly(
        flight.values[STATE],
        flight.values[MEMORY],
        setpoint,
        ControllerGains(),
        BODY,
        shares,
        STILL,
        STEP_S,
        steps,
        age_s,
        tuple(EstimateError() if error is None else error),
    )


def test_a_flight_begins_untrimmed_and_unaccelerated() -> None:
    flight = hovering()
    assert flight.state == standing_state(0.0, 0.0, -5.0, 0.0, hover_speed_rpm(BODY))
    assert flight.memory == ControllerMemory()
    assert flight.values[ACCELERATION] == (0.0, 0.0, 0.0)
    assert len(flight.values) == 23


def test_hovering_stays_where_it_is() -> None:
    state = flown(hovering(), HOVER, 800).state
    assert (state.north_m, state.east_m, state.down_m) == pytest.approx((0.0, 0.0, -5.0), abs=0.01)


def test_one_call_is_as_many_shorter_ones() -> None:
    setpoint = HOVER._replace(velocity_north_mps=2.0, acceleration_north_mps2=1.0)
    once, often = flown(hovering(), setpoint, 40), hovering()
    for part in range(4):
        often = flown(often, setpoint, 10, age_s=part * 10 * STEP_S)
    assert often.values == pytest.approx(once.values, abs=1e-12)


def test_a_failed_rotor_turns_the_vehicle_over() -> None:
    state = flown(hovering(), HOVER, 200, shares=RotorSpeeds(0.0, 1.0, 1.0, 1.0)).state
    assert max(abs(state.roll_rate_radps), abs(state.pitch_rate_radps)) > 1.0


def test_the_controller_flies_the_estimate_to_the_setpoint() -> None:
    error = EstimateError(north_m=1.0, down_m=-0.5)
    state = flown(hovering(), HOVER, 4000, error=error).state
    assert (state.north_m, state.down_m) == pytest.approx((-1.0, -4.5), abs=0.02)


def test_a_heading_error_turns_the_vehicle_against_it() -> None:
    state = flown(hovering(), HOVER, 4000, error=EstimateError(yaw_rad=0.3)).state
    assert 2.0 * math.atan2(state.qz, state.qw) == pytest.approx(-0.3, abs=0.01)


def test_rotors_at_rest_let_it_fall() -> None:
    start = standing_state(0.0, 0.0, -50.0, 0.0)
    flight = spin(tuple(start), RotorSpeeds(0.0, 0.0, 0.0, 0.0), BODY, STILL, STEP_S, 200)
    assert flight.state.velocity_down_mps == pytest.approx(GRAVITY_MPS2 * 0.5, rel=0.02)
    assert flight.values[ACCELERATION][2] == pytest.approx(GRAVITY_MPS2, rel=0.05)
    assert flight.memory == ControllerMemory()


def test_the_ground_carries_it() -> None:
    start = standing_state(0.0, 0.0, 0.0, 0.0)
    flight = spin(tuple(start), RotorSpeeds(0.0, 0.0, 0.0, 0.0), BODY, STILL, STEP_S, 400)
    assert flight.state.down_m == pytest.approx(0.0, abs=0.01)


def test_without_numba_functions_stay_what_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "numba", None)

    def double(x: float) -> float:
        return 2.0 * x

    assert jit.compiled(double) is double
