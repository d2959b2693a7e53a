"""The page of the results."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.benchmark.legs import LegRow, Manner
from gcs_tools.benchmark.page import write_section
from gcs_tools.benchmark.suites import BENCHMARKS, Benchmark
from gcs_tools.benchmark.summary import Run
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.benchmark.rows import row

SANDO, FOREST = BENCHMARKS["sando"], BENCHMARKS["forest"]
DEFAULT, SERVICE = Manner("default"), Manner("ardupilot", service=True)
DOCS = Path(__file__).parents[3] / "docs"


def run(
    rows: list[LegRow],
    benchmark: Benchmark = SANDO,
    manner: Manner = DEFAULT,
    command: str = "c",
    legs: int | None = None,
) -> Run:
    return Run(benchmark, manner, command, rows, len(rows) if legs is None else legs)


def test_a_run_replaces_its_own_section_only(tmp_path: Path) -> None:
    page = tmp_path / "benchmarks.md"
    write_section(page, run([row()], command="clearway benchmark sando"))
    write_section(page, run([row(field="500 stems/ha")], FOREST))
    write_section(page, run([row()], manner=SERVICE))
    before = page.read_text(encoding="utf-8")
    assert before.startswith("# Public benchmarks\n")
    assert before.count("\n## ") == 3
    write_section(page, run([row(), row()], command="sando --legs 2"))
    after = page.read_text(encoding="utf-8")
    assert "sando --legs 2\n" in after
    assert "| static_easy | 2 | 2 | 2 | 0 | 2 | ≥ 22.4% | ≤ 77.6% | 2.10 m/s | 2.50 m/s |" in after
    assert (
        before.partition("<!-- end sando default -->")[2]
        == (after.partition("<!-- end sando default -->")[2])
    )


def test_a_section_names_what_did_not_pass_and_peers(tmp_path: Path) -> None:
    page = tmp_path / "benchmarks.md"
    failed = [row(number=k, passed=False, why_not="no|way", losses=3) for k in range(22)]
    write_section(page, run(failed, manner=Manner("px4", unseen_is_free=True)))
    text = page.read_text(encoding="utf-8")
    assert "vehicle px4, unseen taken as free\n" in text
    assert "- static_easy, flight 0 (number 3): no|way\n" in text
    assert "- and 2 more\n" in text
    assert "| MIGHTY | 100 % without collision |" in text
    assert "0 of 66 unsafe" in text


def test_an_interrupted_run_says_so(tmp_path: Path) -> None:
    page = tmp_path / "benchmarks.md"
    write_section(page, run([row()], legs=9))
    assert "\nInterrupted after 1 of 9 legs.\n" in page.read_text(encoding="utf-8")
    write_section(page, run([row()]))
    assert "Interrupted" not in page.read_text(encoding="utf-8")


def test_a_page_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    page = tmp_path / "missing" / "benchmarks.md"
    with pytest.raises(CommandError, match="cannot be written"):
        write_section(page, run([row()]))


def test_the_page_of_the_repository_has_the_sections_that_runs_replace() -> None:
    text = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    for name in ("sando", "competition", "longleaf", "forest"):
        assert text.count(f"<!-- begin {name} default -->") == 1
        assert text.count(f"<!-- end {name} default -->") == 1
        assert f"\nclearway benchmark {name}" in text
