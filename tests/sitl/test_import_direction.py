"""Imports in the simulator point inward; only `virtual` imports the daemon's flight code."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SITL = Path(__file__).parents[2] / "sitl"
# A room imports itself and the rooms before it.
ROOMS = (
    "sitl.plant",
    "sitl.environment",
    "sitl.config",
    "sitl.autopilot",
    "sitl.autopilot.flavours",
    "sitl.autopilot.protocol",
    "sitl.vehicle",
    "sitl.live",
    "sitl.virtual",
    "sitl.__main__",
)
SHARED = ("onboard.geometry", "onboard.files", "onboard.zenoh_session")


def room_of(module: str) -> str:
    """Return the innermost room that contains a module."""
    return max((room for room in ROOMS if within(module, room)), key=len)


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


PATHS = {
    ".".join(path.relative_to(SITL.parent).with_suffix("").parts): path
    for path in sorted(SITL.rglob("*.py"))
    if path.name != "__init__.py"
}


@pytest.mark.parametrize("module", PATHS)
def test_imports_point_inward(module: str) -> None:
    here = ROOMS.index(room_of(module))
    for name in imports(PATHS[module]):
        if within(name, "sitl"):
            assert ROOMS.index(room_of(name)) <= here, f"{module} imports {name}"
        if within(name, "onboard") and not within(module, "sitl.virtual"):
            assert any(within(name, shared) for shared in SHARED), f"{module} imports {name}"


def test_live_and_virtual_do_not_know_each_other() -> None:
    for module, path in PATHS.items():
        if within(module, "sitl.virtual"):
            assert not any(within(name, "sitl.live") for name in imports(path)), module


def test_every_room_has_modules() -> None:
    found = set(map(room_of, PATHS))
    assert found == set(ROOMS)


def test_no_room_has_more_than_sixteen_files() -> None:
    for room in {path.parent for path in PATHS.values()}:
        assert len(list(room.glob("*.py"))) <= 16, room.name


@pytest.mark.parametrize("module", PATHS)
def test_files_and_functions_stay_short(module: str) -> None:
    text = PATHS[module].read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 400, module
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 45, f"{module}.{node.name}"
