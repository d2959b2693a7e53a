"""The search near the worst flights, without flying."""

from __future__ import annotations

import pytest

from gcs_tools.campaign import search
from gcs_tools.campaign.adversary.genes import SEARCHED, genes_text
from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.search import FLIGHTS_PER_SEARCH, SearchJob, search_jobs, searched
from gcs_tools.campaign.sources import AdversarySource
from tests.gcs_tools.campaign.rows import row


def margin_of(source: AdversarySource) -> float:
    """A margin that is least where one gene is 0.8, and does not exist beyond 0.95."""
    return (dict(source.moved)["across_0"] - 0.8) ** 2


@pytest.fixture
def flights(monkeypatch: pytest.MonkeyPatch) -> list[FlightRow]:
    flown: list[FlightRow] = []

    def fly(source: AdversarySource, campaign_seed: int, number: int) -> FlightRow:
        refused = dict(source.moved)["across_0"] > 0.95
        found = row(
            source=source.name,
            campaign_seed=campaign_seed,
            number=number,
            genes=genes_text(dict(source.moved)),
            least_margin_m=None if refused else margin_of(source),
        )
        flown.append(found)
        return found

    monkeypatch.setattr(search, "fly_numbered", fly)
    return flown


def test_the_flights_with_the_least_margins_are_searched() -> None:
    margins_m = (0.5, 0.1, None, 0.3)
    rows = [row(number=n, least_margin_m=margin) for n, margin in enumerate(margins_m)]
    rows.append(row(number=9, least_margin_m=0.0, genes="late=0.1000"))
    assert search_jobs(rows, FLIGHTS_PER_SEARCH + 5) == [
        SearchJob(1, 1, FLIGHTS_PER_SEARCH),
        SearchJob(1, 3, 5),
    ]
    assert search_jobs(rows, 0) == []


def test_a_search_comes_nearer_and_flies_what_it_was_given(flights: list[FlightRow]) -> None:
    rows = searched(3, 1, 96)
    assert rows == flights
    assert len(rows) == 96
    margins_m = [each.least_margin_m for each in rows if each.least_margin_m is not None]
    assert min(margins_m[-16:]) < 0.01
    assert all(each.genes.count("=") == len(SEARCHED) for each in rows)


def test_a_search_is_always_the_same(flights: list[FlightRow]) -> None:
    first = [each.genes for each in searched(3, 1, 12)]
    assert [each.genes for each in searched(3, 1, 12)] == first
    assert len(flights) == 24
