"""Mutate what the guarantee rests on: ``python -m tests.tools.mutation [PART ...] [--jobs N]``.

Changes every arithmetic operator, comparison, float constant, sign, condition, and choice between
minimum and maximum in the files of a part, one at a time, and runs the unit tests that reach the
change, which must fail.  Prints the mutants that survive without a reason stated in
``survivors.yaml``, and the score of each part; exits with 1 if one is below 95 %.  Not part of the
continuous integration: it takes minutes.

With ``--share 0.3`` it tries a seeded sample of so many.  Writes nothing into the repository.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import pytest
import yaml

from tests.tools.mutation.mutants import Mutant, mutants_of
from tests.tools.mutation.trials import OPTIONS, ROOT, Trials

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
            *_files("onboard/perception", "seen_free", "line_of_sight"),
            *_files("onboard/geometry", "free_grid"),
            *_files(
                "onboard/monitoring/seen",
                *("looks_around", "operators_word", "scan_limits", "seen_space", "sight_queue"),
            ),
        ),
        (
            *_tests("onboard/perception", "seen_free", "line_of_sight", "honest_sensors"),
            *_tests("onboard/monitoring", "seen_space", "operators_word"),
            *_tests("onboard/geometry", "free_grid", "rest"),
            *_tests("onboard/planning", "rest_certifier"),
        ),
    ),
    "certifier": Part(
        (
            *_files("onboard/planning", "certifier", "rest_certifier"),
            *_files("onboard/guidance/dense", "tails", "way_to_rest", "limits"),
        ),
        (
            *_tests("onboard/planning", "certifier", "rest_certifier", "moving_keep_outs"),
            *_tests("onboard/guidance/dense", "limits", "way_to_rest", "shield"),
        ),
    ),
}


@dataclass
class Tally:
    """Counts what became of the mutants of one part.

    Attributes:
        reasons: why a mutant cannot be noticed, by its key.
    """

    reasons: dict[tuple[str, str, str], str]
    tried: int = 0
    noticed: int = 0
    explained: int = 0
    survivors: list[Mutant] = field(default_factory=list)

    def judge(self, mutant: Mutant, noticed: bool, count: int) -> None:
        """Take note of a verdict, after so many tests were chosen for it."""
        self.tried += 1
        if noticed:
            self.noticed += 1
        elif mutant.key in self.reasons:
            self.explained += 1
        else:
            self.survivors.append(mutant)
            which = f"in {mutant.function}" if mutant.function else "at import"
            sys.stderr.write(f"survived {count} tests: {mutant} ({which})\n")
            sys.stderr.flush()

    @property
    def score(self) -> float:
        """Share noticed of those that can be."""
        possible = self.tried - self.explained
        return self.noticed / possible if possible else 1.0


def stated_reasons() -> dict[tuple[str, str, str], str]:
    """Return why some mutants cannot be noticed, by file, function and change."""
    stated = yaml.safe_load(SURVIVORS.read_text(encoding="utf-8")) or []
    return {(each["file"], each["function"], each["change"]): each["reason"] for each in stated}


def drawn(part: Part, share: float, seed: int) -> list[Mutant]:
    """Return the mutants of a part, or a sample of them in the order of the files."""
    found = [m for path in part.files for m in mutants_of(path, (ROOT / path).read_text("utf-8"))]
    chosen = random.Random(seed).sample(range(len(found)), round(share * len(found)))
    return [found[number] for number in sorted(chosen)]


def run(name: str, options: argparse.Namespace) -> Tally:
    """Try the mutants of a part."""
    part = PARTS[name]
    mutants = drawn(part, options.share, options.seed)
    if options.file:
        mutants = [mutant for mutant in mutants if options.file in mutant.path]
    tally = Tally(stated_reasons())
    trials = Trials(mutants, options.jobs, options.budget, tally.judge)
    code = pytest.main([*OPTIONS, *part.tests], plugins=[trials])
    if code != pytest.ExitCode.OK:
        sys.exit(f"{name}: pytest ended with {code}")
    return tally


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--file", help="only files whose path contains this")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of the mutants; default: all")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--budget", type=float, default=20.0, metavar="S", help="of one mutant")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.parts if name not in PARTS]:
        parser.error(f"unknown part '{unknown[0]}': one of {', '.join(PARTS)}")
    enough = True
    for name in options.parts or PARTS:
        tally = run(name, options)
        enough &= tally.score >= SCORE_MIN
        print(
            f"{name}: {tally.noticed} of {tally.tried} mutants noticed, {tally.explained} cannot"
            f" be, {len(tally.survivors)} survive: {100.0 * tally.score:.1f} %",
            flush=True,
        )
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
