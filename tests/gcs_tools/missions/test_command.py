"""`clearway mission import`, from a ground station's file to a pre-flight check."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs_tools.console.errors import CommandError
from gcs_tools.missions.command import ImportRequest, import_mission
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, load_yaml
from tests.gcs_tools.missions.ground_station import (
    RETURN,
    TAKE_OFF,
    WAYPOINT,
    north,
    plan,
    simple,
    waypoints,
    written,
)
from tests.gcs_tools.running import CONFIG, Clearway

ITEMS = (
    simple(TAKE_OFF, *north(0.0)),
    simple(WAYPOINT, *north(1.0)),
    simple(WAYPOINT, *north(1.0, 498.0, east=1.0), frame=0),
    simple(RETURN),
)
LIST = waypoints(
    "0 1 0 16 0 0 0 0 47.397742 8.545594 488 1",
    "1 0 3 22 0 0 0 0 0 0 10 1",
    "2 0 3 16 0 0 0 0 47.398742 8.545594 10 1",
    "3 0 0 16 0 0 0 0 47.398742 8.546594 498 1",
    "4 0 0 20 0 0 0 0 0 0 0 1",
)


KEYS = (
    *("type", "command", "frame", "params", "coordinate", "items", "plannedHomePosition"),
    *("firmwareType", "vehicleType", "complexItemType", "TransectStyleComplexItem", "Items"),
)


def fenced(radius_m: float) -> dict[str, Any]:
    document = plan(*ITEMS)
    circle = {"center": list(north(0.5, east=0.5)[:2]), "radius": radius_m}
    document["geoFence"]["circles"] = [{"circle": circle, "inclusion": True, "version": 1}]
    return document


def test_a_plan_becomes_a_mission_that_the_preflight_check_takes(
    clearway: Clearway, tmp_path: Path
) -> None:
    source, output = written(tmp_path / "a.plan", plan(*ITEMS)), tmp_path / "mission.yaml"
    options = ("--target-half-width", "20", "--corridor-half-width", "9")
    ran = clearway("mission", "import", source, "-o", output, *options)
    assert (ran.code, ran.err) == (0, "")
    assert "2 legs" in ran.out
    assert "GPS_GLOBAL_ORIGIN" in ran.out
    mission = load_yaml(output, Mission)
    assert (mission.altitude_m, mission.start_ned_m) == (10.0, (0.0, 0.0))
    assert [leg.target_half_width_m for leg in mission.legs] == [20.0, 20.0]
    assert [leg.corridor_half_width_m for leg in mission.legs] == [9.0, 9.0]
    contract = CONFIG / "px4_contract.yaml"
    checked = clearway("preflight", "--contract", contract, "--mission", output)
    assert checked.code == 0, checked.out


def test_a_waypoint_list_is_the_same_mission_in_the_other_autopilots_frame(
    clearway: Clearway, tmp_path: Path
) -> None:
    source = tmp_path / "a.waypoints"
    source.write_text(LIST, encoding="utf-8")
    ends = {}
    for vehicle in ("px4", "ardupilot"):
        output = tmp_path / f"{vehicle}.yaml"
        ran = clearway("mission", "import", source, "-o", output, "--vehicle", vehicle)
        assert ran.code == 0, ran
        ends[vehicle] = load_yaml(output, Mission).legs[0].end_ned_m[0]
    assert ends["px4"] == pytest.approx(111.195, abs=2e-3)
    assert ends["ardupilot"] == pytest.approx(111.319, abs=2e-3)
    ran = clearway("mission", "import", source, "-o", tmp_path / "m.yaml")
    assert "note: taken for PX4" in ran.out


def test_the_mission_goes_to_standard_output_and_the_report_beside_it(
    clearway: Clearway, tmp_path: Path
) -> None:
    source = written(tmp_path / "a.plan", plan(*ITEMS))
    ran = clearway("mission", "import", source)
    assert ran.code == 0
    assert ran.out.startswith("# Imported by")
    assert "item 2  NAV_WAYPOINT" in ran.err
    assert "leg 1" in ran.err
    assert ran.err.splitlines()[-1].startswith("2 legs, ")


def test_what_cannot_be_flown_is_listed_and_nothing_is_written(
    clearway: Clearway, tmp_path: Path
) -> None:
    items = (*ITEMS[:2], simple(18, *north(1.0)), simple(82, *north(2.0)), simple(177))
    source, output = written(tmp_path / "a.plan", plan(*items)), tmp_path / "mission.yaml"
    ran = clearway("mission", "import", source, "-o", output)
    assert ran.code == 1
    assert not output.exists()
    refused = [line for line in ran.out.splitlines() if "REFUSED" in line]
    assert [line.split()[2] for line in refused] == [
        "NAV_LOITER_TURNS", "NAV_SPLINE_WAYPOINT", "DO_JUMP",
    ]  # fmt: skip
    assert "3 of 5 items cannot be flown; nothing was written" in ran.out


def test_a_mission_without_a_leg_is_refused(clearway: Clearway, tmp_path: Path) -> None:
    source = written(tmp_path / "a.plan", plan(simple(TAKE_OFF, *north(0.0))))
    ran = clearway("mission", "import", source, "-o", tmp_path / "m.yaml")
    assert ran.code == 1
    assert "no item is a leg" in ran.out
    assert not (tmp_path / "m.yaml").exists()


def test_another_home_counts_and_is_said(clearway: Clearway, tmp_path: Path) -> None:
    source, output = written(tmp_path / "a.plan", plan(*ITEMS[1:])), tmp_path / "mission.yaml"
    home = "47.398242,8.545594,488"
    ran = clearway("mission", "import", source, "-o", output, "--home", home)
    assert "home of the file is 56 m from --home" in ran.out
    first_m = load_yaml(output, Mission).legs[0].end_ned_m[0]
    assert first_m == pytest.approx(55.6, abs=0.1)


# ---------------------------------------------------------------------------- geofence


def test_the_geofence_becomes_a_file_that_the_preflight_check_keeps(
    clearway: Clearway, tmp_path: Path
) -> None:
    mission, fence = tmp_path / "mission.yaml", tmp_path / "geofence.yaml"
    contract = CONFIG / "px4_contract.yaml"
    codes = {}
    # The legs' corners lie 67.4 m from the circle's centre; avoidances need 13.5 m and more beside.
    for radius_m in (200.0, 70.0):
        source = written(tmp_path / "a.plan", fenced(radius_m))
        ran = clearway("mission", "import", source, "-o", mission, "--geofence", fence)
        assert ran.code == 0, ran
        assert load_yaml(fence, Geofence).areas[0].radius_m == radius_m
        arguments = ("--contract", contract, "--mission", mission, "--geofence", fence)
        checked = clearway("preflight", *arguments)
        codes[radius_m] = checked.code
    assert codes == {200.0: 0, 70.0: 1}
    assert "DO NOT FLY" in checked.out
    assert "area 1, inclusion circle" in checked.out.replace("\n", " ")


def test_legs_through_the_geofence_are_refused(clearway: Clearway, tmp_path: Path) -> None:
    source, output = written(tmp_path / "a.plan", fenced(50.0)), tmp_path / "mission.yaml"
    ran = clearway("mission", "import", source, "-o", output)
    assert ran.code == 1
    assert "the legs cross area 1 of the geofence, inclusion circle" in ran.out
    assert not output.exists()


def test_a_geofence_that_is_left_out_is_said(clearway: Clearway, tmp_path: Path) -> None:
    source = written(tmp_path / "a.plan", fenced(200.0))
    ran = clearway("mission", "import", source, "-o", tmp_path / "m.yaml")
    assert ran.code == 0
    assert "--geofence FILE writes it" in ran.out


@pytest.mark.parametrize(
    ("areas", "words"),
    [
        ([], "areas"),
        ([{"keep": "in", "center_ned_m": [0, 0], "radius_m": 5}], "keep"),
        ([{"keep": "inside"}], "expected corners_ned_m, or center_ned_m and radius_m"),
        ([{"keep": "inside", "center_ned_m": [0, 0]}], "expected corners_ned_m"),
        ([{"keep": "inside", "radius_m": 5.0, "corners_ned_m": [[0, 0]] * 3}], "expected corners"),
        ([{"keep": "inside", "corners_ned_m": [[0, 0], [1, 1]]}], "2 corners"),
        ([{"keep": "outside", "center_ned_m": [0, 0], "radius_m": 0}], "radius_m [m] = 0"),
        ([{"keep": "inside", "corners_ned_m": [[9, 9], [-9, -9], [9, -9], [-9, 9]]}], "cross each"),
    ],
)
def test_a_broken_geofence_file_is_one_line(
    clearway: Clearway, tmp_path: Path, areas: list[Any], words: str
) -> None:
    path = tmp_path / "geofence.yaml"
    path.write_text(f"areas: {areas}\n", encoding="utf-8")
    contract, mission = CONFIG / "px4_contract.yaml", CONFIG / "default_mission.yaml"
    ran = clearway("preflight", "--contract", contract, "--mission", mission, "--geofence", path)
    assert ran.code == 2, ran.out
    assert str(path) in ran.err
    assert words in ran.err
    assert ran.err.count("\n") == 1


# ---------------------------------------------------------------------------- whatever comes

JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-400, 400) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.sampled_from(KEYS), inner),
    max_leaves=12,
)
WORDS = st.sampled_from(["0", "3", "16", "-1", "nan", "1e400", "x", "47.4", "\u0661", "1_0"])


@given(st.dictionaries(st.sampled_from(KEYS), JSON, max_size=4), st.booleans())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_json_is_a_mission_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, change: dict[str, Any], into_item: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.plan"
    document = plan(*ITEMS)
    target = document["mission"]["items"][1] if into_item else document["mission"]
    target.update(change)
    path.write_text(json.dumps(document), encoding="utf-8")
    request = ImportRequest(path, output=path.with_suffix(".yaml"))
    with contextlib.suppress(FileError, CommandError), contextlib.redirect_stdout(io.StringIO()):
        if import_mission(request):
            assert load_yaml(path.with_suffix(".yaml"), Mission).legs


@given(st.lists(st.lists(WORDS, min_size=11, max_size=13), max_size=3))
@settings(max_examples=150, deadline=None)
def test_any_waypoint_list_is_a_mission_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.waypoints"
    path.write_text(LIST + "\n".join("\t".join(row) for row in rows), encoding="utf-8")
    request = ImportRequest(path, output=path.with_suffix(".yaml"))
    with contextlib.suppress(FileError, CommandError), contextlib.redirect_stdout(io.StringIO()):
        if import_mission(request):
            assert load_yaml(path.with_suffix(".yaml"), Mission).legs
