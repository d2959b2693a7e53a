"""Waypoint lists, as Mission Planner, MAVProxy and others write them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_tools.missions.waypoint_list import is_waypoint_list, read_waypoint_list
from onboard.files.yaml_file import FileError
from tests.gcs_tools.missions.ground_station import waypoints

HOME_ROW = "0 1 0 16 0 0 0 0 47.397742 8.545594 488.000000 1"
ROW = "1 0 3 16 2.5 0 0 nan 47.3986 8.5456 10.000000 1"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.waypoints"


def test_the_first_item_is_home(path: Path) -> None:
    path.write_text(waypoints(HOME_ROW, ROW), encoding="utf-8")
    found = read_waypoint_list(path)
    assert found.home == (47.397742, 8.545594, 488.0)
    assert found.autopilot is None
    (item,) = found.items
    assert (item.name, item.command, item.frame) == ("item 1", 16, 3)
    assert item.place == (47.3986, 8.5456, 10.0)
    assert item.parameters[0] == 2.5
    assert math.isnan(item.parameters[3])


def test_the_first_item_may_be_flown(path: Path) -> None:
    path.write_text(waypoints(HOME_ROW, ROW), encoding="utf-8")
    found = read_waypoint_list(path, first_is_home=False)
    assert found.home is None
    assert [each.name for each in found.items] == ["item 0", "item 1"]


def test_a_home_of_zeros_is_none(path: Path) -> None:
    path.write_text(waypoints("0 1 0 16 0 0 0 0 0 0 0 1", ROW), encoding="utf-8")
    assert read_waypoint_list(path).home is None


def test_spaces_crlf_comments_and_decimals(path: Path) -> None:
    text = f"QGC WPL 110\r\n# by hand\r\n{HOME_ROW}\r\n\r\n{ROW.replace('16', '16.000')}\r\n"
    path.write_bytes(text.encode())
    (item,) = read_waypoint_list(path).items
    assert item.command == 16


def test_is_waypoint_list() -> None:
    assert is_waypoint_list("QGC WPL 110\n")
    assert is_waypoint_list("QGC WPL 120\n")
    assert not is_waypoint_list('{"fileType": "Plan"}')
    assert not is_waypoint_list("")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("line 1", "expected 'QGC WPL 110'")),
        (waypoints(HOME_ROW, header="QGC WPL 120"), ("line 1", "'QGC WPL 120'")),
        (waypoints(), ("no items",)),
        (waypoints(HOME_ROW, "1 0 3 16"), ("line 3", "4 fields", "expected 12")),
        (waypoints(HOME_ROW, ROW.replace("47.3986", "north")), ("line 3", "latitude", "'north'")),
        (waypoints(HOME_ROW, ROW.replace("47.3986", "nan")), ("latitude = 'nan'",)),
        (waypoints(HOME_ROW, ROW.replace("10.000000", "inf")), ("altitude = 'inf'",)),
        (waypoints(HOME_ROW, ROW.replace("47.3986", "47,3986")), ("latitude = '47,3986'",)),
        (waypoints(HOME_ROW, ROW.replace(" 16 ", " 16.5 ")), ("command = '16.5'", "whole")),
        (waypoints(HOME_ROW, ROW.replace(" 16 ", " -1 ")), ("command = '-1'",)),
        (waypoints(ROW), ("item 1", "frame 3", "not home", "--first-item")),
        (waypoints(HOME_ROW.replace(" 16 ", " 22 ")), ("command 22", "not home")),
    ],
)
def test_a_broken_list_names_the_line(path: Path, text: str, words: tuple[str, ...]) -> None:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as caught:
        read_waypoint_list(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message
