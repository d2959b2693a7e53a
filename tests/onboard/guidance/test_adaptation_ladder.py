"""The response to a failed assumption: as fast as before, slower, or a stop."""

import pytest

from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.guidance.phases import FlightState
from onboard.monitoring.adaptation import adapt
from onboard.monitoring.assumptions import Assumption, Violation
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to, pose_at


def sight(range_m: float) -> Violation:
    return Violation(Assumption.DETECTION_RANGE, range_m, 12.0, "m", "front")


def size(size_m: float) -> Violation:
    return Violation(Assumption.OBSTACLE_SIZE, size_m, 4.0, "m", "front/1")


def respond(flight: PerfectFlight, violation: Violation) -> None:
    flight.navigator.respond_to(violation, flight.now_s)


def test_what_still_complies_is_flown_on_as_fast(cruising: PerfectFlight) -> None:
    current = cruising.situation.reference.current
    respond(cruising, sight(9.0))
    assert cruising.state is FlightState.CRUISING
    assert cruising.situation.reference.current is current
    assert cruising.navigator.assessment.terms.detection_range_m == 9.0
    (text,) = cruising.texts("adapted")
    why = "detection_range (front): 9.00, limit 12.00 m"
    assert text == f"contract solved again for {why}: continuing at 2.80 m/s"


def test_what_complies_only_slower_is_flown_on_slower(cruising: PerfectFlight) -> None:
    respond(cruising, sight(7.0))
    assert cruising.state is FlightState.CRUISING
    speed_mps = cruising.navigator.assessment.terms.cruise_speed_mps
    assert 0.3 <= speed_mps < 2.8
    assert cruising.situation.envelope.speed_max_mps == speed_mps
    cruising.run(5.0)
    assert cruising.reference.velocity_leg_mps[0] == pytest.approx(speed_mps)
    cruising.run_until(FlightState.ARRIVED, seconds=300.0)
    assert cruising.texts("certificate") == []


@pytest.mark.parametrize("violation", [DEFECT, sight(0.5)])
def test_what_complies_at_no_speed_ends_in_a_hold(
    cruising: PerfectFlight, violation: Violation
) -> None:
    before = cruising.navigator.assessment
    respond(cruising, violation)
    assert cruising.state is FlightState.HOLDING
    assert cruising.navigator.assessment is before
    assert cruising.texts("adapted") == []


def test_a_flight_outside_its_contract_does_not_adapt(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((60.0, 0.0)), adaptive=False)
    flight.cruise_at_full_speed()
    respond(flight, sight(9.0))
    assert flight.state is FlightState.HOLDING


@pytest.mark.parametrize("state", [s for s in FlightState if not s.flying])
def test_what_does_not_fly_does_not_respond(cruising: PerfectFlight, state: FlightState) -> None:
    before = cruising.navigator.assessment
    cruising.situation.state = state
    respond(cruising, sight(9.0))
    assert cruising.state is state
    assert cruising.navigator.assessment is before
    assert cruising.navigator.events == []


def test_a_measured_pose_is_what_a_hold_brakes_from(cruising: PerfectFlight) -> None:
    cruising.navigator.respond_to(DEFECT, cruising.now_s, pose_at(1.0, 2.0))
    assert cruising.reference.position_leg_m == pytest.approx((1.0, 2.0, 0.0))


def test_the_same_adaptation_is_reported_once(cruising: PerfectFlight) -> None:
    for _ in range(3):
        respond(cruising, sight(9.0))
    assert len(cruising.texts("adapted")) == 1
    respond(cruising, sight(7.0))
    assert len(cruising.texts("adapted")) == 2


def test_while_it_aligns_it_goes_on_aligning_under_the_slower_contract(
    flight: PerfectFlight,
) -> None:
    flight.depart()
    flight.run(0.2)
    current = flight.situation.reference.current
    respond(flight, sight(7.0))
    assert flight.state is FlightState.ALIGNING
    assert flight.situation.reference.current is current
    flight.run_until(FlightState.CRUISING)
    flight.run(8.0)
    speed_mps = flight.navigator.assessment.terms.cruise_speed_mps
    assert flight.reference.velocity_leg_mps[0] == pytest.approx(speed_mps)


def test_while_it_stops_it_goes_on_stopping(cruising: PerfectFlight) -> None:
    cruising.navigator.change_mission(mission_to((0.0, 60.0)), cruising.now_s)
    cruising.run(0.2)
    respond(cruising, sight(7.0))
    assert cruising.state is FlightState.STOPPING
    cruising.run_until(FlightState.ALIGNING)


def test_a_region_that_begins_before_it_is_slow_enough_ends_in_a_hold(
    cruising: PerfectFlight,
) -> None:
    before, x_m = cruising.navigator.assessment, cruising.reference.position_leg_m[0]
    obstacle = cruising.see(x_m + 4.0, 0.0)
    respond(cruising, sight(7.0))
    assert cruising.state is FlightState.HOLDING
    # Nothing of the attempt is left.
    assert cruising.navigator.assessment is before
    assert cruising.situation.envelope.speed_max_mps == 2.8
    known = cruising.navigator.obstacles.of_track("front/1")
    assert known is not None
    assert known.region == obstacle.region


def test_an_unseen_region_that_may_begin_before_it_is_slow_enough_ends_in_a_hold(
    contract: Contract,
) -> None:
    """Where the range is just enough, the slower contract needs all of it."""
    sensors = (
        contract.sensor.model_copy(update={"detection_range_m": tenths_m / 10.0})
        for tenths_m in range(40, 120)
    )
    contracts = (contract.model_copy(update={"sensor": sensor}) for sensor in sensors)
    short = next(each for each in contracts if assess(each, mission_altitude_m=4.0).compliant)
    flight = PerfectFlight(short, mission_to((60.0, 0.0)))
    flight.cruise_at_full_speed()
    late = Violation(Assumption.REACTION_TIME, 0.20, 0.15, "s")
    adaptation = adapt(flight.navigator.assessment, late)
    assert adaptation is not None
    assert adaptation.slower
    respond(flight, late)
    assert flight.state is FlightState.HOLDING
    assert flight.texts("adapted") == []


def test_in_an_avoidance_it_does_not_slow_down(avoiding: PerfectFlight) -> None:
    respond(avoiding, sight(7.0))
    assert avoiding.state is FlightState.HOLDING


def test_in_an_avoidance_the_plan_is_checked_under_the_adapted_contract(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    rechecked = []
    monkeypatch.setattr(
        type(avoiding.navigator._avoidance_step),
        "recheck",
        lambda _, obstacle, now_s: rechecked.append((obstacle, now_s)),
    )
    respond(avoiding, size(4.3))
    assert avoiding.state is FlightState.AVOIDING
    obstacle = avoiding.navigator.obstacles.of_track("front/1")
    assert rechecked == [(obstacle, avoiding.now_s)]


def test_in_cruise_there_is_no_plan_to_check(
    cruising: PerfectFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    rechecked: list[object] = []
    step = type(cruising.navigator._avoidance_step)
    monkeypatch.setattr(step, "recheck", lambda *args: rechecked.append(args))
    cruising.see(40.0, 0.0)
    respond(cruising, size(4.3))
    assert rechecked == []
    assert cruising.state is FlightState.CRUISING
