"""Every test that ``docs/conformance.md`` names exists, and every test here is named there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tests.sitl.conformance.pages import table_of

HERE = Path(__file__).parent
TABLES = ("MAVLink support", "Flights of PX4's own tests", "More flights")
NAMED = re.compile(r"`(?P<file>[\w./]+)::(?P<test>\w+)(\[(?P<case>[^\]]+)\])?`")
# What holds the page itself together is not a check of MAVLink.
OF_THE_PAGE = {"test_pages.py", "test_commands.py::test_the_page_lists_the_supported_commands"}


def functions(path: Path) -> dict[str, str]:
    """Return the source of each test of a file, decorators included, by its name."""
    text = path.read_text(encoding="utf-8")
    return {
        node.name: "".join(ast.get_source_segment(text, part) or "" for part in node.decorator_list)
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


@pytest.mark.parametrize("heading", TABLES)
def test_every_row_names_a_test_that_exists(heading: str) -> None:
    for row in table_of(heading):
        found = NAMED.fullmatch(row[1])
        assert found, row
        tests = functions((HERE / found["file"]).resolve())
        assert found["test"] in tests, row
        case = found["case"]
        assert case is None or f'"{case}"' in tests[found["test"]], row


def test_the_eighteen_tests_of_px4_are_there() -> None:
    rows = table_of("Flights of PX4's own tests")
    assert len({row[0] for row in rows}) == len({row[1] for row in rows}) == 18


def test_every_test_of_this_folder_is_on_the_page() -> None:
    named = {
        f"{found['file']}::{found['test']}"
        for heading in TABLES
        for row in table_of(heading)
        if (found := NAMED.fullmatch(row[1]))
    }
    here = {
        f"{path.name}::{name}"
        for path in sorted(HERE.glob("test_*.py"))
        for name in functions(path)
        if not {path.name, f"{path.name}::{name}"} & OF_THE_PAGE
    }
    assert here - named == set()
