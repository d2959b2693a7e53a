"""Pre-flight on paper: what satisfies a broken clause, how fast a field may be flown, pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.contract.keys import contract_key
from gcs_tools.contract.solve import solve
from gcs_tools.preflight.command import check
from gcs_tools.preflight.field_check import check_field, legs_of
from gcs_tools.preflight.field_regions import region_boxes
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.picture import offending
from gcs_tools.preflight.remedy import Remedy, remedies
from gcs_tools.preflight.report import advice
from gcs_tools.preflight.speed import fastest_speed_mps
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.yaml_file import load_yaml
from onboard.geometry.box import Box
from tests.gcs_tools.running import CONFIG, Clearway

PAPER = CONFIG / "paper_contract.yaml"
SPEED = "vehicle.cruise_speed_mps"


def broken_contract(*overrides: str) -> Contract:
    return load_contract(PAPER, overrides)


def assessed(contract: Contract) -> Assessment:
    return assess(contract, mission_altitude_m=4.0)


@pytest.mark.parametrize(
    "override",
    [
        "sensor.detection_range_m=4.0",
        "vehicle.thrust_to_weight=1.001",
        "environment.obstacle_separation_min_m=8.0",
        "sensor.field_of_view_deg=80.0",
        "vehicle.tracking_error_z_m=4.9",
        "environment.wind_max_mps=1.5",
        "vehicle.heading_error_deg=8.0",
    ],
)
def test_every_remedy_satisfies_its_clause_and_is_the_least(override: str) -> None:
    contract = broken_contract(override)
    found = remedies(assessed(contract))
    assert {remedy.clause for remedy in found} == {
        clause.name for clause in assessed(contract).clauses if not clause.holds
    }
    for remedy in found:
        changed = assessed(contract_key(remedy.key).changed(contract, remedy.value))
        assert next(c for c in changed.clauses if c.name == remedy.clause).holds
        assert remedy.settles_all is changed.compliant
        less = remedy.declared + 0.97 * (remedy.value - remedy.declared)
        short = assessed(contract_key(remedy.key).changed(contract, less))
        lacking = next(c for c in short.clauses if c.name == remedy.clause)
        assert not lacking.holds or remedy.change < 0.02  # rounding is coarser than that


def test_the_remedy_that_settles_all_is_the_limit_that_solve_finds() -> None:
    contract = broken_contract("sensor.detection_range_m=6.0")
    settling = {r.key: r for r in remedies(assess(contract)) if r.settles_all}
    limit = solve(contract, SPEED).limit
    assert limit is not None
    assert settling[SPEED].value == pytest.approx(limit.value, rel=5e-3)
    assert settling[SPEED].value <= limit.value


def test_the_smallest_change_comes_first() -> None:
    found = [
        Remedy("stop", SPEED, 2.8, 2.1, "m/s", settles_all=True),
        Remedy("stop", "sensor.detection_range_m", 12.0, 14.3, "m", settles_all=False),
    ]
    assert advice("stop", tuple(found)) == "cruise at ≤ 2.1 m/s, or see ≥ 14.3 m (not enough alone)"
    changes = [r.change for r in remedies(assess(broken_contract("sensor.detection_range_m=6.0")))]
    assert changes[:3] == sorted(changes[:3])


def test_a_compliant_contract_needs_no_remedy() -> None:
    assert remedies(assess(load_contract(PAPER))) == ()


def test_the_operator_reads_the_verdict_first(clearway: Clearway) -> None:
    ran = clearway("preflight", "--contract", PAPER, "--set", "sensor.detection_range_m=6.0")
    lines = ran.out.splitlines()
    tier = check(broken_contract("sensor.detection_range_m=6.0"), None, None).tier
    assert lines[0].startswith(tier.value.upper())
    assert any(line.startswith("most violated: sensor_silence") for line in lines)
    assert (
        "to guarantee arrival, satisfy sensor_silence: cruise at ≤ 2.62 m/s, or see ≥ 6.65 m"
        in ran.out
    )
    assert "|██ 111 %" in ran.out


def paper_field() -> tuple[Contract, ObstacleField, Mission]:
    field = load_field(CONFIG / "paper_field.yaml")
    return load_contract(PAPER), field, load_yaml(CONFIG / "paper_mission.yaml", Mission)


def test_the_fastest_speed_is_the_last_that_complies() -> None:
    contract, field, mission = paper_field()
    fastest_mps = fastest_speed_mps(contract, field, mission, "inner")
    assert fastest_mps is not None

    def complies(speed_mps: float) -> bool:
        assessment = assess(contract_key(SPEED).changed(contract, speed_mps))
        rules = check_field(assessment, field, mission)
        return assessment.compliant and all(rule.holds for rule in rules)

    assert complies(fastest_mps)
    assert not complies(fastest_mps + 0.01)


def test_no_speed_helps_where_obstacles_stand_too_close(clearway: Clearway) -> None:
    field = CONFIG / "intersecting_rois_field.yaml"
    arguments = ("preflight", "--contract", PAPER, "--field", field)
    document = json.loads(clearway(*arguments, "--format", "json").out)
    assert document["fastest_compliant_speed_mps"] is None
    assert "no cruise speed makes this field compliant" in clearway(*arguments).out


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("vehicle.heading_error_deg=10",),
        ("environment.wind_max_mps=2.0",),
        ("vehicle.setpoint_loss_run_on_m=3.0", "vehicle.cruise_speed_mps=2.0"),
        ("vehicle.recentring_speed_mps=0.4",),
        ("requirements.stop=false",),
        ("vehicle.setpoint_loss={model: frozen, gain_per_s: 1.0, velocity_gain_per_s: 1.8}",),
    ],
)
@given(
    st.lists(
        st.tuples(*[st.floats(-50.0, 50.0)] * 2, *[st.floats(0.1, 4.0)] * 2), min_size=1, max_size=5
    )
)
def test_regions_of_a_whole_field_are_those_of_its_obstacles(
    overrides: tuple[str, ...], rows: list[tuple[float, float, float, float]]
) -> None:
    assessment = assess(
        load_contract(CONFIG / "default_contract.yaml", overrides), mission_altitude_m=5.0
    )
    boxes = [Box(x, x + along, y, y + across) for x, y, along, across in rows]
    edges_m = np.array([(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in boxes])
    found = region_boxes(assessment, edges_m)
    for number, box in enumerate(boxes):
        region = assessment.region_around(box, 0.0)
        for rows_m, one in (
            (found.extent_m, region.extent),
            (found.apart_m, region.apart),
            (found.manoeuvre_m, region.manoeuvre),
        ):
            one_m = [one.x_min_m, one.x_max_m, one.y_min_m, one.y_max_m]
            assert rows_m[number].tolist() == pytest.approx(one_m, abs=1e-9)


def test_a_mission_near_the_ground_may_not_be_flown(
    clearway: Clearway, written: Callable[[str, Any], Path]
) -> None:
    mission = {"altitude_m": 0.8, "legs": [{"end_ned_m": [46.0, 0.0]}]}
    arguments = ("preflight", "--contract", CONFIG / "default_contract.yaml")
    assert clearway(*arguments).code == 0
    low = clearway(*arguments, "--mission", written("low.yaml", mission))
    assert low.code == 1
    assert "ground_clearance" in low.out
    high = written("high.yaml", mission | {"altitude_m": 0.81})
    assert clearway(*arguments, "--mission", high).code == 0


def test_the_picture_marks_those_that_break_a_rule(clearway: Clearway, tmp_path: Path) -> None:
    field = load_field(CONFIG / "intersecting_rois_field.yaml")
    (leg,) = legs_of(assess(load_contract(PAPER)), field, paper_field()[2])
    assert [name for name, broken in zip(field.ids, offending(leg), strict=True) if broken] == [
        "2",
        "3",
    ]
    path = tmp_path / "field.png"
    arguments: tuple[Any, ...] = (
        *("--field", CONFIG / "intersecting_rois_field.yaml"),
        *("--mission", CONFIG / "paper_mission.yaml"),
        *("--picture", path),
    )
    assert clearway("preflight", "--contract", PAPER, *arguments).code == 1
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["picture.nonsense", "nowhere/picture.png"])
def test_a_picture_that_cannot_be_written(clearway: Clearway, tmp_path: Path, name: str) -> None:
    field = ("--field", CONFIG / "paper_field.yaml")
    ran = clearway("preflight", "--contract", PAPER, *field, "--picture", tmp_path / name)
    assert ran.code == 2
    assert ran.err.count("\n") == 1


def test_a_picture_needs_a_field(clearway: Clearway, tmp_path: Path) -> None:
    ran = clearway("preflight", "--contract", PAPER, "--picture", tmp_path / "field.png")
    assert (ran.code, "--field" in ran.err) == (2, True)


def test_broken_beats_unknown_beats_holding() -> None:
    holds, broken, unknown = Verdict.HOLDS, Verdict.BROKEN, Verdict.UNKNOWN
    assert Verdict.worst([]) is holds
    assert Verdict.worst([holds, unknown]) is unknown
    assert Verdict.worst([unknown, broken, holds]) is broken
