"""The region of stopping and sidestepping, derived a second time from THEORY.md."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.assessment import Assessment, assess
from onboard.contract.derivation import derive
from onboard.contract.run_on import contract_run_on
from onboard.contract.stop_region import (
    OVERHANG_M,
    PASSIVE_OVERHANG_M,
    PLANNING_ROOM_M,
    run_on_ahead_m,
    stop_dimensions,
)
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract, load_contract
from onboard.geometry.box import Box
from onboard.perception.seen_free import CELL_M
from tests.gcs_tools.running import CONFIG
from tests.onboard.contract.ideal_encounter import ideal_encounter
from tests.onboard.contract.test_assessment import (
    GRAVITY_MPS2,
    as_arrays,
    clause_of,
    contract,
    contracts,
    face_error_m,
)

FROZEN: dict[str, Any] = {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8}
LOSSES = st.sampled_from([None, FROZEN])


def stopping(terms: Contract, loss: dict[str, Any] | None) -> Contract:
    """The same contract, which stops, with this autopilot."""
    document = terms.model_dump()
    document["requirements"]["stop"] = True
    document["vehicle"]["setpoint_loss"] = loss
    return Contract.model_validate(document)


def slope_s(assessment: Assessment) -> float:
    """Run per speed on the way to rest, from the points that are certified."""
    return max((kappa_s for kappa_s, _ in contract_run_on(assessment.terms).gains), default=0.0)


@given(contracts(), LOSSES)
def test_everything_derived_again(terms: Contract, loss: dict[str, Any] | None) -> None:
    terms = stopping(terms, loss)
    assessment = assess(terms)
    derived, region, vehicle = assessment.inflated, assessment.inflated.region, terms.vehicle
    b, u = assessment.limits.brake_mps2, assessment.limits.left_mps2
    v, lag_s = vehicle.cruise_speed_mps, vehicle.attitude_lag_s
    kappa_s = slope_s(assessment)
    # The farthest that braking and running on reach, on a grid of speeds.
    speeds_mps = np.append(np.linspace(0.0, v, 4001), min(v, kappa_s * b))
    reach_m = float(((v * v - speeds_mps**2) / (2.0 * b) + kappa_s * speeds_mps).max())
    front_m = reach_m + v * (vehicle.reaction_time_s + lag_s) + 0.15
    assert region.front_m == pytest.approx(front_m)
    passive = terms.requirements.passive_safety
    w = vehicle.recentring_speed_mps
    drift_m = w * (lag_s + kappa_s) + w * w / (2.0 * u)
    overhang_m = max(0.5 if passive else 0.3, drift_m) + drift_m
    assert region.overhang_left_m == region.overhang_right_m == pytest.approx(overhang_m)
    assert region.coast_left_m == region.coast_right_m == 0.0
    margin_m = vehicle.radius_m + vehicle.tracking_error_m + 2.0 * face_error_m(terms)
    size_m = terms.environment.obstacle_size_max_m + 2.0 * margin_m
    assert derived.encounter.size_along_m == pytest.approx(size_m)
    assert region.pob_depth_m == pytest.approx(size_m)
    box_m = (front_m + size_m, overhang_m + size_m)
    assert derived.required_separation_box_m == pytest.approx(box_m)
    assert derived.required_separation_m == pytest.approx(math.hypot(*box_m))
    assert derived.roi_width_m == pytest.approx(size_m + 2.0 * overhang_m)
    before_m = margin_m + vehicle.tracking_error_m
    assert derived.required_detection_range_m == pytest.approx(before_m + front_m)
    standing_m = front_m - reach_m + v * v / (2.0 * b)
    required = {clause.name: clause.required for clause in assessment.clauses}
    assert required["detection_range"] == pytest.approx(before_m + standing_m)
    aside_m = margin_m + drift_m
    view_deg = 2.0 * math.degrees(math.atan2(aside_m, before_m + standing_m))
    assert required["field_of_view"] == pytest.approx(view_deg + 2.0 * vehicle.heading_error_deg)
    if passive:
        seen_m = math.hypot(before_m + front_m, aside_m)
        assert required["passive_safety"] == pytest.approx(seen_m)


def test_the_swerve_is_as_before_whether_it_may_stop_or_not() -> None:
    """Avoidances by Eq. 17 begin as early and use as much width as in the published form."""
    stops, swerves = assess(contract()), assess(contract(stop=False))
    assert stops.inflated.manoeuvre == swerves.inflated.region
    box = Box(20.0, 22.0, -1.0, 1.0)
    one, other = (each.region_around(box, 0.0) for each in (stops, swerves))
    assert one.manoeuvre == other.extent == other.manoeuvre == other.apart
    assert (one.lane_left_m, one.keep_out, one.x_pob_m) == (
        other.lane_left_m,
        other.keep_out,
        other.x_pob_m,
    )
    assert one.approach_x_m == min(one.extent.x_min_m, one.manoeuvre.x_min_m)
    assert one.departure_x_m == max(one.extent.x_max_m, one.manoeuvre.x_max_m)
    assert one.extent.y_min_m > one.manoeuvre.y_min_m


@given(contracts())
def test_a_moved_region_is_the_region_of_the_moved_obstacle(terms: Contract) -> None:
    assessment, box = assess(terms), Box(10.0, 12.0, -1.0, 2.0)
    moved = assessment.region_around(box, 0.0).shifted_by(3.0, -4.0)
    again = assessment.region_around(box.shifted_by(3.0, -4.0), 0.0)
    for name in ("obstacle", "keep_out", "extent", "apart", "manoeuvre"):
        assert vars(getattr(moved, name)) == pytest.approx(vars(getattr(again, name)))


def test_where_obstacles_conflict_is_where_a_region_meets_the_other_inflated() -> None:
    """One overhang between two obstacles side by side, and the front ahead of the second."""
    assessment = assess(contract())
    region = assessment.region_around(Box(20.0, 22.0, -1.0, 1.0), 0.0)
    apart_m = 2.0 * assessment.inflation_m()
    front_m = assessment.inflated.region.front_m
    for x_m, y_m, expected in (
        (0.0, 2.0 + apart_m + PASSIVE_OVERHANG_M - 1e-6, True),
        (0.0, 2.0 + apart_m + PASSIVE_OVERHANG_M + 1e-6, False),
        (2.0 + apart_m + front_m - 1e-6, 0.0, True),
        (2.0 + apart_m + front_m + 1e-6, 0.0, False),
    ):
        for sign in (-1.0, 1.0):
            other = region.shifted_by(x_m, sign * y_m)
            assert region.conflicts_with(other) is expected
            assert other.conflicts_with(region) is expected
            meets = region.extent.intersects(other.obstacle)
            assert (meets or other.extent.intersects(region.obstacle)) is expected


def test_the_room_for_planning_is_that_of_the_grid() -> None:
    """A place at rest, and the line beside a face, lie a cell's diagonal from what is not free."""
    assert math.sqrt(2.0) * CELL_M < PLANNING_ROOM_M
    assert OVERHANG_M >= 2.0 * PLANNING_ROOM_M
    assert PASSIVE_OVERHANG_M > OVERHANG_M


