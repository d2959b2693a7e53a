"""The adversary's plant: exactly what it is told, plus the errors that it wants."""

from __future__ import annotations

import math
from typing import Any

import pytest

from sitl.plant.inner_loop import Flight
from sitl.plant.kinematic import follow
from sitl.plant.multirotor import GRAVITY_MPS2, standing_state
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import VehicleTruth

START = Flight.of(standing_state(1.0, 2.0, -3.0, 0.0, 4000.0))


def truth(flight: Flight) -> VehicleTruth:
    values: Any = flight.values
    return VehicleTruth(
        0.0, values[0:3], values[3:6], values[20:23], values[6:10], values[10:13], values[13:17]
    )


def test_it_is_where_its_setpoint_will_be() -> None:
    setpoint = Setpoint.of(
        (1.0, 2.0, -3.0), (2.0, 0.0, 0.0), (1.0, -1.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0
    )
    after = truth(follow(START, setpoint, 0.01, 0.02))
    assert after.position_ned_m == pytest.approx((1.06045, 1.99955, -3.0))
    assert after.velocity_ned_mps == pytest.approx((2.03, -0.03, 0.0))
    assert after.acceleration_ned_mps2 == (1.0, -1.0, 0.0)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.0])
def test_its_attitude_delivers_the_acceleration(yaw_rad: float) -> None:
    setpoint = Setpoint.of(
        (0.0, 0.0, -3.0), (0.0, 0.0, 0.0), (1.5, -2.0, 0.5), (0.0, 0.0, 0.0), yaw_rad, 0.0
    )
    after = truth(follow(START, setpoint, 0.0, 2.0))
    assert after.yaw_rad == pytest.approx(yaw_rad)
    w, x, y, z = after.attitude_quaternion
    # The thrust axis is the body's upward one, in NED.
    axis = (-2.0 * (x * z + w * y), -2.0 * (y * z - w * x), 2.0 * (x * x + y * y) - 1.0)
    thrust = [a - b for a, b in zip((1.5, -2.0, 0.5), (0.0, 0.0, GRAVITY_MPS2), strict=True)]
    length = math.hypot(*thrust)
    assert axis == pytest.approx([each / length for each in thrust])


def test_the_velocity_error_is_in_full_from_one_metre_a_second_on() -> None:
    for speed_mps, share in ((0.0, 0.0), (0.5, 0.5), (3.0, 1.0)):
        setpoint = Setpoint(
            velocity_north_mps=speed_mps, velocity_east_mps=0.0, velocity_down_mps=0.0
        )
        after = truth(follow(START, setpoint, 0.0, 0.02, (0.2, 0.1)))
        expected = (speed_mps + 0.2 * share, 0.1 * share, 0.0)
        assert after.velocity_ned_mps == pytest.approx(expected)
        assert after.position_ned_m[0] == pytest.approx(1.0 + 0.02 * speed_mps)


def test_without_a_velocity_it_stays_and_it_never_digs_in() -> None:
    stays = truth(follow(START, Setpoint(), 0.0, 1.0))
    assert stays.position_ned_m == (1.0, 2.0, -3.0)
    assert stays.velocity_ned_mps == (0.0, 0.0, 0.0)
    landed = truth(follow(START, Setpoint(velocity_down_mps=9.0), 0.0, 1.0))
    assert landed.position_ned_m[2] == 0.0


def test_the_nose_turns_no_faster_than_the_plant_can() -> None:
    turning = truth(follow(START, Setpoint(yaw_rad=3.0), 0.0, 0.5))
    assert turning.yaw_rad == pytest.approx(1.0)
    assert turning.body_rates_radps[2] == pytest.approx(2.0)
