"""Along the leg: to its end, back to its line, or to a stop for another mission."""

from typing import Any

import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import load_contract
from onboard.guidance.cruise import Cruise
from onboard.guidance.phases import FlightState
from onboard.motion.trajectory import State
from onboard.planning.closed_form import cruise
from onboard.planning.problem import Envelope
from tests.onboard.conftest import CONFIG
from tests.onboard.guidance.perfect_flight import PerfectFlight, mission_to

# The published regions are wider than the separation that the file states for its own.
PURE_FORM = ("requirements.stop=false", "environment.obstacle_separation_min_m=30")


@pytest.fixture
def recentring() -> PerfectFlight:
    """A long leg under a contract that drifts back to the line, 2 m to its left."""
    contract = load_contract(CONFIG / "recentring_contract.yaml", PURE_FORM)
    flight = PerfectFlight(contract, mission_to((150.0, 0.0)))
    flight.pose = flight.pose._replace(position_ned_m=(0.0, -2.0, -4.0))
    flight.depart()
    return flight


def final_x_m(flight: PerfectFlight) -> float:
    current = flight.situation.reference.current
    assert current is not None
    return current.final.position_leg_m[0]


# ---------------------------------------------------------------------------- straight on


def test_the_cruise_stops_at_the_end_of_the_leg(cruising: PerfectFlight) -> None:
    assert final_x_m(cruising) == pytest.approx(60.0)
    cruising.run(3.0)
    assert cruising.state is FlightState.CRUISING
    assert cruising.reference.velocity_leg_mps == pytest.approx((2.8, 0.0, 0.0))


def test_a_leg_that_ends_too_near_is_overshot_no_farther_than_braking_needs(
    cruising: PerfectFlight,
) -> None:
    state = State((59.5, 0.0, 0.0), (2.8, 0.0, 0.0))
    Cruise(cruising.situation, cruising.navigator._fallback).fly_from(state, cruising.now_s)
    stopping_m = cruising.navigator.assessment.inflated.stopping_distance_m
    assert 60.0 < final_x_m(cruising) <= 59.5 + stopping_m
    assert cruising.state is FlightState.CRUISING


