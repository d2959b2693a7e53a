"""Writes logs in a thread of its own: a slow disk must not delay a tick, nor a full one end it."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

log = logging.getLogger(__name__)

# Some ten seconds of flight; a disk that is slower than that loses lines, never ticks.
CAPACITY: Final = 4096

Job = Callable[[], None]


class LogGuard:
    """Does jobs until one fails with OSError: that ends the log, not the flight.

    Attributes:
        failure: why it ended; None as long as it goes on.
    """

    def __init__(self) -> None:
        self.failure: str | None = None

    def do(self, job: Job) -> None:
        """Do a job, unless the log has ended."""
        if self.failure is not None:
            return
        try:
            job()
        except OSError as error:
            self.failure = str(error)


class LogThread:
    """Does jobs one after the other, in the order in which they came, until one fails.

    Args:
        capacity: how many jobs may wait; what comes while they do is dropped and counted.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.dropped = 0
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._capacity = capacity
        self._guard = LogGuard()
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def failure(self) -> str | None:
        """Why the log has ended; None as long as it goes on."""
        return self._guard.failure

    def submit(self, job: Job) -> None:
        """Have a job done soon; never waits."""
        if self._jobs.qsize() < self._capacity:
            self._jobs.put(job)
        else:
            self.dropped += 1
            if self.dropped == 1:
                log.warning("the disk is too slow: dropping log lines")

    def close(self) -> None:
        """Wait until everything submitted is done."""
        self._jobs.put(None)
        self._thread.join()
        if self.dropped:
            log.warning("log lines dropped: %d", self.dropped)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            going_on = self.failure is None
            self._guard.do(job)
            if going_on and self.failure is not None:
                log.error("the flight log ends here: %s", self.failure)
