"""What the parts share: events, the automaton, the contract in force, what is remembered."""

from dataclasses import replace

import pytest

from onboard.contract.assessment import assess_terms
from onboard.event_limiter import EVENT_PERIOD_S
from onboard.events import Event, EventName, Severity
from onboard.guidance.envelope import envelope_of
from onboard.guidance.phases import FlightState, IllegalTransitionError, Trigger
from onboard.guidance.situation import Situation
from tests.onboard.guidance.perfect_flight import PerfectFlight, pose_at


@pytest.fixture
def situation(flight: PerfectFlight) -> Situation:
    return flight.situation


def test_a_change_of_phase_is_reported(situation: Situation) -> None:
    situation.fire(Trigger.CONTROL_GRANTED, 3.0)
    (event,) = situation.events
    assert (event.time_s, event.name, event.severity) == (3.0, "phase", Severity.INFO)
    assert event.text == "cruise (control granted)"
    assert event.data == {"from": "standby", "to": "cruise", "trigger": "control granted"}


def test_a_failed_assumption_is_reported_as_an_error(situation: Situation) -> None:
    situation.state = FlightState.RECENTRING
    situation.fire(Trigger.ASSUMPTION_FAILED, 3.0, text="holding: why")
    (event,) = situation.events
    assert (event.severity, event.text) == (Severity.ERROR, "holding: why")
    assert event.data["from"] == "cruise"


@pytest.mark.parametrize(
    ("state", "trigger"),
    [
        (FlightState.ALIGNING, Trigger.ALIGNED),
        (FlightState.CRUISING, Trigger.CORRIDOR_FREE),
        (FlightState.RECENTRING, Trigger.CORRIDOR_BLOCKED),
        (FlightState.RECENTRING, Trigger.CRUISE_REPLANNED),
        (FlightState.AVOIDING, Trigger.MISSION_CHANGED),
        (FlightState.STANDBY, Trigger.MISSION_CHANGED),
    ],
)
def test_a_change_within_a_phase_is_not_reported(
    situation: Situation, state: FlightState, trigger: Trigger
) -> None:
    situation.state = state
    situation.fire(trigger, 0.0)
    assert situation.events == []


def test_another_leg_is_reported(situation: Situation) -> None:
    situation.state = FlightState.STOPPING
    situation.fire(Trigger.LEG_FLOWN, 0.0)
    assert [event.text for event in situation.events] == ["cruise (leg flown)"]


def test_an_illegal_transition_changes_and_reports_nothing(situation: Situation) -> None:
    with pytest.raises(IllegalTransitionError):
        situation.fire(Trigger.POST_CONDITION, 0.0)
    assert situation.state is FlightState.STANDBY
    assert situation.events == []


def test_what_may_repeat_is_reported_once_in_a_while(situation: Situation) -> None:
    for tick in range(round(EVENT_PERIOD_S / 0.5) + 1):
        situation.emit_rarely(
            Event(0.5 * tick, EventName.PLAN_KEPT, Severity.NOTICE, f"{tick}"), "a"
        )
        situation.emit_rarely(Event(0.5 * tick, EventName.PLAN_KEPT, Severity.NOTICE, "b"), "b")
    assert [event.text for event in situation.events] == ["0", "b", "10", "b"]


def test_an_adopted_contract_holds_for_envelope_and_regions(flight: PerfectFlight) -> None:
    before = flight.see(30.0, 0.0)
    assessment = flight.navigator.assessment
    terms = replace(assessment.terms, cruise_speed_mps=1.0)
    flight.situation.adopt(assess_terms(assessment.contract, terms))
    after = flight.navigator.obstacles.of_track("front/1")
    assert after is not None
    assert after.region.approach_x_m > before.region.approach_x_m
    assert flight.situation.envelope == envelope_of(flight.navigator.assessment)
    assert flight.situation.envelope.speed_max_mps == 1.0


@pytest.mark.parametrize("adaptive", [True, False])
def test_only_an_adaptive_flight_merges_obstacles(flight: PerfectFlight, adaptive: bool) -> None:
    situation = flight.situation
    situation.adaptive = adaptive
    situation.rebuild_map()
    flight.see(30.0, 0.0)
    flight.see(31.5, 0.5, name="2")
    assert len(situation.obstacles) == (1 if adaptive else 2)


def test_a_shift_moves_what_is_flown_and_what_it_avoids(avoiding: PerfectFlight) -> None:
    situation = avoiding.situation
    assert situation.avoidance is not None
    (x_m, y_m, z_m), box = avoiding.reference.position_leg_m, situation.avoidance.obstacle.measured
    final_m = situation.avoidance.plan.trajectory.final.position_leg_m
    situation.shift((0.5, -0.25, 0.125))
    assert avoiding.reference.position_leg_m == pytest.approx((x_m + 0.5, y_m - 0.25, z_m + 0.125))
    assert situation.avoidance.obstacle.measured == box.shifted_by(0.5, -0.25)
    assert situation.avoidance.plan.trajectory.final.position_leg_m == pytest.approx(
        (final_m[0] + 0.5, final_m[1] - 0.25, final_m[2] + 0.125)
    )
    (known,) = situation.obstacles
    assert known.measured.x_min_m == pytest.approx(box.x_min_m + 0.5)
    assert situation.leg.origin_ned_m == (0.0, 0.0, -4.0)


def test_a_measured_state_is_stated_in_the_leg_frame(situation: Situation) -> None:
    state = situation.measured_state(pose_at(3.0, 1.0, -5.0, velocity_ned_mps=(1.0, 0.5, 0.25)))
    assert state.position_leg_m == pytest.approx((3.0, 1.0, -1.0))
    assert state.velocity_leg_mps == pytest.approx((1.0, 0.5, 0.25))
    assert state.acceleration_leg_mps2 == (0.0, 0.0, 0.0)


# ---------------------------------------------------------------------------- what matters now


def test_in_standby_the_first_obstacle_of_the_leg_matters(flight: PerfectFlight) -> None:
    near = flight.see(12.0, 0.0)
    flight.see(50.0, 0.0, name="2")
    assert flight.situation.obstacles_to_meet(0.0) == [near]


def test_obstacles_beside_the_way_and_beyond_range_do_not_matter(flight: PerfectFlight) -> None:
    flight.see(12.0, 9.0)
    flight.see(50.0, 0.0, name="2")
    assert flight.situation.obstacles_to_meet(0.0) == []


def test_in_an_avoidance_its_obstacle_and_the_next_one_matter(avoiding: PerfectFlight) -> None:
    situation = avoiding.situation
    assert situation.avoidance is not None
    x_m, y_m, _ = situation.avoidance.plan.trajectory.final.position_leg_m
    following = avoiding.see(x_m + 17.0, y_m, name="2")
    met = situation.obstacles_to_meet(avoiding.now_s)
    assert [obstacle.id for obstacle in met] == ["front/1", following.id]


def test_the_avoided_obstacle_is_returned_as_it_is_known_now(avoiding: PerfectFlight) -> None:
    assert avoiding.situation.avoidance is not None
    planned = avoiding.situation.avoidance.obstacle
    box = planned.measured
    grown = avoiding.see(
        (box.x_min_m + box.x_max_m) / 2.0 + 0.02, (box.y_min_m + box.y_max_m) / 2.0
    )
    (met,) = avoiding.situation.obstacles_to_meet(avoiding.now_s)
    assert met == grown
    assert met != planned
