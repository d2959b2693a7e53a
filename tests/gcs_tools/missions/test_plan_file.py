"""QGroundControl's plans, whole and broken."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.missions.plan_file import read_plan
from onboard.files.yaml_file import FileError
from tests.gcs_tools.missions.ground_station import (
    HOME,
    LAND,
    TAKE_OFF,
    WAYPOINT,
    north,
    plan,
    simple,
    written,
)

POINT = {"center": [1, 2], "radius": 0}


def problem_of(path: Path, document: dict[str, Any]) -> str:
    with pytest.raises(FileError) as caught:
        read_plan(written(path, document))
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.plan"


def test_items_home_and_firmware(path: Path) -> None:
    items = (simple(TAKE_OFF, *north(0.0)), simple(WAYPOINT, *north(1.0), frame=0))
    found = read_plan(written(path, plan(*items)))
    assert found.home == HOME
    assert found.autopilot == "px4"
    assert [each.command for each in found.items] == [TAKE_OFF, WAYPOINT]
    second = found.items[1]
    assert (second.name, second.frame, second.place) == ("item 2", 0, north(1.0))
    assert math.isnan(second.parameters[3])  # null
    assert found.notes == ()


@pytest.mark.parametrize(("firmware", "autopilot"), [(3, "ardupilot"), (12, "px4"), (0, None)])
def test_the_firmware_names_the_autopilot(path: Path, firmware: int, autopilot: str | None) -> None:
    document = plan(simple(WAYPOINT, *north(1.0)), firmwareType=firmware)
    found = read_plan(written(path, document))
    assert (found.autopilot, found.notes) == (autopilot, ())


def test_an_early_file_states_the_place_apart(path: Path) -> None:
    item = simple(WAYPOINT)
    item |= {"params": [0, 0, 0, 0], "coordinate": list(north(2.0))}
    (found,) = read_plan(written(path, plan(item))).items
    assert found.place == north(2.0)


def test_a_survey_gives_the_items_that_it_expands_to(path: Path) -> None:
    inner = [simple(WAYPOINT, *north(steps)) for steps in (1.0, 2.0)]
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "TransectStyleComplexItem": {"Items": inner, "version": 2},
    }
    found = read_plan(written(path, plan(survey, simple(LAND)))).items
    assert [each.name for each in found] == ["item 1 (survey) 1", "item 1 (survey) 2", "item 2"]
    assert [each.place for each in found[:2]] == [north(1.0), north(2.0)]


def test_the_geofence_of_both_versions_and_the_rest(path: Path) -> None:
    document = plan(simple(WAYPOINT, *north(1.0)), vehicleType=1, firmwareType=7)
    corners = [list(north(n, east=e)[:2]) for n, e in ((0, 0), (1, 0), (1, 1))]
    document["geoFence"] |= {
        "polygons": [{"inclusion": False, "polygon": corners, "version": 1}],
        "circles": [{"inclusion": True, "circle": {"center": corners[0], "radius": 30.5}}],
        "polygon": corners,
        "breachReturn": [1.0, 2.0, 3.0],
    }
    document["rallyPoints"]["points"] = [[1.0, 2.0, 3.0]] * 2
    found = read_plan(written(path, document))
    assert [(len(a.corners), a.radius_m, a.keeps_in) for a in found.fence] == [
        (3, None, False),
        (3, None, True),
        (1, 30.5, True),
    ]
    assert [note.split(":")[0].split(" (")[0] for note in found.notes] == [
        "the plan is for firmware 7",
        "the plan is for a vehicle of type 1",
        "rally points",
        "the geofence's return point",
    ]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fileType": "Mission"}, ("fileType", "'Mission'")),
        ({"version": 2}, ("version", "2")),
        ({"mission": None}, ("mission",)),
        ({"mission": {}}, ("mission.items is missing",)),
        ({"mission": {"items": 3}}, ("mission.items = 3",)),
        ({"mission": {"items": [3]}}, ("mission.items.0 = 3",)),
        ({"geoFence": {"polygons": [{"polygon": [[1.0, 2.0]], "inclusion": True}]}}, ("corners",)),
        ({"geoFence": {"polygons": [{"polygon": [[1.0]], "inclusion": True}]}}, ("polygon.0.1",)),
        ({"geoFence": {"circles": [{"circle": POINT, "inclusion": True}]}}, ("radius [m] = 0",)),
        ({"geoFence": {"circles": [{"circle": {"radius": 5}, "inclusion": True}]}}, ("center",)),
        ({"rallyPoints": {"points": 7}}, ("rallyPoints.points = 7",)),
    ],
)  # fmt: skip
def test_a_broken_plan_names_the_key(
    path: Path, change: dict[str, Any], words: tuple[str, ...]
) -> None:
    message = problem_of(path, {**plan(simple(WAYPOINT, *north(1.0))), **change})
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("item", "words"),
    [
        ({"type": "Waypoint"}, ("item 1", "'Waypoint'")),
        ({"params": [0, 0, 0]}, ("item 1", "3 numbers", "expected 4")),
        ({"params": [0, 0, 0, 0, 0, 0, 0, 0]}, ("item 1", "8 numbers")),
        ({"params": [0, 0, 0, 0, "x", 0, 0]}, ("params.4 = 'x'",)),
        ({"command": "16"}, ("command = '16'",)),
        ({"frame": None}, ("frame = None",)),
        ({"type": "ComplexItem", "complexItemType": "structureScan"}, ("structureScan", "export")),
    ],
)
def test_a_broken_item_is_named(path: Path, item: dict[str, Any], words: tuple[str, ...]) -> None:
    message = problem_of(path, plan({**simple(WAYPOINT, *north(1.0)), **item}))
    for word in words:
        assert word in message


def test_a_home_without_altitude_or_place(path: Path) -> None:
    item = simple(WAYPOINT, *north(1.0))
    message = problem_of(path, plan(item, plannedHomePosition=[1.0, 2.0]))
    assert "plannedHomePosition has 2 numbers" in message
    assert read_plan(written(path, plan(item, plannedHomePosition=[None, None, None]))).home is None
    home = read_plan(written(path, plan(item, plannedHomePosition=[1.0, 2.0, None]))).home
    assert home is not None
    assert math.isnan(home.altitude_m)


def test_what_is_not_json(path: Path) -> None:
    for text in ("{", "hello", ""):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(FileError, match="neither JSON"):
            read_plan(path)
    path.write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(FileError, match="nested too deeply"):
        read_plan(path)
