"""Runs the quickest tests of what a mutant changes, in a fork of a process that is warm.

The tests are collected once.  Each is then run alone, which says how long it takes and which lines
it reaches.  For a mutant only those that reach its statement run, the quickest first, until one
fails.
"""

from __future__ import annotations

import ast
import gc
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NoReturn

import pytest
from _pytest.runner import runtestprotocol

from tests.tools.mutation.injection import ChangedFile, clear_caches, exchange
from tests.tools.mutation.mutants import Mutant, mutated

ROOT = Path(__file__).parents[3]
OPTIONS = (
    *("-x", "-q", "--capture=sys", "-p", "no:cacheprovider", "--hypothesis-profile", "mutation"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is loaded beforehand
)
# A mutant counts as detected if its tests take this many times as long as without it, and more.
_PATIENCE, _PATIENCE_S = 8.0, 20.0
_NOTICED, _SURVIVED = 1, 0

Lines = dict[str, set[int]]


@dataclass(frozen=True)
class Test:
    """What one test reaches.

    Attributes:
        name: its node id.
        took_s: how long it took alone, setting up included.
        lines: by file, the lines that it reached.
    """

    __test__ = False

    name: str
    took_s: float
    lines: Lines

    def reaches(self, mutant: Mutant) -> bool:
        """Tell whether it runs the statement in which a mutant stands, or imports it."""
        first, last = mutant.lines
        reached = self.lines.get(mutant.path, set())
        if not mutant.in_function:
            return bool(reached)
        return any(first <= line <= last for line in reached)


@dataclass
class Trials:
    """A pytest plugin that tries mutants in place of running the tests.

    Args:
        mutants: to try, in this order.
        jobs: so many at a time.
        budget_s: tests for one mutant may take so long together, as without it.
        judged: is called with each mutant, whether it was noticed, and how many tests were chosen.
    """

    mutants: Sequence[Mutant]
    jobs: int
    budget_s: float
    judged: Callable[[Mutant, bool, int], None]
    tests: dict[str, Test] = field(default_factory=dict)
    _items: dict[str, pytest.Item] = field(default_factory=dict)
    _running: dict[int, tuple[Mutant, int, float]] = field(default_factory=dict)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Measure every test, then try every mutant."""
        self._items = {item.nodeid: item for item in session.items}
        paths = {mutant.path for mutant in self.mutants}
        gc.collect()
        gc.freeze()
        names = {str(ROOT / path): path for path in paths}
        for item in session.items:
            # A fork each: what one test leaves in a module, another would not reach any more.
            self.tests[item.nodeid] = _in_fork(partial(_measured, item, names))
        for mutant in self.mutants:
            chosen = self._chosen(mutant)
            if not chosen:
                self.judged(mutant, False, 0)
                continue
            self._wait(self.jobs - 1)
            limit_s = _PATIENCE * sum(test.took_s for test in chosen) + _PATIENCE_S
            sys.stdout.flush()
            child = os.fork()
            if not child:
                self._try(mutant, [test.name for test in chosen])
            self._running[child] = (mutant, len(chosen), time.monotonic() + limit_s)
        self._wait(0)
        return True

    def _chosen(self, mutant: Mutant) -> list[Test]:
        """Return the tests that reach a mutant, the quickest first, as far as the budget goes."""
        reaching = [test for test in self.tests.values() if test.reaches(mutant)]
        chosen: list[Test] = []
        total_s = 0.0
        for test in sorted(reaching, key=lambda test: test.took_s):
            total_s += test.took_s
            if chosen and total_s > self.budget_s:
                break
            chosen.append(test)
        return chosen

    def _try(self, mutant: Mutant, names: Sequence[str]) -> NoReturn:
        """Run tests against a mutant, in a fork, which ends with the answer."""
        noticed = True  # by an exception of the import, say
        try:
            os.setpgid(0, 0)
            noticed = self._is_noticed(mutant, names)
        finally:
            os._exit(_NOTICED if noticed else _SURVIVED)

    def _is_noticed(self, mutant: Mutant, names: Sequence[str]) -> bool:
        gc.unfreeze()  # what is frozen is not found
        path = ROOT / mutant.path
        source = path.read_text(encoding="utf-8")
        after = mutated(source, mutant)
        if mutant.in_function and exchange(path, ast.parse(source), after):
            clear_caches()
            return not all(_passes(self._items[name]) for name in names)
        ChangedFile(path, ROOT, after).import_again()
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        return pytest.main([*OPTIONS, *names]) != pytest.ExitCode.OK

    def _wait(self, at_most: int) -> None:
        """Wait until no more than so many forks run; end those that take too long."""
        while len(self._running) > at_most:
            child, status = os.waitpid(-1, os.WNOHANG)
            if child in self._running:
                mutant, count, _ = self._running.pop(child)
                self.judged(mutant, os.waitstatus_to_exitcode(status) != _SURVIVED, count)
                continue
            for each, (_, _, until_s) in self._running.items():
                if time.monotonic() > until_s:
                    os.killpg(each, signal.SIGKILL)
            time.sleep(0.002)


def _measured(item: pytest.Item, names: dict[str, str]) -> Test:
    """Run a test alone; return what it reaches in some files."""
    lines: Lines = {}
    began_s = time.perf_counter()
    if not _passes(item, _tracer(names, lines)):
        sys.exit(f"{item.nodeid} fails without any mutation")
    return Test(item.nodeid, time.perf_counter() - began_s, lines)


def _passes(item: pytest.Item, tracer: Callable[..., Any] | None = None) -> bool:
    sys.settrace(tracer)
    try:
        reports = runtestprotocol(item, log=False, nextitem=None)
    finally:
        sys.settrace(None)
    return not any(report.failed for report in reports)


def _tracer(names: dict[str, str], lines: Lines) -> Callable[..., Any]:
    """Return a trace function that notes the lines reached in some files."""
    reached: dict[CodeType, set[int] | None] = {}

    def of_call(frame: FrameType, _event: str, _argument: object) -> Callable[..., Any] | None:
        code = frame.f_code
        if code not in reached:
            path = names.get(code.co_filename)
            reached[code] = None if path is None else lines.setdefault(path, set())
        found = reached[code]
        if found is None:
            return None
        found.add(frame.f_lineno)

        def of_line(frame: FrameType, event: str, _argument: object) -> Callable[..., Any]:
            if event == "line":
                found.add(frame.f_lineno)
            return of_line

        return of_line

    return of_call


def _in_fork(work: Callable[[], Test]) -> Test:
    """Return what a fork finds, so that this process stays as it is."""
    receiving, sending = os.pipe()
    child = os.fork()
    if not child:
        try:
            with os.fdopen(sending, "wb") as stream:
                pickle.dump(work(), stream)
        except SystemExit as error:
            os.write(2, f"{error}\n".encode())
            os._exit(2)
        os._exit(0)
    os.close(sending)
    with os.fdopen(receiving, "rb") as stream:
        received = stream.read()
    _, status = os.waitpid(child, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        sys.exit("the tests fail without any mutation")
    found: Test = pickle.loads(received)  # noqa: S301  written by our own fork
    return found
