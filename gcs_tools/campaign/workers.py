"""Where the flights of a campaign are flown: in this process, in several, or on a Dask cluster.

Every pool takes flights one by one and keeps only a few of them waiting, so that memory does not
grow with the campaign.  Results arrive in any order; each is determined by its own numbers alone.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context, parent_process
from typing import Final, NamedTuple

from gcs_tools.campaign.flight import FlightRow, Source, fly_numbered
from gcs_tools.console.errors import CommandError

# Flights that wait for each worker: enough that none is ever idle.
_WAITING_PER_WORKER: Final = 4
_CONNECT_TIMEOUT_S: Final = 20.0


class Order(NamedTuple):
    """One flight to be flown."""

    source: Source
    campaign_seed: int
    number: int


def fly_locally(orders: Iterable[Order], jobs: int) -> Iterator[FlightRow]:
    """Yield the rows of all flights, as they are finished by ``jobs`` processes.

    Raises:
        CommandError: a process died.
    """
    if jobs == 1:
        for order in orders:
            yield fly_numbered(*order)
        return
    remaining = iter(orders)
    # Fresh interpreters: a forked one would inherit locks of threads that it does not have.
    spawn = get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_end_with_parent) as pool:
        waiting = {
            pool.submit(fly_numbered, *order)
            for order in islice(remaining, jobs * _WAITING_PER_WORKER)
        }
        try:
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                waiting |= {pool.submit(fly_numbered, *o) for o in islice(remaining, len(done))}
                for future in done:
                    yield future.result()
        except BrokenProcessPool as error:
            raise CommandError("a worker process died: start again to go on from here") from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _end_with_parent() -> None:
    """Have this worker end when the campaign does, even if that was killed and cannot say so."""

    def wait_for_it() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()


def fly_on_cluster(orders: Iterable[Order], address: str) -> Iterator[FlightRow]:
    """Yield the rows of all flights, as they are finished by the workers of a Dask cluster.

    The workers need this package; flights of a worker that dies are flown by the others.

    Raises:
        CommandError: there is no scheduler at the address, or flights keep killing workers.
    """
    # Dask takes a second to import, and most campaigns fly without it.
    from distributed import Client, as_completed  # noqa: PLC0415
    from distributed.scheduler import KilledWorker  # noqa: PLC0415

    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise CommandError(f"--dask {address}: no scheduler answers: {error}") from error
    with client:
        remaining = iter(orders)
        workers = max(1, sum(client.nthreads().values()))
        waiting = [
            client.submit(fly_numbered, *order, pure=False)
            for order in islice(remaining, workers * _WAITING_PER_WORKER)
        ]
        flying = as_completed(waiting, loop=client.loop)
        waiting.clear()  # a future that is held keeps its result on the cluster
        try:
            for future in flying:
                row = future.result()
                for order in islice(remaining, 1):
                    flying.add(client.submit(fly_numbered, *order, pure=False))
                yield row
        except KilledWorker as error:
            raise CommandError(f"--dask {address}: {error}") from error
