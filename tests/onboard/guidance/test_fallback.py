"""The way to a hover, and what blocks it."""

import math

import pytest

from onboard.events import Severity
from onboard.files.contract_file import Contract
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.fallback import UNCERTIFIED
from onboard.guidance.phases import FlightState, Phase
from tests.onboard.guidance.perfect_flight import DEFECT, PerfectFlight, mission_to, pose_at


def at_rest(flight: PerfectFlight) -> bool:
    return math.hypot(*flight.reference.velocity_leg_mps) < 1e-6


def test_in_cruise_it_brakes_at_once(cruising: PerfectFlight) -> None:
    x_m = cruising.reference.position_leg_m[0]
    cruising.navigator.hold(DEFECT, cruising.now_s)
    assert cruising.state is FlightState.HOLDING
    (event,) = [event for event in cruising.navigator.events if event.name == "phase"]
    assert event.text == "holding: self_check: 1.00, limit 0.00 exceptions; braking to hover"
    assert event.severity is Severity.ERROR
    cruising.run(4.0)
    assert at_rest(cruising)
    stopping_m = cruising.navigator.assessment.inflated.stopping_distance_m
    assert cruising.reference.position_leg_m[0] - x_m <= stopping_m


@pytest.mark.parametrize("state", [s for s in FlightState if not s.flying])
def test_what_does_not_fly_has_nothing_to_brake(
    cruising: PerfectFlight, state: FlightState
) -> None:
    current = cruising.situation.reference.current
    cruising.situation.state = state
    cruising.navigator.hold(DEFECT, cruising.now_s)
    assert cruising.state is state
    assert cruising.situation.reference.current is current
    assert cruising.navigator.events == []


def test_where_the_reference_is_not_trusted_it_brakes_from_the_pose(
    cruising: PerfectFlight,
) -> None:
    measured = pose_at(5.0, 3.0, -4.5, velocity_ned_mps=(1.0, 0.0, 0.0))
    cruising.navigator.hold(DEFECT, cruising.now_s, measured)
    assert cruising.reference.position_leg_m == pytest.approx((5.0, 3.0, -0.5))
    assert cruising.reference.velocity_leg_mps == pytest.approx((1.0, 0.0, 0.0))
    assert cruising.texts("phase")[-1].endswith("; braking to hover where the vehicle is now")


def test_a_second_failure_changes_nothing(cruising: PerfectFlight) -> None:
    cruising.navigator.hold(DEFECT, cruising.now_s)
    braking = cruising.situation.reference.current
    cruising.navigator.events.clear()
    cruising.navigator.hold(DEFECT, cruising.now_s + 0.1)
    assert cruising.situation.reference.current is braking
    assert cruising.navigator.events == []


def test_in_an_avoidance_it_brakes_while_that_is_clear(avoiding: PerfectFlight) -> None:
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert avoiding.texts("phase")[-1].endswith("; braking to hover")
    assert avoiding.situation.reference.upcoming is None
    avoiding.run(5.0)
    assert at_rest(avoiding)
    # Braking from the front of the region ends short of the obstacle.
    assert avoiding.reference.position_leg_m[0] < 24.5 - 0.3


