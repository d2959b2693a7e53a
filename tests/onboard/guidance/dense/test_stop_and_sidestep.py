"""Theorem P, flown: at the limit of the clause every obstacle is passed by stop, look and sidestep.

The planner finds nothing here, so that the only motions are those of the proof.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

from onboard.contract.assessment import Assessment, assess
from onboard.contract.run_on import NO_RUN_ON
from onboard.files.contract_file import Contract, load_contract
from onboard.geometry.box import Box
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.dense.limits import run_on_of
from onboard.guidance.dense.pause import PAUSES_MAX
from onboard.guidance.dense.stop_and_sidestep import MOTIONS_MAX, Known, Step, StopAndSidestep
from onboard.guidance.phases import FlightState
from onboard.perception.seen_free import CELL_M
from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon
from onboard.planning.corridor.receding_horizon import (
    HorizonPlan,
    HorizonProblem,
    RecedingHorizonPlanner,
)
from tests.onboard.guidance.dense.box_flight import BoxFlight
from tests.onboard.guidance.perfect_flight import mission_to

CONTRACTS = Path(__file__).parents[3] / "contracts"
OVERHANG_M = 0.5
SIZE_MAX_M = 1.6
ROWS = 2
# In this field all looks have been used up at the start.
LOOKED_ENOUGH = 26


@pytest.fixture(autouse=True)
def no_planner(monkeypatch: pytest.MonkeyPatch) -> None:
    def plan(
        _: RecedingHorizonPlanner, problem: HorizonProblem
    ) -> Generator[None, None, HorizonPlan]:
        yield
        return HorizonPlan(problem.flown.next_node(), "kept", 0.0)

    monkeypatch.setattr(RecedingHorizonPlanner, "plan", plan)


@pytest.fixture
def coasting() -> Contract:
    """A vehicle that coasts after a loss of the stream, as `BoxFlight` has it."""
    contract = load_contract(CONTRACTS / "precise_vehicle.yaml")
    requirements = contract.requirements.model_copy(update={"progress": "best_effort"})
    return contract.model_copy(update={"requirements": requirements})


def with_passive_safety(contract: Contract, *, passive: bool) -> Contract:
    requirements = contract.requirements.model_copy(update={"passive_safety": passive})
    sensor = contract.sensor.model_copy(update={"field_of_view_deg": 90.0})
    return contract.model_copy(update={"requirements": requirements, "sensor": sensor})


def separations_m(assessment: Assessment) -> tuple[float, float]:
    """Return F + S and o + S of two-tier theory, 2.1 and B1, with what cells take from a gap.

    A cell on either side for where it begins, and another one for lines of sight that graze a face:
    a cell's diagonal, as P has it, is not always enough.
    """
    terms, limits = assessment.terms, assessment.limits
    v, run_on = terms.cruise_speed_mps, run_on_of(assessment)
    late_m = v * (terms.reaction_time_s + terms.attitude_lag_s)
    coasts = run_on is not NO_RUN_ON
    front_m = late_m + (run_on.reach_m(v) if coasts else v**2 / (2.0 * limits.brake_mps2))
    rho_m = terms.body_m + 2.0 * terms.position_error_m + 2.0 * CELL_M
    size_m = SIZE_MAX_M + 2.0 * rho_m
    return front_m + size_m, (OVERHANG_M if coasts else 0.0) + size_m


def field_at_the_limit(assessment: Assessment, seed: int) -> list[Box]:
    """Return rows of boxes across the leg that are as near to each other as the clause allows."""
    random = np.random.default_rng(seed)
    along_m, aside_m = separations_m(assessment)
    boxes, x_m = [], 7.0
    for _ in range(ROWS):
        y_m = float(random.uniform(-0.9, 0.9))
        for place in range(-2, 3):
            # Those in the way are as large as the clause says, some of their neighbours, too.
            largest = place == 0 or random.random() < 0.5
            half_m = np.full(2, SIZE_MAX_M / 2.0) if largest else random.uniform(0.15, 0.8, 2)
            (half_x_m, half_y_m), at_y_m = half_m.tolist(), y_m + place * (aside_m + 1e-6)
            boxes.append(Box(x_m - half_x_m, x_m + half_x_m, at_y_m - half_y_m, at_y_m + half_y_m))
        x_m += along_m + 1e-6
    return boxes


# The first field asks for draws back and for second sidesteps, the other for gaps' middles.
@pytest.mark.parametrize(
    ("seed", "heading", "passive"),
    [
        (12, "leg", True),
        (12, "path", False),
        (25, "leg", False),
        (25, "path", True),
        (LOOKED_ENOUGH, "path", False),
    ],
)
def test_every_obstacle_of_the_clause_is_passed_without_the_planner(
    coasting: Contract, seed: int, heading: str, *, passive: bool
) -> None:
    contract = with_passive_safety(coasting, passive=passive)
    boxes = field_at_the_limit(assess(contract), seed)
    end_m = max(box.x_max_m for box in boxes) + 4.0
    mission = mission_to((end_m, 0.0), half_width_m=12.0).model_copy(update={"heading": heading})
    flight = BoxFlight(contract, mission, boxes, seed)
    flight.depart()
    if seed == LOOKED_ENOUGH:  # it is tried before giving up, too
        flight.thread._leg.pause.count = PAUSES_MAX
    over = (FlightState.ARRIVED, FlightState.HOLDING)
    flight.run(240.0, until=lambda: flight.state in over)
    assert flight.state is FlightState.ARRIVED, (flight.events, flight.reference)
    assert flight.clearance_m > 0.0
    assert flight.run_on_clearance_m > 0.0
    assert flight.uncertified == flight.misled == 0


# ---------------------------------------------------------------------------- when it is tried


@pytest.fixture
def resting(best_effort: Contract) -> BoxFlight:
    """Rest before a wall through which nothing leads."""
    wall = Box(3.0, 4.0, -12.0, 12.0)
    flight = BoxFlight(best_effort, mission_to((12.0, 0.0)), [wall])
    flight.depart()
    flight.run_until(FlightState.THREADING)
    flight.run(30.0, until=lambda: flight.thread.pauses == 1)
    return flight


def test_before_a_wall_it_is_tried_before_each_pause_and_ends_at_rest(resting: BoxFlight) -> None:
    flight, manoeuvre = resting, resting.thread._leg.manoeuvre
    looked = 0
    for _ in range(6000):
        flight.tick()
        looked += manoeuvre.looking
        if flight.thread.pauses == 3:
            break
    assert looked > 100
    assert flight.thread.pauses == 3
    assert flight.thread.way.still
    assert flight.state is FlightState.LOOKING
    assert flight.clearance_m > 0.0


def test_it_is_begun_at_rest_and_not_for_ever_without_getting_farther(resting: BoxFlight) -> None:
    manoeuvre, way = resting.thread._leg.manoeuvre, resting.thread.way
    assert way.flown is not None
    manoeuvre.cancel()
    manoeuvre._motions = MOTIONS_MAX
    assert not manoeuvre.begin(may_look=True)
    way.begin(resting.now_s, (way.flown.nodes[0, 0, 0] + 0.31, 0.0, 0.0))
    assert manoeuvre.begin(may_look=True)
    jerks = np.zeros((PIECES, 2))
    jerks[:2, 0] = 3.0, -3.0
    way.flown = Horizon.integrated(resting.now_s, np.zeros((3, 2)), jerks)
    assert not manoeuvre.begin(may_look=True)


def test_along_the_leg_nothing_is_flown_with_the_nose_elsewhere(resting: BoxFlight) -> None:
    manoeuvre = resting.thread._leg.manoeuvre
    manoeuvre.cancel()
    resting.seen._seen.void()
    resting.seen._seen.confirm(0.0, 0.0, 14.0)
    known = Known(resting.seen.grid(), [], (0.0, 0.0), math.radians(40.0), 100)
    assert manoeuvre.begin(may_look=False)
    assert manoeuvre.advance(known, resting.now_s) is Step.FAILED
    assert manoeuvre.begin(may_look=False)
    ahead = known._replace(heading_rad=0.0)
    resting.situation.reference.heading_rad = 0.0
    assert manoeuvre.advance(ahead, resting.now_s) is Step.FLIES


def looked_round(manoeuvre: StopAndSidestep, flight: BoxFlight, grid: FreeGrid) -> Step:
    """Look with a nose that follows at once, until something else is decided."""
    for tick in range(5000):
        heading_rad = flight.situation.reference.heading_rad
        step = manoeuvre.advance(Known(grid, [], (0.0, 0.0), heading_rad, tick), flight.now_s)
        if not manoeuvre.looking and step is not Step.GOES_ON:
            return step
    pytest.fail("it looks for ever")


def test_what_is_too_near_to_be_seen_is_looked_at_from_farther_away(resting: BoxFlight) -> None:
    """Free is only the way that has led here: it draws back along it, and looks from there."""
    flight, seen = resting, resting.seen._seen
    manoeuvre, way = flight.thread._leg.manoeuvre, flight.thread.way
    body_m = flight.thread._leg.limits.body_radius_m
    manoeuvre.cancel()
    seen.void()
    for back_m in np.arange(0.0, 3.0 * body_m, CELL_M):
        seen.confirm(-float(back_m), 0.0, body_m + 0.2)
    flight.situation.reference.heading_rad = 0.0
    way.begin(flight.now_s, (0.0, 0.0, 0.0))
    assert manoeuvre.begin(may_look=True)
    assert looked_round(manoeuvre, flight, seen.grid()) is Step.FLIES
    assert manoeuvre.moving
    way.pass_nodes(flight.now_s + PIECE_S)
    assert way.flown is not None
    x_m, y_m = way.flown.nodes[-1, 0].tolist()
    assert -3.0 * body_m < x_m < -0.9 * body_m
    assert y_m == pytest.approx(0.0, abs=1e-9)
    way.begin(flight.now_s, (x_m, y_m, 0.0))
    known = Known(seen.grid(), [], (x_m, y_m), 0.0, 0)
    assert manoeuvre.advance(known, flight.now_s) is Step.GOES_ON
    assert manoeuvre.looking


def test_without_room_to_draw_back_it_gives_up(resting: BoxFlight) -> None:
    flight, seen = resting, resting.seen._seen
    manoeuvre, way = flight.thread._leg.manoeuvre, flight.thread.way
    manoeuvre.cancel()
    seen.void()
    seen.confirm(0.0, 0.0, flight.thread._leg.limits.body_radius_m + 0.2)
    flight.situation.reference.heading_rad = 0.0
    way.begin(flight.now_s, (0.0, 0.0, 0.0))
    assert manoeuvre.begin(may_look=True)
    assert looked_round(manoeuvre, flight, seen.grid()) is Step.FAILED
