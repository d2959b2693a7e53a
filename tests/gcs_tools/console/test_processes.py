"""What is started is stopped, whatever it does."""

from __future__ import annotations

import os
import signal
import socket
import time
from pathlib import Path

import pytest

from gcs_tools.console import processes
from gcs_tools.console.processes import Children, ProcessEndedError, free_ports
from tests.gcs_tools.running import is_alive, until

STUBBORN = """
import os, signal, subprocess, sys, time
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(os.getpid(), child.pid, flush=True)
time.sleep(600)
"""


@pytest.fixture
def stubborn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module that ignores polite signals and has a child of its own; returns its log."""
    (tmp_path / "stubborn_program.py").write_text(STUBBORN, encoding="utf-8")
    (tmp_path / "broken_program.py").write_text("raise SystemExit('no luck')", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    impatient = tuple((number, 0.2) for number, _ in processes._STOP_SIGNALS)
    monkeypatch.setattr(processes, "_STOP_SIGNALS", (*impatient[:-1], (signal.SIGKILL, 5.0)))
    return tmp_path / "program.log"


def check_until_it_raises(children: Children) -> None:
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        children.check()
        time.sleep(0.02)


def test_a_stubborn_program_and_its_child_are_stopped(stubborn: Path) -> None:
    with Children() as children:
        children.start("stubborn", "stubborn_program", log_path=stubborn)
        until(lambda: len(stubborn.read_text().split()) == 2)
        children.check()
        pids = [int(word) for word in stubborn.read_text().split()]
        assert all(is_alive(pid) for pid in pids)
    until(lambda: not any(is_alive(pid) for pid in pids))


def test_an_error_stops_everything_too(stubborn: Path) -> None:
    def fly() -> None:
        with Children() as children:
            children.start("stubborn", "stubborn_program", log_path=stubborn)
            until(lambda: len(stubborn.read_text().split()) == 2)
            raise RuntimeError("mishap")

    with pytest.raises(RuntimeError, match="mishap"):
        fly()
    pids = [int(word) for word in stubborn.read_text().split()]
    until(lambda: not any(is_alive(pid) for pid in pids))


def test_a_program_that_ended_is_named_with_its_last_words(stubborn: Path) -> None:
    with Children() as children:
        children.start("broken", "broken_program", log_path=stubborn)
        with pytest.raises(ProcessEndedError, match=r"broken ended \(exit code 1\): no luck"):
            check_until_it_raises(children)


def test_a_killed_program_is_named_with_the_signal(stubborn: Path) -> None:
    with Children() as children:
        children.start("stubborn", "stubborn_program", log_path=stubborn)
        until(lambda: len(stubborn.read_text().split()) == 2)
        os.kill(int(stubborn.read_text().split()[0]), signal.SIGKILL)
        with pytest.raises(ProcessEndedError, match=r"stubborn ended \(SIGKILL\)"):
            check_until_it_raises(children)


def test_free_ports_are_distinct_and_free() -> None:
    ports = free_ports(8)
    assert len(set(ports)) == 8
    for port in ports:
        for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
            with socket.socket(socket.AF_INET, kind) as probe:
                probe.bind(("127.0.0.1", port))


def test_waiting_gives_up() -> None:
    began_s = time.monotonic()
    with pytest.raises(AssertionError, match="did not happen"):
        until(lambda: False, timeout_s=0.1)
    assert time.monotonic() - began_s >= 0.1
