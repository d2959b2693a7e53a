"""Mutate the contract's formulas: ``python -m tests.tools.mutation [--jobs N] [--file FILE]``.

Changes every arithmetic operator, comparison, constant, sign, factor, and choice between minimum
and maximum in the files, one at a time, and runs the unit tests, which must fail.  Prints the
mutants that survive and the score.  Not part of the continuous integration: it takes minutes.

Writes the mutants to a copy of the repository in a temporary directory, never to this one.
"""

from __future__ import annotations

import argparse
import ast
import copy
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_AGILITY, _CLAUSES, _CONTRACT, _DERIVATION, _RECENTRING, _REGION, _TERMS, _RUN_ON, _STOP = (
    f"tests/onboard/contract/test_{name}.py"
    for name in (
        *("agility", "clauses", "assessment", "derivation", "recentring", "region", "terms"),
        *("run_on", "stop_region"),
    )
)
_BY_HAND = (
    "test_lane_of_a_worked_example",
    "test_boundary_of_the_worked_example",
    "test_border_with_drift_by_hand",
    "test_the_region_lies_around_its_obstacle",
    "test_the_lane_covers_an_entry_beside_the_face_that_drifts_on",
    "test_slow_drift_costs_no_time_and_fast_drift_must_be_outrun",
)

# The tests that must detect a change to each file, the fastest first.
TESTS = {
    "onboard/contract/agility.py": (_AGILITY, _CONTRACT),
    "onboard/contract/arithmetic.py": (_AGILITY, _CONTRACT, _RECENTRING),
    "onboard/contract/clauses.py": (_CLAUSES, _CONTRACT, _STOP, _RECENTRING),
    "onboard/contract/assessment.py": (_CONTRACT, _STOP, _RECENTRING),
    "onboard/contract/derivation.py": (_DERIVATION, _STOP, _CONTRACT, _RECENTRING),
    "onboard/contract/terms.py": (_TERMS, _CONTRACT, _RECENTRING),
    "onboard/contract/recentring.py": (_RECENTRING,),
    "onboard/contract/run_on.py": (_RUN_ON, _STOP),
    "onboard/contract/stop_region.py": (_STOP,),
    "onboard/contract/region.py": (
        *(f"{_REGION}::{name}" for name in _BY_HAND),
        *(_REGION, _RECENTRING, _CONTRACT, _STOP),
    ),
}

