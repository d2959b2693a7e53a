"""Writes messages in a thread of its own, so that a stopped terminal does not stop a tick."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from typing import Final, TextIO

# Messages that may wait to be written; further ones are dropped and counted.
CAPACITY: Final = 1000
# How long the end of the process waits for the last of them.
FLUSH_S: Final = 1.0


class MessageThread(logging.Handler):
    """Formats messages at once and writes them when the stream takes them.

    Args:
        stream: where lines go; they are lost if it is closed.
        capacity: how many lines may wait.

    Attributes:
        dropped: lines dropped because too many were waiting.
    """

    def __init__(self, stream: TextIO, capacity: int = CAPACITY) -> None:
        super().__init__()
        self.dropped = 0
        self._stream = stream
        self._waiting: queue.Queue[str | threading.Event] = queue.Queue(capacity)
        threading.Thread(target=self._work, name="messages", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a message; never waits."""
        try:
            self._waiting.put_nowait(self.format(record) + "\n")
        except queue.Full:
            self.dropped += 1

    def flush(self) -> None:
        """Wait until everything queued is written, at most `FLUSH_S`."""
        done = threading.Event()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(done)
            done.wait(FLUSH_S)

    def _work(self) -> None:
        reported = 0
        while True:
            item = self._waiting.get()
            if isinstance(item, threading.Event):
                item.set()
                continue
            if self.dropped > reported:
                item += f"{self.dropped - reported} messages were dropped here\n"
                reported = self.dropped
            # The terminal or the pipe may be gone; the flight goes on.
            with contextlib.suppress(OSError, ValueError):
                self._stream.write(item)
                self._stream.flush()
