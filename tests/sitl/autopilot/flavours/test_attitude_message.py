"""SET_ATTITUDE_TARGET: which acceleration an attitude and a thrust mean."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase

from sitl.autopilot.flavours.attitude_message import attitude_setpoint

HOVER, G = 0.5, 9.81
RATES_IGNORED = 0x07
NAN = math.nan


def attitude(
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    yaw_deg: float = 0.0,
    thrust: float = HOVER,
    mask: int = RATES_IGNORED,
) -> Any:
    quaternion = QuaternionBase([math.radians(each) for each in (roll_deg, pitch_deg, yaw_deg)])
    return mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, mask, list(quaternion.q), 0.0, 0.0, 0.0, thrust
    )


@pytest.mark.parametrize(
    ("message", "acceleration_mps2"),
    [
        (attitude(), (0.0, 0.0, 0.0)),
        (attitude(thrust=0.75), (0.0, 0.0, -0.5 * G)),
        (attitude(thrust=0.0), (0.0, 0.0, G)),
        (attitude(pitch_deg=-20.0), (0.342 * G, 0.0, 0.0603 * G)),  # nose down: forward
        (attitude(roll_deg=20.0), (0.0, 0.342 * G, 0.0603 * G)),
        (attitude(pitch_deg=-20.0, yaw_deg=90.0), (0.0, 0.342 * G, 0.0603 * G)),
    ],
)
def test_thrust_acts_along_the_body_against_gravity(
    message: Any, acceleration_mps2: tuple[float, float, float]
) -> None:
    setpoint = attitude_setpoint(message, HOVER)
    assert setpoint is not None
    assert setpoint[6:9] == pytest.approx(acceleration_mps2, abs=0.02)
    assert all(map(math.isnan, setpoint[:6]))


@pytest.mark.parametrize("yaw_deg", [-170.0, 0.0, 45.0])
def test_the_heading_is_that_of_the_attitude(yaw_deg: float) -> None:
    setpoint = attitude_setpoint(attitude(pitch_deg=-10.0, yaw_deg=yaw_deg), HOVER)
    assert setpoint is not None
    assert math.degrees(setpoint.yaw_rad) == pytest.approx(yaw_deg, abs=1e-3)


def spoiled(**changes: Any) -> Any:
    message = attitude()
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    "message",
    [
        attitude(mask=0x80),  # body rates only
        attitude(mask=0x40),  # no thrust
        attitude(mask=0x20),  # thrust as a vector
        attitude(thrust=NAN),
        attitude(thrust=1.5),
        attitude(thrust=-0.1),
        spoiled(q=[0.0, 0.0, 0.0, 0.0]),
        spoiled(q=[NAN, 0.0, 0.0, 1.0]),
        spoiled(q=[3.0, 0.0, 0.0, 0.0]),
    ],
)
def test_what_gives_no_attitude_and_thrust_is_ignored(message: Any) -> None:
    assert attitude_setpoint(message, HOVER) is None


@given(st.lists(st.floats(width=32), min_size=5, max_size=5))
def test_no_numbers_break_it(values: list[float]) -> None:
    setpoint = attitude_setpoint(spoiled(q=values[:4], thrust=values[4]), HOVER)
    assert setpoint is None or all(map(math.isfinite, setpoint[6:]))
