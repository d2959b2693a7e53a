"""Searches near the worst flights of an adversary for smaller margins, by CMA-ES.

Each search begins at one flight of the campaign and moves its field and timing, not its contract.
It depends on that flight alone, so that searches run in any order and in any process.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from gcs_tools.campaign.adversary.draw import adversary_genes
from gcs_tools.campaign.adversary.genes import DECIMALS, SEARCHED
from gcs_tools.campaign.flight import FlightRow, fly_numbered
from gcs_tools.campaign.sources import AdversarySource
from gcs_tools.console.worker_pool import run_locally

# Flights of one search: six generations.
FLIGHTS_PER_SEARCH: Final = 48
_POPULATION: Final = 8
_STEP: Final = 0.15
# What a field counts that may not be flown: more than any margin.
_REFUSED_M: Final = 100.0


class SearchJob(NamedTuple):
    """One search: arguments of `searched`."""

    campaign_seed: int
    number: int
    flights: int


def search_jobs(rows: Sequence[FlightRow], flights: int) -> list[SearchJob]:
    """Divide a number of flights among the flown flights with the least margins."""
    flown = [row for row in rows if row.least_margin_m is not None and not row.genes]
    worst = sorted(flown, key=lambda row: (row.least_margin_m or 0.0, row.number))
    jobs: list[SearchJob] = []
    for row in worst:
        share = min(flights - len(jobs) * FLIGHTS_PER_SEARCH, FLIGHTS_PER_SEARCH)
        if share <= 0:
            break
        jobs.append(SearchJob(row.campaign_seed, row.number, share))
    return jobs


def search_locally(jobs: Iterable[SearchJob], processes: int) -> Iterator[list[FlightRow]]:
    """Yield the flights of each search as one of ``processes`` finishes it."""
    return run_locally(searched, jobs, processes)


def searched(campaign_seed: int, number: int, flights: int) -> list[FlightRow]:
    """Search near one flight; return a row of each flight on the way.

    Args:
        campaign_seed: of the campaign.
        number: of the flight where the search begins.
        flights: to fly at most.
    """
    # The library takes half a second to import, and most campaigns do not search.
    import cma  # noqa: PLC0415  loads SciPy; only a search needs it

    begin = adversary_genes(campaign_seed, number)
    options = {
        "bounds": [0.0, 1.0],
        "popsize": _POPULATION,
        "seed": number + 1,
        "verbose": -9,
        "maxfevals": flights,
    }
    strategy = cma.CMAEvolutionStrategy([begin.value(name) for name in SEARCHED], _STEP, options)
    rows: list[FlightRow] = []
    while len(rows) < flights:
        candidates = strategy.ask()[: flights - len(rows)]
        generation = [_flown(campaign_seed, number, values) for values in candidates]
        rows += generation
        if len(candidates) < _POPULATION:
            break
        strategy.tell(candidates, [_cost_m(row) for row in generation])
    return rows


def _flown(campaign_seed: int, number: int, values: Sequence[float]) -> FlightRow:
    moved = tuple(
        (name, round(min(max(float(value), 0.0), 1.0), DECIMALS))
        for name, value in zip(SEARCHED, values, strict=True)
    )
    return fly_numbered(AdversarySource(moved), campaign_seed, number)


def _cost_m(row: FlightRow) -> float:
    return _REFUSED_M if row.least_margin_m is None else row.least_margin_m
