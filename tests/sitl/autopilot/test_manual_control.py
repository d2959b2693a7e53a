"""What the pilot's sticks command."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.autopilot.manual_control import ManualControl

SPEED_MPS, CLIMB_MPS, SINK_MPS = 10.0, 3.0, 1.5


def sticks(x: int = 0, y: int = 0, z: int = 500, r: int = 0, now_s: float = 0.0) -> ManualControl:
    """Return sticks in a position: x forward, y right, z throttle, r clockwise."""
    control = ManualControl()
    control.receive(SimpleNamespace(x=x, y=y, z=z, r=r), now_s)
    return control


def velocity(control: ManualControl, yaw_rad: float = 0.0) -> tuple[float, float, float]:
    return control.velocity_ned_mps(yaw_rad, SPEED_MPS, CLIMB_MPS, SINK_MPS)


def test_before_the_first_message_the_sticks_are_centred_and_infinitely_old() -> None:
    control = ManualControl()
    assert velocity(control) == (0.0, 0.0, 0.0)
    assert control.yaw_rate_radps == 0.0
    assert control.age_s(100.0) == math.inf


def test_the_age_counts_from_the_last_message() -> None:
    assert sticks(now_s=2.0).age_s(2.5) == 0.5


@pytest.mark.parametrize(
    ("position", "velocity_ned_mps"),
    [
        ({"x": 1000}, (10.0, 0.0, 0.0)),
        ({"x": -1000}, (-10.0, 0.0, 0.0)),
        ({"y": 500}, (0.0, 5.0, 0.0)),
        ({"z": 1000}, (0.0, 0.0, -3.0)),
        ({"z": 0}, (0.0, 0.0, 1.5)),
        ({"z": 750}, (0.0, 0.0, -1.5)),
        ({"x": 40, "y": -40, "z": 520}, (0.0, 0.0, 0.0)),  # within the dead band
        ({"x": 1001, "y": -32768, "z": 1001}, (0.0, 0.0, 0.0)),  # outside the range
    ],
)
def test_a_stick_commands_its_share_of_the_speed(
    position: dict[str, int], velocity_ned_mps: tuple[float, float, float]
) -> None:
    assert velocity(sticks(**position)) == pytest.approx(velocity_ned_mps)


def test_forward_is_where_the_nose_points() -> None:
    assert velocity(sticks(x=1000), math.pi / 2.0) == pytest.approx((0.0, 10.0, 0.0))
    assert velocity(sticks(y=1000), math.pi / 2.0) == pytest.approx((-10.0, 0.0, 0.0))


@given(x=st.integers(-1000, 1000), y=st.integers(-1000, 1000), yaw_rad=st.floats(-math.pi, math.pi))
def test_the_heading_changes_the_direction_only(x: int, y: int, yaw_rad: float) -> None:
    control = sticks(x, y)
    turned, straight = velocity(control, yaw_rad), velocity(control)
    assert math.hypot(*turned) == pytest.approx(math.hypot(*straight), abs=1e-9)


@pytest.mark.parametrize(("r", "rate_degps"), [(1000, 90.0), (-500, -45.0), (0, 0.0), (1500, 0.0)])
def test_the_yaw_stick_commands_a_rate(r: int, rate_degps: float) -> None:
    assert math.degrees(sticks(r=r).yaw_rate_radps) == pytest.approx(rate_degps)
