from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from sitl.plant.controller import ControllerGains, ControllerMemory
from sitl.plant.inner_loop import fly
from sitl.plant.multirotor import (
    GRAVITY_MPS2,
    INTACT,
    MultirotorState,
    Wind,
    hover_speed_rpm,
    quadrotor,
    rotate_ned_from_frd,
    standing_state,
)
from sitl.plant.setpoint import Setpoint

BODY = quadrotor()
STILL = Wind(0.0, 0.0, 0.0)
STEP_S = 1.0 / 400.0
STREAM_HZ = 50
CRUISE_MPS = 2.8

Profile = Callable[[float], tuple[float, float, float, float]]


def hovering() -> MultirotorState:
    return standing_state(0.0, 0.0, -4.0, 0.0, hover_speed_rpm(BODY))


def side_step(acceleration_mps2: float, jerk_mps3: float, width_m: float) -> Profile:
    """Position, velocity, acceleration and jerk of a rest-to-rest side step, limits reached."""
    ramp_s = acceleration_mps2 / jerk_mps3
    hold_s = (-3.0 * ramp_s + math.sqrt(ramp_s**2 + 4.0 * width_m / acceleration_mps2)) / 2.0
    assert hold_s > 0.0
    pieces = [
        (jerk_mps3, ramp_s),
        (0.0, hold_s),
        (-jerk_mps3, 2.0 * ramp_s),
        (0.0, hold_s),
        (jerk_mps3, ramp_s),
    ]

    def at(time_s: float) -> tuple[float, float, float, float]:
        position = velocity = acceleration = 0.0
        if time_s < 0.0:
            return 0.0, 0.0, 0.0, 0.0
        for jerk, duration_s in pieces:
            t = min(time_s, duration_s)
            position += t * (velocity + t * (acceleration / 2.0 + t * jerk / 6.0))
            velocity += t * (acceleration + t * jerk / 2.0)
            acceleration += t * jerk
            time_s -= duration_s
            if time_s < 0.0:
                return position, velocity, acceleration, jerk
        return position, velocity, 0.0, 0.0

    return at


@dataclass
class Tracking:
    """Worst errors of a flight."""

    position_m: float = 0.0
    velocity_mps: float = 0.0
    height_m: float = 0.0
    tilt_rad: float = 0.0


def tilt_rad(state: MultirotorState) -> float:
    _, _, down = rotate_ned_from_frd(*state[6:10], 0.0, 0.0, 1.0)
    return math.acos(min(down, 1.0))


def track_side_step(angle_deg: float, wind: Wind = STILL) -> Tracking:
    """Cruise north at 2.8 m/s and step 3 m east, on a 50 Hz stream; jerk 17 m/s^3."""
    acceleration_mps2 = GRAVITY_MPS2 * math.tan(math.radians(angle_deg))
    profile = side_step(acceleration_mps2, 17.0, 3.0)
    state = hovering()._replace(velocity_north_mps=CRUISE_MPS)
    memory, worst = ControllerMemory(), Tracking()
    settle_s = 3.0
    for tick in range(round((settle_s + 8.0) * STREAM_HZ)):
        now_s = tick / STREAM_HZ
        y, vy, ay, jy = profile(now_s - settle_s)
        setpoint = Setpoint(
            CRUISE_MPS * now_s, y, -4.0, CRUISE_MPS, vy, 0.0, 0.0, ay, 0.0, 0.0, jy, 0.0, 0.0, 0.0
        )
        if now_s >= settle_s:
            error = (state.north_m - CRUISE_MPS * now_s, state.east_m - y)
            worst.position_m = max(worst.position_m, math.hypot(*error))
            worst.velocity_mps = max(worst.velocity_mps, abs(state.velocity_east_mps - vy))
            worst.height_m = max(worst.height_m, abs(state.down_m + 4.0))
            worst.tilt_rad = max(worst.tilt_rad, tilt_rad(state))
        flight = fly(state, memory, setpoint, ControllerGains(), BODY, INTACT, wind, STEP_S, 8)
        state, memory = flight.state, flight.memory
    return worst


