"""Oracles about the reference, one by one."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.campaign.oracles.references import (
    continuous_reference,
    entry_condition,
    exit_condition,
    setpoints_in_limits,
    tracked_reference,
)
from onboard.contract.assessment import TICK_S
from tests.gcs_tools.campaign.oracles.evidence import (
    AVOIDS,
    PHASES,
    changed,
    flown,
    plan,
    rectangle,
    result,
    scenario,
    state,
)

LEFT = AVOIDS + 50


def astray(by_m: float) -> list[dict[str, Any]]:
    """Ground truth beside the reference in one tick of the cruise."""
    truths: list[dict[str, Any]] = [
        {"position_ned_m": list(state(tick)["reference_position_ned_m"]), "collisions": 0}
        for tick in range(len(PHASES))
    ]
    truths[50]["position_ned_m"][1] += by_m
    return truths


def test_the_true_path_stays_within_the_tracking_error() -> None:
    limit_m = scenario().contract.vehicle.tracking_error_m
    assert not list(tracked_reference(flown(truths=astray(limit_m - 1e-3))))
    (found,) = tracked_reference(flown(truths=astray(limit_m + 0.1)))
    assert found == f"flown {limit_m + 0.1:.3f} m beside the reference, {limit_m:.3f} m declared"


def test_a_disturbed_flight_is_not_checked_against_the_tracking_error() -> None:
    disturbed = flown(truths=astray(5.0), ended=result(violations=("tracking_error",)))
    assert not list(tracked_reference(disturbed))


@pytest.mark.parametrize(
    ("asked_mps2", "allowed"),
    [
        ([0.0, 0.0, 0.0], True),
        ([0.8, 0.8, 0.0], True),
        ([9.0, 0.0, 0.0], False),
        ([-9.0, 0.0, 0.0], False),
        ([0.0, 9.0, 0.0], False),
        ([0.0, 0.0, -30.0], False),  # more thrust than there is
        ([1.0, 0.0, 9.0], False),  # hardly any thrust left to tilt
    ],
)
def test_setpoints_ask_for_no_more_than_the_contract(
    asked_mps2: list[float], *, allowed: bool
) -> None:
    states = changed(50, reference_acceleration_ned_mps2=asked_mps2)
    assert (not list(setpoints_in_limits(flown(states=states)))) is allowed


def test_setpoints_are_checked_in_flight_only() -> None:
    wild = {"reference_acceleration_ned_mps2": [90.0, 0.0, 0.0]}
    assert not list(setpoints_in_limits(flown(states=changed(5, **wild))))
    unknown = changed(50, reference_acceleration_ned_mps2=None)
    assert not list(setpoints_in_limits(flown(states=unknown)))


def test_limits_turn_with_the_leg() -> None:
    vehicle = scenario().contract.vehicle
    assert vehicle.pitch_max_deg == vehicle.roll_max_deg  # else the next line means another thing
    diagonal = changed(50, reference_acceleration_ned_mps2=[0.8, 0.8, 0.0])
    straight = [{**each, "leg_heading_rad": 0.7853981634} for each in diagonal]
    assert not list(setpoints_in_limits(flown(states=diagonal)))
    assert list(setpoints_in_limits(flown(states=straight)))


def test_the_reference_does_not_jump() -> None:
    here_m = state(50)["reference_position_ned_m"]
    (there, back) = continuous_reference(
        flown(states=changed(50, reference_position_ned_m=[here_m[0], 1.0, here_m[2]]))
    )
    assert there == back == f"the reference jumps by 1.000 m in {TICK_S:.2f} s"
    assert not list(continuous_reference(flown()))


def test_jumps_outside_the_flight_and_unknown_references_are_not_checked() -> None:
    assert not list(
        continuous_reference(flown(states=changed(5, reference_position_ned_m=[9.0, 0.0, 0.0])))
    )
    assert not list(continuous_reference(flown(states=changed(50, reference_position_ned_m=None))))


@pytest.mark.parametrize(
    ("velocity_mps", "allowed"),
    [
        ([0.0, 0.0, 0.0], True),
        ([2.8, 0.0, 0.0], True),
        ([2.9, 0.0, 0.0], False),
        ([-0.1, 0.0, 0.0], False),
        ([1.0, 0.1, 0.0], False),
        ([1.0, -0.1, 0.0], False),
    ],
)
def test_an_avoidance_begins_in_its_pre_condition(
    velocity_mps: list[float], *, allowed: bool
) -> None:
    vehicle = scenario().contract.vehicle
    assert (vehicle.cruise_speed_mps, vehicle.recentring_speed_mps) == (2.8, 0.0)
    states = changed(AVOIDS - 1, reference_velocity_ned_mps=velocity_mps)
    assert (not list(entry_condition(flown(states=states)))) is allowed


def test_velocities_elsewhere_are_no_pre_condition() -> None:
    states = changed(AVOIDS - 2, reference_velocity_ned_mps=[9.0, 9.0, 0.0])
    assert not list(entry_condition(flown(states=states)))


def test_an_avoidance_ends_outside_its_region_and_without_lateral_speed() -> None:
    assert not list(exit_condition(flown()))
    (found,) = exit_condition(
        flown(states=changed(LEFT, reference_velocity_ned_mps=[1.0, 0.2, 0.0]))
    )
    assert found.endswith("at 0.200 m/s across")
    longer = plan(region_ned_m=rectangle(0.0, LEFT * TICK_S + 0.5, 3.0))
    (found,) = exit_condition(flown(plans=[longer]))
    assert found.startswith("avoidance left 0.500 m before the border of the region")


def test_the_region_is_that_of_the_latest_plan() -> None:
    longer = plan(region_ned_m=rectangle(0.0, 99.0, 3.0))
    later = plan(time_s=plan()["time_s"] + 10 * TICK_S)
    assert not list(exit_condition(flown(plans=[longer, later])))
    assert list(exit_condition(flown(plans=[later, {**longer, "time_s": later["time_s"]}])))


def test_without_a_plan_there_is_no_region_to_leave() -> None:
    assert not list(exit_condition(flown(plans=[])))
