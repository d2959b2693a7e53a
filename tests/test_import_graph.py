"""The house rules of the packages, read from their imports: dependencies point inward."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("onboard", "sitl", "gcs_tools")

# Pure geometry: these may know one another, in this order, and nobody else.
INNERMOST = ("onboard.geometry.frames", "onboard.geometry.box")

# What touches sockets, threads, event loops and clocks, and the modules that may.
IO_LIBRARIES = {"asyncio", "mavsdk", "select", "serial", "socket", "threading", "time", "zenoh"}
IO_MODULES = {
    "onboard.__main__",
    "onboard.daemon",
    "onboard.mavlink.connections",
    "onboard.timing",
    "onboard.recording.writer_thread",
    "onboard.message_thread",
    "onboard.mavlink.serial_line",
    "onboard.zenoh_session",
    "sitl.__main__",
    "sitl.live.service",
    "sitl.virtual.simulation",  # a stopwatch: how long the simulation took
    "sitl.live.transport",
}


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(source: str) -> set[str]:
    """Every absolute dotted name that a module imports, wherever in the file it does so."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=aliases):
                names.update(alias.name for alias in aliases)
            case ast.ImportFrom(module=str(module), names=aliases, level=0):
                names.add(module)
                names.update(f"{module}.{alias.name}" for alias in aliases)
            case ast.ImportFrom():
                raise AssertionError("relative import: write the full name")
            case _:
                pass
    return names


def sources() -> dict[str, str]:
    return {
        module_name(path): path.read_text(encoding="utf-8")
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    }


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def violations(modules: dict[str, str]) -> Iterator[str]:
    """Yield one sentence per broken rule."""
    for module, source in modules.items():
        for name in sorted(imported(source)):
            if (rule := broken_rule(module, name)) is not None:
                yield f"{module} imports {name}: {rule}"


def broken_rule(module: str, name: str) -> str | None:
    if within(module, "onboard") and (within(name, "sitl") or within(name, "gcs_tools")):
        return "the daemon knows neither the simulation nor the operator's tools"
    if within(module, "sitl"):
        if within(name, "gcs_tools"):
            return "the simulation does not know the operator's tools"
        if within(name, "onboard") and not may_import_onboard(module, name):
            return "only sitl.virtual.simulation may, so that no sign error is shared"
    if module in INNERMOST and within(name, "onboard"):
        earlier = INNERMOST[: INNERMOST.index(module)]
        if not any(within(name, inner) for inner in earlier) and name != "onboard":
            return "geometry knows only the geometry before it"
    if not within(module, "gcs_tools") and module not in IO_MODULES:
        library = name.partition(".")[0]
        if library in IO_LIBRARIES:
            return "only entry points touch sockets, threads and clocks"
    return None


# Files, bytes and distances: nothing in them has a sign that both sides could get wrong alike.
SHARED = ("onboard.files", "onboard.geometry", "onboard.zenoh_session")


def may_import_onboard(module: str, name: str) -> bool:
    shared = any(within(name, one) for one in SHARED)
    return module == "sitl.virtual.simulation" or name == "onboard" or shared


def test_dependencies_point_inward() -> None:
    assert list(violations(sources())) == []


def test_no_import_cycles() -> None:
    modules = sources()
    TopologicalSorter(
        {module: imported(source) & modules.keys() - {module} for module, source in modules.items()}
    ).prepare()


def test_every_package_is_read() -> None:
    found = sources()
    for package in PACKAGES:
        assert sum(within(module, package) for module in found) > 1
    assert IO_MODULES | set(INNERMOST) <= set(found)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("onboard.planning.planner", "from sitl.environment.world import World"),
        ("onboard.planning.planner", "def f():\n    import gcs_tools.logs.result"),
        ("sitl.plant.controller", "from onboard.contract.agility import GRAVITY_MPS2"),
        ("sitl.plant.controller", "from onboard import agility"),
        ("sitl.environment.world", "import gcs_tools"),
        ("onboard.geometry.frames", "from onboard.contract.region import Box"),
        ("onboard.geometry.box", "from onboard.contract.assessment import assess"),
        ("onboard.autonomy", "import time"),
        ("onboard.guidance.phases", "import asyncio"),
        ("sitl.vehicle.autopilot", "from socket import socket"),
        ("onboard.perception.obstacle_map", "import zenoh.ext"),
    ],
)
def test_the_rules_catch(module: str, source: str) -> None:
    assert list(violations({module: source}))


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("sitl.virtual.simulation", "from onboard.autonomy import Autonomy"),
        ("sitl.config", "from onboard.files.yaml_file import FileModel"),
        ("sitl.virtual.scripted_operator", "from onboard.files.mavlink_frames import FrameReader"),
        ("onboard.geometry.box", "from onboard.geometry.frames import Q"),
        ("sitl.environment.world", "from onboard.files.obstacle_field import ObstacleField"),
        ("onboard.daemon", "import asyncio, time, zenoh"),
        ("gcs_tools.fly.command", "import asyncio\nfrom onboard.files.models import Contract"),
    ],
)
def test_the_rules_allow(module: str, source: str) -> None:
    assert list(violations({module: source})) == []
