"""Readers of the public scenes' files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_tools.benchmark.formats import (
    Way,
    read_box_scenes,
    read_forest,
    read_pillars,
    read_ways,
)
from onboard.files.yaml_file import FileError
from tests.gcs_tools.benchmark.public_files import BOXES, MISSIONS, PILLARS

Written = Callable[[str, str], Path]


@pytest.fixture
def text(tmp_path: Path) -> Written:
    def write(name: str, content: str) -> Path:
        path = tmp_path / name
        path.write_text(content, encoding="utf-8")
        return path

    return write


def test_pillars_of_sando(text: Written) -> None:
    pillars = read_pillars(text("static.csv", PILLARS))
    assert pillars.centre_m.tolist() == [[9.0, 0.3], [16.0, -2.5]]
    assert pillars.radius_m.tolist() == [1.2, 1.0]


def test_stems_have_half_their_diameter(text: Written) -> None:
    forest = read_forest(text("stems.csv", "x_m,y_m,dbh_cm\n200.0,8.8,32.9\n"))
    assert forest.centre_m.tolist() == [[200.0, 8.8]]
    assert forest.radius_m.tolist() == [pytest.approx(0.1645)]


def test_scenes_of_boxes(text: Written) -> None:
    first, second = read_box_scenes(text("two_box_scenes.csv", BOXES))
    assert (first.number, first.peer_distance_m, second.number) == (0, 1.2, 1)
    assert first.boxes.centre_m.tolist() == [[1.0, 12.0], [-9.0, 14.0]]
    assert first.boxes.half_m.tolist() == [[1.5, 1.0], [2.0, 2.0]]
    assert first.boxes.turn_rad.tolist() == [pytest.approx(math.radians(30.0)), 0.0]


def test_scenes_of_one_box_without_a_peer(text: Written) -> None:
    (scene,) = read_box_scenes(
        text("one.csv", "north1_m,east1_m,l1_north_m,w1_east_m,r1_deg\n1,12,3,2,0\n")
    )
    assert len(scene.boxes.radius_m) == 1
    assert scene.peer_distance_m is None


def test_cells_may_be_separated_and_lines_end_otherwise(text: Written) -> None:
    """A box or a peer's distance that is not recognized in the header would be left out."""
    other = BOXES.replace(",", ";").replace("\n", "\r\n")
    first, _ = read_box_scenes(text("two_box_scenes.csv", other))
    assert first.peer_distance_m == 1.2
    assert len(first.boxes.radius_m) == 2


def test_a_way_of_several_missions_is_flown_once(text: Written) -> None:
    ways = read_ways(text("missions.json", json.dumps(MISSIONS)))
    assert ways == [Way((0.0, 0.0), (0.0, 24.0))]


@pytest.mark.parametrize(
    ("read", "content", "words"),
    [
        (read_pillars, "x_m,y_m,radius_m\n1,2,thick\n", ("row 2", "radius_m", "'thick'")),
        (read_pillars, "x_m,y_m,radius_m\n1,2,3\n1,2,0\n", ("row 3", "radius_m [m] = 0")),
        (read_pillars, "x_m,y_m,radius_m\n1,2,1e300\n", ("row 2", "at most 200")),
        (read_pillars, "x_m,y_m,radius_m\n1e7,2,1\n", ("row 2", "x_m [m] = 10000000")),
        (read_pillars, "x_m,y_m\n1,2\n", ("header", "radius_m")),
        (read_pillars, "", ("header",)),
        (read_pillars, "x_m,y_m,radius_m\n", ("at least one",)),
        (read_box_scenes, BOXES.replace("30.0,-9.0", "nan,-9.0"), ("row 2", "r1_deg", "'nan'")),
        (read_box_scenes, BOXES.replace("3.0,2.0,30.0", "3.0,-2,30.0"), ("row 2", "w1_east_m")),
        (read_box_scenes, BOXES.replace("w2_east_m", "w2"), ("header", "w2_east_m")),
        (read_forest, "x_m,y_m,dbh_cm\n1,2,0\n", ("row 2", "dbh_cm [cm] = 0")),
        (read_ways, "{", ("not JSON",)),
        (read_ways, "[" * 100_000, ("not JSON",)),
        (read_ways, "[]", ("missions",)),
        (read_ways, "{}", ("missions is missing",)),
        (read_ways, '{"missions": {}}', ("missions",)),
        (read_ways, '{"missions": {"a": [["land", 1.0]]}}', ("missions.a",)),
        (
            read_ways,
            '{"missions": {"a": [["takeoff", 0, 0, 9], ["land", 1e9, "x", 0]]}}',
            ("missions.a.1.1", "missions.a.1.2"),
        ),
    ],
)
def test_a_bad_file_is_one_line_that_names_the_place(
    text: Written, read: Callable[[Path], object], content: str, words: tuple[str, ...]
) -> None:
    path = text("bad.csv", content)
    with pytest.raises(FileError) as refused:
        list(read(path))  # type: ignore[call-overload]
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    for word in words:
        assert word in message
