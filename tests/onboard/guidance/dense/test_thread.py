"""Whole flights with best effort: whatever happens, a certified way to rest is held."""

import math
from collections.abc import Callable, Generator
from itertools import pairwise

import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.guidance.dense import pause
from onboard.guidance.dense.sliced_planning import SLICES_PER_TICK
from onboard.guidance.dense.stop_and_sidestep import StopAndSidestep
from onboard.guidance.dense.threaded_leg import ARRIVED_M
from onboard.guidance.dense.way_to_rest import STILL_MPS
from onboard.guidance.phases import FlightState, Phase
from onboard.monitoring.adaptation import PROGRESS_ASSUMPTIONS
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.planning.corridor.horizon import Horizon
from onboard.planning.corridor.receding_horizon import (
    HorizonPlan,
    HorizonProblem,
    RecedingHorizonPlanner,
)
from tests.onboard.guidance.dense.field_flight import (
    FieldFlight,
    IdealSeenSpace,
    Stem,
    random_field,
)
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to

FlightOver = Callable[..., FieldFlight]
OVER = (FlightState.ARRIVED, FlightState.HOLDING)
# A fence of stems, with gaps in which no vehicle fits, across the whole corridor.
FENCE = [Stem(8.0, -9.0 + 0.6 * k, 0.15) for k in range(31)]


def speed_mps(flight: FieldFlight) -> float:
    return math.hypot(*flight.reference.velocity_leg_mps)


def threading(flight: FieldFlight, speed_min_mps: float = 1.5) -> FieldFlight:
    """Fly until the vehicle is fast."""
    flight.depart()
    flight.run(30.0, until=lambda: speed_mps(flight) > speed_min_mps)
    assert speed_mps(flight) > speed_min_mps
    return flight


def assert_safe(flight: FieldFlight) -> None:
    assert flight.clearance_m > 0.0
    assert flight.adopted_clearance_m > 0.0
    assert flight.uncertified == 0
    assert flight.thread.slices_max <= SLICES_PER_TICK


# ---------------------------------------------------------------------------- forests


