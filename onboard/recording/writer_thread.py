"""Writes the log in a thread of its own, so that a slow or full disk does not delay a tick."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

log = logging.getLogger(__name__)

# About ten seconds of flight: a disk that stalls for longer loses lines of the log.
CAPACITY: Final = 4096

Job = Callable[[], None]


class StopOnFirstError:
    """Runs jobs until one raises OSError; later jobs are skipped, and the caller goes on.

    Attributes:
        failure: why it stopped; None while it runs jobs.
    """

    def __init__(self) -> None:
        self.failure: str | None = None

    def run(self, job: Job) -> None:
        """Run a job, unless an earlier one has failed."""
        if self.failure is not None:
            return
        try:
            job()
        except OSError as error:
            self.failure = str(error)


class LogThread:
    """Runs jobs one after the other, in the order of submission, until one fails.

    Args:
        capacity: how many jobs may wait; further ones are dropped and counted.

    Attributes:
        dropped: jobs that found no room.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.dropped = 0
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._capacity = capacity
        self._guard = StopOnFirstError()
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
        """Why the log has ended; None while it is written."""
        return self._guard.failure

    def submit(self, job: Job) -> None:
        """Queue a job, or drop it if too many wait; never blocks."""
        if self._jobs.qsize() < self._capacity:
            self._jobs.put(job)
        else:
            self.dropped += 1
            if self.dropped == 1:
                log.warning("the disk is too slow: dropping log lines")

    def close(self) -> None:
        """Wait until every queued job has run."""
        self._jobs.put(None)
        self._thread.join()
        if self.dropped:
            log.warning("log lines dropped: %d", self.dropped)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            running = self.failure is None
            self._guard.run(job)
            if running and self.failure is not None:
                log.error("the flight log ends here: %s", self.failure)