@pytest.mark.parametrize(
    ("angle_deg", "position_m", "velocity_mps"), [(5.0, 0.02, 0.10), (15.0, 0.03, 0.12)]
)
def test_side_step_is_tracked(angle_deg: float, position_m: float, velocity_mps: float) -> None:
    worst = track_side_step(angle_deg)
    assert worst.position_m < position_m
    assert worst.velocity_mps < velocity_mps
    assert worst.height_m < 0.02
    assert math.degrees(worst.tilt_rad) > angle_deg  # it really used the agility


def test_steady_wind_is_trimmed_out() -> None:
    assert track_side_step(15.0, Wind(4.0, -4.0, 0.5)).position_m < 0.04


def test_tilt_limit_is_kept_whatever_is_asked() -> None:
    gains = ControllerGains(tilt_max_rad=math.radians(20.0))
    state, memory = hovering(), ControllerMemory()
    far = Setpoint(100.0, -100.0, -4.0, 10.0, -10.0, 0.0, 30.0, -30.0, 0.0)
    steepest_rad = 0.0
    for _ in range(200):
        flight = fly(state, memory, far, gains, BODY, INTACT, STILL, STEP_S, 4)
        state, memory = flight.state, flight.memory
        steepest_rad = max(steepest_rad, tilt_rad(state))
    assert math.radians(18.0) < steepest_rad < math.radians(22.0)
    assert abs(state.down_m + 4.0) < 0.5  # lift before everything horizontal


def settle(setpoint: Setpoint, time_s: float, gains: ControllerGains) -> MultirotorState:
    state, memory = hovering(), ControllerMemory()
    for _ in range(round(time_s * 100)):
        flight = fly(state, memory, setpoint, gains, BODY, INTACT, STILL, STEP_S, 4)
        state, memory = flight.state, flight.memory
    return state


def test_speed_limit_bounds_a_far_position_setpoint() -> None:
    gains = ControllerGains(speed_max_mps=3.0)
    state = settle(Setpoint(300.0, 400.0, -4.0), 8.0, gains)
    assert math.hypot(state[3], state[4]) == pytest.approx(3.0, abs=0.05)
    assert state[4] / state[3] == pytest.approx(4.0 / 3.0, rel=0.01)


@pytest.mark.parametrize("yaw_rad", [0.5, -2.0, 3.0])
def test_yaw_is_reached_without_leaving_the_spot(yaw_rad: float) -> None:
    hold = Setpoint(0.0, 0.0, -4.0, 0.0, 0.0, 0.0, yaw_rad=yaw_rad)
    state = settle(hold, 6.0, ControllerGains())
    assert 2.0 * math.atan2(state.qz, state.qw) == pytest.approx(yaw_rad, abs=0.01)
    assert state[:3] == pytest.approx((0.0, 0.0, -4.0), abs=0.02)


def test_velocity_setpoint_leaves_position_free() -> None:
    nan = math.nan
    state = settle(Setpoint(nan, nan, nan, 1.0, -2.0, 0.0), 4.0, ControllerGains())
    assert state[3:6] == pytest.approx((1.0, -2.0, 0.0), abs=0.02)


def test_acceleration_setpoint_is_flown_without_feedback() -> None:
    nan = math.nan
    state = settle(Setpoint(nan, nan, -4.0, nan, nan, 0.0, 1.0, 0.0), 2.0, ControllerGains())
    assert state.velocity_north_mps == pytest.approx(2.0, abs=0.25)  # less the attitude's lag


def test_an_axis_without_position_and_velocity_has_no_feedback() -> None:
    nan = math.nan
    state = settle(Setpoint(nan, nan, nan, nan, nan, nan, 0.0, 0.0, -1.0), 2.0, ControllerGains())
    assert state.velocity_down_mps == pytest.approx(-2.0, abs=0.2)
    assert state[3:5] == pytest.approx((0.0, 0.0), abs=0.01)


def test_setpoint_moves_along_its_derivatives_between_updates() -> None:
    """One update a second is as good as many, if the motion is a polynomial."""
    gains = ControllerGains()
    state = hovering()._replace(velocity_north_mps=2.0)
    memory = ControllerMemory()
    for second in range(3):
        setpoint = Setpoint(2.0 * second, 0.0, -4.0, 2.0, 0.0, 0.0)
        flight = fly(state, memory, setpoint, gains, BODY, INTACT, STILL, STEP_S, 400)
        state, memory = flight.state, flight.memory
    assert state.north_m == pytest.approx(6.0, abs=0.02)
