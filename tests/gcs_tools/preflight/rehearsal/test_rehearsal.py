"""A mission rehearsed on a known map: does it pass, how fast, how narrow, where does it wait."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_tools.preflight.command import check
from gcs_tools.preflight.rehearsal.prediction import Rehearsal, Wait
from gcs_tools.preflight.rehearsal.rehearse import rehearse
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.guidance.dense.limits import rest_limits_of
from tests.gcs_tools.running import CONFIG, Clearway

DEFAULT = CONFIG / "default_contract.yaml"
WALL_M = 8.0


def assessment() -> Assessment:
    return assess(load_contract(DEFAULT))


def mission(length_m: float, half_width_m: float = 6.0) -> Mission:
    leg = {"end_ned_m": (0.0, length_m), "target_half_width_m": half_width_m}
    return Mission.model_validate({"altitude_m": 4.0, "legs": [leg]})


def obstacle(name: str, north_m: float, east_m: float, size_m: tuple[float, float]) -> Obstacle:
    return Obstacle(id=name, center_ned_m=(north_m, east_m), size_m=size_m)


def wall(gap_m: float) -> ObstacleField:
    """A wall across a leg to the east, with a door 1 m south of it; no door for 0."""
    ends_m = [(-WALL_M, -1.0 - gap_m / 2.0), (-1.0 + gap_m / 2.0, WALL_M)]
    return ObstacleField.of(
        [
            obstacle(str(n), (low + high) / 2.0, 6.0, (high - low, 0.4))
            for n, (low, high) in enumerate(ends_m)
        ]
    )


@cache
def through_a_door() -> Rehearsal:
    return rehearse(assessment(), wall(3.0), mission(11.0), confined=True)


def test_a_door_is_passed_and_is_the_narrowest_gap() -> None:
    found = through_a_door()
    assert found.passes
    assert found.narrowest_gap_m == pytest.approx(3.0, abs=0.1)
    assert 0.3 < found.mean_speed_mps < 2.8
    (leg,) = found.legs
    assert leg.distance_m >= 10.0
    assert leg.duration_s == pytest.approx(leg.distance_m / leg.mean_speed_mps)
    assert math.dist(leg.path_ned_m[0], (0.0, 0.0)) < 1e-9
    assert math.dist(leg.path_ned_m[-1], (0.0, 11.0)) < 1.0


def test_the_body_keeps_clear_of_the_wall_all_the_way() -> None:
    (leg,) = through_a_door().legs
    field, body_m = wall(3.0), assessment().terms.body_m
    for center_m, half_m in zip(field.center_ned_m, field.half_size_m, strict=True):
        outside_m = np.maximum(np.abs(leg.path_ned_m - center_m) - half_m, 0.0)
        assert float(np.hypot(*outside_m.T).min()) >= body_m
    assert float(leg.speed_mps.max()) <= assessment().terms.cruise_speed_mps


def test_a_wall_without_a_door_is_not_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_tools.preflight.rehearsal.leg_flight._PAUSES_MAX", 1)
    two = mission(9.0)
    two = two.model_copy(update={"legs": (*two.legs, two.legs[0])})
    found = rehearse(assessment(), wall(0.0), two, confined=True)
    assert not found.passes
    assert len(found.legs) == 1  # the second leg is not begun
    assert len(found.waits) == 2
    assert all(wait.position_ned_m[1] < 6.0 for wait in found.waits)
    assert found.waits[0].duration_s > 0.0
    assert found.sentence().startswith("does not pass leg 1: expected ")
    assert "2 pauses, the longest of " in found.sentence()


def test_the_same_map_gives_the_same_prediction() -> None:
    one, other = (rehearse(assessment(), wall(3.0), mission(4.0), confined=True) for _ in range(2))
    assert one.document() == other.document()


def test_the_limits_hold_for_any_heading_and_with_the_run_on() -> None:
    limits = rest_limits_of(assessment(), any_heading=True)
    terms = assessment().terms
    assert limits.body_radius_m == terms.body_m
    assert limits.acceleration_disc_mps2 == min(limits.acceleration_max_mps2)
    assert limits.run_on.reach_m(terms.cruise_speed_mps) >= (
        terms.cruise_speed_mps * terms.setpoint_loss_timeout_s
    )
    bare = assess(load_contract(DEFAULT, ("requirements.passive_safety=false",)))
    assert rest_limits_of(bare, any_heading=True).run_on.gains == ()
    measured = ("vehicle.setpoint_loss_run_on_m=9.0",)
    longer = rest_limits_of(assess(load_contract(DEFAULT, measured)), any_heading=True).run_on
    assert longer.reach_m(terms.cruise_speed_mps) == pytest.approx(9.0)


def test_the_operator_gets_prediction_and_picture(
    clearway: Clearway, written: Callable[[str, Any], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def rehearsed(*arguments: object, confined: bool) -> Rehearsal:
        asked.append((arguments, confined))
        return through_a_door()

    monkeypatch.setattr("gcs_tools.preflight.rehearsal.rehearse.rehearse", rehearsed)
    field = written(
        "field.yaml",
        "[{id: a, center_ned_m: [-5.25, 10.0], size_m: [5.5, 0.4]},"
        " {id: b, center_ned_m: [4.25, 10.0], size_m: [7.5, 0.4]}]",
    )
    flown = written("mission.yaml", "altitude_m: 4.0\nlegs: [{end_ned_m: [0.0, 18.0]}]")
    picture = field.with_name("rehearsal.png")
    files = ("--contract", DEFAULT, "--field", field, "--mission", flown)
    ran = clearway("preflight", *files, "--accept-no-progress", "--picture", picture)
    assert ran.code == 0, ran.out
    assert "rehearsal, a prediction by the known map alone: passes: expected " in ran.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    document = json.loads(clearway("preflight", *files, "--format", "json").out)
    assert document["verdict"] == "safe, arrival not guaranteed"  # whatever the rehearsal says
    assert document["rehearsal"] == through_a_door().document()
    assert document["rehearsal"]["prediction"] is True
    assert [confined for _, confined in asked] == [True, True]


def test_what_is_guaranteed_is_not_rehearsed() -> None:
    result = check(load_contract(DEFAULT), None, None)
    assert result.compliant
    assert result.document()["rehearsal"] is None


def test_pauses_are_in_the_document() -> None:
    leg = through_a_door().legs[0]
    paused = Rehearsal((leg,), 2)
    assert not paused.passes
    waits = (Wait((1.0, 2.0), 3.0),)
    document = Rehearsal((type(leg)(**{**_fields(leg), "waits": waits}),), 1).document()
    assert document["waits"] == [{"position_ned_m": [1.0, 2.0], "duration_s": 3.0}]
    assert document["legs"][0]["waits"] == 1


def _fields(leg: object) -> dict[str, Any]:
    return dict(vars(leg))
