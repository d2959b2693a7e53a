"""Starting a leg, ending it, and changing the mission."""

import math

import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.guidance.envelope import HEADING_TOLERANCE_RAD, at_rest_speed_mps
from onboard.guidance.phases import FlightState, IllegalTransitionError, Phase
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to, pose_at


def advance(flight: PerfectFlight, seconds: float, **pose: object) -> None:
    """Advance with a pose that does not follow the setpoints."""
    for _ in range(round(seconds / TICK_S)):
        flight.now_s += TICK_S
        flight.navigator.advance(pose_at(**pose), flight.now_s)  # type: ignore[arg-type]
        flight._note()


# ---------------------------------------------------------------------------- taking control


def test_it_first_comes_to_a_hover(flight: PerfectFlight) -> None:
    flight.pose = pose_at(0.5, 1.0, -4.2, velocity_ned_mps=(0.2, -0.1, 0.0))
    flight.depart()
    assert flight.state is FlightState.ALIGNING
    assert flight.reference.position_leg_m == pytest.approx((0.5, 1.0, -0.2))
    assert flight.reference.velocity_leg_mps == pytest.approx((0.2, -0.1, 0.0))
    current = flight.situation.reference.current
    assert current is not None
    assert current.final.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert flight.texts("phase") == ["cruise (control granted)"]


@pytest.mark.parametrize("state", [s for s in FlightState if s is not FlightState.STANDBY])
def test_control_is_not_taken_twice(flight: PerfectFlight, state: FlightState) -> None:
    flight.situation.state = state
    with pytest.raises(IllegalTransitionError, match="control granted"):
        flight.navigator.take_control(flight.pose, flight.now_s)
    assert flight.state is state
    assert flight.situation.reference.current is None


def test_it_looks_along_the_leg_before_it_cruises(flight: PerfectFlight) -> None:
    flight.depart()
    flight.run_until(FlightState.CRUISING)
    terms = flight.navigator.assessment.terms
    hover_s = 1.0
    look_s = terms.frame_age_max_s + terms.reaction_time_s
    assert flight.now_s == pytest.approx(hover_s + look_s, abs=3.0 * TICK_S)


@pytest.mark.parametrize(
    ("yaw_rad", "aligned"),
    [
        (HEADING_TOLERANCE_RAD - 1e-6, True),
        (-HEADING_TOLERANCE_RAD + 1e-6, True),
        (2.0 * math.pi, True),
        (HEADING_TOLERANCE_RAD + 1e-6, False),
        (math.pi, False),
    ],
)
def test_the_nose_has_to_point_along_the_leg(
    flight: PerfectFlight, yaw_rad: float, aligned: bool
) -> None:
    flight.depart()
    advance(flight, 5.0, yaw_rad=yaw_rad)
    assert (flight.state is FlightState.CRUISING) is aligned
    assert flight.navigator.cruising_freely is aligned
    assert flight.navigator.moving is aligned
    assert flight.navigator.flying


def test_the_vehicle_has_to_be_at_rest(flight: PerfectFlight) -> None:
    slow_mps = at_rest_speed_mps(flight.navigator.assessment)
    flight.depart()
    advance(flight, 5.0, velocity_ned_mps=(0.0, slow_mps + 0.01, 0.0))
    assert flight.states == [FlightState.ALIGNING]
    advance(flight, 5.0, velocity_ned_mps=(0.0, slow_mps - 0.01, 0.0))
    assert flight.states == [FlightState.ALIGNING, FlightState.CRUISING]


def test_a_look_that_is_interrupted_begins_anew(flight: PerfectFlight) -> None:
    flight.depart()
    advance(flight, 1.0)
    for _ in range(10):
        advance(flight, 0.3)
        advance(flight, 0.1, yaw_rad=0.2)
    assert flight.states == [FlightState.ALIGNING]


# ---------------------------------------------------------------------------- ending a leg