@pytest.mark.parametrize(
    ("seed", "stems_per_ha", "heading"), [(1, 500.0, "path"), (2, 800.0, "path"), (2, 500.0, "leg")]
)
def test_a_forest_is_flown_and_every_plan_on_the_way_ends_clear_of_the_stems(
    flight_over: FlightOver, seed: int, stems_per_ha: float, heading: str
) -> None:
    stems = random_field(seed, stems_per_ha, length_m=20.0)
    flight = flight_over(*stems, heading=heading)
    flight.depart()
    flight.run(90.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.ARRIVED, flight.events
    assert flight.thread.plans > 10
    assert_safe(flight)
    north_m, east_m, down_m = flight.pose.position_ned_m
    assert math.hypot(north_m - 20.0, east_m) <= ARRIVED_M
    assert down_m == pytest.approx(-4.0)


def test_the_next_leg_starts_where_the_vehicle_rests(flight_over: FlightOver) -> None:
    flight = flight_over(Stem(6.0, 0.1, 0.1), ends_ned_m=((10.0, 0.0), (10.0, 10.0)))
    flight.depart()
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.ARRIVED, flight.states
    assert flight.seen.frame is not None
    assert flight.seen.frame.heading_rad == pytest.approx(math.pi / 2.0, abs=0.05)
    assert math.dist(flight.pose.position_ned_m[:2], (10.0, 10.0)) < 0.5
    assert_safe(flight)


# ---------------------------------------------------------------------------- the start


def test_a_start_that_nothing_confirms_is_looked_at_all_round(flight_over: FlightOver) -> None:
    flight = flight_over(seen=IdealSeenSpace())
    flight.depart()
    headings_rad = []
    while flight.state is FlightState.LOOKING:
        flight.tick()
        headings_rad.append(flight.pose.yaw_rad)
        assert flight.now_s < 30.0
    assert flight.seen.confirmed == 1
    assert flight.state is FlightState.THREADING
    # Views of 120 degrees at these headings leave no bearing out.
    turned = sorted({round(math.degrees(heading)) % 360 for heading in headings_rad})
    gaps = [b - a for a, b in zip(turned, [*turned[1:], turned[0] + 360], strict=True)]
    assert max(gaps) < 120


def test_nothing_is_flown_before_the_start_is_confirmed(flight_over: FlightOver) -> None:
    flight = flight_over(seen=IdealSeenSpace())
    flight.depart()
    flight.run(3.0)
    assert flight.thread.way.certified is None
    assert flight.pose.position_ned_m == (0.0, 0.0, -4.0)


def test_a_start_beside_an_obstacle_is_held(flight_over: FlightOver) -> None:
    flight = flight_over(seen=IdealSeenSpace(refusing=True))
    flight.depart()
    flight.run_until(FlightState.HOLDING)
    assert "no_passage" in flight.texts("violation")[0]
    assert flight.pose.position_ned_m == (0.0, 0.0, -4.0)


def test_before_any_sensor_feeds_the_set_nothing_is_flown(best_effort: Contract) -> None:
    flight = PerfectFlight(best_effort, mission_to((20.0, 0.0)))
    flight.depart()
    flight.run(20.0)
    assert flight.pose.position_ned_m == (0.0, 0.0, -4.0)


# ---------------------------------------------------------------------------- no way


def test_where_there_is_no_way_the_vehicle_looks_and_gives_up_at_rest(
    flight_over: FlightOver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pause, "PAUSES_MAX", 4)
    flight = flight_over(*FENCE, ends_ned_m=((14.0, 0.0),))
    flight.depart()
    flight.run(600.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.HOLDING
    assert flight.thread.pauses == 4
    assert "no_passage" in flight.texts("violation")[0]
    assert speed_mps(flight) == pytest.approx(0.0, abs=1e-6)
    assert_safe(flight)


Plans = Generator[None, None, HorizonPlan]


def keeping(_: RecedingHorizonPlanner, problem: HorizonProblem) -> Plans:
    """Plan like a planner that never finds anything."""
    yield
    return HorizonPlan(problem.flown.next_node(), "kept", 0.0)


def raising(_: RecedingHorizonPlanner, problem: HorizonProblem) -> Plans:
    """Plan like a solver that fails."""
    yield
    raise FloatingPointError(str(problem.flown.start_s))


def without_numbers(_: RecedingHorizonPlanner, problem: HorizonProblem) -> Plans:
    """Plan like a solver that returns NaN."""
    yield
    base = problem.flown.next_node()
    nodes = base.nodes.copy()
    nodes[3:20, :2] = math.nan
    return HorizonPlan(Horizon(base.start_s, nodes, base.jerk_mps3), "improved", -1.0)


@pytest.mark.parametrize("plan", [keeping, raising, without_numbers])
def test_a_planner_that_finds_nothing_costs_a_pause_not_the_way_to_rest(
    flight_over: FlightOver, monkeypatch: pytest.MonkeyPatch, plan: Callable[..., Plans]
) -> None:
    flight = threading(flight_over())
    plans = flight.thread.plans
    monkeypatch.setattr(RecedingHorizonPlanner, "plan", plan)
    monkeypatch.setattr(StopAndSidestep, "begin", lambda *_, **__: False)
    flight.run_until(FlightState.LOOKING, seconds=15.0)
    flight.run(1.0)
    assert flight.thread.plans <= plans + 1
    assert speed_mps(flight) == pytest.approx(0.0, abs=1e-6)
    assert flight.texts("violation") == []
    assert_safe(flight)


@pytest.mark.parametrize("plan", [keeping, raising])
def test_without_the_planner_the_leg_is_flown_by_stopping_and_going(
    flight_over: FlightOver, monkeypatch: pytest.MonkeyPatch, plan: Callable[..., Plans]
) -> None:
    monkeypatch.setattr(RecedingHorizonPlanner, "plan", plan)
    flight = flight_over(Stem(8.0, 0.1, 0.3))
    flight.depart()
    flight.run_until(FlightState.ARRIVED)
    assert_safe(flight)


# ---------------------------------------------------------------------------- what costs time


def test_a_silent_sensor_stops_the_vehicle_which_goes_on_by_itself(flight_over: FlightOver) -> None:
    flight = threading(flight_over(Stem(12.0, 0.1, 0.2), ends_ned_m=((24.0, 0.0),)))
    flight.blind = True
    flight.run(40.0, until=lambda: flight.state is FlightState.LOOKING and flight.thread.way.still)
    blind_at_m = flight.pose.position_ned_m[0]
    assert flight.state is FlightState.LOOKING
    assert speed_mps(flight) < STILL_MPS
    pauses = flight.thread.pauses
    flight.run(20.0)
    assert (flight.state, flight.thread.pauses) == (FlightState.LOOKING, pauses)
    flight.blind = False
    flight.run_until(FlightState.ARRIVED)
    assert blind_at_m < 23.0
    assert_safe(flight)


def test_what_costs_time_only_is_flown_on_through(flight_over: FlightOver) -> None:
    flight = threading(flight_over())
    for assumption in PROGRESS_ASSUMPTIONS:
        flight.navigator.respond_to(Violation(assumption, 2.0, 1.0, "m"), flight.now_s)
    flight.run_until(FlightState.ARRIVED)
    assert_safe(flight)


@pytest.mark.parametrize(
    "assumption", [Assumption.TRACKING_ERROR, Assumption.DETECTION_UNCERTAINTY]
)
def test_what_safety_rests_on_ends_at_rest_on_the_way_that_was_held(
    flight_over: FlightOver, assumption: Assumption
) -> None:
    flight = threading(flight_over())
    reference = flight.situation.reference
    held = reference.upcoming or reference.current
    assert held is not None
    flight.navigator.respond_to(Violation(assumption, 2.0, 1.0, "m"), flight.now_s)
    assert flight.state is FlightState.HOLDING
    flight.run(8.0)
    assert flight.reference.position_leg_m == pytest.approx(held.final.position_leg_m)
    assert speed_mps(flight) == pytest.approx(0.0, abs=1e-6)
    assert not any("no way to stop" in text for text in flight.texts("phase"))


@pytest.mark.parametrize("passive", [True, False])
def test_a_vehicle_that_is_too_fast_is_held_for_its_run_on_only(
    best_effort: Contract, *, passive: bool
) -> None:
    requirements = best_effort.requirements.model_copy(update={"passive_safety": passive})
    contract = best_effort.model_copy(update={"requirements": requirements})
    seen = IdealSeenSpace(start_known=True)
    flight = threading(FieldFlight(contract, mission_to((16.0, 0.0)), [], seen), 1.0)
    too_fast = Violation(Assumption.VELOCITY_ERROR, 0.9, 0.2, "m/s", "x")
    flight.navigator.respond_to(too_fast, flight.now_s)
    assert (flight.state is FlightState.HOLDING) == passive


def test_a_late_tick_flies_on_along_the_way_that_is_held(flight_over: FlightOver) -> None:
    flight = threading(flight_over())
    flight.now_s += 0.7
    expected = flight.navigator.reference(flight.now_s + TICK_S)
    flight.tick()
    assert flight.reference == expected
    flight.run_until(FlightState.ARRIVED)
    assert_safe(flight)


def test_the_map_blocks_nothing_in_a_hold_from_seen_space(flight_over: FlightOver) -> None:
    """The way to rest lies in space that was seen free: no later box makes it brake elsewhere."""
    flight = threading(flight_over())
    flight.navigator.respond_to(DEFECT, flight.now_s)
    held = flight.situation.reference.current
    flight.see(flight.reference.position_leg_m[0] + 1.0, 0.0)
    assert flight.situation.reference.current is held


# ---------------------------------------------------------------------------- resets, missions


def test_a_reset_moves_the_way_that_is_held(flight_over: FlightOver) -> None:
    flight = threading(flight_over())
    before = flight.reference.position_leg_m
    flight.navigator.shift((0.2, 0.1, 0.0))
    flight.seen.shift(0.2, 0.1)
    after = flight.reference.position_leg_m
    assert after == pytest.approx((before[0] + 0.2, before[1] + 0.1, before[2]))
    flight.stems = [Stem(s.north_m + 0.2, s.east_m + 0.1, s.radius_m) for s in flight.stems]
    flight.run_until(FlightState.ARRIVED)


def test_another_mission_begins_where_the_vehicle_comes_to_rest(flight_over: FlightOver) -> None:
    flight = threading(flight_over())
    flight.navigator.change_mission(mission_to((-2.0, 0.0)), flight.now_s)
    assert flight.state is FlightState.RESTING
    plans = flight.thread.plans
    flight.run_until(FlightState.LOOKING)
    assert flight.thread.plans == plans
    flight.run_until(FlightState.ARRIVED)
    assert math.dist(flight.pose.position_ned_m[:2], (-2.0, 0.0)) < 0.5


def test_the_pilot_takes_over_and_hands_back(flight_over: FlightOver) -> None:
    flight = threading(flight_over())
    flight.navigator.release_control(flight.now_s)
    assert flight.navigator.setpoint(flight.now_s) is None
    assert flight.thread.way.flown is None
    assert not flight.situation.rest_held
    flight.depart()
    flight.run_until(FlightState.ARRIVED)


# ---------------------------------------------------------------------------- the nose


@pytest.mark.parametrize("heading", ["leg", "path"])
def test_the_nose_turns_in_flight_no_faster_than_frames_allow_or_a_look_needs(
    flight_over: FlightOver, heading: str
) -> None:
    stems = random_field(3, 500.0, length_m=20.0)
    flight = flight_over(*stems, heading=heading)
    flight.depart()
    yaws_rad = []
    while flight.state not in OVER:
        before = flight.state
        flight.tick()
        if flight.navigator.phase is before.phase is Phase.THREAD:
            yaws_rad.append(flight.pose.yaw_rad)
        else:
            yaws_rad.append(math.nan)
    steps = [abs(b - a) for a, b in pairwise(yaws_rad)]
    fastest = max(step for step in steps if not math.isnan(step))
    assert fastest <= math.radians(20.0 if heading == "leg" else 60.0) * TICK_S + 1e-9
    if heading == "leg":
        assert yaws_rad[-2] == pytest.approx(0.0, abs=1e-9)


def test_along_the_leg_the_nose_is_not_turned_aside_before_the_vehicle_rests(
    flight_over: FlightOver,
) -> None:
    """W holds with the nose along the leg; a pause for want of progress may begin in motion."""
    flight = threading(flight_over(heading="leg"))
    flight.thread._pause(flight.now_s)
    flight.thread._leg.pause.look_round((1.5, 0.0), 3)
    turned_at_mps = []
    while flight.state is FlightState.LOOKING:
        flight.tick()
        if abs(flight.situation.reference.heading_rad) > math.radians(5.0):
            turned_at_mps.append(speed_mps(flight))
    assert turned_at_mps
    assert max(turned_at_mps) <= STILL_MPS


def test_along_the_leg_nothing_is_planned_while_the_nose_only_passes_the_leg(
    flight_over: FlightOver,
) -> None:
    flight = flight_over(heading="leg", ends_ned_m=((20.0, 0.0),))
    flight.depart()
    thread = flight.thread
    thread._frames_before, thread._confirming = -100, False
    assert flight.pose.yaw_rad == 0.0
    assert thread._may_plan(flight.pose)
    flight.situation.reference.heading_rad = math.radians(15.0)  # the nose lags behind its command
    assert not thread._may_plan(flight.pose)