OPTIONS = (
    *("-x", "-q", "-p", "no:cacheprovider", "--hypothesis-profile", "mutation"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is loaded beforehand
)

# A mutant that loops without end counts as detected.
TIME_LIMIT_S = 300

_OPERATORS: dict[type[ast.operator], tuple[type[ast.operator], ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_OPPOSITES = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min"}


@dataclass(frozen=True)
class Mutant:
    """One change to one file.

    Attributes:
        path: of the file, in the repository.
        line: where.
        change: what, in words.
        source: the whole changed file.
    """

    path: str
    line: int
    change: str
    source: str


def mutants_of(path: str, source: str) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    tree = ast.parse(source)
    # frozen=True and the like are not formulas.
    decorators = [d for node in ast.walk(tree) for d in getattr(node, "decorator_list", ())]
    exempt = {id(part) for decorator in decorators for part in ast.walk(decorator)}
    for number, node in enumerate(ast.walk(tree)):
        if id(node) in exempt:
            continue
        for replacement, change in _replacements(node):
            changed = copy.deepcopy(tree)
            target = list(ast.walk(changed))[number]
            _Replace(target, replacement).visit(changed)
            line = getattr(node, "lineno", 0)
            yield Mutant(path, line, change, ast.unparse(ast.fix_missing_locations(changed)))


class _Replace(ast.NodeTransformer):
    """Replaces one node, by identity."""

    def __init__(self, target: ast.AST, replacement: ast.AST) -> None:
        self._target, self._replacement = target, replacement

    def visit(self, node: ast.AST) -> ast.AST:
        """Replace the node, or look for it below."""
        return self._replacement if node is self._target else super().visit(node)


def _replacements(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield replacements of a node, each with its description."""
    match node:
        case ast.BinOp(left=left, op=operator, right=right):
            for other in _OPERATORS.get(type(operator), ()):
                yield ast.BinOp(left, other(), right), f"{_text(node)}: {other.__name__}"
                yield left, f"{_text(node)}: only the left"
                yield right, f"{_text(node)}: only the right"
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            yield operand, f"{_text(node)}: without its sign"
        case ast.Compare() | ast.BoolOp():
            yield from _other_conditions(node)
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value), f"{value}: negated"
        case ast.Constant(value=float() as value):
            yield ast.Constant(value + 1.0), f"{value}: one more"
        case ast.Call():
            yield from _other_calls(node)


def _other_conditions(node: ast.Compare | ast.BoolOp) -> Iterator[tuple[ast.AST, str]]:
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            for other in _COMPARISONS.get(type(operator), ()):
                yield ast.Compare(left, [other()], [right]), f"{_text(node)}: {other.__name__}"
        case ast.BoolOp(op=ast.And(), values=values):
            yield ast.BoolOp(ast.Or(), values), f"{_text(node)}: or"
        case ast.BoolOp(op=ast.Or(), values=values):
            yield ast.BoolOp(ast.And(), values), f"{_text(node)}: and"


def _other_calls(node: ast.Call) -> Iterator[tuple[ast.AST, str]]:
    name = _text(node.func).removeprefix("ops.")
    choices = {"where": node.args[1:], "sqrt": node.args, "tan": node.args}
    if name in _OPPOSITES:
        choices[name] = [argument for argument in node.args if _text(node.func) != name]
    for argument in choices.get(name, ()):
        yield argument, f"{_text(node)}: only {_text(argument)}"
    if name in _OPPOSITES and not node.keywords and _text(node.func) == name:
        yield ast.Call(ast.Name(_OPPOSITES[name]), node.args, []), f"{_text(node)}: opposite"


def _text(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())


def is_noticed(mutant: Mutant) -> bool:
    """Run the tests against a mutant, in a copy of what they need; for a process of its own."""
    with tempfile.TemporaryDirectory() as directory:
        for name in ("onboard", "tests/onboard", "config"):
            ignore = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, Path(directory) / name, ignore=ignore)
        for name in ("pyproject.toml", "tests/conftest.py"):
            shutil.copy(ROOT / name, Path(directory) / name)
        (Path(directory) / mutant.path).write_text(mutant.source, encoding="utf-8")
        os.chdir(directory)
        sys.path.insert(0, directory)
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        signal.signal(signal.SIGALRM, _give_up)
        signal.alarm(TIME_LIMIT_S)
        try:
            return pytest.main([*OPTIONS, *TESTS[mutant.path]]) != pytest.ExitCode.OK
        except TimeoutError:
            return True
        finally:
            signal.alarm(0)
            os.chdir(ROOT)


def _give_up(_signal: int, _frame: object) -> None:
    raise TimeoutError


def run(files: list[str], jobs: int) -> int:
    """Try every mutant of the files; return how many survive."""
    mutants = [m for path in files for m in mutants_of(path, (ROOT / path).read_text("utf-8"))]
    unchanged = Mutant(files[0], 0, "unchanged", (ROOT / files[0]).read_text("utf-8"))
    # A fresh process for each, forked from one that has the large libraries but none of our code.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["hypothesis", "numpy", "pydantic", "pytest", "yaml"])
    survivors = 0
    with context.Pool(jobs, maxtasksperchild=1) as pool:
        if pool.apply(is_noticed, (unchanged,)):
            sys.exit("the tests fail without any mutation")
        tried = pool.imap(is_noticed, mutants, chunksize=1)
        for number, (mutant, noticed) in enumerate(zip(mutants, tried, strict=True), start=1):
            sys.stderr.write(f"\r{number} of {len(mutants)}")
            if not noticed:
                survivors += 1
                print(f"\rsurvived: {mutant.path}:{mutant.line}: {mutant.change}", flush=True)
    killed = len(mutants) - survivors
    print(f"\r{killed} of {len(mutants)} mutants detected: {100.0 * killed / len(mutants):.1f} %")
    return survivors


def main() -> int:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--file", action="append", choices=list(TESTS), help="default: all")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    return 1 if run(options.file or list(TESTS), options.jobs) else 0


if __name__ == "__main__":
    sys.exit(main())
