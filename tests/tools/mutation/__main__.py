"""Mutate what the guarantee rests on: ``python -m tests.tools.mutation [PART ...] [--jobs N]``.

Changes every arithmetic operator, comparison, float constant, sign, condition, and choice between
minimum and maximum in the files of a part, one at a time, and runs the unit tests that reach the
change, which must fail.  Prints the mutants that survive without a reason stated in
``survivors.yaml``, and the score of each part; exits with 1 if one is below 95 % or was not tried
to the end.  Not part of the continuous integration: it takes minutes.

With ``--share 0.3`` it tries a seeded sample of so many.  Every verdict is written as it comes
below ``build/mutation``; ``--resume`` tries only what is not noticed there, so that a first run may
be ``--quick``.  ``--page`` writes the results of all parts to ``docs/mutation.md``.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import pytest
import yaml

from tests.tools.mutation.mutants import Mutant, mutants_of
from tests.tools.mutation.page import PAGE, page
from tests.tools.mutation.records import Sample, Tally, records_of, samples, state
from tests.tools.mutation.trials import OPTIONS, ROOT, Trials, Verdict

SCORE_MIN: Final = 0.95
SURVIVORS: Final = ROOT / "tests" / "tools" / "mutation" / "survivors.yaml"


@dataclass(frozen=True)
class Part:
    """Files that are mutated together, and the tests that must notice."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


def _files(room: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{room}/{name}.py" for name in names)


def _tests(room: str, *names: str) -> tuple[str, ...]:
    return tuple(f"tests/{room}/test_{name}.py" for name in names)


_CONTRACT_TESTS: Final = _tests(
    "onboard/contract",
    *("agility", "clauses", "assessment", "derivation", "recentring", "region", "terms"),
    *("run_on", "stop_region"),
)
PARTS: Final = {
    "contract": Part(
        _files(
            "onboard/contract",
            *("agility", "arithmetic", "clauses", "assessment", "derivation", "terms"),
            *("recentring", "stop_region"),
        ),
        _CONTRACT_TESTS,
    ),
    "region": Part(
        _files("onboard/contract", "region"),
        _tests("onboard/contract", "region", "recentring", "assessment", "derivation"),
    ),
    "run-on": Part(
        _files("onboard/contract", "run_on"),
        _tests("onboard/contract", "run_on", "run_on_strips", "stop_region", "clauses"),
    ),
    "seen-free": Part(
        (
            *_files("onboard/perception", "cells", "seen_free", "line_of_sight"),
            *_files("onboard/geometry", "free_grid"),
            *_files(
                "onboard/monitoring/seen",
                *("looks_around", "operators_word", "scan_limits", "seen_space", "sight_queue"),
            ),
        ),
        (
            *_tests("onboard/perception", "seen_free", "line_of_sight", "honest_sensors"),
            *_tests("onboard/monitoring", "seen_space", "operators_word", "looks_around"),
            *_tests("onboard/monitoring", "sight_queue"),
            *_tests("onboard/geometry", "free_grid"),
        ),
    ),
    "certifier": Part(
        (
            *_files("onboard/planning", "certifier", "rest_certifier"),
            *_files("onboard/guidance/dense", "tails", "way_to_rest", "limits"),
        ),
        (
            *_tests("onboard/planning", "certifier", "certifier_by_hand", "rest_certifier"),
            *_tests("onboard/planning", "moving_keep_outs"),
            *_tests("onboard/guidance/dense", "limits", "tails", "way_to_rest"),
        ),
    ),
}


def stated_reasons() -> dict[tuple[str, str, str], str]:
    """Return why some mutants cannot be noticed, by file, function and change."""
    stated = yaml.safe_load(SURVIVORS.read_text(encoding="utf-8")) or []
    return {(each["file"], each["function"], each["change"]): each["reason"] for each in stated}


def drawn(part: Part, share: float, seed: int) -> list[Mutant]:
    """Return the mutants of a part, or a sample of them in the order of the files."""
    found = [m for path in part.files for m in mutants_of(path, (ROOT / path).read_text("utf-8"))]
    chosen = random.Random(seed).sample(range(len(found)), round(share * len(found)))
    return [found[number] for number in sorted(chosen)]


def run(name: str, options: argparse.Namespace) -> None:
    """Try the mutants of a part; their verdicts are in its records."""
    part = PARTS[name]
    records, reasons = records_of(name), stated_reasons()
    mutants = drawn(part, options.share, options.seed)
    if options.file:
        mutants = [mutant for mutant in mutants if options.file in mutant.path]
    if options.resume:
        done = {
            record.identity for record in records.of(mutants) if record.verdict is Verdict.NOTICED
        }
        mutants = [mutant for mutant in mutants if mutant.identity not in done]

    def judged(mutant: Mutant, verdict: Verdict, tests: int) -> None:
        records.add(mutant, verdict, tests)
        if verdict is not Verdict.NOTICED and mutant.key not in reasons:
            which = f"in {mutant.function}" if mutant.function else "at import"
            print(f"{verdict} {tests} tests: {mutant} ({which})", file=sys.stderr, flush=True)

    if mutants:
        limits = options.jobs, options.budget, options.slowest
        trials = Trials(part.files, mutants, *limits, judged)
        drawing = ("-m", "not hypothesis") if options.quick else ()
        code = pytest.main([*OPTIONS, *drawing, *part.tests], plugins=[trials])
        if code == pytest.ExitCode.INTERRUPTED:
            print(f"{name}: interrupted", file=sys.stderr)
        elif code != pytest.ExitCode.OK:
            sys.exit(f"{name}: pytest ended with {code}")


def tallies(sample: Sample) -> dict[str, Tally]:
    """Return by file what is known of the mutants of a sample."""
    part, reasons = PARTS[sample.part], stated_reasons()
    mutants = drawn(part, sample.share, sample.seed)
    records = records_of(sample.part)
    by_file = {path: [mutant for mutant in mutants if mutant.path == path] for path in part.files}
    return {
        path: Tally.of(len(found), records.of(found), reasons) for path, found in by_file.items()
    }


def write_page() -> None:
    """Write the page of what was tried of all parts."""
    tried = {sample: tallies(sample) for sample in samples()}
    (ROOT / PAGE).write_text(page(tried, stated_reasons()), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--file", help="only files whose path contains this")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of the mutants; default: all")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument(
        *("--budget",), type=float, default=10.0, metavar="S", help="processor time of one mutant"
    )
    parser.add_argument(
        *("--slowest",), type=float, default=0.5, metavar="S", help="leave out slower tests"
    )
    parser.add_argument("--quick", action="store_true", help="without the tests of Hypothesis")
    parser.add_argument("--resume", action="store_true", help="try only what is not noticed yet")
    parser.add_argument("--page", action="store_true", help=f"write {PAGE}, of what was tried")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.parts if name not in PARTS]:
        parser.error(f"unknown part '{unknown[0]}': one of {', '.join(PARTS)}")
    enough = True
    for name in options.parts or ([] if options.page else PARTS):
        sample = Sample(name, options.share, options.seed)
        state(sample)
        run(name, options)
        total = Tally.together(tallies(sample).values())
        enough &= total.score >= SCORE_MIN and total.tried == total.drawn
        print(f"{name}: {total}", flush=True)
    if options.page:
        write_page()
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
