"""Scenes in which something moves: as the file says, declared as fast as it goes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.benchmark.moving_scenes import greatest_speed_mps, moving_legs, sphere_legs
from gcs_tools.benchmark.scenes import Scene
from gcs_tools.benchmark.service_flight import contract_of, scenario_of, waits_of
from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import log_of
from gcs_tools.preflight.command import check
from onboard.files.yaml_file import FileError
from onboard.guidance.phases import Phase
from onboard.recording.messages import EventRecord, StateRecord
from sitl.environment.movers.config import Knot
from tests.gcs_tools.benchmark.public_files import KNOT, MOVING


def written(folder: Path, document: Any) -> Path:
    path = folder / "dynamic_easy.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def scenes_of(folder: Path, document: Any = MOVING, legs: int = 5) -> list[Scene]:
    return list(moving_legs(written(folder, document), legs))


def test_each_seed_is_a_leg_among_what_stands_and_what_moves(tmp_path: Path) -> None:
    one, other = scenes_of(tmp_path)
    assert [(each.field, each.name) for each in (one, other)] == [
        ("dynamic_easy", "seed 0"),
        ("dynamic_easy", "seed 1"),
    ]
    assert one.length_m == 16.0
    assert one.obstacles.centre_m.tolist() == [[13.0, -4.0]]
    assert one.obstacles.half_m.tolist() == [[0.2, 2.0]]
    assert one.moving is not None
    assert other.moving is not None
    (cube,) = one.moving.movers
    assert cube.path == Knot(
        kind="knot",
        center_ned_m=(9.0, 1.0),
        scale_m=(2.5, 3.0),
        period_s=2.0 * math.pi * 4.6,
        phase_deg=math.degrees(2.35),
    )
    assert other.moving.movers == ()
    assert len(scenes_of(tmp_path, legs=1)) == 1


def test_what_is_declared_is_at_least_as_fast_as_the_curve(tmp_path: Path) -> None:
    moving = scenes_of(tmp_path)[0].moving
    assert moving is not None
    (cube,) = moving.movers
    assert isinstance(cube.path, Knot)
    # By hand: the derivative of the knot, at many more angles than are sampled.
    true_mps = max(
        math.hypot(
            2.5 / 6.0 * (math.cos(s) + 4.0 * math.cos(2.0 * s)),
            3.0 / 5.0 * (4.0 * math.sin(2.0 * s) - math.sin(s)),
        )
        / 4.6
        for s in (k * 1e-4 for k in range(62832))
    )
    assert greatest_speed_mps(cube.path) == pytest.approx(true_mps, rel=1e-4)
    assert true_mps < moving.speed_max_mps < true_mps + 0.06
    assert (cube.speed_mps, moving.size_max_m) == (moving.speed_max_mps, 0.8)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([], "expected an object"),
        ({"seeds": {}}, "start"),
        ({**MOVING, "seeds": {"0": [{**KNOT, "x0": 1e9}]}}, "seeds.0.0.x0"),
        ({**MOVING, "seeds": {"0": [{**KNOT, "size_x": -1.0}]}}, "seeds.0.0.size_x"),
        ({**MOVING, "seeds": {"0": [{**KNOT, "size_x": 0.7}]}}, "to be square"),
        ({**MOVING, "seeds": {"0": [{**KNOT, "slower": 0.0}]}}, "slower = 0 [s/rad]"),
        ({**MOVING, "goal": [16, 3, 2]}, "along x"),
        ({**MOVING, "seeds": {"0": []}}, "seeds.0"),
    ],
)
def test_a_file_that_says_otherwise_is_refused(tmp_path: Path, document: Any, words: str) -> None:
    with pytest.raises(FileError) as refused:
        scenes_of(tmp_path, document)
    assert words in str(refused.value)
    assert "dynamic_easy.json" in str(refused.value)


def test_the_scenario_declares_what_moves_and_sees_all_round(tmp_path: Path) -> None:
    scene = scenes_of(tmp_path)[0]
    assert scene.moving is not None
    scenario = scenario_of(scene, 0.7, "ardupilot")
    (declared,) = scenario.contract.environment.movers
    assert (declared.kind, declared.speed_max_mps) == ("box", scene.moving.speed_max_mps)
    assert check(scenario.contract, None, scenario.mission).may_fly
    assert scenario.mission.legs[0].end_ned_m == (16.0, 0.0)  # squares do not turn
    plant = scenario.sitl_config(seed=1)
    assert plant.movers == scene.moving.movers
    assert (plant.sensors[0].message_version, plant.sensors[0].field_of_view_deg) == (2, 360.0)
    with pytest.raises(CommandError, match="only ardupilot"):
        contract_of(scene, "px4")


def in_phases(*phases: Phase) -> list[StateRecord]:
    return [StateRecord(time_s=float(k), phase=phase) for k, phase in enumerate(phases)]


def test_waits_are_counted_and_the_last_one_has_a_reason() -> None:
    thread, wait, over = Phase.THREAD, Phase.YIELD, Phase.STANDBY
    begins = [
        EventRecord(time_s=0.0, text=f"yielding: {why}", data={"to": Phase.YIELD})
        for why in ("one", "other")
    ]
    goes_on = log_of([*in_phases(thread, wait, wait, thread, wait, thread), *begins])
    assert waits_of(goes_on) == (3.0, "")
    ends = log_of([*in_phases(thread, wait, thread, wait, wait, over), *begins])
    assert waits_of(ends) == (3.0, "yielding: other")
    assert waits_of(log_of(in_phases(over))) == (0.0, "")


SPHERES = """\
rpg_box01,9.0,2.0,3.0,1.0,0.0,0.0,0.0,2.0,2.0,2.0
rpg_box01,1000.0,1000.0,1000.0,1.0,0.0,0.0,0.0,1.0,1.0,1.0
rpg_box01,0.0,0.0,8.0,1.0,0.0,0.0,0.0,3.0,3.0,3.0
"""


def spheres_of(folder: Path, text: str) -> list[Scene]:
    path = folder / "hard_7.csv"
    path.write_text(text, encoding="utf-8")
    return list(sphere_legs(path, 2))


def test_a_sphere_is_the_box_around_it_at_its_height(tmp_path: Path) -> None:
    one, other = spheres_of(tmp_path, SPHERES)
    assert [(each.field, each.name) for each in (one, other)] == [
        ("hard", "hard_7 flight 0"),
        ("hard", "hard_7 flight 1"),
    ]
    # y is to the left there, to the right here; where none stands is left out.
    assert one.obstacles.centre_m.tolist() == [[9.0, -2.0], [0.0, 0.0]]
    assert one.obstacles.half_m.tolist() == [[1.0, 1.0], [1.5, 1.5]]
    assert one.aloft is not None
    assert one.aloft.down_m.tolist() == [[-4.0, -2.0], [-9.5, -6.5]]
    scenario = scenario_of(one, 0.0, "ardupilot")
    assert scenario.obstacles.down_m is not None
    assert check(scenario.contract, None, scenario.mission).may_fly
    (sensor,) = scenario.plant.sensors
    assert sensor.height_noise_m == scenario.contract.sensor.position_error_z_m


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no sphere"),
        ("rpg_box01,1,2\n", "with 3 cells; expected"),
        (SPHERES.replace("9.0,2.0", "nan,2.0"), "row 1: x [m] = nan is more than"),
        (SPHERES.replace("9.0,2.0", "far,2.0"), "row 1: could not convert"),
        (SPHERES.replace("2.0,2.0,2.0", "2.0,0.0,2.0"), "row 1: scale [m] = 2, 0, 2 must be"),
    ],
)
def test_what_is_no_sphere_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileError) as refused:
        spheres_of(tmp_path, text)
    assert words in str(refused.value)


def test_no_leg_begins_in_a_sphere(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"is -1\.50 m from the nearest sphere"):
        spheres_of(tmp_path, SPHERES.replace("0.0,0.0,8.0", "0.0,0.0,3.0"))
