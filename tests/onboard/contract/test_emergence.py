"""Movers that hide behind obstacles: how much more room is kept beside these, and required."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_tools.preflight.field_regions import region_boxes
from onboard.contract.arithmetic import SCALAR
from onboard.contract.assessment import Assessment, assess, derive
from onboard.contract.emergence import emergence_m
from onboard.contract.movers import RASTER_M, stop_of
from onboard.contract.terms import Terms
from onboard.geometry.box import Box
from tests.onboard.contract.test_movers import DRONE, PERSON, contract

HIDING = {**PERSON, "speed_max_mps": 0.8, "hidden": True}
WIDE = {
    "environment__obstacle_size_max_m": 1.0,
    "environment__obstacle_separation_min_m": 40.0,
    "sensor__detection_range_m": 40.0,
}


def of(*movers: dict[str, Any], **changes: Any) -> Assessment:
    return assess(contract(environment__movers=list(movers), **{**WIDE, **changes}))


def required(assessment: Assessment) -> dict[str, float]:
    return {c.name: c.required for c in assessment.clauses}


def test_it_is_how_far_the_fastest_that_hides_comes_until_the_vehicle_rests() -> None:
    assessment = of(HIDING, {**HIDING, "class": "child", "speed_max_mps": 0.5}, DRONE)
    terms = assessment.terms
    time_s = stop_of(terms, assessment.inflated, SCALAR).time_s(terms.reaction_time_s)
    assert time_s > terms.reaction_time_s + terms.attitude_lag_s + terms.rest_settle_s
    assert assessment.emergence_m == pytest.approx(0.8 * time_s + RASTER_M)


@pytest.mark.parametrize(("v_o", "more_m"), [(0.5, 0.8), (1.5, 2.3), (5.0, 7.8)])
def test_the_table_of_the_theory(v_o: float, more_m: float) -> None:
    """T2e at 15 degrees and 2.8 m/s: no settling, not accelerating, no cells."""
    mover = {**HIDING, "speed_max_mps": v_o}
    terms = replace(Terms.of(contract(environment__movers=[mover])), rest_settle_s=0.0)
    derived = derive(terms, SCALAR)
    found_m = emergence_m(terms, derived, SCALAR) - RASTER_M - v_o * terms.attitude_lag_s
    assert found_m == pytest.approx(more_m, abs=0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"environment__movers": [PERSON]},
        {"requirements__movers": "none"},
        {"requirements__progress": "best_effort"},
    ],
)
def test_else_nothing_changes(changes: dict[str, Any]) -> None:
    assessment = assess(contract(**{"environment__movers": [HIDING], **WIDE, **changes}))
    assert assessment.emergence_m == 0.0
    assert not {"emergence", "emergence_range"} & required(assessment).keys()
    box = Box(10.0, 11.0, -0.5, 0.5)
    around = assessment.region_around(box, 0.0).obstacle
    assert around.y_max_m == pytest.approx(0.5 + assessment.inflation_m())


def test_static_clauses_are_those_of_obstacles_that_are_wider_by_as_much() -> None:
    hidden, plain = of(HIDING), of({**HIDING, "hidden": False})
    more_m = hidden.emergence_m
    assert required(hidden)["separation"] == required(plain)["separation"]
    wider = of({**HIDING, "hidden": False}, environment__obstacle_size_max_m=1.0 + 2.0 * more_m)
    assert required(hidden)["emergence"] == pytest.approx(required(wider)["separation"])
    assert required(hidden)["emergence_range"] > required(wider)["detection_range"] + more_m
    concerns = {c.name: c.concerns for c in hidden.clauses}
    assert concerns["emergence"] == concerns["emergence_range"] == "progress"


def test_near_obstacles_break_the_clause_first() -> None:
    near = of(HIDING, environment__obstacle_separation_min_m=9.0)
    assert [c.name for c in near.clauses if not c.holds] == ["emergence"]


def test_regions_in_flight_and_in_pre_flight_have_that_room() -> None:
    hidden, plain = of(HIDING), of({**HIDING, "hidden": False})
    box, more_m = Box(10.0, 11.0, -0.5, 0.5), hidden.emergence_m
    region, wider = hidden.region_around(box, 0.0), plain.region_around(box.inflated(more_m), 0.0)
    assert region.obstacle.y_max_m == pytest.approx(wider.obstacle.y_max_m)
    assert region.lane_left_m == pytest.approx(wider.lane_left_m)
    assert region.obstacle.y_max_m > 0.5 + hidden.inflation_m() + 0.8
    rows = np.array(((10.0, 11.0, -0.5, 0.5),))
    grown = rows + more_m * np.array((-1.0, 1.0, -1.0, 1.0))
    for one, other in zip(
        vars(region_boxes(hidden, rows)).values(),
        vars(region_boxes(plain, grown)).values(),
        strict=True,
    ):
        assert one == pytest.approx(other)


@given(
    beside_m=st.floats(0.5, 5.0),
    x_m=st.floats(-15.0, 15.0),
    place=st.tuples(st.floats(-10.0, 10.0), st.floats(-3.0, 12.0)),
)
@settings(max_examples=300, deadline=None)
def test_a_shadow_never_comes_nearer_to_the_way_than_its_obstacle(
    beside_m: float, x_m: float, place: tuple[float, float]
) -> None:
    """Seen from anywhere on the way, what a box beside it hides lies beyond its near face."""
    shares = np.linspace(0.0, 1.0, 200)
    line = np.stack((x_m + (place[0] - x_m) * shares, place[1] * shares), axis=1)
    within = (np.abs(line[:, 0]) <= 1.0) & (line[:, 1] >= beside_m) & (line[:, 1] <= beside_m + 2.0)
    if within.any():
        assert place[1] >= beside_m
