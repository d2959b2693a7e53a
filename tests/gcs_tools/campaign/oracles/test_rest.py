"""A flight without a certified way to rest is a finding, and so is a way into a true obstacle."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from gcs_tools.campaign.generator.faults import FAULT_KINDS, MISLEADING, UNDETECTABLE
from gcs_tools.campaign.held_ways import HeldWay
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.campaign.oracles.rest import distances_m, rest_held
from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.campaign.oracles.evidence import PHASES, flown, result, state

BEGINS = PHASES.index("cruise")
HELD: dict[str, Any] = {"phase": "thread", "rest_certified": True, "free_cells": 500}


@cache
def base() -> Evidence:
    """The flight in THREAD, under a contract that requires to be able to stop."""
    states = [state(n, **(HELD if phase != "standby" else {})) for n, phase in enumerate(PHASES)]
    return flown(states=states, plans=[])


def threaded(tick: int = BEGINS + 20, *, stop: bool = True, **changes: Any) -> Evidence:
    """The flight, with one of its ticks changed."""
    evidence = base()
    states = list(evidence.flight.states)
    states[tick] = replace(states[tick], **changes)
    scenario = evidence.case.scenario
    requirements = scenario.contract.requirements.model_copy(update={"stop": stop})
    contract = scenario.contract.model_copy(update={"requirements": requirements})
    case = replace(evidence.case, scenario=replace(scenario, contract=contract))
    return replace(evidence, case=case, flight=replace(evidence.flight, states=states))


def test_a_flight_that_always_holds_a_way_is_fine() -> None:
    assert list(rest_held(threaded())) == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rest_certified": None}, "the way to rest is not held in thread ()"),
        ({"rest_certified": False}, "the way to rest is not certified in thread ()"),
        ({"rest_certified": False, "free_cells": 0}, "the way to rest is not certified"),
        ({"rest_certified": False, "phase": "pause"}, "is not certified in pause"),
    ],
)
def test_one_tick_without_a_certified_way_is_found(changes: dict[str, Any], text: str) -> None:
    (found,) = rest_held(threaded(**changes))
    assert text in found


STILL: dict[str, Any] = {"reference_velocity_ned_mps": (0.0, 0.0, 0.0)}


def flown_through(*states: dict[str, Any]) -> list[str]:
    """Findings about a flight that ends with ticks in some states, the last one at rest."""
    evidence, found = threaded(), list(threaded().flight.states)
    for tick, changes in enumerate(states, start=len(found) - len(states)):
        found[tick] = replace(found[tick], **changes)
    return list(rest_held(replace(evidence, flight=replace(evidence.flight, states=found))))


def test_before_the_first_look_a_vehicle_at_rest_holds_nothing() -> None:
    assert list(rest_held(threaded(rest_certified=None, **STILL))) == []
    assert list(rest_held(threaded(rest_certified=False, **STILL)))


UNSEEN: dict[str, Any] = {"phase": "cruise", "state": "aligning", "rest_certified": None, **STILL}
ON_ITS_WAY: dict[str, Any] = {"phase": "cruise", "state": "cruising"}


@pytest.mark.parametrize("state", ["cruising", "avoiding", "threading"])
def test_the_start_of_a_later_leg_has_been_seen_on_the_way_there(state: str) -> None:
    before = {"state": state}
    assert flown_through(UNSEEN, before) == []
    assert flown_through(UNSEEN, before, UNSEEN, {"state": "cruising"}) == [
        "the way to rest is not held in cruise (aligning)"
    ]


def test_after_control_is_taken_again_or_the_set_is_emptied_a_start_may_be_unseen() -> None:
    assert flown_through(ON_ITS_WAY, {"phase": "hold", "state": "holding"}, UNSEEN, UNSEEN) == []
    emptied = {**UNSEEN, "free_cells": 0}
    assert flown_through(ON_ITS_WAY, emptied, UNSEEN) == []
    assert len(flown_through(ON_ITS_WAY, emptied, UNSEEN, ON_ITS_WAY, UNSEEN)) == 1


def test_what_a_doubt_has_emptied_certifies_nothing_any_more() -> None:
    evidence = threaded(rest_certified=False, free_cells=0)
    doubted = replace(evidence, result=result(violations=("position_quality: lost",)))
    assert list(rest_held(doubted)) == []


def test_without_the_requirement_to_stop_nothing_is_promised() -> None:
    assert list(rest_held(threaded(stop=False, rest_certified=None))) == []


# ------------------------------------------------------------------ against the truth


STEM = Obstacle(id="stem", center_ned_m=(10.0, 0.0), size_m=(1.0, 0.4), yaw_deg=90.0)


def beside(room_m: float, *, faults: tuple[Fault, ...] = (), covered: bool = True) -> Evidence:
    """A flight that held a way past a stem, whose face is 0.5 m east of its centre."""
    evidence = threaded()
    scenario = replace(evidence.case.scenario, obstacles=ObstacleField.of([STEM]), faults=faults)
    points_m = np.column_stack((np.linspace(0.0, 20.0, 401), np.full(401, 0.5 + room_m)))
    case = replace(evidence.case, scenario=scenario, covered=covered)
    return replace(evidence, case=case, ways=[HeldWay(3.0, points_m)])


def body_m() -> float:
    vehicle = threaded().case.scenario.contract.vehicle
    return vehicle.radius_m + vehicle.tracking_error_m


def test_a_way_that_the_vehicle_just_fits_along_is_free() -> None:
    assert list(rest_held(beside(body_m()))) == []


def test_a_way_into_a_true_obstacle_is_found_although_it_was_certified() -> None:
    (found,) = rest_held(beside(body_m() - 0.01))
    assert found.startswith("the way to rest held at 3.00 s passes a true obstacle")


def test_where_nothing_is_promised_or_the_service_was_misled_the_truth_does_not_count() -> None:
    assert list(rest_held(beside(0.0, covered=False))) == []
    assert list(rest_held(beside(0.0, faults=(Fault(kind="sensor_clock_ahead"),)))) == []
    assert len(list(rest_held(beside(0.0, faults=(Fault(kind="tick_stall"),))))) == 1


def test_distances_are_those_of_turned_boxes() -> None:
    points_m = np.array(
        [[10.0, 0.5], [10.0, 1.5], [10.2, 0.0], [10.5, 0.0], [10.5, 0.9], [13.2, 4.5]]
    )
    found_m = distances_m(points_m, ObstacleField.of([STEM]))[:, 0]
    assert found_m == pytest.approx([0.0, 1.0, 0.0, 0.3, 0.5, 5.0])


def test_only_kinds_that_exist_mislead() -> None:
    assert UNDETECTABLE < MISLEADING < set(FAULT_KINDS)