# What a PX4 vehicle was measured to have, where its estimate does not wander.
MEASURED = ("vehicle.tracking_error_m=0.8", "sensor.position_error_m=0.1")


@pytest.mark.parametrize(
    ("name", "as_measured", "at_most_m"),
    [("px4", MEASURED, 15.0), ("px4", (), 16.5), ("ardupilot", (), 12.0), ("default", (), 13.0)],
)
def test_shipped_contracts_ask_for_little_where_the_heading_is_exact(
    name: str, as_measured: tuple[str, ...], at_most_m: float
) -> None:
    path = CONFIG / f"{name}_contract.yaml"
    exact = assess(load_contract(path, ("vehicle.heading_error_deg=0", *as_measured)))
    assert exact.terms.cruise_speed_mps == 2.8
    assert exact.inflated.required_separation_m <= at_most_m
    assert exact.compliant
    assert assess(load_contract(path)).compliant


@given(contracts(), LOSSES, st.floats(0.2, 1.0))
def test_a_slower_cruise_never_requires_more(
    terms: Contract, loss: dict[str, Any] | None, share: float
) -> None:
    fast = Terms.of(stopping(terms, loss))
    document = stopping(terms, loss).model_dump()
    document["vehicle"]["cruise_speed_mps"] *= share
    fast_m, slow_m = (
        derive(each, SCALAR).required_separation_m
        for each in (fast, Terms.of(Contract.model_validate(document)))
    )
    assert slow_m <= fast_m + 1e-9


@given(contracts(), LOSSES)
def test_arrays_and_floats_agree(terms: Contract, loss: dict[str, Any] | None) -> None:
    scalar = Terms.of(stopping(terms, loss))
    one, many = derive(scalar, SCALAR), derive(as_arrays(scalar, 2), ARRAY)
    for box_m, found_m in zip(
        one.required_separation_box_m, many.required_separation_box_m, strict=True
    ):
        np.testing.assert_allclose(found_m, np.full(2, box_m), rtol=1e-12)


