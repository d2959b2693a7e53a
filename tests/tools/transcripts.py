"""Run the commands of a documentation page: ``python -m tests.tools.transcripts [PAGE]``.

Every console block of the page is run by one shell, in a directory of its own that shows the
repository's files, and what its commands printed is written into the page.  What a block leaves
running is ended with it.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
_BLOCK: Final = re.compile(r"^```console\n(.*?)^```", re.MULTILINE | re.DOTALL)
_MARK: Final = "--- the next command"
_TIMEOUT_S: Final = 120.0
_ENDING_S: Final = 3.0


def typed(page: str) -> list[list[str]]:
    """Return the commands of each block of a page."""
    lines = (block.splitlines() for block in _BLOCK.findall(page))
    return [[line[2:] for line in block if line.startswith("$ ")] for block in lines]


def answers(commands: list[str], directory: Path, kept: list[str]) -> list[str]:
    """Return what each command printed.

    Args:
        commands: one to a line.
        directory: to run in.
        kept: ``export`` lines of earlier blocks.
    """
    lines = list(kept)
    for command in commands:
        quiet = " >/dev/null 2>&1" if command.endswith("&") else ""
        lines += [f"echo '{_MARK}'", command.removesuffix("&") + quiet + ("&" if quiet else "")]
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    shell = subprocess.Popen(
        ["bash"],  # noqa: S607  the user's own
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        cwd=directory, env=os.environ | {"PATH": path, "COLUMNS": "100"}, start_new_session=True,
    )  # fmt: skip
    try:
        printed, _ = shell.communicate("\n".join([*lines, ""]), timeout=_TIMEOUT_S)
    finally:
        with suppress(ProcessLookupError):  # no process is left
            os.killpg(shell.pid, signal.SIGTERM)
            time.sleep(_ENDING_S)
    return [each.strip("\n") for each in printed.split(_MARK)[1:]]


def with_answers(page: str, directory: Path) -> str:
    """Return the page with what its commands print now."""
    kept: list[str] = []
    written = iter(typed(page))

    def replaced(_: re.Match[str]) -> str:
        commands = next(written)
        printed = answers(commands, directory, kept)
        kept.extend(command for command in commands if command.startswith("export "))
        lines = []
        for command, answer in zip(commands, printed, strict=True):
            lines += [f"$ {command}", *(line.rstrip() for line in answer.splitlines())]
        return "\n".join(["```console", *lines, "```"])

    return _BLOCK.sub(replaced, page)


def main() -> None:
    """Rewrite a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path, nargs="?", default=ROOT / "docs" / "preflight.md")
    page: Path = parser.parse_args().page
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        (directory / "config").symlink_to(ROOT / "config")
        page.write_text(with_answers(page.read_text(encoding="utf-8"), directory), "utf-8")


if __name__ == "__main__":
    main()
