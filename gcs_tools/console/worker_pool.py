"""Does jobs in several processes, or in this one.

The pool queues only a few jobs at a time, so that memory does not grow with their number.  Results
arrive in any order; each depends on its own job alone.
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

# Queued jobs per worker: enough that none is ever idle.
_WAITING_PER_WORKER: Final = 4

_Result = TypeVar("_Result")


def run_locally(
    work: Callable[..., _Result], jobs: Iterable[tuple[Any, ...]], processes: int
) -> Iterator[_Result]:
    """Yield the result of each job as one of ``processes`` finishes it.

    Args:
        work: a module's function; its arguments are a job's items.
        jobs: any number; only a few are queued at a time.
        processes: with one, the jobs are done in this process.

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
            pool.submit(work, *job) for job in islice(remaining, processes * _WAITING_PER_WORKER)
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
    """End this worker when the campaign's process ends, even if that was killed."""

    def wait_for_it() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()
