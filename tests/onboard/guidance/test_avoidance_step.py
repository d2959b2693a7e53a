"""One step of the induction: begun, followed, rechecked, extended, ended."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.phases import FlightState
from onboard.guidance.situation import Avoidance
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.certifier import certify_clear
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to, pose_at

RESET = Violation(Assumption.ESTIMATOR_RESET, 0.5, 0.4, "m")


def avoidance_of(flight: PerfectFlight) -> Avoidance:
    assert flight.navigator.avoidance is not None
    return flight.navigator.avoidance


def measured_again(flight: PerfectFlight, grown_m: float) -> Obstacle:
    """See the avoided box with every face farther out."""
    box = avoidance_of(flight).obstacle.measured.inflated(grown_m)
    x_m, y_m = (box.x_min_m + box.x_max_m) / 2.0, (box.y_min_m + box.y_max_m) / 2.0
    return flight.see(x_m, y_m, size_m=box.size_m)


@pytest.fixture
def near(contract: Contract) -> PerfectFlight:
    """An avoidance without passive safety, whose plan passes the faces as near as it may."""
    requirements = contract.requirements.model_copy(update={"passive_safety": False})
    flight = PerfectFlight(
        contract.model_copy(update={"requirements": requirements}), mission_to((60.0, 0.0))
    )
    flight.avoid()
    return flight


# ---------------------------------------------------------------------------- begin


def test_the_plan_starts_at_the_front_of_the_region(flight: PerfectFlight) -> None:
    obstacle = flight.see(25.0, 0.2)
    flight.cruise_at_full_speed()
    flight.run_until(FlightState.AVOIDING)
    (problem,) = flight.planner.problems
    assert problem.start.position_leg_m[0] == pytest.approx(obstacle.region.approach_x_m)
    assert flight.now_s <= problem.start_s <= flight.now_s + TICK_S
    assert problem.start.velocity_leg_mps == pytest.approx((2.8, 0.0, 0.0))
    assert problem.region == obstacle.region
    assert problem.exit_speed_mps == pytest.approx(2.8)
    assert (
        problem.coast_time_s
        == flight.navigator.assessment.inflated.manoeuvre_encounter.coast_time_s
    )
    assert flight.texts("phase")[-1].startswith("avoiding front/1 (")
    assert flight.texts("violation") == flight.texts("pre_condition") == []


def test_the_reference_is_continuous_over_the_whole_step(flight: PerfectFlight) -> None:
    flight.see(25.0, 0.2)
    flight.cruise_at_full_speed()
    flown = list(flight.states_to_arrival())
    positions_m = [state.position_leg_m for state in flown]
    speeds_mps = [state.velocity_leg_mps for state in flown]
    assert FlightState.AVOIDING in flight.states
    steps_m = [
        abs(after - before - TICK_S * (v + w) / 2.0)
        for one, other, v_mps, w_mps in zip(
            positions_m, positions_m[1:], speeds_mps, speeds_mps[1:], strict=False
        )
        for before, after, v, w in zip(one, other, v_mps, w_mps, strict=True)
    ]
    assert max(steps_m) < 1e-4
    assert flight.texts("violation") == flight.texts("post_condition") == []


def test_plans_are_recorded_once(avoiding: PerfectFlight) -> None:
    (step,) = avoiding.navigator.take_planned()
    assert step.plan is avoidance_of(avoiding).plan
    assert step.obstacle is avoidance_of(avoiding).obstacle
    assert step.leg is avoiding.navigator.leg
    assert step.plan_time_s == 0.25
    assert avoiding.navigator.plan_times_s == [0.25]
    assert avoiding.navigator.take_planned() == []


def test_the_mission_says_how_far_a_plan_may_climb(flight: PerfectFlight) -> None:
    mission = mission_to((60.0, 0.0)).model_copy(update={"climb_max_m": 1.5})
    climbing = PerfectFlight(flight.navigator.assessment.contract, mission)
    climbing.avoid()
    (problem,) = climbing.planner.problems
    assert problem.climb_m == 1.5
    assert problem.climb_preferred
    flight.avoid()
    (level,) = flight.planner.problems
    assert (level.climb_m, level.climb_preferred) == (0.0, False)


def test_without_a_plan_it_brakes_short_of_the_obstacle(cruising: PerfectFlight) -> None:
    obstacle = cruising.see(25.0, 0.2)
    cruising.planner.failing = True
    cruising.run_until(FlightState.HOLDING)
    assert cruising.texts("violation") == ["plan_exists (front/1): 0.00, limit 1.00 plans"]
    assert FlightState.AVOIDING not in cruising.states
    assert [problem.exit_speed_mps for problem in cruising.planner.problems] == [pytest.approx(2.8)]
    cruising.run(5.0)
    assert cruising.reference.position_leg_m[0] <= obstacle.region.keep_out.x_min_m
    assert cruising.navigator.take_planned() == []


def test_from_a_slow_entry_a_slow_exit_is_taken_where_no_faster_one_is(
    flight: PerfectFlight,
) -> None:
    probe = flight.see(55.0, 0.0, name="far")
    flight.see(55.3 - probe.region.approach_x_m, 0.2)
    flight.planner.exit_max_mps = 2.0
    flight.depart()
    flight.run_until(FlightState.AVOIDING)
    fast, slow = flight.planner.problems
    assert (fast.exit_speed_mps, slow.exit_speed_mps) == (2.8, 1.4)
    avoidance = avoidance_of(flight)
    assert avoidance.entry_speed_mps < 1.4
    assert avoidance.exit_speed_mps == 1.4
    assert len(flight.navigator.plan_times_s) == 1
    flight.run_until(FlightState.CRUISING)
    assert flight.texts("post_condition") == []


def test_an_obstacle_first_seen_late_is_reported(cruising: PerfectFlight) -> None:
    probe = cruising.see(100.0, 0.0, name="far")
    front_m = 100.0 - probe.region.approach_x_m
    cruising.see(cruising.reference.position_leg_m[0] + front_m - 0.7, 0.2)
    cruising.tick()
    assert cruising.state is FlightState.AVOIDING
    (text,) = cruising.texts("violation")
    encounter_mps = cruising.navigator.assessment.inflated.manoeuvre_encounter.speed_mps
    limit_m = encounter_mps * cruising.navigator.assessment.terms.reaction_time_s
    (problem,) = cruising.planner.problems
    late_m = problem.start.position_leg_m[0] - problem.region.approach_x_m
    assert late_m >= 0.7 + 2.8 * TICK_S > limit_m
    assert text == f"late_first_sight (front/1): {late_m:.2f}, limit {limit_m:.2f} m"


def test_an_obstacle_that_grows_into_the_way_within_its_error_is_not_seen_late(
    cruising: PerfectFlight,
) -> None:
    beside = cruising.see(cruising.reference.position_leg_m[0] + 12.0, 3.0, name="beside")
    cruising.tick()
    step, here, deep = cruising.navigator._avoidance_step, *grown_by(cruising, beside, 1.9, 2.1)
    step._check_pre_condition(here, beside, cruising.now_s)
    assert cruising.texts("violation") == []
    step._check_pre_condition(deep, beside, cruising.now_s)
    assert len(cruising.texts("violation")) == 1


def grown_by(flight: PerfectFlight, obstacle: Obstacle, *errors: float) -> Iterator[State]:
    """States 2 m late, that an obstacle beside comes into the way of by some errors of a face."""
    low_m, _ = obstacle.region.conflict_band_y_m
    for each in errors:
        y_m = low_m + each * flight.navigator.assessment.face_error_m
        yield State((obstacle.region.approach_x_m + 2.0, y_m, 0.0), (2.8, 0.0, 0.0))


def test_what_was_known_when_a_leg_began_may_grow_into_the_way_and_what_joined_it_late_not(
    flight: PerfectFlight,
) -> None:
    flight.see(6.0, 3.0, name="1")
    flight.cruise_at_full_speed()
    step, beside = flight.navigator._avoidance_step, flight.see(25.0, 3.0, name="2")
    flight.tick()
    assert step._in_time == {"front/1", "front/2"}
    (here,) = grown_by(flight, beside, 1.0)
    flight.see(flight.reference.position_leg_m[0] + 1.0, 3.0, name="3")
    flight.tick()
    assert step._in_time == {"front/1", "front/2"}
    joined = replace(beside, members=("front/2", "front/3"))
    step._check_pre_condition(here, joined, flight.now_s)
    assert len(flight.texts("violation")) == 1


@pytest.mark.parametrize(
    ("y_m", "error_m"), [(0.0, 1.5), (0.0, 2.0), (0.0, 3.0), (1.0, 0.05), (-1.0, 0.05)]
)
def test_an_obstacle_never_seen_before_is_late_however_coarse_its_sensor_or_far_aside(
    cruising: PerfectFlight, y_m: float, error_m: float
) -> None:
    cruising.see(cruising.reference.position_leg_m[0] + 3.0, y_m, error_m=error_m)
    cruising.tick()
    late = [text for text in cruising.texts("violation") if text.startswith("late_first_sight")]
    assert len(late) == 1


def test_another_broken_pre_condition_is_reported(cruising: PerfectFlight) -> None:
    obstacle = cruising.see(40.0, 0.0)
    here = State((obstacle.region.approach_x_m, 0.0, 0.0), (3.5, 0.0, 0.0))
    cruising.navigator._avoidance_step._check_pre_condition(here, obstacle, cruising.now_s)
    assert cruising.texts("pre_condition") == ["speed 3.50 m/s (expected 0 to 2.80 m/s)"]


# ---------------------------------------------------------------------------- end


def test_the_step_ends_past_the_border_and_the_cruise_goes_on(avoiding: PerfectFlight) -> None:
    avoidance = avoidance_of(avoiding)
    avoiding.run_until(FlightState.CRUISING)
    assert avoiding.navigator.avoidance is None
    end_s = avoidance.plan.trajectory.end_s
    assert end_s <= avoiding.now_s < end_s + TICK_S
    state = avoiding.navigator.reference(end_s)
    assert state is not None
    assert state.position_leg_m[0] == pytest.approx(avoidance.obstacle.region.x_pob_m, abs=1e-5)
    assert "cruise (post-condition)" in avoiding.texts("phase")


@pytest.mark.parametrize(("late_s", "ended"), [(-1e-6, False), (0.0, True)])
def test_the_step_ends_with_its_plan(avoiding: PerfectFlight, late_s: float, ended: bool) -> None:
    end_s = avoidance_of(avoiding).plan.trajectory.end_s
    avoiding.navigator.advance(avoiding.pose, end_s + late_s)
    assert (avoiding.state is FlightState.CRUISING) is ended


def test_a_broken_post_condition_is_reported_as_a_defect(avoiding: PerfectFlight) -> None:
    avoidance = avoidance_of(avoiding)
    avoiding.situation.avoidance = replace(avoidance, exit_speed_mps=1.0)
    avoiding.run_until(FlightState.CRUISING)
    assert avoiding.texts("post_condition") == [
        "speed 2.800 m/s (expected the exit speed 1.000 m/s)"
    ]


# ---------------------------------------------------------------------------- recheck


def test_an_obstacle_beside_the_plan_changes_nothing(avoiding: PerfectFlight) -> None:
    before = avoidance_of(avoiding)
    avoiding.see(28.0, 12.0, name="2")
    assert avoiding.navigator.avoidance is before
    assert len(avoiding.planner.problems) == 1


def test_growth_that_the_plan_keeps_clear_of_changes_nothing(avoiding: PerfectFlight) -> None:
    before = avoidance_of(avoiding)
    avoiding.see(25.0, 0.2, size_m=(0.9, 0.9))
    assert avoiding.navigator.avoidance is before


def test_growth_into_the_plan_is_planned_around(near: PerfectFlight) -> None:
    near.navigator.take_planned()
    before = avoidance_of(near)
    grown = measured_again(near, 0.3)
    after = avoidance_of(near)
    assert after.obstacle == grown
    assert after.plan is not before.plan
    assert after.entry_speed_mps == before.entry_speed_mps
    assert near.texts("replanned")[0].startswith("replanned around front/1 (")
    # It takes over at the next tick, from where the plan of before is then.
    assert after.plan.trajectory.start_s == pytest.approx(near.now_s + TICK_S)
    expected = before.plan.trajectory.sample(near.now_s + TICK_S)
    state = near.navigator.reference(near.now_s + TICK_S)
    assert state is not None
    assert state.position_leg_m == pytest.approx(expected.position_leg_m)
    (step,) = near.navigator.take_planned()
    assert step.plan is after.plan
    near.run_until(FlightState.ARRIVED)
    assert near.texts("violation") == []


def test_a_plan_replaced_as_soon_as_it_has_taken_over_is_flown_until_then(
    near: PerfectFlight,
) -> None:
    near.navigator.release_control(near.now_s)
    near.pose = pose_at(0.0)
    near.cruise_at_full_speed()
    near.run_until(FlightState.AVOIDING)
    near.now_s += TICK_S
    before = near.reference
    measured_again(near, 0.3)
    assert near.texts("replanned") != []
    assert near.reference == before


def test_growth_within_the_error_keeps_the_plan(near: PerfectFlight) -> None:
    before = avoidance_of(near)
    near.planner.failing = True
    for grown_m in (0.02, 0.03, 0.04):
        measured_again(near, grown_m)
    assert avoidance_of(near) is before
    assert len(near.planner.problems) == 1 + 3
    assert near.texts("plan_kept") == [
        "keeping the plan: obstacle front/1 has grown within its position error"
    ]
    assert near.state is FlightState.AVOIDING


def test_growth_beyond_the_error_without_a_plan_ends_in_a_hold(avoiding: PerfectFlight) -> None:
    avoiding.planner.failing = True
    measured_again(avoiding, 1.0)
    assert avoiding.state is FlightState.HOLDING
    assert avoiding.texts("violation") == ["plan_exists (front/1): 0.00, limit 1.00 plans"]


def test_another_obstacle_in_the_plan_ends_in_a_hold(avoiding: PerfectFlight) -> None:
    """Two steps cannot be flown as one: what is not merged is a failed assumption."""
    trajectory = avoidance_of(avoiding).plan.trajectory
    x_m, y_m, _ = trajectory.sample(trajectory.end_s - 0.5).position_leg_m
    avoiding.situation.adaptive = False
    avoiding.situation.rebuild_map()
    avoiding.see(x_m, y_m, name="2")
    assert avoiding.state is FlightState.HOLDING
    assert avoiding.texts("violation") == ["plan_exists (front/2): 0.00, limit 1.00 plans"]
    assert len(avoiding.planner.problems) == 1


def test_the_plan_ends_later_where_the_obstacle_reaches_beyond_its_end(
    avoiding: PerfectFlight,
) -> None:
    avoidance = avoidance_of(avoiding)
    trajectory = avoidance.plan.trajectory
    # Beside the obstacle: on the plan's last stretch, the box is found to be longer.
    avoiding.run(60.0, until=lambda: avoiding.now_s > trajectory.end_s - 0.3)
    avoiding.navigator.take_planned()
    box = avoidance.obstacle.measured
    longer = avoiding.see(
        (box.x_min_m + box.x_max_m + 3.0) / 2.0,
        (box.y_min_m + box.y_max_m) / 2.0,
        size_m=(4.0, 1.0),
    )
    after = avoidance_of(avoiding)
    final = trajectory.final
    met_again = longer.region.on_collision_course(*final.position_leg_m[:2])
    assert (after.plan.trajectory.end_s > trajectory.end_s) is met_again
    for step in avoiding.navigator.take_planned():
        assert step.plan is after.plan
        assert step.plan_time_s == 0.0
    avoiding.run_until(FlightState.ARRIVED)
    assert avoiding.texts("violation") == avoiding.texts("post_condition") == []


def test_what_has_ended_is_not_rechecked(avoiding: PerfectFlight) -> None:
    avoiding.now_s = avoidance_of(avoiding).plan.trajectory.end_s
    measured_again(avoiding, 0.6)
    assert avoiding.state is FlightState.AVOIDING
    assert len(avoiding.planner.problems) == 1


def test_outside_an_avoidance_there_is_nothing_to_recheck(cruising: PerfectFlight) -> None:
    step = cruising.navigator._avoidance_step
    obstacle = cruising.see(50.0, 0.0)
    step.recheck(obstacle, cruising.now_s)
    step.recheck_avoided(cruising.now_s)
    step.recertify(RESET, cruising.now_s)
    assert cruising.state is FlightState.CRUISING
    assert cruising.planner.problems == []


# ---------------------------------------------------------------------------- after a reset


def test_a_shift_keeps_the_certificate(avoiding: PerfectFlight) -> None:
    avoiding.navigator.shift((0.3, -0.4, 0.1))
    avoiding.navigator.fly_on_after_shift(RESET, avoiding.now_s)
    assert avoiding.state is FlightState.AVOIDING
    rest = avoidance_of(avoiding).plan.trajectory.from_time(avoiding.now_s)
    boxes = [obstacle.region.obstacle for obstacle in avoiding.navigator.obstacles]
    start = rest.sample(rest.start_s)
    assert certify_clear(rest, start, rest.start_s, avoiding.situation.envelope, boxes).valid


def test_a_plan_that_no_longer_certifies_is_not_flown(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdicts = [False, True]
    monkeypatch.setattr(ClearCheck, "is_clear", lambda *_: verdicts.pop(0))
    avoiding.navigator.fly_on_after_shift(RESET, avoiding.now_s)
    assert avoiding.state is FlightState.HOLDING
    assert avoiding.texts("phase")[-1] == (
        "holding: estimator_reset: 0.50, limit 0.40 m; braking to hover"
    )


def test_a_hold_keeps_what_was_avoided_as_it_was_planned(avoiding: PerfectFlight) -> None:
    avoidance = avoidance_of(avoiding)
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert avoiding.navigator.avoidance is avoidance
    avoiding.navigator.release_control(avoiding.now_s)
    assert avoiding.navigator.avoidance is None
