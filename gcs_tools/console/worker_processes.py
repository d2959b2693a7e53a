"""Runs one function over many jobs, in this process or in several.

Only a few jobs are queued at a time, so that memory does not grow with their number.  Results
arrive in any order.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context, parent_process
from typing import Any, Final, TypeVar

from gcs_tools.console.errors import CommandError

Result = TypeVar("Result")

# Queued jobs per worker: enough that none is ever idle.
WAITING_PER_WORKER: Final = 4


def in_processes(
    work: Callable[..., Result], jobs: Iterable[tuple[Any, ...]], processes: int
) -> Iterator[Result]:
    """Yield the result of each job as one of ``processes`` finishes it.

    Args:
        work: a function of a module, which other processes can import.
        jobs: arguments of one call each.
        processes: 1 runs the jobs in this process, in order.

    Raises:
        CommandError: a process died.
    """
    if processes == 1:
        for job in jobs:
            yield work(*job)
        return
    remaining = iter(jobs)
    # A forked interpreter would inherit locks of threads that it does not have.
    spawn = get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=spawn, initializer=_end_with_parent) as pool:
        waiting = {
            pool.submit(work, *job) for job in islice(remaining, processes * WAITING_PER_WORKER)
        }
        try:
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                waiting |= {pool.submit(work, *job) for job in islice(remaining, len(done))}
                for future in done:
                    yield future.result()
        except BrokenProcessPool as error:
            raise CommandError(
                "a worker process died: repeat the command to continue from here"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _end_with_parent() -> None:
    """End this worker when the command's process ends, even if that was killed."""

    def wait_for_it() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()
