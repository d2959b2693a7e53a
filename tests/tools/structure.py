"""Measure the code's structure: ``python -m tests.tools.structure [--picture]``.

Prints rooms with their files, arrows between rooms, the longest files and functions, the modules on
a detection's way to a setpoint, and lines of tests per line of code.  ``--picture`` writes
docs/rooms_*.svg anew.  tests/test_structure.py holds the limits.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import grimp

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = ("onboard", "sitl", "gcs_tools")
PICTURES: Final = {package: ROOT / "docs" / f"rooms_{package}.svg" for package in PACKAGES}

ROOM_FILES_MAX: Final = 16
FILE_LINES_MAX: Final = 400
FUNCTION_LINES_MAX: Final = 45
WALK_MODULES_MAX: Final = 12
TESTS_PER_CODE_MIN: Final = 0.9


@dataclass(frozen=True, order=True)
class Length:
    """The length of a file or a function.

    Attributes:
        lines: from the first to the last, comments, docstrings and blank lines included.
        name: of the file, or of the function with its file.
    """

    lines: int
    name: str


def sources(*directories: str) -> Iterator[Path]:
    """Yield the Python files below directories of the repository, in order."""
    for directory in directories:
        yield from sorted((ROOT / directory).rglob("*.py"))


def line_count(*directories: str) -> int:
    """Count the lines of all Python files below directories of the repository."""
    return sum(_lines_of(path) for path in sources(*directories))


def _lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def _name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def rooms() -> dict[str, int]:
    """Return the number of Python files, ``__init__.py`` included, in each folder of the code."""
    return dict(Counter(_name_of(path.parent) for path in sources(*PACKAGES)))


def file_lengths() -> list[Length]:
    """Return the length of every file of the code, the longest first."""
    return sorted(
        (Length(_lines_of(path), _name_of(path)) for path in sources(*PACKAGES)), reverse=True
    )


def function_lengths() -> list[Length]:
    """Return the length of every function and method of the code, the longest first."""
    found = []
    for path in sources(*PACKAGES):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                found.append(Length(lines, f"{_name_of(path)}::{node.name}"))
    return sorted(found, reverse=True)


def room_of(module: str) -> str:
    """Return the folder of a module, with dots; a package is its own."""
    is_room = ROOT.joinpath(*module.split(".")).is_dir()
    return module if is_room else module.rpartition(".")[0] or module


def arrows() -> dict[tuple[str, str], int]:
    """Return how many imports lead from one room to another, for every pair that has any."""
    graph = grimp.build_graph(*PACKAGES)
    found: Counter[tuple[str, str]] = Counter()
    for importer in graph.modules:
        for imported in graph.find_modules_directly_imported_by(importer):
            arrow = (room_of(importer), room_of(imported))
            if arrow[0] != arrow[1]:
                found[arrow] += 1
    return dict(found)


def ratio_of_tests() -> float:
    """Return how many lines of tests there are for each line of code, examples not counted."""
    return line_count("tests") / line_count(*PACKAGES)


def main() -> None:
    """Print the measurements, or write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m tests.tools.structure")
    parser.add_argument(
        "--picture", action="store_true", help="write docs/rooms_*.svg and nothing else"
    )
    if parser.parse_args().picture:
        from tests.tools.rooms_picture import draw  # noqa: PLC0415  it imports this module

        for package, path in PICTURES.items():
            path.write_text(draw(package), encoding="utf-8")
        return
    found = rooms()
    print(f"rooms: {len(found)}; files in each (at most {ROOM_FILES_MAX})")
    for room, files in sorted(found.items()):
        print(f"  {files:4d}  {room}")
    pairs = arrows()
    print(f"arrows between rooms: {len(pairs)}, for {sum(pairs.values())} imports")
    for package in PACKAGES:
        inside = [pair for pair in pairs if all(room.split(".")[0] == package for room in pair)]
        print(f"  {len(inside):4d}  within {package}")
    _print_longest("files", file_lengths(), FILE_LINES_MAX)
    _print_longest("functions", function_lengths(), FUNCTION_LINES_MAX)
    _print_walk()
    print(f"lines of code: {line_count(*PACKAGES)}, of tests: {line_count('tests')}")
    ratio = ratio_of_tests()
    print(f"lines of tests per line of code: {ratio:.3f} (at least {TESTS_PER_CODE_MIN})")


def _print_longest(what: str, lengths: list[Length], limit: int) -> None:
    beyond = sum(each.lines > limit for each in lengths)
    print(f"longest {what}: {beyond} of {len(lengths)} beyond {limit} lines")
    for each in lengths[:10]:
        print(f"  {each.lines:4d}  {each.name}")


def _print_walk() -> None:
    from tests.tools.detection_walk import walk_of_a_detection  # noqa: PLC0415  it flies

    walk = walk_of_a_detection()
    print(f"modules that a detection visits: {len(walk.visited)} (at most {WALK_MODULES_MAX})")
    print(f"  {walk.lines} lines in {', '.join(walk.visited)}")
    for made, modules in walk.stations.items():
        print(f"  {made}: {', '.join(modules)}")
    print(f"modules that run at all in those ticks: {len(walk.executed)}")


if __name__ == "__main__":
    main()
