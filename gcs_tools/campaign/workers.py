"""Runs the flights of a campaign: in this process, in several, or on a Dask cluster.

A cluster queues only a few flights at a time, so that memory does not grow with the campaign.
Results arrive in any order; each depends on its own job alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final, NamedTuple

from gcs_tools.campaign.flight import FlightRow, fly_numbered
from gcs_tools.campaign.sources import Source
from gcs_tools.console.errors import CommandError
from gcs_tools.console.worker_pool import run_locally

# Queued flights per worker: enough that none is ever idle.
_WAITING_PER_WORKER: Final = 4
_CONNECT_TIMEOUT_S: Final = 20.0


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
