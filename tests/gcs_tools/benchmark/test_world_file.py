"""Cylinders of a Gazebo world."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_tools.benchmark.scenes import Selection
from gcs_tools.benchmark.suites import benchmark_named
from gcs_tools.benchmark.world_file import read_world
from onboard.files.yaml_file import FileError

CYLINDER = "<geometry><cylinder><length>6</length><radius>1.2</radius></cylinder></geometry>"
GROUND = (
    "<model name='ground'><link><collision><geometry><plane/></geometry></collision></link></model>"
)


def world(*models: str) -> str:
    return f"<sdf version='1.7'><world name='default'>{''.join(models)}</world></sdf>"


def model(shape: str = CYLINDER, pose: str = "45.2 -9 3 0 -0 0", inner: str = "") -> str:
    link = f"<link name='body'>{inner}<collision name='c'>{shape}</collision></link>"
    return f"<model name='7'><static>1</static>{link}<pose>{pose}</pose></model>"


def written(folder: Path, text: str) -> Path:
    path = folder / "easy_forest.world"
    path.write_text(text, encoding="utf-8")
    return path


def test_cylinders_stand_where_their_models_do(tmp_path: Path) -> None:
    path = written(tmp_path, world(GROUND, model(), model(pose="1 2 3 0 0 0.5")))
    pillars = read_world(path)
    assert pillars.centre_m.tolist() == [[45.2, -9.0], [1.0, 2.0]]
    assert pillars.radius_m.tolist() == [1.2, 1.2]


def test_the_pose_of_a_link_is_in_the_frame_of_its_model(tmp_path: Path) -> None:
    turned = model(pose=f"10 5 0 0 0 {math.pi / 2}", inner="<pose>2 0 0 0 0 0</pose>")
    assert read_world(written(tmp_path, world(turned))).centre_m[0] == pytest.approx((10.0, 7.0))


def test_a_folder_of_worlds_is_data(tmp_path: Path) -> None:
    (tmp_path / "worlds").mkdir()
    written(tmp_path / "worlds", world(model()))
    scenes = benchmark_named("sando").scenes(Selection((), tmp_path, 1, 1))
    assert [scene.field for scene in scenes] == ["easy_forest"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not XML"),
        ("<sdf>", "is not XML"),
        ("x_m,y_m,radius_m\n1,2,3\n", "line 1"),
        (world(GROUND), "no model with a cylinder"),
        (world(model("<geometry><box/></geometry>")), "model '7': collides as <box>"),
        (world(model(pose="1 2 3 0.5 0 0")), "pose [rad] = 0.5 0 is not upright"),
        (world(model(pose="1 2 3")), "pose = '1 2 3'; expected 6 numbers"),
        (world(model(pose="1 2 3 0 0 nan")), "expected 6 numbers"),
        (world(model(pose="1e9 2 3 0 0 0")), "from the origin"),
        (world(model(CYLINDER.replace("1.2", "-1"))), "radius [m] = -1"),
        (world(model(CYLINDER.replace("<radius>1.2</radius>", ""))), "radius = ''"),
    ],
)
def test_a_bad_world_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(FileError) as refused:
        read_world(path)
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert "\n" not in message
