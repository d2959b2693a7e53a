"""The page of the results: Markdown, one section for each benchmark and manner of flying it.

A run replaces its own section of the page and leaves the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from gcs_tools.benchmark.legs import LegRow, Manner
from gcs_tools.benchmark.suites import Benchmark
from gcs_tools.benchmark.summary import HEADER, Run, peers_of, summarize, waits
from gcs_tools.campaign.statistics import CONFIDENCE
from gcs_tools.console.output import write_text
from onboard.files.yaml_file import read_text

_INTRODUCTION: Final = """\
# Public benchmarks

Every section is written by the command above its table, which also prints each leg; `-o` keeps
them as Parquet. The scenes' files are not part of the repository. *Passable*: a way is open on the
true map with all faces moved out by what the vehicle keeps from a reported face. *Clearance* is
from the vehicle's hull, *distance* from its centre. [dense_fields.md](dense_fields.md) says what
the vehicle of *the planner alone* has to endure, and how the whole service flies such fields.

A count without a collision bounds the rate, no more; the argument is that no plan is flown unless
it is certified in the space seen free. Legs through one map are not independent.
"""
_REASONS_SHOWN: Final = 20


def write_section(path: Path, run: Run) -> None:
    """Write this run's section of a page, which is made if there is none.

    Raises:
        FileError: the page cannot be read.
        CommandError: it cannot be written.
    """
    key = _key(run.benchmark, run.manner)
    page = read_text(path) if path.exists() else _INTRODUCTION
    begin, end = f"<!-- begin {key} -->", f"<!-- end {key} -->"
    text = "\n".join((begin, *_lines(run), end))
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if pattern.search(page):
        page = pattern.sub(lambda _: text, page, count=1)
    else:
        page = f"{page.rstrip()}\n\n{text}\n"
    write_text(page, path)


def _key(benchmark: Benchmark, manner: Manner) -> str:
    words = [benchmark.name, manner.vehicle]
    words += ["service"] if manner.service else []
    words += ["unseen-is-free"] if manner.unseen_is_free else []
    return " ".join(words)


def _lines(run: Run) -> Iterator[str]:
    benchmark, manner, rows = run.benchmark, run.manner, run.rows
    by = "the whole service" if manner.service else "the planner alone"
    control = ", unseen taken as free" if manner.unseen_is_free else ""
    yield f"## {benchmark.title}: {by}, vehicle {manner.vehicle}{control}"
    yield f"\n{benchmark.origin}.\n"
    yield f"```sh\n{run.command}\n```\n"
    yield f"A leg passes if {benchmark.rule.text}. Bounds at {CONFIDENCE:.0%} (Clopper-Pearson).\n"
    if run.interruption:
        yield f"{run.interruption}\n"
    yield from _table(HEADER, [each.cells() for each in summarize(rows)])
    losses = sum(row.losses for row in rows)
    if losses:
        unsafe = sum(row.losses_unsafe for row in rows)
        yield f"\nLoss of the setpoint stream, tried in every period: {unsafe} of {losses} unsafe."
    if waited := waits(benchmark, rows):
        yield f"\n{waited}"
    peers = peers_of(benchmark, rows)
    if peers:
        yield ""
        yield from _table(("system", "reported", "source"), peers)
    yield f"\n{benchmark.differences}"
    yield from _failures([row for row in rows if not row.passed])


def _failures(failed: Sequence[LegRow]) -> Iterator[str]:
    if not failed:
        return
    yield "\nDid not pass:\n"
    for row in failed[:_REASONS_SHOWN]:
        yield f"- {row.field}, {row.leg} (number {row.number}): {row.why_not}"
    if len(failed) > _REASONS_SHOWN:
        yield f"- and {len(failed) - _REASONS_SHOWN} more"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield _cells(header)
    yield _cells(["---"] * len(header))
    for row in rows:
        yield _cells(row)


def _cells(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
