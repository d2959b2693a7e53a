"""Every command answers bad input with one clear line and exit code 2."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.gcs_tools.running import CONFIG, Clearway, Ran


def assert_refused(ran: Ran, *words: str) -> None:
    assert ran.code == 2, ran
    assert ran.err.startswith("clearway: error: "), ran.err
    assert ran.err.count("\n") == 1, ran.err
    for word in words:
        assert word in ran.err, ran.err


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("vehicle.colour=red", ("vehicle.colour", "not a known key")),
        ("vehicle.cruise_speed_mps=2.8 m/s", ("cruise_speed_mps [m/s]", "'2.8 m/s'")),
        ("vehicle.cruise_speed_mps=.nan", ("cruise_speed_mps [m/s]", "nan")),
        ("vehicle.cruise_speed_mps=-1", ("cruise_speed_mps [m/s] = -1", "greater than 0")),
        ("environment.obstacle_size_max_m=-4", ("obstacle_size_max_m [m] = -4",)),
        ("environment.obstacle_size_min_m=9", ("obstacle_size_min_m", "exceeds")),
        ("vehicle.roll_max_deg=95", ("roll_max_deg [°] = 95", "less than 90")),
        ("vehicle.thrust_to_weight=0.9", ("thrust_to_weight",)),
        ("sensor.detection_range_m=true", ("detection_range_m [m] = True",)),
        ("sensor=12", ("sensor",)),
        ("vehicle", ("dotted.key=value",)),
        ("sensor.detection_range_m=[", ("not a value",)),
    ],
)
@pytest.mark.parametrize("command", [("contract", "show"), ("preflight",)])
def test_bad_terms(
    clearway: Clearway, config: Path, command: tuple[str, ...], override: str, words: tuple[str]
) -> None:
    contract = config / "default_contract.yaml"
    assert_refused(clearway(*command, "--contract", contract, "--set", override), *words)


@pytest.mark.parametrize(
    "arguments",
    [
        ("contract", "show", "--contract", "nowhere.yaml"),
        ("preflight", "--contract", "nowhere.yaml"),
        ("preflight", "--contract", CONFIG / "default_contract.yaml", "--field", "nowhere.yaml"),
        ("preflight", "--contract", CONFIG / "default_contract.yaml", "--mission", "nowhere.yaml"),
        ("fly", "nowhere.yaml"),
        ("fly", "nowhere.yaml", "--virtual"),
    ],
)
def test_missing_file(clearway: Clearway, arguments: tuple[object, ...]) -> None:
    assert_refused(clearway(*arguments), "nowhere.yaml", "No such file")


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("levitate",),
        ("contract",),
        ("contract", "show"),
        ("contract", "show", "--contract", "x", "--format", "xml"),
        ("preflight", "--contract", "x", "--format", "csv"),
        ("preflight", "--contract", "x", "--zenoh-config", "x"),
        ("fly", "--seed", "-1"),
        ("fly", "--seed", "one"),
        ("schema",),
    ],
)
def test_bad_arguments(clearway: Clearway, arguments: tuple[str, ...]) -> None:
    assert_refused(clearway(*arguments))


def test_not_yaml_at_all(clearway: Clearway, written: Callable[[str, Any], Path]) -> None:
    path = written("contract.yaml", "vehicle: [unclosed")
    assert_refused(clearway("contract", "show", "--contract", path), str(path), "not valid YAML")
    path = written("list.yaml", "- 1\n- 2\n")
    assert_refused(clearway("contract", "show", "--contract", path), "expected keys and values")
    path.write_bytes(b"\xff\xfe\x00")
    assert_refused(clearway("contract", "show", "--contract", path), "not UTF-8")


def test_missing_and_repeated_keys(clearway: Clearway, config: Path, tmp_path: Path) -> None:
    text = (config / "default_contract.yaml").read_text(encoding="utf-8")
    path = tmp_path / "contract.yaml"
    path.write_text(text.replace("  radius_m: 0.30\n", ""), encoding="utf-8")
    assert_refused(clearway("contract", "show", "--contract", path), "radius_m [m] is missing")
    path.write_text(text.replace("  radius_m: 0.30\n", "  radius_m: 0.30\n" * 2), encoding="utf-8")
    assert_refused(clearway("contract", "show", "--contract", path), "'radius_m' is given twice")


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ([{"id": "1", "center_ned_m": [1.0, 2.0], "size_m": [-1.0, 1.0]}], ("size_m", "[m] = -1")),
        ([{"id": "1", "center_ned_m": [1.0], "size_m": [1.0, 1.0]}], ("center_ned_m",)),
        ([{"id": "1", "center_ned_m": [float("nan"), 0.0], "size_m": [1.0, 1.0]}], ("nan",)),
        ([{"id": "1", "centre_m": [0.0, 0.0], "size_m": [1.0, 1.0]}], ("centre_m",)),
        ([{"id": "1", "center_ned_m": [0.0, 0.0], "size_m": [1.0, 1.0]}] * 2, ("two obstacles",)),
        ([], ("at least one obstacle",)),
    ],
)
def test_bad_field(
    clearway: Clearway,
    config: Path,
    written: Callable[[str, Any], Path],
    field: Any,
    words: tuple[str, ...],
) -> None:
    path = written("field.yaml", field)
    contract = config / "default_contract.yaml"
    ran = clearway("preflight", "--contract", contract, "--field", path)
    assert_refused(ran, str(path), *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"contract": "nowhere.yaml"}, ("nowhere.yaml", "No such file")),
        ({"forse": True}, ("forse", "not a known key")),
        ({"expect": {"outcome": "landed"}}, ("outcome", "'landed'")),
        ({"sitl": {"multirotor": {"mass_kg": 0.0}}}, ("mass_kg [kg] = 0.0",)),
        ({"faults": [{"kind": "quiet"}]}, ("faults.0.kind", "'quiet'", "expected one of")),
        ({"sitl": {"start": {"position_ned_m": [5.0, 0.0, 0.0]}}}, ("start_ned_m",)),
        ({"mission": {"altitude_m": 4.0, "legs": []}}, ("legs",)),
    ],
)
def test_bad_scenario(
    clearway: Clearway,
    config: Path,
    written: Callable[[str, Any], Path],
    change: dict[str, Any],
    words: tuple[str, ...],
) -> None:
    scenario = yaml.safe_load((config / "paper.yaml").read_text(encoding="utf-8"))
    for key in ("contract", "field", "mission"):
        scenario[key] = str(config / scenario[key])
    path = written("scenario.yaml", {**scenario, **change})
    assert_refused(clearway("fly", path, "--virtual"), *words)


def test_unwritable_output(clearway: Clearway, config: Path, tmp_path: Path) -> None:
    contract = config / "default_contract.yaml"
    nowhere = tmp_path / "nowhere" / "contract.json"
    ran = clearway("contract", "show", "--contract", contract, "--format", "json", "-o", nowhere)
    assert_refused(ran, "cannot be written")
    occupied = tmp_path / "occupied"
    occupied.touch()
    assert_refused(clearway("schema", "-o", occupied), "cannot be written")
    assert_refused(clearway("fly", "--virtual", "--out", occupied), "cannot be written")


def test_vehicle_port_in_use(clearway: Clearway, config: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{taken.getsockname()[1]}"
        contract = config / "default_contract.yaml"
        ran = clearway("preflight", "--contract", contract, "--vehicle", url)
    assert_refused(ran, url, "cannot be opened")
