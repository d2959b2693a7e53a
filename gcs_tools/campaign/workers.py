"""Runs the flights of a campaign: in this process, in several, or on a Dask cluster.

Each pool queues only a few flights at a time, so that memory does not grow with the campaign.
Results arrive in any order; each depends on its own job alone.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context, parent_process
from typing import Any, Final, NamedTuple, TypeVar

from gcs_tools.campaign.flight import FlightRow, fly_numbered
from gcs_tools.campaign.sources import Source
from gcs_tools.console.errors import CommandError

# Queued flights per worker: enough that none is ever idle.
_WAITING_PER_WORKER: Final = 4
_CONNECT_TIMEOUT_S: Final = 20.0

_Result = TypeVar("_Result")


class FlightJob(NamedTuple):
    """One flight to fly: arguments of `fly_numbered`."""

    source: Source
    campaign_seed: int
    number: int


def fly_locally(jobs: Iterable[FlightJob], processes: int) -> Iterator[FlightRow]:
    """Yield the row of each flight as one of ``processes`` finishes it.

    Raises:
        CommandError: a process died.
    """
    return run_locally(fly_numbered, jobs, processes)


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


def fly_on_cluster(jobs: Iterable[FlightJob], address: str) -> Iterator[FlightRow]:
    """Yield the row of each flight as a worker of a Dask cluster finishes it.

    The workers need this package installed; the others repeat the flights of a worker that dies.

    Raises:
        CommandError: no scheduler answers at the address, or flights keep killing workers.
    """
    # Dask takes a second to import, and most campaigns fly without it.
    from distributed import Client, as_completed  # noqa: PLC0415
    from distributed.scheduler import KilledWorker  # noqa: PLC0415

    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise CommandError(f"--dask {address}: no scheduler answers: {error}") from error
    with client:
        remaining = iter(jobs)
        workers = max(1, sum(client.nthreads().values()))
        waiting = [
            client.submit(fly_numbered, *job, pure=False)
            for job in islice(remaining, workers * _WAITING_PER_WORKER)
        ]
        flying = as_completed(waiting, loop=client.loop)
        waiting.clear()  # the cluster keeps the result of a future as long as we refer to it
        try:
            for future in flying:
                row = future.result()
                for job in islice(remaining, 1):
                    flying.add(client.submit(fly_numbered, *job, pure=False))
                yield row
        except KilledWorker as error:
            raise CommandError(f"--dask {address}: {error}") from error
