"""Oracles about avoidance plans, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.campaign.oracles.plans import (
    _outside_m,
    _room_required_m,
    certified_plans,
    entered_in_time,
    plan_not_expired,
    plans_in_region,
)
from onboard.contract.assessment import TICK_S
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.campaign.oracles.evidence import (
    AVOIDS,
    BEGAN_S,
    flown,
    plan,
    rectangle,
    result,
    scenario,
)


def test_a_plan_without_a_certificate_is_a_finding() -> None:
    (found,) = certified_plans(flown(plans=[plan(certificate={"valid": False})]))
    assert found == "plan qp round 1 flown without a valid certificate"
    assert not list(certified_plans(flown()))
    assert not list(certified_plans(flown(plans=[])))


def test_an_avoidance_needs_a_plan() -> None:
    assert next(plan_not_expired(flown(plans=[]))) == "avoidance without a plan"


def test_a_plan_may_be_flown_one_tick_beyond_its_end() -> None:
    last_s = BEGAN_S + (AVOIDS + 49) * TICK_S
    assert not list(plan_not_expired(flown(plans=[plan(end_s=last_s - TICK_S)])))
    (found,) = plan_not_expired(flown(plans=[plan(end_s=last_s - 2.0 * TICK_S)]))
    assert found == "setpoint sent 0.04 s after its plan expired"


def test_a_replacement_takes_over_from_a_plan_that_ends() -> None:
    middle_s = BEGAN_S + (AVOIDS + 25) * TICK_S
    replaced = [plan(end_s=middle_s), plan(time_s=middle_s)]
    assert not list(plan_not_expired(flown(plans=replaced)))
    assert list(plan_not_expired(flown(plans=replaced[:1])))


@pytest.mark.parametrize("kind", ["daemon_dead", "tick_stall"])
def test_a_silent_service_sends_nothing_that_could_expire(kind: str) -> None:
    fault = Fault(kind=kind, duration_s=0.5)  # type: ignore[arg-type]
    assert not list(plan_not_expired(flown(plans=[], faults=(fault,))))


def test_a_plan_stays_in_its_region() -> None:
    wide = plan(path_ned_m=[[AVOIDS * TICK_S, 3.5, -4.0]])
    (found,) = plans_in_region(flown(plans=[wide]))
    assert found == "plan qp leaves its region by 0.500 m"
    assert not list(plans_in_region(flown(plans=[{**wide, "kind": "brake"}])))
    assert not list(plans_in_region(flown()))


@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_how_far_a_point_is_outside(north_m: float, east_m: float) -> None:
    corners_m = np.array(rectangle(-2.0, 4.0, 1.0))
    expected_m = max(-2.0 - north_m, north_m - 4.0, abs(east_m) - 1.0, 0.0)
    assert _outside_m(np.array([[north_m, east_m]]), corners_m) == pytest.approx(expected_m)


def test_an_avoidance_begins_while_there_is_room() -> None:
    begins_m = AVOIDS * TICK_S
    near = plan(keep_out_ned_m=rectangle(begins_m + 0.5, begins_m + 4.5, 2.0))
    (found,) = entered_in_time(flown(plans=[near]))
    assert found.startswith("avoidance begins 0.510 m before the obstacle, where the worst case")
    assert not list(entered_in_time(flown(plans=[near], ended=result(violations=("wind",)))))
    assert not list(entered_in_time(flown()))


def test_the_room_required_grows_with_the_obstacle_up_to_a_stop() -> None:
    contract = scenario().contract
    rooms_m = [_room_required_m(contract, width_m) for width_m in (0.0, 0.5, 1.0, 2.0, 4.0)]
    assert rooms_m == sorted(rooms_m)
    assert len(set(rooms_m[:4])) == 4
    # A wall is not swerved round: the vehicle stops.
    assert _room_required_m(contract, 500.0) == _room_required_m(contract, 1000.0)


def test_a_faster_vehicle_needs_more_room() -> None:
    contract = scenario().contract
    vehicle = contract.vehicle.model_copy(
        update={"cruise_speed_mps": 2.0 * contract.vehicle.cruise_speed_mps}
    )
    faster = contract.model_copy(update={"vehicle": vehicle})
    assert _room_required_m(faster, 500.0) > 2.0 * _room_required_m(contract, 500.0)
