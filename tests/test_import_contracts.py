"""Contracts of import-linter (pyproject.toml): the code keeps each, and each reports a violation.

One copy of the packages gets every forbidden import at once; each has to be reported.
"""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("onboard", "sitl", "gcs_tools")
LINT = Path(sys.executable).with_name("lint-imports")

# Importing module, what it must not import, and the contract that says so.
FORBIDDEN = [
    ("onboard.planning.planner", "sitl.environment.world", "packages"),
    ("onboard.geometry.box", "gcs_tools.scenario", "packages"),
    ("sitl.environment.world", "gcs_tools.scenario", "packages"),
    ("onboard.geometry.frames", "onboard.contract.region", "onboard-rooms"),
    ("onboard.motion.polynomial", "onboard.contract.agility", "onboard-rooms"),
    ("onboard.planning.plan", "onboard.perception.pose_history", "onboard-rooms"),
    ("onboard.perception.full_view", "onboard.monitoring.assumptions", "onboard-rooms"),
    ("onboard.monitoring.detections", "onboard.guidance.phases", "onboard-rooms"),
    ("onboard.guidance.phases", "onboard.autonomy", "onboard-rooms"),
    ("onboard.autonomy", "onboard.recording.messages", "onboard-rooms"),
    ("onboard.recording.messages", "onboard.daemon", "onboard-rooms"),
    ("sitl.plant.wind", "sitl.environment.world", "sitl-rooms"),
    ("sitl.vehicle.scene", "sitl.virtual.standstill", "sitl-rooms"),
    ("gcs_tools.console.progress", "gcs_tools.logs.flight_log", "gcs-tools-rooms"),
    ("gcs_tools.preflight.finding", "gcs_tools.fly.picture", "gcs-tools-rooms"),
    ("sitl.plant.controller", "onboard.contract.agility", "independent-simulator"),
    ("sitl.live.service", "onboard.motion.trajectory", "independent-simulator"),
    ("onboard.autonomy", "time", "io"),
    ("onboard.guidance.phases", "asyncio", "io"),
    ("onboard.daemon", "mavsdk", "io"),
    ("sitl.vehicle.autopilot", "socket", "io"),
    ("onboard.perception.obstacle_map", "zenoh", "io"),
]
# Closes a cycle between two modules of one room.
CYCLE = ("onboard.contract.agility", "onboard.contract.assessment")


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("imports")
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, directory / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    shutil.copy(ROOT / "pyproject.toml", directory)
    return directory


def lint(directory: Path) -> dict[str, str]:
    """Return what is reported, by the name of the broken contract."""
    done = subprocess.run(
        [LINT, "--no-logo"],  # its cache is in the copy
        cwd=directory,
        env={"COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in {0, 1}, done.stderr
    _, _, broken = done.stdout.partition("Broken contracts")
    parts = re.split(r"^(.+)\n-{3,}\n", broken, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def contract_names() -> dict[str, str]:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    return {contract["id"]: contract["name"] for contract in contracts}


@pytest.fixture(scope="module")
def reported(copied: Path) -> dict[str, str]:
    for importer, imported, _ in FORBIDDEN:
        path = copied.joinpath(*importer.split(".")).with_suffix(".py")
        path.write_text(f"{path.read_text(encoding='utf-8')}\nimport {imported}\n")
    names = contract_names()
    by_name = lint(copied)
    return {key: by_name.get(name, "") for key, name in names.items()}


@pytest.mark.parametrize(("importer", "imported", "contract"), FORBIDDEN)
def test_a_forbidden_import_is_reported(
    reported: dict[str, str], importer: str, imported: str, contract: str
) -> None:
    assert f"{importer} -> {imported} " in reported[contract]


def test_every_contract_is_tried() -> None:
    assert {contract for *_, contract in FORBIDDEN} | {"acyclic"} == contract_names().keys()


def test_what_a_cycle_is_made_of_is_reported(copied: Path) -> None:
    """A layers contract does not look into a room; this one does."""
    path = copied.joinpath(*CYCLE[0].split(".")).with_suffix(".py")
    path.write_text(f"{path.read_text(encoding='utf-8')}\nimport {CYCLE[1]}\n")
    broken = lint(copied)[contract_names()["acyclic"]]
    assert "No cycles are allowed in onboard.contract." in broken


def test_a_room_without_a_layer_is_reported(copied: Path) -> None:
    (copied / "onboard" / "another_room").mkdir()
    (copied / "onboard" / "another_room" / "__init__.py").touch()
    done = subprocess.run(
        [LINT, "--no-logo", "--contract", "onboard-rooms"],
        cwd=copied,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "another_room" in done.stdout + done.stderr


def test_the_code_keeps_every_contract() -> None:
    done = subprocess.run(
        [LINT, "--no-logo", "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_are_absolute(package: str) -> None:
    """A reader finds a module by its full name; so does a search."""
    for path in sorted((ROOT / package).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        assert re.search(r"^\s*from \.", source, re.MULTILINE) is None, path