def test_a_cruise_that_the_certifier_rejects_ends_in_a_hold(
    cruising: PerfectFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_fast(state: State, start_s: float, envelope: Envelope, *_: object, **__: object) -> Any:
        return cruise(state, start_s, envelope, 4.0)

    monkeypatch.setattr("onboard.guidance.cruise.stop_at", too_fast)
    cruising.navigator._cruise.replan(cruising.reference, cruising.now_s)
    assert cruising.state is FlightState.HOLDING
    assert cruising.texts("certificate")[0].startswith("the certifier rejected the cruise: ")
    assert cruising.texts("violation") == ["self_check: 1.00, limit 0.00 certificates"]


def test_the_cruise_returns_to_its_height(cruising: PerfectFlight) -> None:
    high = State((10.0, 0.0, -1.0), (2.8, 0.0, 0.0))
    cruising.navigator._cruise.replan(high, cruising.now_s)
    cruising.run(6.0)
    assert cruising.reference.position_leg_m[2] == pytest.approx(0.0, abs=1e-9)
    assert cruising.state is FlightState.CRUISING


# ---------------------------------------------------------------------------- obstacles


def advance(flight: PerfectFlight) -> str | None:
    """Have a cruise decide one tick of a flight; return the obstacle to avoid."""
    obstacle = flight.navigator._cruise.advance(flight.now_s)
    return None if obstacle is None else obstacle.id


@pytest.mark.parametrize(("ahead_m", "met"), [(-0.01, True), (0.01, True), (0.1, False)])
def test_an_obstacle_is_met_where_its_region_begins_before_the_next_tick(
    cruising: PerfectFlight, ahead_m: float, met: bool
) -> None:
    front_m = cruising.see(40.0, 0.0).region.approach_x_m
    assert 0.01 < 2.8 * TICK_S < 0.1
    here = State((front_m - ahead_m, 0.0, 0.0), (2.8, 0.0, 0.0))
    cruising.navigator._cruise.replan(here, cruising.now_s)
    assert advance(cruising) == ("front/1" if met else None)


@pytest.mark.parametrize("y_m", [-8.0, 8.0])
def test_an_obstacle_beside_the_way_is_not_met(cruising: PerfectFlight, y_m: float) -> None:
    cruising.see(20.0, y_m)
    cruising.run_until(FlightState.ARRIVED)
    assert FlightState.AVOIDING not in cruising.states
    assert cruising.planner.problems == []


def test_an_obstacle_beyond_the_end_of_the_leg_is_not_met(cruising: PerfectFlight) -> None:
    obstacle = cruising.see(66.0, 0.0)
    assert obstacle.region.approach_x_m < 60.0 < obstacle.region.keep_out.x_min_m
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.planner.problems == []
    assert cruising.texts("violation") == []


def test_a_leg_that_ends_inside_a_region_is_not_flown_to_its_end(cruising: PerfectFlight) -> None:
    obstacle = cruising.see(60.0, 0.0)
    cruising.run_until(FlightState.HOLDING)
    (text,) = cruising.texts("violation")
    short_m = obstacle.region.x_pob_m - 60.0
    assert text == f"leg_end_clear (front/1): {short_m:.2f}, limit 0.00 m"
    cruising.run(4.0)
    assert cruising.reference.position_leg_m[0] < obstacle.region.obstacle.x_min_m
    assert cruising.planner.problems == []


# ---------------------------------------------------------------------------- recentring


def test_it_drifts_back_to_the_leg_line_and_cruises_on(recentring: PerfectFlight) -> None:
    recentring.run_until(FlightState.RECENTRING)
    x_m = recentring.reference.position_leg_m[0]
    # What is beside has been in view: so far it has flown straight on.
    corridor = recentring.navigator.assessment.corridor
    assert corridor is not None
    assert x_m >= corridor.reach_m
    recentring.run_until(FlightState.ARRIVED)
    assert recentring.states[-4:] == [
        FlightState.CRUISING,
        FlightState.RECENTRING,
        FlightState.CRUISING,
        FlightState.ARRIVED,
    ]
    assert abs(recentring.reference.position_leg_m[1]) < 0.05
    assert recentring.texts("phase") == ["cruise (control granted)", "arrived (mission flown)"]


def test_the_drift_has_ended_before_the_vehicle_slows_down() -> None:
    """Else it would be faster sideways, for its speed along the leg, than the view allows for."""
    contract = load_contract(CONFIG / "recentring_contract.yaml", PURE_FORM)
    flight = PerfectFlight(contract, mission_to((60.0, 0.0), half_width_m=20.0))
    flight.pose = flight.pose._replace(position_ned_m=(0.0, -12.0, -4.0))
    flight.depart()
    corridor = flight.navigator.assessment.corridor
    assert corridor is not None
    flight.run_until(FlightState.RECENTRING)
    drifts_mps = {True: 0.0, False: 0.0}
    for state in flight.states_to_arrival():
        along_mps, lateral_mps, _ = state.velocity_leg_mps
        fast = along_mps >= corridor.speed_min_mps - 1e-6
        drifts_mps[fast] = max(drifts_mps[fast], abs(lateral_mps))
    assert abs(flight.reference.position_leg_m[1]) > 1.0, "the leg line was reached"
    assert drifts_mps[True] == pytest.approx(0.40)
    assert drifts_mps[False] == pytest.approx(0.0, abs=1e-9)


def test_while_it_drifts_it_counts_as_cruising_freely(recentring: PerfectFlight) -> None:
    recentring.run_until(FlightState.RECENTRING)
    recentring.run(1.0)
    lateral_mps = recentring.reference.velocity_leg_mps[1]
    assert 0.0 < lateral_mps <= 0.40 + 1e-9
    assert recentring.navigator.cruising_freely
    assert recentring.navigator.phase.value == "cruise"


def test_an_obstacle_in_the_corridor_ends_the_drift(recentring: PerfectFlight) -> None:
    corridor = recentring.navigator.assessment.corridor
    assert corridor is not None
    recentring.run_until(FlightState.RECENTRING)
    recentring.run(0.5)
    x_m, y_m, _ = recentring.reference.position_leg_m
    recentring.see(x_m + 8.0, y_m + 3.5, size_m=(0.5, 0.5))
    recentring.tick()
    assert recentring.state.value == "cruising"
    blocked_x_m = recentring.reference.position_leg_m[0]
    recentring.run(2.0)
    assert recentring.reference.velocity_leg_mps[1] == pytest.approx(0.0, abs=1e-9)
    # The next one begins once it has flown straight on from there, past the obstacle.
    recentring.run_until(FlightState.RECENTRING)
    assert recentring.reference.position_leg_m[0] >= blocked_x_m + corridor.reach_m


@pytest.mark.parametrize(("ahead_m", "ends"), [(-0.5, True), (0.5, False)])
def test_the_corridor_reaches_as_far_ahead_as_it_says(
    recentring: PerfectFlight, ahead_m: float, ends: bool
) -> None:
    corridor = recentring.navigator.assessment.corridor
    assert corridor is not None
    recentring.run_until(FlightState.RECENTRING)
    x_m, y_m, _ = recentring.reference.position_leg_m
    probe = recentring.see(140.0, 0.0, size_m=(0.5, 0.5), name="probe")
    front_m = 140.0 - probe.region.approach_x_m
    beside_m = y_m + corridor.side_m / 2.0
    recentring.see(x_m + corridor.reach_m + front_m + ahead_m, beside_m, size_m=(0.5, 0.5))
    recentring.tick()
    assert (recentring.state is FlightState.CRUISING) is ends


def test_on_its_line_it_does_not_drift() -> None:
    contract = load_contract(CONFIG / "recentring_contract.yaml", PURE_FORM)
    flight = PerfectFlight(contract, mission_to((150.0, 0.0)))
    flight.depart()
    flight.run_until(FlightState.ARRIVED, seconds=90.0)
    assert FlightState.RECENTRING not in flight.states


def test_without_a_drift_in_the_contract_it_stays_beside_the_line(flight: PerfectFlight) -> None:
    flight.pose = flight.pose._replace(position_ned_m=(0.0, -2.0, -4.0))
    flight.depart()
    flight.run_until(FlightState.ARRIVED)
    assert flight.reference.position_leg_m == pytest.approx((60.0, -2.0, 0.0))
    assert FlightState.RECENTRING not in flight.states


def test_an_obstacle_met_while_drifting_is_avoided(recentring: PerfectFlight) -> None:
    recentring.run_until(FlightState.RECENTRING)
    x_m, y_m, _ = recentring.reference.position_leg_m
    recentring.see(x_m + 30.0, y_m + 1.0)
    recentring.run_until(FlightState.AVOIDING)
    recentring.run_until(FlightState.ARRIVED, seconds=120.0)
    assert recentring.texts("violation") == []


def test_another_mission_ends_the_drift(recentring: PerfectFlight) -> None:
    recentring.run_until(FlightState.RECENTRING)
    recentring.run(1.0)
    recentring.navigator.change_mission(mission_to((0.0, 60.0)), recentring.now_s)
    assert recentring.state is FlightState.STOPPING
    recentring.run_until(FlightState.ALIGNING)
    assert (
        FlightState.RECENTRING
        not in recentring.states[recentring.states.index(FlightState.STOPPING) :]
    )


# ---------------------------------------------------------------------------- stopping


def test_for_another_mission_it_stops_as_soon_as_it_can(cruising: PerfectFlight) -> None:
    x_m = cruising.reference.position_leg_m[0]
    cruising.navigator.change_mission(mission_to((0.0, 60.0)), cruising.now_s)
    assert cruising.state is FlightState.STOPPING
    stopping_m = cruising.navigator.assessment.inflated.stopping_distance_m
    assert 0.0 < final_x_m(cruising) - x_m <= stopping_m


def test_an_obstacle_met_before_the_stop_is_avoided_first(cruising: PerfectFlight) -> None:
    obstacle = cruising.see(40.0, 0.0)
    front_m = obstacle.region.approach_x_m
    cruising.run(30.0, until=lambda: cruising.reference.position_leg_m[0] > front_m - 0.3)
    cruising.navigator.change_mission(mission_to((0.0, 60.0)), cruising.now_s)
    end_m, keep_out_m = final_x_m(cruising), obstacle.region.keep_out.x_min_m
    cruising.run_until(FlightState.AVOIDING_THEN_STOPPING, FlightState.ALIGNING)
    met = FlightState.AVOIDING_THEN_STOPPING in cruising.states
    # Where the stop is short of what a plan keeps out of, no plan is needed.
    assert met is (end_m >= keep_out_m)
    cruising.run_until(FlightState.ALIGNING)
    assert cruising.texts("violation") == []
