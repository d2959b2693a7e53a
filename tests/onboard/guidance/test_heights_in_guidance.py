"""What guidance makes of obstacles that are lower than the leg."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from onboard.contract.heights import half_band_m
from onboard.files.contract_file import Contract
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.departure import RefusalKind, departure_refusals
from onboard.motion.trajectory import State
from onboard.perception.detection import DownRange
from onboard.planning.closed_form import cruise
from tests.onboard.guidance.perfect_flight import PerfectFlight, mission_to, pose_at
from tests.onboard.perception.messages import square

LOW: DownRange = (-1.0, math.inf)


@pytest.fixture
def flight(contract: Contract) -> PerfectFlight:
    """A leg of 60 m north at 4 m, under a contract with heights."""
    document: dict[str, Any] = contract.model_dump()
    document["requirements"]["stop"] = True
    document["vehicle"] |= {"radius_z_m": 0.3, "height_drift_m": 0.3, "tracking_error_z_m": 0.5}
    document["sensor"] |= {"position_error_z_m": 0.2, "vertical_field_of_view_deg": (40.0, 40.0)}
    return PerfectFlight(Contract.model_validate(document), mission_to((60.0, 0.0)))


def see(flight: PerfectFlight, north_m: float, filled_m: DownRange) -> None:
    flight.situation.obstacles.add("front/a", square((north_m, 0.0)), 0.05, filled_m=filled_m)


def along(flight: PerfectFlight, down_m: float) -> bool:
    """Tell whether a cruise over the obstacle is clear, at a height of the leg frame."""
    start = State((0.0, 0.0, down_m), (2.0, 0.0, 0.0))
    envelope = replace(flight.situation.envelope)
    return ClearCheck(flight.situation).is_clear(
        cruise(start, 0.0, envelope, 2.0, z_m=down_m).until(20.0)
    )


def test_at_the_height_of_the_leg_a_low_obstacle_is_passed_over(flight: PerfectFlight) -> None:
    see(flight, 20.0, LOW)
    assert not list(flight.situation.obstacles)
    assert along(flight, 0.0)
    assert along(flight, 0.04)


@pytest.mark.parametrize("down_m", [0.3, -0.3])
def test_at_another_height_it_is_a_pillar(flight: PerfectFlight, down_m: float) -> None:
    see(flight, 20.0, LOW)
    assert not along(flight, down_m)


def test_a_mission_at_another_altitude_meets_it(flight: PerfectFlight) -> None:
    see(flight, 20.0, LOW)
    flight.navigator.change_mission(mission_to((60.0, 0.0), altitude_m=1.5), 0.0)
    assert list(flight.situation.obstacles)


def test_under_larger_errors_it_is_in_the_way(flight: PerfectFlight) -> None:
    see(flight, 20.0, LOW)
    assessment = flight.situation.assessment
    terms = replace(assessment.terms, tracking_error_z_m=2.5)
    flight.situation.adopt(replace(assessment, terms=terms))
    assert list(flight.situation.obstacles)


@pytest.mark.parametrize("off_m", [-0.6, 0.6])
def test_a_start_is_as_near_to_the_leg_as_it_is_tracked(
    flight: PerfectFlight, off_m: float
) -> None:
    pose = pose_at(0.0, 0.0, -4.0 + off_m)
    kinds = [each.kind for each in departure_refusals(flight.situation, pose)]
    assert kinds == [RefusalKind.OFF_HEIGHT]
    assert not departure_refusals(flight.situation, pose_at(0.0, 0.0, -4.0 + off_m / 2.0))


def test_no_start_is_beside_what_is_just_below_it(flight: PerfectFlight) -> None:
    half_m = half_band_m(flight.situation.assessment.terms)
    see(flight, 0.0, (-4.0 + half_m + 0.2, math.inf))
    assert not departure_refusals(flight.situation, pose_at())
    (refused,) = departure_refusals(flight.situation, pose_at(0.0, 0.0, -3.6))
    assert refused.kind is RefusalKind.OFF_HEIGHT
    assert "front/a" in refused.text
    assert not departure_refusals(flight.situation, pose_at(0.0, 3.0, -3.6))
