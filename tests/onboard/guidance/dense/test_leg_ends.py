"""Where a leg begins at another height, and where an obstacle stands on its end."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from onboard.contract.assessment import TICK_S
from onboard.geometry.box import Box
from onboard.guidance.dense.level import CLIMB_MPS, LEVEL_M
from onboard.guidance.dense.threaded_leg import end_beside, is_blocked
from onboard.guidance.phases import FlightState
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace, Stem
from tests.onboard.guidance.perfect_flight import pose_at

FlightOver = Callable[..., FieldFlight]
OVER = (FlightState.ARRIVED, FlightState.HOLDING)


# ------------------------------------------------------------------ another height


@pytest.mark.parametrize("above_m", [-1.2, 0.3, 1.2])
def test_a_start_at_another_height_is_left_on_the_spot_before_anything_is_seen(
    flight_over: FlightOver, above_m: float
) -> None:
    flight = flight_over(ends_ned_m=((12.0, 0.0),))
    flight.pose = pose_at(0.2, -0.1, -4.0 - above_m)
    flight.depart()
    accelerations_mps2 = [0.0]
    while abs(flight.pose.position_ned_m[2] + 4.0) > LEVEL_M:
        flight.tick()
        assert flight.pose.position_ned_m[:2] == (0.2, -0.1)
        assert flight.thread.way.certified is None
        assert flight.thread.pause_reason == "going to the height of the leg"
        assert flight.reference.velocity_leg_mps[:2] == (0.0, 0.0)
        assert abs(flight.reference.velocity_leg_mps[2]) <= CLIMB_MPS + 1e-9
        accelerations_mps2.append(flight.reference.acceleration_leg_mps2[2])
        assert flight.now_s < 10.0
    jerk_mps3 = np.abs(np.diff(accelerations_mps2)).max() / TICK_S
    assert jerk_mps3 <= flight.situation.envelope.jerk_max_mps3[2] + 1e-6
    flight.run_until(FlightState.ARRIVED)
    assert flight.pose.position_ned_m[2] == pytest.approx(-4.0)
    assert flight.clearance_m > 0.0


def test_a_climb_ends_where_the_pilot_takes_over(flight_over: FlightOver) -> None:
    flight = flight_over(ends_ned_m=((12.0, 0.0),))
    flight.pose = pose_at(0.0, 0.0, -3.0)
    flight.depart()
    flight.run(0.5)
    flight.navigator.release_control(flight.now_s)
    assert flight.navigator.setpoint(flight.now_s) is None
    flight.pose = pose_at()
    flight.depart()
    flight.run_until(FlightState.ARRIVED)


def test_a_flight_that_is_held_on_its_way_to_the_height_hovers_there(
    flight_over: FlightOver,
) -> None:
    flight = flight_over(seen=IdealSeenSpace(refusing=True))
    flight.pose = pose_at(0.0, 0.0, -3.0)
    flight.depart()
    flight.run_until(FlightState.HOLDING)
    assert flight.pose.position_ned_m[2] == pytest.approx(-4.0)


# ------------------------------------------------------------------ a blocked end


def test_an_obstacle_on_the_end_ends_the_leg_beside_it(flight_over: FlightOver) -> None:
    flight = flight_over(Stem(14.0, 0.0, 0.3), ends_ned_m=((14.0, 0.0),))
    flight.depart()
    flight.run(120.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.ARRIVED, flight.events
    assert flight.thread.pauses <= 4
    assert math.dist(flight.pose.position_ned_m[:2], (14.0, 0.0)) < 2.5
    assert flight.clearance_m > 0.0


def test_where_no_place_is_left_a_blocked_end_is_named_after_a_look(
    flight_over: FlightOver,
) -> None:
    flight = flight_over(Stem(14.0, 0.0, 0.8), ends_ned_m=((14.0, 0.0),))
    legs = flight.navigator.situation.route.mission.legs
    narrow = [
        leg.model_copy(update={"target_half_width_m": 0.8, "corridor_half_width_m": 8.0})
        for leg in legs
    ]
    route = flight.navigator.situation.route
    route.mission = route.mission.model_copy(update={"legs": tuple(narrow)})
    flight.depart()
    flight.run(120.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.HOLDING
    assert "leg_end_clear" in flight.texts("violation")[0]
    assert 1 <= flight.thread.pauses <= 4
    assert flight.clearance_m > 0.0


def test_the_other_end_is_the_nearest_free_place() -> None:
    end, box = (10.0, 0.0), Box(9.0, 11.0, -0.4, 2.0)
    assert is_blocked(end, [box], 0.5)
    place = end_beside(end, [box], 0.5, 2.0)
    assert place == pytest.approx((10.0, -1.0))
    assert place is not None
    assert not is_blocked(place, [box], 0.5)
    assert end_beside(end, [box], 0.5, 0.8) is None
    assert end_beside(end, [box], 0.5, -1.0) is None
    assert end_beside(end, [], 0.5, 1.0) == pytest.approx(end)
