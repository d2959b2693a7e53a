"""Handles standard output that is closed, full, or cannot encode a character."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gcs_tools.console.errors import CommandError

# Exit code of a program that a closed pipe has ended; differs from yes (0) and no (1).
CLOSED_PIPE: Final = 128 + signal.SIGPIPE


class OutputError(CommandError):
    """Standard output, or a file that a command has opened, cannot be used."""


def with_output(run: Callable[[], int]) -> int:
    """Run a command, write all of its output, and return its exit code.

    Characters that standard output cannot encode become question marks.  If the reader of a pipe
    has gone, the exit code is `CLOSED_PIPE`.

    Raises:
        OutputError: the output cannot be written, for instance because it is full or closed.
    """
    _prepare()
    try:
        code = run()
        # At the interpreter's end an error would only change the exit code.
        sys.stdout.flush()
    except BrokenPipeError:
        _abandon_output()
        return CLOSED_PIPE
    except OSError as error:
        _abandon_output()
        where = error.filename or "standard output"
        raise OutputError(f"{where}: cannot be used: {error.strerror or error}") from error
    except SystemExit as ending:
        # argparse exits with 0 or 2; rich exits with 1 after writing to a closed pipe.
        if ending.code == 1:
            return CLOSED_PIPE
        _flush_or_abandon()
        raise
    except BaseException:
        _flush_or_abandon()
        raise
    return code


def _flush_or_abandon() -> None:
    try:
        sys.stdout.flush()
    except OSError:
        _abandon_output()


def _prepare() -> None:
    # Python sets them to None if the descriptor was closed before the start.
    if sys.stdout is None:
        sys.stdout = _ClosedOutput()
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  to the very end
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


class _ClosedOutput(io.TextIOBase):
    """Raises on every write, as a closed descriptor does."""

    def write(self, _: str) -> int:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))


def _abandon_output() -> None:
    """Discard what is still buffered; otherwise the interpreter reports an error at its end."""
    if sys.stdout is sys.__stdout__ and isinstance(sys.stdout, io.TextIOWrapper):
        with contextlib.suppress(OSError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)
            sys.stdout.flush()
