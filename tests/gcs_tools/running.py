"""What a command leaves behind, as the tests see it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

CONTRACTS = Path(__file__).parents[1] / "contracts"
CONFIG = Path(__file__).parents[2] / "config"


class Ran(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


Clearway = Callable[..., Ran]


def until(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    """Wait for something that happens in another process, which may have to start first."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "what was waited for did not happen"
        time.sleep(0.02)


def is_alive(pid: int) -> bool:
    """Tell whether a process runs; a zombie has stopped."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def children_of(pid: int) -> dict[str, int]:
    """Process ids of a process's children, by the name of the module that they run."""
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8")
    found = {}
    for child in map(int, listed.split()):
        command = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
        if "-m" in command:
            found[command[command.index("-m") + 1]] = child
    return found