def test_where_braking_is_blocked_it_finishes_the_avoidance(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    avoidance = avoiding.situation.avoidance
    assert avoidance is not None
    end_s = avoidance.plan.trajectory.end_s
    # Of the three ways only that which brakes at once ends before the plan does.
    monkeypatch.setattr(ClearCheck, "is_clear", lambda _, way, *__: way.end_s >= end_s - 1e-9)
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert avoiding.texts("phase")[-1].endswith("; finishing the avoidance, then braking to hover")
    way = avoiding.situation.reference.current
    assert way is not None
    assert way.end_s > end_s
    assert way.final.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    border_m = avoidance.obstacle.region.x_pob_m
    assert way.sample(end_s).position_leg_m[0] == pytest.approx(border_m, abs=1e-5)


@pytest.mark.parametrize("blocked", ["the plan", "the stop after it"])
def test_finishing_the_avoidance_needs_both_the_plan_and_the_stop_after_it(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch, blocked: str
) -> None:
    avoidance = avoiding.situation.avoidance
    assert avoidance is not None
    end_s = avoidance.plan.trajectory.end_s
    # The plan ends there, and the stop after it begins there; braking at once does neither.
    plan_clear = blocked != "the plan"
    monkeypatch.setattr(
        ClearCheck,
        "is_clear",
        lambda _, way: (way.end_s if plan_clear else way.start_s) == end_s,
    )
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert avoiding.texts("phase")[-1].endswith(UNCERTIFIED)


def test_at_the_end_of_the_plan_there_is_nothing_left_to_finish(avoiding: PerfectFlight) -> None:
    avoidance = avoiding.situation.avoidance
    assert avoidance is not None
    avoiding.navigator.hold(DEFECT, avoidance.plan.trajectory.end_s)
    assert avoiding.state is FlightState.HOLDING
    assert "finishing" not in avoiding.texts("phase")[-1]


@pytest.mark.parametrize("seconds", [0.0, 1.5])
def test_where_nothing_certifies_it_says_so(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    avoiding.run(seconds)
    assert avoiding.states[-1] is FlightState.AVOIDING
    monkeypatch.setattr(ClearCheck, "is_clear", lambda *_: False)
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert avoiding.texts("phase")[-1].endswith(UNCERTIFIED)
    assert avoiding.state is FlightState.HOLDING


@pytest.mark.parametrize("finishing", [True, False])
def test_where_nothing_certifies_what_keeps_farther_away_is_flown(
    avoiding: PerfectFlight, monkeypatch: pytest.MonkeyPatch, finishing: bool
) -> None:
    avoidance = avoiding.situation.avoidance
    assert avoidance is not None
    end_s = avoidance.plan.trajectory.end_s
    monkeypatch.setattr(ClearCheck, "is_clear", lambda *_: False)
    monkeypatch.setattr(
        ClearCheck, "room_m", lambda _, way: 1.0 if (way.end_s > end_s) is finishing else 0.5
    )
    avoiding.navigator.hold(DEFECT, avoiding.now_s)
    assert ("keeps farther away" in avoiding.texts("phase")[-1]) is finishing


# ---------------------------------------------------------------------------- on the way to it


def holding(flight: PerfectFlight) -> PerfectFlight:
    flight.navigator.hold(DEFECT, flight.now_s)
    flight.tick()
    return flight


def test_an_obstacle_on_the_braking_path_is_reported(cruising: PerfectFlight) -> None:
    flight = holding(cruising)
    flight.see(flight.reference.position_leg_m[0] + 0.6, 0.0)
    (text,) = flight.texts("hold_replanned")
    assert text == f"obstacle front/1 blocks the braking path: braking to hover{UNCERTIFIED}"


def test_an_obstacle_off_the_braking_path_changes_nothing(cruising: PerfectFlight) -> None:
    flight = holding(cruising)
    braking = flight.situation.reference.current
    flight.see(flight.reference.position_leg_m[0] + 10.0, 0.0)
    assert flight.situation.reference.current is braking
    assert flight.texts("hold_replanned") == []


def test_at_rest_nothing_is_left_to_block(cruising: PerfectFlight) -> None:
    flight = holding(cruising)
    braking = flight.situation.reference.current
    assert braking is not None
    flight.now_s = braking.end_s
    flight.see(flight.reference.position_leg_m[0] + 0.5, 0.0)
    assert flight.texts("hold_replanned") == []


@pytest.mark.parametrize("state", FlightState)
def test_only_a_hover_moves_to_where_the_vehicle_is(
    cruising: PerfectFlight, state: FlightState
) -> None:
    current = cruising.situation.reference.current
    cruising.situation.state = state
    cruising.navigator.hover_at(pose_at(7.0, 2.0, -3.0), cruising.now_s)
    if state.phase in (Phase.HOLD, Phase.ARRIVED):
        assert cruising.reference.position_leg_m == pytest.approx((7.0, 2.0, 1.0))
    else:
        assert cruising.situation.reference.current is current
    assert cruising.state is state


# ------------------------------------------------------------------ where only swerving is safe


@pytest.fixture
def pointed(contract: Contract) -> PerfectFlight:
    """A vehicle that rolls well and hardly brakes, at full speed, without passive safety."""
    vehicle = contract.vehicle.model_copy(update={"pitch_max_deg": 6.0, "roll_max_deg": 20.0})
    requirements = contract.requirements.model_copy(update={"passive_safety": False})
    update = {"vehicle": vehicle, "requirements": requirements}
    flight = PerfectFlight(contract.model_copy(update=update), mission_to((60.0, 0.0)))
    flight.cruise_at_full_speed()
    return flight


def test_where_braking_comes_too_late_an_avoidance_is_tried_first(pointed: PerfectFlight) -> None:
    here_m = pointed.reference.position_leg_m[0]
    braking = pointed.situation.braking_from(pointed.reference, pointed.now_s)
    stops_m = braking.final.position_leg_m[0]
    obstacle = pointed.see(stops_m + 0.5, 0.2, size_m=(0.6, 0.6))
    assert obstacle.region.extent.x_min_m > here_m
    pointed.navigator.hold(DEFECT, pointed.now_s)
    assert pointed.texts("phase")[-1].endswith(
        "; avoiding what braking would meet, then braking to hover"
    )
    box = obstacle.region.obstacle
    for _ in range(600):
        pointed.tick()
        x_m, y_m, _ = pointed.reference.position_leg_m
        assert not (box.x_min_m < x_m < box.x_max_m and box.y_min_m < y_m < box.y_max_m)
    assert at_rest(pointed)
    assert pointed.reference.position_leg_m[0] > box.x_max_m


@pytest.mark.parametrize(("yaw_rad", "along"), [(0.0, True), (math.pi / 4.0, False)])
def test_from_a_pose_it_brakes_along_the_leg_with_w_and_else_with_the_least_of_it(
    contract: Contract, yaw_rad: float, *, along: bool
) -> None:
    """W holds along and across the nose: of a turned one nothing beyond its least limit."""
    vehicle = contract.vehicle.model_copy(update={"roll_max_deg": 5.0})
    flight = PerfectFlight(
        contract.model_copy(update={"vehicle": vehicle}), mission_to((60.0, 0.0))
    )
    flight.cruise_at_full_speed()
    measured = pose_at(20.0, velocity_ned_mps=(2.8, 0.5, 0.0), yaw_rad=yaw_rad)
    flight.navigator.hold(DEFECT, flight.now_s, measured)
    current, limits = flight.situation.reference.current, flight.navigator.assessment.limits
    assert current is not None
    strongest_mps2 = math.hypot(*abs(current.acceleration_leg_mps2[:, :2]).max(axis=0))
    least_mps2 = min(limits.brake_mps2, limits.left_mps2)
    assert (strongest_mps2 <= least_mps2 + 1e-9) is not along
