"""How long each test takes, and which lines it reaches: each in a fork of its own.

What one test leaves in a module, another would not reach any more.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

import pytest
from _pytest.runner import runtestprotocol

from tests.tools.mutation.mutants import Mutant

# More than the tests of any part take together.
_MEMORY_MAX_B: Final = 6 << 30
_FAILED, _SUCCEEDED = 3, 0

Lines = dict[str, set[int]]


@dataclass(frozen=True)
class Test:
    """What one test reaches.

    Attributes:
        name: its node id.
        took_s: processor time that it took alone while traced, setting up included.
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


def limit_own_use(processor_s: float) -> None:
    """End this process when it has used so much processor time; refuse it memory without end."""
    limit_s = round(processor_s + 0.5)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_MAX_B, _MEMORY_MAX_B))


def passes(item: pytest.Item, tracer: Callable[..., Any] | None = None) -> bool:
    """Run a test; tell whether it passes."""
    sys.settrace(tracer)
    try:
        reports = runtestprotocol(item, log=False, nextitem=None)
    finally:
        sys.settrace(None)
    return not any(report.failed for report in reports)


class Measurements:
    """What tests reach, kept in a file as it is measured.

    Args:
        file: of earlier measurements; created with the first.
        names: the files that matter: absolute to in the repository.
        slowest_s: processor time that a test may take.
    """

    def __init__(self, file: Path, names: dict[str, str], slowest_s: float) -> None:
        self._file, self._names, self._slowest_s = file, names, slowest_s
        self._known: dict[str, Test | None] = {}
        if file.exists():
            with file.open("rb") as stream:
                while stream.peek(1):
                    self._known.update(pickle.load(stream))  # noqa: S301  written by ourselves

    def of(self, items: Sequence[pytest.Item]) -> list[Test]:
        """Return what tests reach, without those that are too slow for mutants.

        Raises:
            SystemExit: a test fails without any mutation.
        """
        found = [self._of(item) for item in items]
        quick = [test for test in found if test is not None]
        limit = f"at most {self._slowest_s:g} s"
        print(f"{len(quick)} of {len(items)} tests take {limit}", file=sys.stderr, flush=True)
        return quick

    def _of(self, item: pytest.Item) -> Test | None:
        changing = sorted({*self._names, str(item.path)})
        parts = (*(Path(path).read_bytes() for path in changing), str(self._slowest_s).encode())
        digest = hashlib.sha256(b"".join(parts)).hexdigest()
        key = f"{item.nodeid} {digest}"
        if key not in self._known:
            self._known[key] = _in_fork(item, self._names, self._slowest_s)
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("ab") as stream:
                pickle.dump({key: self._known[key]}, stream)
        return self._known[key]


def _in_fork(item: pytest.Item, names: dict[str, str], slowest_s: float) -> Test | None:
    receiving, sending = os.pipe()
    child = os.fork()
    if not child:
        code = _FAILED
        try:
            limit_own_use(slowest_s)
            lines: Lines = {}
            if passes(item, _tracer(names, lines)):
                with os.fdopen(sending, "wb") as stream:
                    pickle.dump(Test(item.nodeid, time.process_time(), lines), stream)
                code = _SUCCEEDED
        finally:
            os._exit(code)
    os.close(sending)
    with os.fdopen(receiving, "rb") as stream:
        received = stream.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code > 0:
        sys.exit(f"{item.nodeid} fails without any mutation")
    if code < 0:
        return None
    found: Test = pickle.loads(received)  # noqa: S301  written by our own fork
    return found


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
