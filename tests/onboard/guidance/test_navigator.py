"""The dispatcher: which part acts in which state, and whole flights without a service."""

import inspect
import math

import pytest

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.guidance import navigator as module
from onboard.guidance.avoidance_step import AvoidanceStep
from onboard.guidance.cruise import Cruise
from onboard.guidance.fallback import Fallback
from onboard.guidance.leg_progress import LegProgress
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import TRANSITIONS, FlightState, Phase, Trigger
from onboard.guidance.situation import Situation
from onboard.monitoring.assumptions import Assumption, Violation
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to, pose_at
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig

RESET = Violation(Assumption.ESTIMATOR_RESET, 0.5, 0.4, "m")


def test_the_dispatcher_is_short() -> None:
    assert len(inspect.getsource(module).splitlines()) <= 190


# ---------------------------------------------------------------------------- dispatch


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The parts that are called, in order; none of them does anything."""
    names: list[str] = []

    def note(part: type, method: str, answer: object = None) -> None:
        def called(*_: object) -> object:
            names.append(f"{part.__name__}.{method}")
            return answer

        monkeypatch.setattr(part, method, called)

    note(AvoidanceStep, "advance")
    note(AvoidanceStep, "begin")
    note(AvoidanceStep, "recheck")
    note(AvoidanceStep, "recertify")
    note(LegProgress, "advance", answer=False)
    note(Cruise, "advance", answer="an obstacle")
    note(Cruise, "replan")
    note(Fallback, "recheck_way_to_hover")
    return names


@pytest.mark.parametrize("state", FlightState)
def test_a_tick_goes_to_the_part_of_the_phase(
    flight: PerfectFlight, called: list[str], state: FlightState
) -> None:
    flight.situation.state = state
    flight.navigator.advance(flight.pose, 0.0)
    assert called == {
        Phase.CRUISE: ["LegProgress.advance", "Cruise.advance", "AvoidanceStep.begin"],
        Phase.AVOID: ["AvoidanceStep.advance"],
    }.get(state.phase, [])


@pytest.mark.parametrize("state", FlightState)
def test_an_obstacle_goes_to_the_part_whose_trajectory_it_may_block(
    cruising: PerfectFlight, called: list[str], state: FlightState
) -> None:
    obstacle = cruising.see(50.0, 0.0)
    called.clear()
    cruising.situation.state = state
    cruising.navigator.recheck_plan(obstacle, 0.0)
    assert called == {
        Phase.AVOID: ["AvoidanceStep.recheck"],
        Phase.HOLD: ["Fallback.recheck_way_to_hover"],
    }.get(state.phase, [])


@pytest.mark.parametrize("state", FlightState)
def test_after_a_shift_only_a_free_cruise_is_planned_anew(
    cruising: PerfectFlight, called: list[str], state: FlightState
) -> None:
    cruising.situation.state = state
    cruising.navigator.fly_on_after_shift(RESET, 0.0)
    assert called == ["Cruise.replan"] * state.cruising_freely + ["AvoidanceStep.recertify"]


@pytest.mark.parametrize("state", FlightState)
def test_what_it_says_of_itself_follows_from_the_state(
    flight: PerfectFlight, state: FlightState
) -> None:
    flight.situation.state = state
    navigator = flight.navigator
    assert (navigator.state, navigator.phase) == (state, state.phase)
    assert navigator.flying is state.flying
    assert navigator.cruising_freely is state.cruising_freely
    assert navigator.in_seen_space is state.in_seen_space
    assert navigator.moving is (state.cruising_freely or state.phase in (Phase.AVOID, Phase.THREAD))
    assert (navigator.pointing_rad is None) is not navigator.moving
    if navigator.moving:
        assert navigator.flying


def test_in_standby_a_tick_does_nothing(flight: PerfectFlight) -> None:
    flight.see(10.0, 0.0)
    flight.run(1.0)
    assert flight.state is FlightState.STANDBY
    assert flight.events == []
    assert flight.navigator.obstacles_to_meet(flight.now_s) != []


# ---------------------------------------------------------------------------- whole flights


def tree_of(flight: PerfectFlight) -> set[tuple[FlightState, FlightState]]:
    return set(zip(flight.states, flight.states[1:], strict=False))


def legal() -> set[tuple[FlightState, FlightState]]:
    return {(source, target) for (source, _), target in TRANSITIONS.items()}


def test_three_obstacles_are_avoided_one_after_another(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((110.0, 0.0)))
    for number, (x_m, y_m) in enumerate([(25.0, 0.2), (55.0, -1.8), (85.0, 0.5)]):
        flight.see(x_m, y_m, name=str(number))
    flight.depart()
    flight.run_until(FlightState.ARRIVED, seconds=90.0)
    assert flight.texts("violation") == []
    assert len(flight.navigator.take_planned()) == flight.states.count(FlightState.AVOIDING) >= 2
    assert tree_of(flight) <= legal()
    assert flight.reference.position_leg_m[0] == pytest.approx(110.0)


def test_it_keeps_clear_of_every_obstacle_that_it_avoids(flight: PerfectFlight) -> None:
    obstacle = flight.see(30.0, 0.2, size_m=(2.0, 2.0))
    flight.depart()
    faces = obstacle.region.obstacle
    for state in flight.states_to_arrival():
        x_m, y_m, _ = state.position_leg_m
        beside = not faces.y_min_m + 1e-6 < y_m < faces.y_max_m - 1e-6
        assert beside or not faces.x_min_m + 1e-6 < x_m < faces.x_max_m - 1e-6
    assert FlightState.AVOIDING in flight.states


def test_the_same_flight_twice_is_the_same(contract: Contract) -> None:
    tracks = []
    for _ in range(2):
        flight = PerfectFlight(contract, mission_to((60.0, 0.0)))
        flight.see(25.0, 0.2)
        flight.depart()
        flown = list(flight.states_to_arrival())
        tracks.append((flown, list(flight.events)))
    assert tracks[0] == tracks[1]


def test_a_stop_and_a_second_start_end_the_mission(avoiding: PerfectFlight) -> None:
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    avoiding.run(5.0)
    assert avoiding.states[-1] is FlightState.HOLDING
    avoiding.navigator.release_control(avoiding.now_s)
    # The pilot flies round the obstacle.
    avoiding.pose = pose_at(30.0, 5.0)
    assert avoiding.navigator.departure_refusals(avoiding.pose) == []
    avoiding.depart()
    avoiding.run_until(FlightState.ARRIVED)
    assert avoiding.pose.position_ned_m == pytest.approx((60.0, 5.0, -4.0))


def test_a_shift_in_cruise_aims_at_the_end_of_the_leg_again(cruising: PerfectFlight) -> None:
    cruising.navigator.shift((0.4, -0.3, 0.2))
    cruising.navigator.fly_on_after_shift(RESET, cruising.now_s)
    assert cruising.state is FlightState.CRUISING
    cruising.run_until(FlightState.ARRIVED)
    assert cruising.reference.position_leg_m == pytest.approx((60.0, -0.3, 0.0))


def test_events_and_obstacles_are_those_of_the_situation(flight: PerfectFlight) -> None:
    navigator: Navigator = flight.navigator
    situation: Situation = navigator.situation
    assert navigator.events is situation.events
    assert navigator.obstacles is situation.obstacles
    assert navigator.assessment is situation.assessment
    assert navigator.leg is situation.route.frame


# ---------------------------------------------------------------------------- defects in flight


@pytest.fixture
def rig(px4_contract: Contract) -> Rig:
    """A service in cruise."""
    autonomy = Autonomy(px4_contract, mission_to((60.0, 0.0)), epoch_unix_s=EPOCH_UNIX_S)
    rig = Rig(autonomy, mode=OFFBOARD)
    rig.run(6.0)
    assert autonomy.navigator.state is FlightState.CRUISING
    return rig


ILLEGAL = [
    trigger
    for trigger in Trigger
    if (FlightState.CRUISING, trigger) not in TRANSITIONS
    and (FlightState.HOLDING, trigger) not in TRANSITIONS
]


@pytest.mark.parametrize("trigger", ILLEGAL)
def test_an_illegal_transition_in_flight_ends_in_a_hold(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, trigger: Trigger
) -> None:
    navigator = rig.autonomy.navigator
    monkeypatch.setattr(
        navigator, "advance", lambda _, now_s: navigator.situation.fire(trigger, now_s)
    )
    sent = len(rig.setpoints)
    rig.run(3.0)
    assert navigator.state is FlightState.HOLDING
    # The stream goes on, tick by tick, to a hover.
    assert len(rig.setpoints) - sent == round(3.0 / TICK_S)
    assert math.hypot(*rig.velocity_ned_mps) < 0.01
    assert rig.texts("violation") == ["self_check: 1.00, limit 0.00 exceptions"]


def test_a_defect_of_any_part_ends_in_a_hold(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Cruise, "advance", defect)
    rig.tick()
    assert rig.autonomy.navigator.state is FlightState.HOLDING
