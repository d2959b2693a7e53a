"""A terminal for a command to write to, and what a person would have read there."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_WIDTH = 80


class Terminal:
    """A pseudo-terminal.

    Attributes:
        written_to: descriptor for the command's output.
    """

    def __init__(self) -> None:
        self._ours, self.written_to = pty.openpty()
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", 40, _WIDTH, 0, 0))
        self._data = b""
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        # Linux ends a terminal without a writer with an error.
        while True:
            try:
                data = os.read(self._ours, 1 << 16)
            except OSError:
                return
            self._data += data

    def close(self) -> None:
        """Wait for the last of what was written; the command has ended."""
        os.close(self.written_to)
        self._thread.join(timeout=60.0)
        os.close(self._ours)

    @property
    def lines(self) -> list[str]:
        """Every line that was to be read, also those written over later."""
        text = _ESCAPE.sub("", self._data.decode())
        return [line.strip() for line in re.split(r"[\r\n]+", text) if line.strip()]

    @property
    def shares(self) -> list[int]:
        """The percentages that were to be read, one after the other."""
        return [int(found[1]) for line in self.lines if (found := re.search(r"(\d+)%", line))]

    @property
    def estimates(self) -> list[str]:
        """The estimates of the time left, as far as there were any."""
        return re.findall(r"left (\d:\d\d:\d\d)", "\n".join(self.lines))


@contextmanager
def terminal() -> Iterator[Terminal]:
    """Open a terminal, and close it once the command has ended."""
    opened = Terminal()
    try:
        yield opened
    finally:
        opened.close()
