"""What becomes of a leg, and whether it passes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs_tools.benchmark import legs
from gcs_tools.benchmark.legs import LegRow, Manner, Rule, fly_leg
from gcs_tools.benchmark.planner_flight import Outcome
from gcs_tools.benchmark.scenes import Scene
from gcs_tools.benchmark.service_flight import Served
from gcs_tools.benchmark.vehicles import Vehicle
from gcs_tools.logs.result import Result
from tests.gcs_tools.benchmark.small_scene import scene

ARRIVES, FAR = Rule("arrives"), Rule("stays away", 1.5)
SMALL = scene((5.0, 0.1))


class Asked(NamedTuple):
    """What a flight was asked for."""

    scene: Scene
    vehicle: Vehicle
    seed: int
    options: dict[str, Any]


def flown(
    monkeypatch: pytest.MonkeyPatch,
    outcome: Outcome,
    rule: Rule = ARRIVES,
    field: Scene = SMALL,
    **manner: Any,
) -> tuple[LegRow, Asked]:
    """Judge an outcome, without the flight."""
    asked: list[Asked] = []

    class Recorded:
        def __init__(self, scene: Scene, vehicle: Vehicle, seed: int, **options: Any) -> None:
            asked.append(Asked(scene, vehicle, seed, options))

        def fly(self) -> Outcome:
            return outcome

    monkeypatch.setattr(legs, "Flight", Recorded)
    row = fly_leg("forest", rule, field, 7, Manner(**{"vehicle": "default", **manner}))
    return row, asked[0]


def test_a_leg_that_arrives_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome("arrived", duration_s=10.0, first_look_s=3.0, clearance_min_m=0.4)
    row, asked = flown(monkeypatch, outcome)
    assert (row.passed, row.why_not, row.arrived, row.collisions) == (True, "", True, 0)
    assert (row.benchmark, row.field, row.leg, row.number) == ("forest", "small", "leg 0", 7)
    assert (row.length_m, row.duration_s, row.speed_mps) == (14.0, 10.0, 1.4)
    assert (row.clearance_min_m, row.distance_min_m) == (0.4, 0.7)
    assert row.passable
    assert asked.options == {"unseen_is_free": False, "first_look": False, "wish_m": 0.0}


@pytest.mark.parametrize(
    ("outcome", "rule", "why_not"),
    [
        (Outcome("collision", clearance_min_m=-0.1), ARRIVES, "touched an obstacle"),
        (Outcome("stuck"), ARRIVES, "no passage certified in 25 pauses"),
        (Outcome("timeout"), ARRIVES, "still under way after 300 s"),
        (Outcome("arrived", 9.0, clearance_min_m=1.1), FAR, "1.40 m from an obstacle, less than"),
        (Outcome("stuck", clearance_min_m=1.0), FAR, "no passage certified in 25 pauses; 1.30 m"),
    ],
)
def test_why_a_leg_does_not_pass(
    monkeypatch: pytest.MonkeyPatch, outcome: Outcome, rule: Rule, why_not: str
) -> None:
    row, _ = flown(monkeypatch, outcome, rule)
    assert not row.passed
    assert row.why_not.startswith(why_not)
    assert row.collisions == int(outcome.end == "collision")
    assert (row.speed_mps is None) == (outcome.end != "arrived")


def test_the_rule_counts_from_the_centre(monkeypatch: pytest.MonkeyPatch) -> None:
    row, _ = flown(monkeypatch, Outcome("arrived", 9.0, clearance_min_m=1.2), FAR)
    assert row.distance_min_m == 1.5
    assert row.passed


def test_a_leg_on_which_no_way_is_open_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = scene(*((7.0, 0.5 * y) for y in range(-20, 21)))
    row, _ = flown(monkeypatch, Outcome("stuck"), field=wall)
    assert not row.passable
    assert row.why_not == "no passage certified in 25 pauses, and no way is open on the map"


def test_the_manner_reaches_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    manner: dict[str, Any] = {
        "vehicle": "px4", "seed": 4, "wish_m": 1.5, "tracking_error_m": 0.5,
        "first_look": True, "unseen_is_free": True,
    }  # fmt: skip
    row, asked = flown(monkeypatch, Outcome("arrived", 9.0, clearance_min_m=1.0), **manner)
    assert asked.options == {"unseen_is_free": True, "first_look": True, "wish_m": 1.5}
    assert (asked.vehicle.radius_m, asked.vehicle.tracking_error_m) == (0.4, 0.5)
    assert (row.vehicle, row.seed, row.distance_min_m) == ("px4", 4, 1.4)


def test_each_leg_of_each_seed_has_its_own_errors() -> None:
    seeds = {Manner("default", seed=s).seed_of(n) for s in range(9) for n in range(9)}
    assert len(seeds) == 81
    assert Manner("px4", seed=3).seed_of(5) == Manner("default", seed=3).seed_of(5)
    assert all(np.random.default_rng(seed) is not None for seed in seeds)


def test_open_space_has_no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    row, _ = flown(monkeypatch, Outcome("arrived", 9.0), FAR)
    assert (row.clearance_min_m, row.distance_min_m, row.certified_min_m) == (None, None, None)
    assert row.passed


def served(**changes: Any) -> Served:
    """Return what the service made of a leg of 14 m."""
    result = Result(
        outcome="arrived", reason="mission flown", collisions=0, clearance_min_m=1.0,
        tracking_error_max_m=0.1, velocity_error_max_mps=(0.1, 0.1), duration_s=20.0,
        obstacles_avoided=0, plans={}, plan_time_ms={}, violations=(), final_position_ned_m=None,
        contract_sha256="", seed=1, pauses=3,
    )  # fmt: skip
    return Served(replace(result, **changes), 14.0, 12.0)


@pytest.mark.parametrize(
    ("changes", "why_not"),
    [
        ({}, ""),
        ({"outcome": "held", "reason": "no passage"}, "held: no passage"),
        ({"outcome": "collided", "collisions": 2}, "touched an obstacle"),
        ({"clearance_min_m": 0.9}, "1.30 m from an obstacle, less than 1.4 m"),
    ],
)
def test_a_leg_of_the_service_is_judged_alike(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], why_not: str
) -> None:
    asked: dict[str, Any] = {}

    def fly(scene: Scene, number: int, **options: Any) -> Served:
        asked.update(options, number=number, scene=scene)
        return served(**changes)

    monkeypatch.setattr(legs, "fly_by_service", fly)
    manner = Manner("px4", service=True, seed=2, wish_m=0.3)
    row = fly_leg("forest", Rule("stays away", 1.4), SMALL, 7, manner)
    assert (row.form, row.vehicle, row.why_not, row.passed) == (
        "service",
        "px4",
        why_not,
        not why_not,
    )
    assert asked == {
        "scene": SMALL, "number": 7, "vehicle": "px4", "seed": manner.seed_of(7), "wish_m": 0.3,
    }  # fmt: skip
    assert row.arrived == ("outcome" not in changes)
    assert row.speed_mps == (0.7 if row.arrived else None)
    assert (row.first_look_s, row.pauses) == (12.0, 2)
    assert row.distance_min_m == pytest.approx((row.clearance_min_m or 0.0) + 0.4)
    assert (row.certified_min_m, row.false_cells, row.losses) == (None, None, 0)


@pytest.mark.parametrize(
    ("rule", "why_not"),
    [
        (Rule("in time", duration_max_s=10.0), ""),
        (Rule("in time", duration_max_s=9.5), "10.0 s of flight, more than 9.5"),
        # The planner's flights do not say how far beside they were.
        (Rule("in bounds", beside_max_m=0.1, behind_max_m=0.1), ""),
    ],
)
def test_a_leg_that_is_late_does_not_pass(
    monkeypatch: pytest.MonkeyPatch, rule: Rule, why_not: str
) -> None:
    row, _ = flown(monkeypatch, Outcome("arrived", duration_s=10.0), rule)
    assert (row.passed, row.why_not) == (not why_not, why_not)
