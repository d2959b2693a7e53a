"""The page of the mutants that were tried: a table of the files, and what survives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from tests.tools.mutation.records import Key, Sample, Tally

PAGE: Final = "docs/mutation.md"
_HEAD: Final = """# Mutants

How well do the unit tests check the code that the guarantee rests on? The command below changes
one operator, comparison, constant, sign, condition, or choice between minimum and maximum at a
time, and runs the unit tests that reach the change. A test must fail. The score is the share
noticed of the mutants that can be; the aim is 95 %. A mutant that no test can notice counts as
equivalent: its reason stands in `tests/tools/mutation/survivors.yaml` and below.

A mutant that hangs counts as noticed when its tests use eight times the processor time that they
use without it. Tests that take more than half a second are left out, whole flights among them: a
mutant that survives here may still be noticed by a flight.

`python -m tests.tools.mutation --page` writes this page from the verdicts below `build/mutation`.
"""


def page(tried: Mapping[Sample, Mapping[str, Tally]], reasons: Mapping[Key, str]) -> str:
    """Return the page.

    Args:
        tried: by sample, by file, what became of its mutants.
        reasons: why a mutant cannot be noticed.
    """
    return "\n".join((_HEAD, *_table(tried), *_survivors(tried), *_equivalents(tried, reasons)))


def _table(tried: Mapping[Sample, Mapping[str, Tally]]) -> Iterator[str]:
    yield "| Module | Drawn | Run | Noticed | Equivalent | Survive | Score |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"
    for sample, files in tried.items():
        for path, tally in files.items():
            if tally.drawn:
                yield _row(f"`{path}`", tally)
        total = Tally.together(files.values())
        yield _row(f"**{sample.part}**", total)
    yield ""
    yield "The mutants were drawn by"
    yield ""
    yield "```sh"
    yield from (str(sample) for sample in tried)
    yield "```"
    yield ""


def _row(name: str, tally: Tally) -> str:
    counts = tally.drawn, tally.tried, tally.noticed, tally.explained, len(tally.survivors)
    score = f"{100.0 * tally.score:.1f} %" if tally.tried else "not run"
    return f"| {name} | {' | '.join(map(str, counts))} | {score} |"


def _survivors(tried: Mapping[Sample, Mapping[str, Tally]]) -> Iterator[str]:
    total = Tally.together(tally for files in tried.values() for tally in files.values())
    if not total.survivors:
        return
    yield "## What survives"
    yield ""
    yield "| Where | Function | Change | Tests that reach it |"
    yield "| --- | --- | --- | ---: |"
    for record in total.survivors:
        where, change = f"`{record.path}:{record.line}`", _quoted(record.change)
        yield f"| {where} | `{record.function or 'at import'}` | {change} | {record.tests} |"
    yield ""


def _equivalents(
    tried: Mapping[Sample, Mapping[str, Tally]], reasons: Mapping[Key, str]
) -> Iterator[str]:
    paths = {path for files in tried.values() for path in files}
    yield "## What no test can notice"
    yield ""
    yield "| File | Function | Change | Why |"
    yield "| --- | --- | --- | --- |"
    for (path, function, change), reason in reasons.items():
        if path in paths:
            yield f"| `{path}` | `{function}` | {_quoted(change)} | {_cell(reason)} |"
    yield ""


def _quoted(change: str) -> str:
    return f"`{_cell(change)}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
