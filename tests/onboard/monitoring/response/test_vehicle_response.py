"""The response as a whole: what each monitor is given, and what a departure forgets."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.response.second_commander import CONFIRMATIONS, SPAN_MIN_S
from onboard.monitoring.response.tracking import CONFIRMATIONS as TRACKING_CONFIRMATIONS
from onboard.monitoring.response.trim import LEARNING_TIME_S
from onboard.monitoring.response.vehicle_response import VehicleResponse
from onboard.monitoring.response.wind import CONFIRMATION_S
from onboard.vehicle_state import Pose, Setpoint
from tests.onboard.monitoring.fake_flight import FakeFlight

STILL = (0.0, 0.0, 0.0)
HOVER = Setpoint((0.0, 0.0, -4.0), STILL, STILL, 0.0)


def pose_at(now_s: float, east_m: float = 0.0, pitch_rad: float = 0.0) -> Pose:
    return Pose(now_s, (0.0, east_m, -4.0), STILL, 0.0, pitch_rad, 0.0)


def heard(link: MavlinkEndpoint, autopilot: int, now_s: float = 0.0) -> None:
    """Let the link hear what autopilot it is, and that it is in the air."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    messages = (
        mavlink.MAVLink_heartbeat_message(2, autopilot, 128 | 1, 4, 4, 3),
        mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR),
    )
    link.receive(b"".join(message.pack(sender) for message in messages), now_s)


@pytest.fixture
def link() -> MavlinkEndpoint:
    link = MavlinkEndpoint(1)
    heard(link, mavlink.MAV_AUTOPILOT_PX4)
    return link


@pytest.fixture
def flight(contract: Contract) -> FakeFlight:
    return FakeFlight.under(contract)


@pytest.mark.parametrize(
    ("autopilot", "explained"),
    [(mavlink.MAV_AUTOPILOT_PX4, True), (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, False)],
)
def test_velocity_from_a_position_error_is_explained_on_px4_only(
    link: MavlinkEndpoint, autopilot: int, *, explained: bool
) -> None:
    """PX4 echoes its controller's output, ArduPilot the setpoint that it took."""
    heard(link, autopilot)
    response, found = VehicleResponse(link), []
    link.target = ((0.0, 0.0, -4.0), (0.0, -0.5, 0.0))  # back to us, by 1 per second
    for step in range(round((SPAN_MIN_S + 1.0) / TICK_S)):
        now_s = step * TICK_S
        response.sent.add(HOVER, now_s)
        link.target_heard_s = now_s
        found.append(response.check_commander(pose_at(now_s, 0.5), now_s))
    assert any(found) is not explained
    assert len(found) > CONFIRMATIONS


def test_deviations_before_the_departure_do_not_count_after_it(
    link: MavlinkEndpoint, flight: FakeFlight
) -> None:
    response = VehicleResponse(link)
    for step in range(TRACKING_CONFIRMATIONS - 1):
        assert response.check_tracking(pose_at(step * TICK_S, 1.0), flight) == []
    response.begin_flight()
    assert response.tracking_monitor.position_error_m == 0.0
    assert response.check_tracking(pose_at(1.0, 1.0), flight) == []
    for step in range(TRACKING_CONFIRMATIONS):
        found = response.check_tracking(pose_at(1.02 + step * TICK_S, 1.0), flight)
    assert [violation.assumption for violation in found] == [Assumption.TRACKING_ERROR]


def test_a_setpoint_of_another_before_the_departure_does_not_blame_the_flight(
    link: MavlinkEndpoint,
) -> None:
    response = VehicleResponse(link)
    response.sent.add(HOVER, 0.0)
    link.target, link.target_heard_s = ((9.0, 9.0, -4.0), STILL), 0.0
    response.check_commander(pose_at(0.0), 0.0)
    assert response.follows_another(0.0)
    response.begin_flight()
    assert not response.follows_another(0.0)


def test_the_trim_learnt_before_the_departure_is_kept(
    link: MavlinkEndpoint, flight: FakeFlight
) -> None:
    terms = replace(flight.assessment.terms, wind_max_mps=1.0, drag_per_s=0.2)
    response = VehicleResponse(link)
    for step in range(round((LEARNING_TIME_S + 0.1) / TICK_S)):
        response.check_tilt(pose_at(step * TICK_S, pitch_rad=-0.2), terms)
    response.begin_flight()
    assert response.check_wind(0.0, terms) is None
    found = response.check_wind(CONFIRMATION_S, terms)
    assert found is not None
    assert found.assumption is Assumption.WIND


def test_on_the_ground_the_trim_is_forgotten(link: MavlinkEndpoint, flight: FakeFlight) -> None:
    terms = replace(flight.assessment.terms, wind_max_mps=1.0, drag_per_s=0.2)
    response = VehicleResponse(link)
    for step in range(round((LEARNING_TIME_S + 0.1) / TICK_S)):
        response.check_tilt(pose_at(step * TICK_S, pitch_rad=-0.2), terms)
    link.status = replace(link.status, airborne=False)
    response.check_tilt(pose_at(LEARNING_TIME_S + 0.2, pitch_rad=-0.2), terms)
    assert response.check_wind(0.0, terms) is None
    assert response.check_wind(CONFIRMATION_S, terms) is None
