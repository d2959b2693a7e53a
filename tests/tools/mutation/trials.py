"""Runs the quickest tests of what a mutant changes, in a fork of a process that is warm.

The tests are collected once and measured (``measuring``).  For a mutant only those that reach its
statement run, the quickest first, until one fails.  A mutant that hangs counts as noticed: it is
ended when its tests have used several times the processor time that they use without it, so that a
busy machine changes no verdict.  One that only waits is ended much later and stays undecided.
"""

from __future__ import annotations

import ast
import enum
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import pytest

from tests.tools.mutation.injection import ChangedFile, Holders, Places, codes_of
from tests.tools.mutation.measuring import Measurements, Test, limit_own_use, passes
from tests.tools.mutation.mutants import Mutant, mutated

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "build" / "mutation"
OPTIONS = (
    *("-x", "-q", "--capture=sys", "-p", "no:cacheprovider", "--hypothesis-profile", "mutation"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is loaded beforehand
)
# Processor time of a mutant's tests: so many times what they take without it, and this much more,
# of which importing everything again takes the most.
_PATIENCE, _PATIENCE_S = 8.0, 30.0
_WAIT_MAX_S = 900.0
_NOTICED, _SURVIVED = 1, 0


class Verdict(enum.StrEnum):
    """What became of a mutant."""

    NOTICED = "noticed"
    SURVIVED = "survived"
    UNDECIDED = "undecided"


@dataclass
class Trials:
    """A pytest plugin that tries mutants in place of running the tests.

    Args:
        files: of the part.
        mutants: to try, in this order.
        jobs: so many at a time.
        budget_s: tests for one mutant may take so much processor time together, as without it.
        slowest_s: processor time that one test may take.
        judged: is called with each mutant, its verdict, and how many tests were chosen.
    """

    files: Sequence[str]
    mutants: Sequence[Mutant]
    jobs: int
    budget_s: float
    slowest_s: float
    judged: Callable[[Mutant, Verdict, int], None]
    tests: list[Test] = field(default_factory=list)
    _holders: Holders = field(default_factory=Holders)
    _codes: dict[str, Places] = field(default_factory=dict)
    _items: dict[str, pytest.Item] = field(default_factory=dict)
    _running: dict[int, tuple[Mutant, int, float]] = field(default_factory=dict)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Measure every test, then try every mutant."""
        self._items = {item.nodeid: item for item in session.items}
        names = {str(ROOT / path): path for path in self.files}
        gc.collect()
        self._holders = Holders.of(names)
        for name, path in names.items():
            self._codes[path] = codes_of(Path(name), ast.parse(Path(name).read_text("utf-8")))
        gc.freeze()
        self.tests = Measurements(FOLDER / "tests.pickle", names, self.slowest_s).of(session.items)
        try:
            self._try_all()
        finally:
            for child in self._running:
                os.killpg(child, signal.SIGKILL)
        return True

    def _try_all(self) -> None:
        for mutant in self.mutants:
            chosen = self._chosen(mutant)
            if not chosen:
                self.judged(mutant, Verdict.SURVIVED, 0)
                continue
            self._wait(self.jobs - 1)
            sys.stdout.flush()
            sys.stderr.flush()
            child = os.fork()
            if not child:
                self._try(mutant, chosen)
            self._running[child] = (mutant, len(chosen), time.monotonic() + _WAIT_MAX_S)
        self._wait(0)

    def _chosen(self, mutant: Mutant) -> list[Test]:
        """Return the tests that reach a mutant, the quickest first, as far as the budget goes."""
        reaching = [test for test in self.tests if test.reaches(mutant)]
        chosen: list[Test] = []
        total_s = 0.0
        for test in sorted(reaching, key=lambda test: test.took_s):
            total_s += test.took_s
            if chosen and total_s > self.budget_s:
                break
            chosen.append(test)
        return chosen

    def _try(self, mutant: Mutant, tests: Sequence[Test]) -> NoReturn:
        """Run tests against a mutant, in a fork, which ends with the answer."""
        noticed = True  # by an exception of the import, say
        try:
            os.setpgid(0, 0)
            limit_own_use(_PATIENCE * sum(test.took_s for test in tests) + _PATIENCE_S)
            noticed = self._is_noticed(mutant, [test.name for test in tests])
        finally:
            os._exit(_NOTICED if noticed else _SURVIVED)

    def _is_noticed(self, mutant: Mutant, names: Sequence[str]) -> bool:
        path = ROOT / mutant.path
        source = path.read_text(encoding="utf-8")
        after = mutated(source, mutant)
        if mutant.in_function and self._holders.exchange(path, self._codes[mutant.path], after):
            self._holders.clear_caches()
            return not all(passes(self._items[name]) for name in names)
        ChangedFile(path, ROOT, after).import_again()
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        return pytest.main([*OPTIONS, *names]) != pytest.ExitCode.OK

    def _wait(self, at_most: int) -> None:
        """Wait until no more than so many forks run; end those that only wait."""
        while len(self._running) > at_most:
            child, status = os.waitpid(-1, os.WNOHANG)
            if child in self._running:
                mutant, count, _ = self._running.pop(child)
                self.judged(mutant, _verdict(os.waitstatus_to_exitcode(status)), count)
                continue
            for each, (_, _, until_s) in self._running.items():
                if time.monotonic() > until_s:
                    os.killpg(each, signal.SIGTERM)
            time.sleep(0.002)


def _verdict(exit_code: int) -> Verdict:
    """Return what the end of a fork means."""
    if exit_code == -signal.SIGTERM:
        return Verdict.UNDECIDED
    return Verdict.SURVIVED if exit_code == _SURVIVED else Verdict.NOTICED
