"""Saved parameters of the real autopilots, in the forms of three ground stations."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from gcs_tools.preflight.offline.parameter_file import check_parameter_file, read_parameters
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.yaml_file import FileError
from tests.gcs_tools.running import CONFIG, Clearway

RECORDED = Path(__file__).parents[1] / "live" / "recorded_parameters"
# What docs/vehicles.md asks for and the recorded flights went without.
DOCUMENTED = {
    "px4": {
        "COM_OBL_RC_ACT": "5",
        "COM_RCL_EXCEPT": "4",
        "COM_LOW_BAT_ACT": "2",
        "COM_FLTT_LOW_ACT": "1",
    },
    "ardupilot": {"BATT_MONITOR": "0", "FS_DR_ENABLE": "1"},
}
TIMEOUT_S = {"px4": 1.0, "ardupilot": 0.5}


def recorded(flavour: str, **changes: str) -> dict[str, str]:
    with (RECORDED / f"{flavour}.csv").open(encoding="utf-8", newline="") as file:
        values = {row["name"]: row["value"] for row in csv.DictReader(file)}
    return values | DOCUMENTED[flavour] | changes


def qgroundcontrol(values: dict[str, str], stack: str = "PX4 Pro", version: str = "1.16.0") -> str:
    head = f"# Onboard parameters for Vehicle 1\n#\n# Stack: {stack}\n# Version: {version} dev\n#\n"
    return head + "".join(f"1\t1\t{name}\t{value}\t9\n" for name, value in values.items())


def mission_planner(values: dict[str, str]) -> str:
    return "#NOTE: saved\r\n" + "".join(f"{name},{value}\r\n" for name, value in values.items())


def mavproxy(values: dict[str, str]) -> str:
    return "".join(f"{name:<17}{value}  # of today\n" for name, value in values.items())


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "saved.params"


@pytest.mark.parametrize("form", [qgroundcontrol, mission_planner, mavproxy])
def test_every_form_states_the_same(path: Path, form: object) -> None:
    values = recorded("px4")
    path.write_text(form(values), encoding="utf-8")  # type: ignore[operator]
    found = read_parameters(path)
    assert found.values == {name: float(value) for name, value in values.items()}
    assert found.autopilot == "px4"
    assert found.version == ((1, 16, 0) if form is qgroundcontrol else None)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_the_parameters_that_the_contract_was_measured_with_fit_it(
    path: Path, flavour: str
) -> None:
    timeout = (f"vehicle.setpoint_loss_timeout_s={TIMEOUT_S[flavour]}",)
    contract = load_contract(CONFIG / f"{flavour}_contract.yaml", timeout)
    path.write_text(mavproxy(recorded(flavour)), encoding="utf-8")
    identity, *findings = check_parameter_file(path, assess(contract), None)
    assert "parameters of saved.params" in identity.text
    assert len(findings) > 5
    assert [each for each in findings if not each.holds] == []


@pytest.mark.parametrize(
    ("changes", "left_out", "code", "words"),
    [
        ({}, None, 0, "PROGRESS GUARANTEED"),
        ({"MPC_TILTMAX_AIR": "12"}, None, 1, "MPC_TILTMAX_AIR: broken: MPC_TILTMAX_AIR = 12"),
        ({}, "MPC_TILTMAX_AIR", 2, "MPC_TILTMAX_AIR not reported"),
    ],
)
def test_the_preflight_check_judges_by_the_file(
    clearway: Clearway,
    path: Path,
    changes: dict[str, str],
    left_out: str | None,
    code: int,
    words: str,
) -> None:
    values = recorded("px4", COM_OF_LOSS_T="0.3", **changes)
    values.pop(left_out or "", None)
    path.write_text(qgroundcontrol(values), encoding="utf-8")
    contract = CONFIG / "px4_contract.yaml"
    ran = clearway("preflight", "--contract", contract, "--parameters", path)
    assert ran.code == code, ran.out
    assert words in ran.out.replace("\n", " ")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "0 parameters of neither PX4"),
        ("MPC_XY_P,1.5\nATC_ANG_MAX 30\n", "of neither PX4 (MPC_...) nor ArduPilot"),
        ("WPNAV_ACCEL,600\n", "save all parameters"),
        ("MPC_XY_P,fast\n", "line 1: MPC_XY_P = 'fast' is not a finite number"),
        ("# x\nMPC_XY_P nan\n", "line 2: MPC_XY_P = 'nan'"),
        ("MPC_XY_P\n", "line 1: has 1 fields"),
        ("1 1 MPC_XY_P 1.5\n", "line 1: has 4 fields"),
        ("mass_kg: 1.5\n", "line 1: 'mass_kg:' is not the name of a parameter"),
    ],
)
def test_what_is_no_file_of_parameters(path: Path, text: str, words: str) -> None:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as caught:
        read_parameters(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


def test_a_vehicle_that_is_asked_needs_no_file(clearway: Clearway, path: Path) -> None:
    contract = CONFIG / "px4_contract.yaml"
    options = ("--parameters", path, "--vehicle", "udpin://127.0.0.1:1")
    ran = clearway("preflight", "--contract", contract, *options)
    assert ran.code == 2
    assert "leave out --vehicle" in ran.err
