"""What is left of each promise, by hand-made flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_tools.campaign.adversary.draw import adversary_case
from gcs_tools.campaign.adversary.margins import least_margin, margins
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.held_ways import HeldWay
from gcs_tools.campaign.oracles.evidence import Evidence
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.recording.messages import PlanRecord, StateRecord
from tests.gcs_tools.campaign.oracles.evidence import flown, result

WALL = Obstacle(id="wall", center_ned_m=(10.0, 0.0), size_m=(2.0, 8.0))


def case(*, passive: bool) -> FlightCase:
    cases = (adversary_case(3, number) for number in range(40))
    drawn = next(
        each for each in cases if each.scenario.contract.requirements.passive_safety is passive
    )
    return replace(drawn, scenario=replace(drawn.scenario, obstacles=ObstacleField.of([WALL])))


def evidence(*, passive: bool, speed_mps: float = 0.0) -> Evidence:
    state = StateRecord(
        time_s=1_790_000_001.0,
        phase="cruise",
        reference_position_ned_m=(4.0, 0.0, -3.0),
        reference_velocity_ned_mps=(speed_mps, 0.0, 0.0),
        reference_acceleration_ned_mps2=(0.0, 0.0, 0.0),
    )
    found = replace(flown(ended=replace(result(), clearance_min_m=3.0)), case=case(passive=passive))
    ways = (HeldWay(0.0, np.array([[4.0, 0.0], [6.0, 0.0]])),)
    return replace(found, ways=ways, flight=replace(found.flight, states=[state], plans=[]))


def body_m(found: Evidence) -> float:
    vehicle = found.case.scenario.contract.vehicle
    return vehicle.radius_m + vehicle.tracking_error_m


def test_each_promise_has_a_margin() -> None:
    found = evidence(passive=True)
    assert dict(margins(found)) == pytest.approx(
        {
            "clearance": 3.0,
            "rest": 3.0 - body_m(found),
            "plan": 5.0 - body_m(found),
            "run_on": 5.0 - body_m(found),
        }
    )
    least = least_margin(found)
    assert least is not None
    assert least.promise == "rest"


@pytest.mark.parametrize("stop", [True, False])
def test_a_plan_counts_as_far_as_it_is_flown_where_a_way_to_rest_is_held(*, stop: bool) -> None:
    """Without one, the whole of it does."""
    found = evidence(passive=False)
    plan = PlanRecord(
        time_s=1_790_000_001.0, kind="qp", path_ned_m=[(0.0, 0.0, -3.0), (9.5, 0.0, -3.0)]
    )
    scenario = found.case.scenario
    requirements = scenario.contract.requirements.model_copy(update={"stop": stop})
    contract = scenario.contract.model_copy(update={"requirements": requirements})
    of_it = replace(found.case, scenario=replace(scenario, contract=contract))
    found = replace(found, case=of_it, flight=replace(found.flight, plans=[plan]))
    left_m = dict(margins(found))["plan"] + body_m(found)
    assert left_m == pytest.approx(5.0 if stop else 0.0)


def test_a_run_into_an_obstacle_is_negative() -> None:
    fast = dict(margins(evidence(passive=True, speed_mps=20.0)))
    assert fast["run_on"] < 0.0


def test_without_passive_safety_nothing_is_promised_of_a_dead_daemon() -> None:
    assert "run_on" not in dict(margins(evidence(passive=False)))


def test_without_obstacles_or_a_flight_there_is_none() -> None:
    found = evidence(passive=True)
    empty = replace(found.case.scenario, obstacles=ObstacleField.of([]))
    assert least_margin(replace(found, case=replace(found.case, scenario=empty))) is None
    unflown = replace(found.result, clearance_min_m=None)
    assert least_margin(replace(found, result=unflown)) is None