def test_a_mission_of_one_leg_is_flown(cruising: PerfectFlight) -> None:
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.reference.position_leg_m == pytest.approx((60.0, 0.0, 0.0))
    assert cruising.texts("phase") == ["cruise (control granted)", "arrived (mission flown)"]
    position_m = cruising.pose.position_ned_m
    cruising.run(5.0)
    assert cruising.pose.position_ned_m == position_m


def test_the_next_leg_begins_where_the_vehicle_is(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((30.0, 0.0), (30.0, 40.0)))
    flight.pose = pose_at(0.0, 1.5)
    flight.cruise_at_full_speed()
    flight.run_until(FlightState.ALIGNING)
    assert flight.navigator.leg.origin_ned_m == pytest.approx((30.0, 1.5, -4.0))
    assert flight.navigator.leg.heading_rad == pytest.approx(math.pi / 2.0)
    assert flight.reference.position_leg_m == pytest.approx((0.0, 0.0, 0.0))
    flight.run_until(FlightState.ARRIVED)
    assert flight.pose.position_ned_m == pytest.approx((30.0, 40.0, -4.0))
    assert "cruise (leg flown)" in flight.texts("phase")


def test_obstacles_are_known_on_the_next_leg_too(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((30.0, 0.0), (30.0, 40.0)))
    flight.see(30.0, 20.0)
    flight.cruise_at_full_speed()
    flight.run_until(FlightState.ALIGNING)
    (known,) = flight.navigator.obstacles
    assert known.measured.x_min_m == pytest.approx(19.5)
    assert known.measured.y_min_m == pytest.approx(-0.5)
    flight.run_until(FlightState.AVOIDING)


def test_an_end_beside_the_target_is_not_accepted(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((60.0, 0.0), half_width_m=1.0))
    flight.pose = pose_at(0.0, 1.5)
    flight.depart()
    flight.run_until(FlightState.HOLDING)
    assert flight.texts("violation") == ["target_reached: 1.50, limit 1.00 m"]


# ---------------------------------------------------------------------------- giving control back


@pytest.mark.parametrize("seconds", [0.0, 1.0, 4.0, 12.0])
def test_the_pilot_takes_over_at_any_time(flight: PerfectFlight, seconds: float) -> None:
    flight.see(25.0, 0.2)
    flight.depart()
    flight.run(seconds)
    flight.navigator.release_control(flight.now_s)
    assert flight.navigator.phase is Phase.STANDBY
    assert flight.navigator.reference(flight.now_s) is None
    assert flight.navigator.setpoint(flight.now_s) is None
    assert flight.navigator.avoidance is None
    assert flight.texts("phase")[-1] == "standby (control taken)"


def test_giving_back_what_was_not_taken_reports_nothing(flight: PerfectFlight) -> None:
    flight.navigator.release_control(0.0)
    assert flight.state is FlightState.STANDBY
    assert flight.navigator.events == []


def test_the_leg_is_resumed_from_where_the_pilot_leaves_the_vehicle(
    cruising: PerfectFlight,
) -> None:
    cruising.navigator.release_control(cruising.now_s)
    cruising.pose = pose_at(30.0, 2.0)
    cruising.depart()
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.pose.position_ned_m == pytest.approx((60.0, 2.0, -4.0))


# ---------------------------------------------------------------------------- another mission

OTHER = mission_to((10.0, 30.0))


def test_in_standby_another_mission_begins_at_its_start(flight: PerfectFlight) -> None:
    flight.navigator.change_mission(OTHER, 0.0)
    assert flight.state is FlightState.STANDBY
    assert flight.situation.route.mission is OTHER
    (event,) = flight.navigator.events
    assert event.text == "mission changed: flying the new mission after control is granted"
    assert event.data == {"mission": OTHER.model_dump(mode="json")}


def test_in_standby_its_altitude_counts_for_the_contract(flight: PerfectFlight) -> None:
    low = mission_to((60.0, 0.0), altitude_m=0.35)
    clauses = {clause.name: clause for clause in flight.navigator.assessment.clauses}
    flight.navigator.change_mission(low, 0.0)
    lower = {clause.name: clause for clause in flight.navigator.assessment.clauses}
    margin_m, less_m = (c["ground_clearance"].margin for c in (clauses, lower))
    assert margin_m - less_m == pytest.approx(3.65)
    assert flight.navigator.leg.origin_ned_m[2] == -0.35


