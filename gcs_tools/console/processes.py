"""Starts child programs and makes sure to stop them."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs_tools.console.errors import CommandError

# Signals from polite to forced, and how long to wait after each.
_STOP_SIGNALS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0))


class ProcessEndedError(CommandError):
    """A child program ended too early."""


@dataclass(frozen=True)
class _Child:
    name: str
    process: subprocess.Popen[bytes]
    log_path: Path


class Children:
    """Child programs that end with the ``with`` block around them.

    Each gets its own session: a Ctrl-C in the terminal reaches only us, and stopping the session
    stops the child's own children, too.
    """

    def __init__(self) -> None:
        self._children: list[_Child] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self, name: str, module: str, *arguments: str, log_path: Path) -> None:
        """Start ``python -m module``; what it prints goes to ``log_path``."""
        # -P: nothing in the operator's folder may take the place of our modules.
        command = [sys.executable, "-P", "-m", module, *arguments]
        with log_path.open("wb") as log:
            process = subprocess.Popen(  # noqa: S603  our own module, no shell
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._children.append(_Child(name, process, log_path))

    def check(self) -> None:
        """Check that every child is still running.

        Raises:
            ProcessEndedError: names the child, how it ended, and its last line of output.
        """
        for child in self._children:
            code = child.process.poll()
            if code is not None:
                raise ProcessEndedError(f"{child.name} ended ({_ending(code)}){_last_words(child)}")

    def stop(self) -> None:
        """Stop every running child, last started first."""
        while self._children:
            _stop(self._children.pop().process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    for number, patience_s in _STOP_SIGNALS:
        # The group outlives its leader while the leader's children run.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience_s)
            break
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _ending(code: int) -> str:
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name


def _last_words(child: _Child) -> str:
    lines = child.log_path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f": {lines[-1]}" if lines else ""


def free_ports(count: int) -> list[int]:
    """Return loopback ports that are free for both UDP and TCP.

    They are not reserved: another program may still take one before the caller opens it.
    """
    with contextlib.ExitStack() as stack:
        ports: list[int] = []
        while len(ports) < count:
            tcp = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            tcp.bind(("127.0.0.1", 0))
            port = tcp.getsockname()[1]
            udp = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            with contextlib.suppress(OSError):
                udp.bind(("127.0.0.1", port))
                ports.append(port)
        return ports