@pytest.mark.parametrize("stop", [True, False])
def test_a_pair_of_separations_has_to_exceed_both_of_what_is_required(*, stop: bool) -> None:
    required_m = assess(contract(stop=stop)).inflated.required_separation_box_m
    for shares, holds in (
        ((1.001, 1.001), True),
        ((0.999, 3.0), False),
        ((3.0, 0.999), False),
    ):
        pair = [share * each_m for share, each_m in zip(shares, required_m, strict=True)]
        clause = clause_of(
            assess(contract(stop=stop, obstacle_separation_min_m=pair)), "separation"
        )
        assert clause.holds is holds
        assert clause.declared == pytest.approx(math.hypot(*pair))


def test_a_turned_box_is_inflated_by_the_error_of_its_corner() -> None:
    """Soundness row 5: a box at 45° whose faces are off by e stays within its inflation."""
    assessment = assess(contract(position_error_m=0.2))
    half_m, error_m = 1.0, 0.2
    corner_m = math.sqrt(2.0) * half_m
    measured = Box(-corner_m, corner_m, -corner_m, corner_m)
    keep_out = assessment.region_around(measured, 0.0).obstacle
    true_corner_m = math.sqrt(2.0) * (half_m + error_m)
    assert -keep_out.x_min_m - true_corner_m == pytest.approx(assessment.terms.body_m)


def test_the_front_is_that_of_the_worked_example() -> None:
    """2.8 m/s at 15°, PX4 with a gain of 0.95/s and a lag of 0.2 s: the run is v/0.95."""
    assessment = assess(
        contract(setpoint_loss=FROZEN, attitude_lag_s=0.2, reaction_time_s=0.2, stop=True)
    )
    b = GRAVITY_MPS2 * math.tan(math.radians(15.0))
    assert b / 0.95 < 2.8  # beyond κb: the run is farthest on the way
    reach_m = 2.8**2 / (2.0 * b) + b / (2.0 * 0.95**2)
    assert assessment.inflated.region.front_m == pytest.approx(reach_m + 2.8 * 0.4 + 0.15)


@pytest.mark.parametrize(("left_mps2", "right_mps2"), [(1.0, 4.0), (4.0, 1.0)])
@pytest.mark.parametrize(("passive_safety", "least_m"), [(True, 0.5), (False, 0.3)])
def test_sides_that_differ_by_hand(
    left_mps2: float, right_mps2: float, *, passive_safety: bool, least_m: float
) -> None:
    """2 m/s against 2 m/s², 0.4 m/s aside, a lag of 0.2 s, a reaction of 0.3 s, a run of 0.5 s."""
    limits = AccelerationLimits(2.0, 3.0, left_mps2, right_mps2)
    e = ideal_encounter(limits, 2.0, (1.5, 2.5))._replace(
        lateral_speed_mps=0.4,
        attitude_lag_s=0.2,
        reaction_time_s=0.3,
        run_on_m=0.7,
    )
    region = stop_dimensions(e, 0.5, passive_safety=passive_safety, ops=SCALAR)
    assert region.drift_left_m == pytest.approx(0.4 * 0.7 + 0.16 / (2.0 * left_mps2))
    assert region.drift_right_m == pytest.approx(0.4 * 0.7 + 0.16 / (2.0 * right_mps2))
    # The weaker side is 0.28 + 0.08 m: a little more than the least without passive safety.
    overhang_m = max(least_m, 0.36) + 0.36
    assert region.overhang_left_m == region.overhang_right_m == pytest.approx(overhang_m)
    assert region.collision_set_depth_m == pytest.approx(1.0)
    assert region.front_m == pytest.approx(0.7 + 1.0 + 2.0 * 0.5 + 0.15)
    assert (region.coast_left_m, region.coast_right_m) == (0.0, 0.0)
    assert (region.recovery_m, region.pob_depth_m) == (1.5, 1.5)
    assert region.avoidance_time_s == pytest.approx(1.0)
    assert region.flat
    still = e._replace(lateral_speed_mps=0.0, speed_mps=0.0)
    assert stop_dimensions(still, 0.0, passive_safety=passive_safety, ops=SCALAR).flat


def test_the_farthest_of_braking_and_running_on_by_hand() -> None:
    """At 2 m/s and 2 m/s² a run of 0.5 s per speed is farthest at 1 m/s, one of 1.5 s at 2 m/s."""
    assert run_on_ahead_m(2.0, 2.0, 0.5, SCALAR) == pytest.approx(0.25)
    assert run_on_ahead_m(2.0, 2.0, 1.5, SCALAR) == pytest.approx(3.0 - 1.0)
    assert run_on_ahead_m(2.0, 2.0, 1.0, SCALAR) == pytest.approx(1.0)