def test_another_altitude_is_refused_in_flight(cruising: PerfectFlight) -> None:
    for _ in range(3):
        cruising.navigator.change_mission(mission_to((0.0, 40.0), altitude_m=9.0), cruising.now_s)
    assert cruising.state is FlightState.CRUISING
    assert cruising.texts("mission_refused") == [
        "mission refused: altitude 9 m (expected 4 m while in flight)"
    ]
    assert cruising.texts("mission_changed") == []


def test_while_the_nose_turns_it_stops_there(flight: PerfectFlight) -> None:
    flight.depart()
    flight.run(0.2)
    flight.navigator.change_mission(OTHER, flight.now_s)
    assert flight.state is FlightState.STOPPING_UNALIGNED
    # The nose points anywhere: nothing may be concluded from it.
    assert not flight.navigator.cruising_freely
    assert not flight.navigator.moving
    flight.run_until(FlightState.ALIGNING)
    assert flight.situation.route.mission is OTHER
    assert flight.navigator.leg.origin_ned_m == pytest.approx((0.0, 0.0, -4.0))
    assert FlightState.CRUISING not in flight.states


def test_an_avoidance_is_finished_first(avoiding: PerfectFlight) -> None:
    avoidance = avoiding.situation.avoidance
    assert avoidance is not None
    avoiding.navigator.change_mission(OTHER, avoiding.now_s)
    assert avoiding.navigator.avoidance is avoidance
    avoiding.run_until(FlightState.ALIGNING)
    assert avoiding.states[-4:] == [
        FlightState.AVOIDING,
        FlightState.AVOIDING_THEN_STOPPING,
        FlightState.STOPPING,
        FlightState.ALIGNING,
    ]
    assert avoiding.now_s > avoidance.plan.trajectory.end_s


@pytest.mark.parametrize("state", [FlightState.ARRIVED, FlightState.HOLDING])
def test_a_hover_goes_on_until_the_pilot_has_taken_over(
    cruising: PerfectFlight, state: FlightState
) -> None:
    if state is FlightState.HOLDING:
        cruising.navigator.hold(DEFECT, cruising.now_s)
        cruising.run(4.0)
    else:
        cruising.run_until(state)
    position_m, mission = cruising.pose.position_ned_m, cruising.situation.route.mission
    cruising.navigator.change_mission(OTHER, cruising.now_s)
    cruising.run(3.0)
    assert cruising.state is state
    assert cruising.pose.position_ned_m == position_m
    assert cruising.situation.route.mission is mission
    cruising.navigator.release_control(cruising.now_s)
    assert cruising.situation.route.mission is OTHER


def test_a_mission_that_ends_where_the_vehicle_stops_is_flown(cruising: PerfectFlight) -> None:
    cruising.navigator.change_mission(OTHER, cruising.now_s)
    current = cruising.situation.reference.current
    assert current is not None
    here_m = current.final.position_leg_m
    cruising.navigator.change_mission(mission_to(here_m[:2]), cruising.now_s)
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.pose.position_ned_m[:2] == pytest.approx(here_m[:2], abs=0.05)


def test_the_last_of_several_missions_counts(cruising: PerfectFlight) -> None:
    cruising.navigator.change_mission(mission_to((0.0, 50.0)), cruising.now_s)
    cruising.run(0.5)
    assert cruising.states[-1] is FlightState.STOPPING
    cruising.navigator.change_mission(OTHER, cruising.now_s)
    assert cruising.state is FlightState.STOPPING
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.pose.position_ned_m == pytest.approx((10.0, 30.0, -4.0), abs=0.05)


def test_stopping_beside_the_target_does_not_fail(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((60.0, 0.0), half_width_m=0.5))
    flight.cruise_at_full_speed()
    flight.navigator.change_mission(OTHER, flight.now_s)
    flight.run_until(FlightState.ARRIVED)
    assert flight.texts("violation") == []
