"""Which clauses a contract has, and what each compares."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.clauses import PROGRESS_CLAUSES, TICK_S, Clause, clauses, recentring_drift
from onboard.contract.derivation import Derived, derive
from onboard.contract.recentring import required_view
from onboard.contract.terms import Terms
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.example_terms import TERMS

ALWAYS = {"thrust", "detection_range", "edge_visibility", "field_of_view", "separation"}


def found(**changes: Any) -> dict[str, Clause[float]]:
    terms = replace(TERMS, **changes)
    return {clause.name: clause for clause in clauses(terms, derive(terms, SCALAR), SCALAR)}


def derived(**changes: Any) -> Derived[float]:
    return derive(replace(TERMS, **changes), SCALAR)


@pytest.mark.parametrize(
    ("changes", "further"),
    [
        ({"stop": False, "passive_safety": False}, set()),
        ({"stop": True, "passive_safety": False}, {"stop", "sensor_silence", "seen_free_view"}),
        ({"stop": False, "passive_safety": True}, {"passive_safety"}),
        ({"stop": False, "passive_safety": False, "wind_max_mps": 0.0}, {"wind"}),
        ({"stop": False, "passive_safety": False, "recentring_speed_mps": 0.2}, {"recentring"}),
        (
            {"stop": False, "passive_safety": False, "mission_altitude_m": 4.0},
            {"ground_clearance"},
        ),
    ],
)
def test_clauses_are_those_that_the_contract_has_use_for(
    changes: dict[str, Any], further: set[str]
) -> None:
    assert found(**changes).keys() == ALWAYS | further


def test_separation_comes_last_and_thrust_first() -> None:
    names = list(found(wind_max_mps=1.0, mission_altitude_m=4.0, recentring_speed_mps=0.2))
    assert names[0] == "thrust"
    assert names[-1] == "separation"


def test_declared_values_are_those_of_the_contract() -> None:
    terms = found(wind_max_mps=1.0, mission_altitude_m=4.0)
    for name in ("detection_range", "edge_visibility", "stop", "sensor_silence", "passive_safety"):
        assert terms[name].declared == TERMS.detection_range_m
        assert terms[name].unit == "m"
    assert terms["field_of_view"].declared == pytest.approx(math.degrees(TERMS.field_of_view_rad))
    assert terms["separation"].declared == TERMS.obstacle_separation_min_m
    assert terms["thrust"].declared == TERMS.thrust_to_weight
    assert terms["ground_clearance"].declared == 4.0


def test_equality_does_not_hold() -> None:
    """Erratum 13: the boundary belongs to the collision set."""
    clause = Clause("range", 5.0, 5.0, "m", "because")
    assert clause.margin == 0.0
    assert not clause.holds
    assert Clause("range", 5.0, math.nextafter(5.0, 6.0), "m", "because").holds
    assert not Clause("range", math.nan, 5.0, "m", "because").holds


def test_silence_is_noticed_a_tick_after_the_frame_is_too_old() -> None:
    clause = found(passive_safety=False)
    speed_mps = derived().encounter.speed_mps
    difference_m = clause["sensor_silence"].required - clause["stop"].required
    later_s = TERMS.frame_age_max_s + TICK_S - TERMS.reaction_time_s
    assert difference_m == pytest.approx(speed_mps * later_s)


def test_stopping_is_reaction_lag_and_braking_beyond_the_margins() -> None:
    e, margin_m = derived().encounter, derived().margin_m
    way_m = e.speed_mps * (TERMS.reaction_time_s + TERMS.attitude_lag_s)
    way_m += e.speed_mps**2 / (2.0 * e.brake_mps2)
    required_m = found()["stop"].required
    assert required_m == pytest.approx(margin_m + TERMS.tracking_error_m + way_m)


def test_ground_clearance_is_the_body_below_its_reference_and_one_reset() -> None:
    clause = found(mission_altitude_m=4.0, tracking_error_z_m=0.9, estimator_reset_max_m=0.5)
    assert clause["ground_clearance"].required == pytest.approx(TERMS.radius_m + 0.9 + 0.5)


def test_a_heading_error_is_needed_on_both_sides_of_the_view() -> None:
    """Apart from the room that it takes by displacing faces, which the ideal sensor has not."""
    turned = replace(TERMS, heading_error_rad=0.05)
    with_error = {c.name: c for c in clauses(turned, derived(), SCALAR)}
    without = {c.name: c for c in clauses(TERMS, derived(), SCALAR)}
    difference = with_error["field_of_view"].required - without["field_of_view"].required
    assert difference == pytest.approx(math.degrees(0.1))


def test_what_costs_time_only_concerns_progress_where_only_seen_space_is_flown_into() -> None:
    every: dict[str, Any] = {
        "wind_max_mps": 1.0, "mission_altitude_m": 4.0, "recentring_speed_mps": 0.2,
        "radius_z_m": 0.4, "height_drift_m": 0.3, "position_error_z_m": 0.2,
        "view_up_rad": 0.5, "view_down_rad": 0.5,
    }  # fmt: skip
    concern = {name: clause.concerns for name, clause in found(**every).items()}
    progress = {name for name, each in concern.items() if each == "progress"}
    assert progress == PROGRESS_CLAUSES
    assert concern.keys() - progress == {
        "thrust", "wind", "ground_clearance", "stop", "passive_safety", "seen_free_view", "terrain"
    }  # fmt: skip
    assert {clause.concerns for clause in found(**every, stop=False).values()} == {"safety"}


def test_every_reason_is_one_sentence_for_operators() -> None:
    every = found(wind_max_mps=1.0, mission_altitude_m=4.0, recentring_speed_mps=0.2)
    reasons = [clause.reason for clause in every.values()]
    assert len(set(reasons)) == len(reasons)
    assert all(reason[0].islower() and not reason.endswith(".") for reason in reasons)


def test_where_only_some_elements_recentre_the_others_require_nothing() -> None:
    speeds_mps = np.array([0.0, 0.2, 0.4])
    numbers: dict[str, Any] = {
        name: np.full(3, value) for name, value in vars(TERMS).items() if isinstance(value, float)
    }
    terms: Terms[FloatArray] = Terms(**numbers | {"recentring_speed_mps": speeds_mps})
    arrays = {c.name: c for c in clauses(terms, derive(terms, ARRAY), ARRAY)}
    required = arrays["recentring"].required
    assert required[0] == 0.0
    for i in (1, 2):
        alone = found(recentring_speed_mps=float(speeds_mps[i]))["recentring"]
        assert required[i] == pytest.approx(alone.required)


def test_the_drift_waits_for_whichever_is_noticed_later() -> None:
    slow = replace(TERMS, recentring_speed_mps=0.3, reaction_time_s=0.05)
    late = replace(slow, reaction_time_s=0.9)
    quick_drift, late_drift = (
        recentring_drift(terms, derive(terms, SCALAR), SCALAR) for terms in (slow, late)
    )
    silent_s = TERMS.frame_age_max_s + TICK_S
    assert late_drift.ending_s - quick_drift.ending_s == pytest.approx(0.9 - silent_s)
    assert quick_drift.speed_min_mps == TERMS.cruise_speed_mps - TERMS.velocity_error_x_mps


def test_a_view_of_90_degrees_suffices_and_a_heading_error_widens_it_on_both_sides() -> None:
    square = math.radians(90.0)
    assert found(field_of_view_rad=square)["seen_free_view"].holds
    assert not found(field_of_view_rad=square - 1e-3)["seen_free_view"].holds
    turned = found(field_of_view_rad=square + 0.2, heading_error_rad=0.1)["seen_free_view"]
    assert turned.required == pytest.approx(90.0 + math.degrees(0.2))
    assert turned.declared == pytest.approx(90.0 + math.degrees(0.2))
    # Where no obstacle is stopped for, what must be seen ahead is seen best from the full range.
    swerving = found(stop=False, heading_error_rad=0.1)["field_of_view"]
    edge_m = derived(stop=False, heading_error_rad=0.1).edge_offset_m
    half_rad = math.asin(edge_m / TERMS.detection_range_m) + 0.1
    assert swerving.required == pytest.approx(math.degrees(2.0 * half_rad))
    near = found(stop=False, detection_range_m=1.0)["field_of_view"]
    assert near.required == pytest.approx(180.0)
    assert near.declared == pytest.approx(math.degrees(TERMS.field_of_view_rad))


def test_the_view_of_a_drift_counts_the_heading_error_on_both_sides() -> None:
    changes: dict[str, Any] = {"recentring_speed_mps": 0.3, "heading_error_rad": 0.1}
    terms = replace(TERMS, **changes)
    drift = recentring_drift(terms, derived(**changes), SCALAR)
    clause = found(**changes)["recentring"]
    view_rad = required_view(drift, TERMS.detection_range_m, SCALAR) + 0.2
    assert clause.required == pytest.approx(math.degrees(view_rad))
    assert clause.declared == pytest.approx(math.degrees(TERMS.field_of_view_rad))


def test_a_pair_of_separations_requires_the_diagonal_that_both_of_its_shares_allow() -> None:
    along_m, across_m = derived().required_separation_box_m
    for along, across in ((0.6, 0.8), (0.99, 0.141)):
        clause = found(separation_shares=(along, across))["separation"]
        assert clause.required == pytest.approx(max(along_m / along, across_m / across))
    assert found()["separation"].required == pytest.approx(math.hypot(along_m, across_m))
