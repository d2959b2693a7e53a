"""With a guarantee to pass, too, what is flown is a certified way to rest at every time."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract, load_contract
from onboard.guidance.phases import FlightState, Phase
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.vehicle_state import Pose
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace, Stem
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to

CONFIG = Path(__file__).parents[4] / "config"
STEM = Stem(18.0, 0.1, 0.3)
BLIND = Violation(Assumption.DETECTION_AGE, 1.0, 0.3, "s", "front")
SHORT_SIGHTED = Violation(Assumption.DETECTION_RANGE, 0.5, 12.0, "m", "front")


class ShieldedFlight(FieldFlight):
    """Checks in every tick that what is flown ends at rest, clear of every stem.

    Attributes:
        held_clearance_m: least distance of any way that was held from any stem, less r + E.
        unguarded: ticks in which the vehicle moved and no way was held.
    """

    held_clearance_m, unguarded = math.inf, 0

    def tick(self) -> None:
        before = self.navigator.reference(self.now_s)
        super().tick()
        shield, guard = self.navigator.shield, self.situation.reference.guard
        assert shield is not None
        after = self.navigator.reference(self.now_s)
        if before is not None and after is not None and self.state is FlightState.CRUISING:
            # The reference never jumps, whatever was intended.
            moved_m = math.dist(before.position_leg_m, after.position_leg_m)
            assert moved_m <= 1.01 * self.navigator.assessment.terms.cruise_speed_mps * TICK_S
        if not shield.guards:
            return
        if guard is None:
            self.unguarded += 1
            return
        assert max(map(abs, guard.final.velocity_leg_mps)) < 1e-6
        leg, times_s = self.navigator.leg, np.linspace(self.now_s, guard.end_s, 12).tolist()
        places = [leg.position_ned(guard.sample(t).position_leg_m)[:2] for t in times_s]
        room_m = self._room_m(places) - self.navigator.assessment.terms.body_m
        self.held_clearance_m = min(self.held_clearance_m, room_m)


Shielded = Callable[..., ShieldedFlight]


@pytest.fixture
def shielded(contract: Contract) -> Shielded:
    """Make a flight through stems that guarantees to pass, on foreknown ground by default."""
    requirements = contract.requirements.model_copy(update={"stop": True})
    stopping = contract.model_copy(update={"requirements": requirements})

    def make(
        *stems: Stem,
        ends_ned_m: tuple[tuple[float, float], ...] = ((45.0, 0.0),),
        start_clear_m: float | None = 3.0,
        seen: IdealSeenSpace | None = None,
    ) -> ShieldedFlight:
        mission = mission_to(*ends_ned_m).model_copy(update={"start_clear_m": start_clear_m})
        return ShieldedFlight(stopping, mission, stems, seen or IdealSeenSpace())

    return make


def arrived(flight: ShieldedFlight, seconds: float = 150.0) -> ShieldedFlight:
    flight.depart()
    flight.run_until(FlightState.ARRIVED, FlightState.HOLDING, seconds=seconds)
    assert flight.state is FlightState.ARRIVED
    assert flight.unguarded == 0
    assert min(flight.held_clearance_m, flight.clearance_m) >= 0.0
    return flight


# ------------------------------------------------------------------ cruise and avoidance


def test_an_obstacle_is_avoided_as_ever_and_a_way_to_rest_is_held_all_the_time(
    shielded: Shielded,
) -> None:
    flight = arrived(shielded(STEM))
    assert FlightState.AVOIDING in flight.states
    assert FlightState.LOOKING not in flight.states
    shield = flight.navigator.shield
    assert shield is not None
    assert shield.rest_certified is True
    assert shield.renewals > 50


def test_an_avoidance_leads_no_farther_aside_than_was_seen_free_where_that_suffices() -> None:
    """Else the shield stops it there, and what was promised is flown by best effort."""
    wandering = ("sensor.position_error_m=0.55", "vehicle.tracking_error_m=1.0")
    shorter = ("sensor.detection_range_m=13.2", *wandering)
    contract = load_contract(CONFIG / "px4_contract.yaml", shorter)
    mission = mission_to((60.0, 0.0), half_width_m=20.0).model_copy(update={"start_clear_m": 5.0})
    flight = arrived(ShieldedFlight(contract, mission, (Stem(25.0, 0.0, 0.9),), IdealSeenSpace()))
    assert FlightState.AVOIDING in flight.states
    assert FlightState.LOOKING not in flight.states


def test_a_plan_that_ends_later_is_recorded_with_the_region_that_it_was_made_in(
    contract: Contract,
) -> None:
    """With room for the cells of the set: else the plan would begin outside its region."""
    requirements = contract.requirements.model_copy(update={"stop": True})
    sensor = contract.sensor.model_copy(update={"position_error_m": 0.25})
    coarse = contract.model_copy(update={"requirements": requirements, "sensor": sensor})
    mission = mission_to((45.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
    flight = ShieldedFlight(coarse, mission, (STEM,), IdealSeenSpace())
    flight.depart()
    flight.run_until(FlightState.AVOIDING)
    (planned,) = flight.navigator.take_planned()
    avoidance = flight.navigator.avoidance
    assert avoidance is not None
    trajectory = planned.plan.trajectory
    flight.run(60.0, until=lambda: flight.now_s > trajectory.end_s - 0.3)
    # A plan that passes as near as it may, whose obstacle turns out to be larger within its error.
    aside_m = planned.obstacle.region.obstacle.y_min_m - trajectory.final.position_leg_m[1] - 0.02
    near = replace(planned.plan, trajectory=trajectory.shifted_by((0.0, aside_m, 0.0)))
    flight.situation.avoidance = replace(avoidance, plan=near)
    flight.planner.failing = True
    flight.see(18.0, 0.1, size_m=(1.4, 1.4), name="0")
    (longer,) = flight.navigator.take_planned()
    assert longer.plan.trajectory.end_s > trajectory.end_s
    end_x_m = longer.plan.trajectory.final.position_leg_m[0]
    assert end_x_m == pytest.approx(longer.obstacle.region.x_pob_m)
    region, before = longer.obstacle.region.manoeuvre, planned.obstacle.region.manoeuvre
    assert region.enclosing(before) == region


def test_without_a_plan_it_stops_in_time_and_threads_on(shielded: Shielded) -> None:
    flight = shielded(STEM)
    flight.planner.failing = True
    arrived(flight)
    assert FlightState.LOOKING in flight.states
    assert Phase.AVOID not in {state.phase for state in flight.states}
    # A plan is tried at a bounded rate.
    assert len(flight.planner.problems) < 200


def test_the_next_leg_is_cruised_again(shielded: Shielded) -> None:
    flight = shielded(STEM, ends_ned_m=((30.0, 0.0), (30.0, 20.0)))
    flight.planner.failing = True
    arrived(flight)
    threaded = flight.states.index(FlightState.THREADING)
    assert FlightState.CRUISING in flight.states[threaded:]


def test_what_is_flown_ends_at_rest_if_nothing_decides_any_more(shielded: Shielded) -> None:
    flight = shielded()
    flight.depart()
    flight.run(8.0)
    assert flight.state is FlightState.CRUISING
    before = flight.reference
    later = flight.navigator.reference(flight.now_s + 60.0)
    assert later is not None
    assert later.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert 0.0 < later.position_leg_m[0] - before.position_leg_m[0] < 12.0


def test_a_blind_sensor_ends_in_rest_and_not_in_a_hold_and_the_flight_goes_on(
    shielded: Shielded,
) -> None:
    flight = shielded()
    flight.depart()
    flight.run(6.0)
    flight.blind = True
    flight.navigator.respond_to(BLIND, flight.now_s)
    assert flight.state is FlightState.CRUISING
    flight.run(15.0)
    assert flight.state.in_seen_space
    assert math.hypot(*flight.reference.velocity_leg_mps) < 1e-3
    flight.blind = False
    flight.run_until(FlightState.ARRIVED, seconds=60.0)


def test_what_a_range_that_suffices_to_stop_shows_in_its_region_is_not_late(
    contract: Contract,
) -> None:
    changes = {
        "requirements": contract.requirements.model_copy(update={"stop": True}),
        "vehicle": contract.vehicle.model_copy(update={"cruise_speed_mps": 5.0}),
        "sensor": contract.sensor.model_copy(update={"detection_range_m": 13.5}),
    }
    fast, wide = contract.model_copy(update=changes), Stem(30.0, 0.1, 1.9)
    mission = mission_to((60.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
    flight = ShieldedFlight(fast, mission, (wide,), IdealSeenSpace())
    assert flight.navigator.assessment.compliant
    flight.depart()
    flight.run_until(FlightState.LOOKING, FlightState.AVOIDING)
    (seen,) = flight.situation.obstacles
    late_m = flight.reference.position_leg_m[0] - seen.region.approach_x_m
    assert late_m > 5.0 * flight.navigator.assessment.terms.reaction_time_s
    assert flight.texts("violation") == []


# ------------------------------------------------------------------ the start


def test_a_start_that_nobody_has_confirmed_is_looked_at_all_round_before_the_cruise(
    shielded: Shielded,
) -> None:
    flight = arrived(shielded(start_clear_m=None))
    begins = flight.states[: flight.states.index(FlightState.CRUISING) + 1]
    assert begins == [
        FlightState.ALIGNING,
        FlightState.LOOKING,
        FlightState.ALIGNING,
        FlightState.CRUISING,
    ]
    assert flight.seen.confirmed == 1


def test_while_a_start_is_looked_at_nothing_is_held_and_nothing_called_uncertified(
    shielded: Shielded,
) -> None:
    flight = shielded(start_clear_m=None)
    shield = flight.navigator.shield
    assert shield is not None
    flight.depart()
    flight.run_until(FlightState.LOOKING)
    while flight.state is FlightState.LOOKING:
        assert shield.rest_certified is None
        flight.tick()
    flight.run_until(FlightState.CRUISING)
    assert shield.rest_certified is True


def test_a_start_that_is_not_free_is_not_left(shielded: Shielded) -> None:
    flight = shielded(start_clear_m=None, seen=IdealSeenSpace(refusing=True))
    flight.depart()
    flight.run(60.0)
    assert flight.state is FlightState.HOLDING
    assert FlightState.CRUISING not in flight.states


def test_it_comes_to_the_height_of_the_leg_before_it_cruises(shielded: Shielded) -> None:
    flight = shielded()
    flight.pose = Pose(0.0, (0.0, 0.0, -3.6), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    flight.depart()
    flight.run_until(FlightState.CRUISING)
    assert flight.reference.position_leg_m[2] == pytest.approx(0.0, abs=1e-6)


# ------------------------------------------------------------------ failed assumptions


def cruising(flight: ShieldedFlight) -> ShieldedFlight:
    flight.depart()
    flight.run(6.0)
    assert flight.state is FlightState.CRUISING
    return flight


def test_an_assumption_of_progress_that_no_contract_helps_ends_in_thread(
    shielded: Shielded,
) -> None:
    flight = cruising(shielded(ends_ned_m=((60.0, 0.0),)))
    flight.navigator.respond_to(SHORT_SIGHTED, flight.now_s)
    assert flight.state is FlightState.LOOKING
    flight.run_until(FlightState.ARRIVED, seconds=90.0)


@pytest.mark.parametrize("assumption", [Assumption.OBSTACLE_SIZE, Assumption.ROI_INTERSECTION])
def test_sizes_and_distances_of_obstacles_end_nothing(
    shielded: Shielded, assumption: Assumption
) -> None:
    flight = cruising(shielded())
    before = flight.navigator.assessment
    flight.navigator.respond_to(Violation(assumption, 9.0, 1.0, "m", "1"), flight.now_s)
    assert flight.state is FlightState.CRUISING
    assert flight.navigator.assessment is before


@pytest.mark.parametrize(
    "assumption",
    [Assumption.TRACKING_ERROR, Assumption.DETECTION_UNCERTAINTY, Assumption.SENSOR_CONTRADICTION],
)
def test_one_of_safety_is_never_adapted_to_and_ends_on_the_way_that_is_held(
    shielded: Shielded, assumption: Assumption
) -> None:
    flight = cruising(shielded())
    held = flight.situation.reference.guard
    assert held is not None
    # Slightly beyond the contract: without a way to rest the contract would be solved again.
    violation = Violation(assumption, 0.11, 0.10, "m")
    flight.navigator.respond_to(violation, flight.now_s)
    assert flight.state is FlightState.HOLDING
    assert flight.situation.reference.current is held
    flight.run(10.0)
    assert flight.reference.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_where_it_cannot_go_on_it_rests_for_another_mission(shielded: Shielded) -> None:
    flight = cruising(shielded())
    flight.navigator.change_mission(mission_to((10.0, 15.0)), flight.now_s)
    assert flight.state is FlightState.STOPPING
    shield = flight.navigator.shield
    assert shield is not None
    shield.divert("tested", flight.now_s)
    assert flight.navigator.state.value == "resting"
    flight.run_until(FlightState.ALIGNING)
    flight.run_until(FlightState.ARRIVED, seconds=60.0)


def test_the_pilot_ends_what_is_held(shielded: Shielded) -> None:
    flight = cruising(shielded())
    flight.navigator.release_control(flight.now_s)
    assert flight.navigator.reference(flight.now_s) is None
    shield = flight.navigator.shield
    assert shield is not None
    assert shield.rest_certified is None


# ------------------------------------------------------------------ the paper's pure form


def test_in_the_pure_form_nothing_is_held(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((45.0, 0.0)))
    flight.cruise_at_full_speed()
    assert flight.navigator.shield is None
    assert flight.situation.reference.guard is None
    flight.navigator.respond_to(DEFECT, flight.now_s)
    assert flight.state is FlightState.HOLDING


def test_the_nose_stays_ahead_on_a_way_that_was_certified_with_it_ahead(
    shielded: Shielded,
) -> None:
    flight = cruising(shielded())
    mission = flight.situation.route.mission
    flight.situation.route.mission = mission.model_copy(update={"heading": "path"})
    shield, thread = flight.navigator.shield, flight.navigator.thread
    assert shield is not None
    assert thread is not None
    shield.divert("tested", flight.now_s)
    thread._leg.pause.look_round((math.pi / 2.0,), 1)
    while not thread.way.still:
        assert flight.situation.reference.heading_rad == 0.0
        flight.tick()
    for _ in range(50):
        flight.tick()
    assert flight.situation.reference.heading_rad != 0.0
